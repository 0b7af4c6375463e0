//! One session with a server, from connecting to its loss: endpoint, login, nodes, units, subscription or reading.
//!
//! Place in the flow: run by the thread of [`crate::client`], again and again.

use crate::client::{Asks, Check, Event, Found, LOOK_UP, NodeValue, Security, Settings, Shared, Values};
use crate::cnc::{self, Position};
use crate::node::{self, AxisName, NodeName, Place};
use crate::units::ServerUnit;
use futures::StreamExt;
use opcua::client::UARequest;
use opcua::client::services::Read;
use opcua::client::{
    ClientBuilder, IdentityToken, MonitoredItemMap, OnSubscriptionNotificationCore, Password, Session,
    SessionPollResult,
};
use opcua::crypto::SecurityPolicy;
use opcua::types::{
    AttributeId, BrowsePath, DataChangeFilter, DataChangeNotification, DataChangeTrigger, DataValue, DateTime,
    EUInformation, EndpointDescription, Error, ExtensionObject, MessageSecurityMode, MonitoredItemCreateRequest,
    MonitoringMode, MonitoringParameters, NodeId, NotificationMessage, QualifiedName, ReadValueId, ReferenceTypeId,
    RelativePath, RelativePathElement, StatusChangeNotification, StatusCode, TimestampsToReturn, UAString,
    UserTokenType, VariableId, Variant,
};
use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tracing::dispatcher::{Dispatch, with_default};
use tracing::subscriber::NoSubscriber;

/// Longest time in which a session begins.
const BEGIN_WITHIN: Duration = Duration::from_secs(20);
/// Longest time for an end in peace.
const END_WITHIN: Duration = Duration::from_secs(1);
/// Values of a node that the server keeps until they are told.
const KEPT: u32 = 1000;
/// Values of one message at most, and bytes: what waits for a client that was away for a moment.
const LONGEST_MESSAGE: (usize, usize) = (100_000, 16 << 20);
/// How many messages without news belong to a silence.
const SIGNS_OF_LIFE: f64 = 3.0;
/// Ticks of 100 ns from 1601 to 1970.
const TICKS_1601_TO_1970: i64 = 116_444_736_000_000_000;
/// The private key in the folder of certificates.
const PRIVATE_KEY: &str = "private/private.pem";
/// Names of the application, as its certificate has them.
const APPLICATION: (&str, &str) = ("Abbe", "urn:abbe:opcua-client");

/// Why a session has ended.
pub(crate) enum Stop {
    /// Nobody wants it any more.
    Gone,
    /// It was lost, and why.
    Lost(String),
}

impl From<Error> for Stop {
    fn from(error: Error) -> Stop {
        Stop::Lost(error.to_string())
    }
}

impl Security {
    fn policy(self) -> SecurityPolicy {
        match self {
            Security::None => SecurityPolicy::None,
            Security::Basic256Sha256 => SecurityPolicy::Basic256Sha256,
            Security::Aes128Sha256RsaOaep => SecurityPolicy::Aes128Sha256RsaOaep,
            Security::Aes256Sha256RsaPss => SecurityPolicy::Aes256Sha256RsaPss,
        }
    }
}

/// Keeps a session until it ends.
pub(crate) async fn run(settings: &Settings, check: &Check, shared: &Arc<Shared>) -> Stop {
    shared.begin();
    let keep = keep(settings, check, shared);
    tokio::select! {
        stop = keep => stop,
        // Nothing to take leave from: a session that has begun looks for itself.
        () = stopped_before_it_began(shared) => Stop::Gone,
    }
}

/// Waits until told to stop, and a second more in which a session may end in peace.
async fn stopped_before_it_began(shared: &Shared) {
    while !shared.is_stopped() {
        tokio::time::sleep(LOOK_UP).await;
    }
    tokio::time::sleep(2 * END_WITHIN).await;
}

async fn keep(settings: &Settings, check: &Check, shared: &Arc<Shared>) -> Stop {
    let begun = tokio::time::timeout(BEGIN_WITHIN, connect(settings));
    let (session, events) = match begun.await {
        Ok(Ok(begun)) => begun,
        Ok(Err(stop)) => return stop,
        Err(_) => return Stop::Lost("the server does not answer".to_owned()),
    };
    let mut events = std::pin::pin!(events);
    let work = work(settings, check, shared, &session);
    let stop = {
        let mut work = std::pin::pin!(work);
        loop {
            tokio::select! {
                stop = &mut work => break stop,
                event = events.next() => match event {
                    Some(Ok(SessionPollResult::ConnectionLost(status))) => return Stop::Lost(format!("the connection ended: {status}")),
                    Some(Ok(_)) => {}
                    Some(Err(error)) => return Stop::Lost(format!("no session: {error}")),
                    None => return Stop::Lost("the connection ended".to_owned()),
                },
            }
        }
    };
    let leave = async {
        let mut leave = std::pin::pin!(session.disconnect());
        loop {
            tokio::select! {
                _ = &mut leave => return,
                event = events.next() => if !matches!(event, Some(Ok(_))) { return },
            }
        }
    };
    // Who does not listen any more needs no leave.
    let _ = tokio::time::timeout(END_WITHIN, leave).await;
    stop
}

type Events = std::pin::Pin<Box<dyn futures::Stream<Item = Result<SessionPollResult, StatusCode>> + Send>>;

/// Chooses an endpoint as it was asked for; the session begins when its events are taken.
async fn connect(settings: &Settings) -> Result<(Arc<Session>, Events), Stop> {
    let builder = || {
        let request_timeout = settings.silent_after.clamp(Duration::from_secs(1), BEGIN_WITHIN);
        let every = match settings.asks {
            Asks::Subscribed(every) | Asks::Polled(every) => every,
        };
        ClientBuilder::new()
            .application_name(APPLICATION.0)
            .application_uri(APPLICATION.1)
            .product_uri(APPLICATION.1)
            .session_name("abbe")
            .create_sample_keypair(settings.certificates.is_some())
            .certificate_path("own/cert.der")
            .private_key_path(PRIVATE_KEY)
            // Without certificates there is nothing to write.
            .pki_dir(settings.certificates.clone().unwrap_or_else(|| PathBuf::from("/dev/null/none")))
            .trust_server_certs(false)
            .session_retry_limit(0)
            .recreate_subscriptions(false)
            .max_array_length(LONGEST_MESSAGE.0)
            .max_message_size(LONGEST_MESSAGE.1)
            .max_chunk_count(0)
            .request_timeout(request_timeout)
            .publish_timeout(2 * settings.silent_after + BEGIN_WITHIN)
            .min_publish_interval(every.max(Duration::from_millis(1)))
            .client()
    };
    let client = match settings.certificates {
        Some(_) => builder(),
        None => with_default(&Dispatch::new(NoSubscriber::default()), builder),
    };
    let mut client = client.map_err(|problems| Stop::Lost(problems.join("; ")))?;
    if let Some(folder) = &settings.certificates {
        keep_private(&folder.join(PRIVATE_KEY))?;
    }
    let endpoints = client.get_server_endpoints_from_url(settings.server.as_str()).await?;
    let mut endpoint = choose(settings, &endpoints).map_err(Stop::Lost)?;
    // The address by which it was reached: servers name themselves by names that nobody else knows.
    endpoint.endpoint_url = UAString::from(settings.server.as_str());
    let identity = match &settings.user {
        None => IdentityToken::Anonymous,
        Some(user) => IdentityToken::UserName(user.name.clone(), Password::new(user.password.clone())),
    };
    let (session, events) = client.connect_to_endpoint_directly(endpoint, identity)?;
    Ok((session, Box::pin(events.enter())))
}

/// The library makes the key readable for everybody; and says in its log alone that it could make none.
fn keep_private(key: &Path) -> Result<(), Stop> {
    let outcome = std::fs::set_permissions(key, Permissions::from_mode(0o600));
    outcome.map_err(|error| Stop::Lost(format!("{}: {error}; it must be there, or able to be made", key.display())))
}

/// The endpoint with this security, for this kind of user.
fn choose(settings: &Settings, endpoints: &[EndpointDescription]) -> Result<EndpointDescription, String> {
    let mode = match (settings.security, settings.signed_only) {
        (Security::None, _) => MessageSecurityMode::None,
        (_, true) => MessageSecurityMode::Sign,
        (_, false) => MessageSecurityMode::SignAndEncrypt,
    };
    let policy = settings.security.policy();
    let token = if settings.user.is_some() { UserTokenType::UserName } else { UserTokenType::Anonymous };
    let is_secure_enough =
        |end: &&EndpointDescription| end.security_policy_uri.as_ref() == policy.to_uri() && end.security_mode == mode;
    let takes_user =
        |end: &&EndpointDescription| end.user_identity_tokens.iter().flatten().any(|policy| policy.token_type == token);
    let offers: Vec<String> = endpoints.iter().map(words_of).collect();
    let offers = if offers.is_empty() { "nothing".to_owned() } else { offers.join(", ") };
    let mut fitting = endpoints.iter().filter(is_secure_enough).peekable();
    if fitting.peek().is_none() {
        return Err(format!("the server does not offer {policy} with {mode:?}; it offers {offers}"));
    }
    let who = if settings.user.is_some() { "a user name and password" } else { "anonymous clients" };
    fitting.find(takes_user).cloned().ok_or_else(|| format!("the server does not take {who} there; it offers {offers}"))
}

fn words_of(endpoint: &EndpointDescription) -> String {
    let uri = endpoint.security_policy_uri.as_ref();
    let policy = uri.rsplit_once('#').map_or(uri, |(_, name)| name);
    let tokens = endpoint.user_identity_tokens.iter().flatten().map(|policy| format!("{:?}", policy.token_type));
    format!("{policy} with {:?} for {}", endpoint.security_mode, tokens.collect::<Vec<_>>().join(" or "))
}

/// What is done in a session.
async fn work(settings: &Settings, check: &Check, shared: &Arc<Shared>, session: &Arc<Session>) -> Stop {
    let begun = tokio::time::timeout(BEGIN_WITHIN, async {
        session.wait_for_connection().await;
        let nodes = find(settings, session).await?;
        let found: Vec<Found> = nodes.iter().map(|(_, found)| found.clone()).collect();
        check(&found).map_err(Stop::Lost)?;
        shared.connected(found);
        let nodes: Vec<Option<NodeId>> =
            nodes.into_iter().map(|(id, found)| id.filter(|_| found.problem.is_none())).collect();
        if let Asks::Subscribed(every) = settings.asks {
            subscribe(settings, every, &nodes, shared, session).await?;
        }
        Ok(nodes)
    });
    let nodes = match begun.await {
        Ok(Ok(nodes)) => nodes,
        Ok(Err(stop)) => return stop,
        Err(_) => return Stop::Lost("the server does not answer".to_owned()),
    };
    shared.hear();
    let mut due = Instant::now();
    while !shared.is_stopped() {
        if let Some(why) = shared.trouble(settings.silent_after) {
            return Stop::Lost(why);
        }
        match settings.asks {
            Asks::Subscribed(_) => tokio::time::sleep(LOOK_UP).await,
            Asks::Polled(every) => {
                if let Err(stop) = ask(&nodes, shared, session).await {
                    return stop;
                }
                // What was missed is not made up for.
                due = (due + every).max(Instant::now());
                while Instant::now() < due && !shared.is_stopped() {
                    tokio::time::sleep(LOOK_UP.min(due.saturating_duration_since(Instant::now()))).await;
                }
            }
        }
    }
    Stop::Gone
}

pub(crate) fn value_of(node: &NodeId) -> ReadValueId {
    ReadValueId { node_id: node.clone(), attribute_id: AttributeId::Value as u32, ..ReadValueId::default() }
}

/// The nodes at this server, whether they are there, and their units.
async fn find(settings: &Settings, session: &Session) -> Result<Vec<(Option<NodeId>, Found)>, Stop> {
    let namespaces = value_of(&VariableId::Server_NamespaceArray.into());
    let answer = session.read(&[namespaces], TimestampsToReturn::Neither, 0.0).await?;
    let names: Vec<UAString> = match answer.first().and_then(|value| value.value.as_ref()) {
        Some(Variant::Array(array)) => array
            .values
            .iter()
            .map(|name| match name {
                Variant::String(name) => name.clone(),
                _ => UAString::null(),
            })
            .collect(),
        _ => Vec::new(),
    };
    let ids = places(settings, &names, session).await?;
    let known: Vec<&Position> = ids.iter().filter_map(|id| id.as_ref().ok()).collect();
    let questions: Vec<ReadValueId> = known.iter().map(|known| value_of(&known.value)).collect();
    let answers = session.read(&questions, TimestampsToReturn::Neither, 0.0).await?;
    let units = units_of(&known, session).await?;
    let (mut answers, mut units) = (answers.into_iter(), units.into_iter());
    Ok(ids
        .into_iter()
        .zip(&settings.nodes)
        .map(|(id, name)| match id {
            Err(problem) => (None, Found { unit: None, problem: Some(problem) }),
            Ok(Position { value, .. }) => {
                let status = answers.next().map_or(StatusCode::BadUnexpectedError, |answer| answer.status());
                let problem = is_no_node(status).then(|| format!("node {name}: {status}"));
                (Some(value), Found { unit: units.next().flatten(), problem })
            }
        })
        .collect())
}

/// Where the values are, and the units of those whose specification says where those are.
async fn places(
    settings: &Settings,
    namespaces: &[UAString],
    session: &Session,
) -> Result<Vec<Result<Position, String>>, Stop> {
    let axis = |node| match NodeName::place(node) {
        Place::Axis(axis) => Some(axis),
        Place::Node { .. } => None,
    };
    let axes: Vec<&AxisName> = settings.nodes.iter().filter_map(axis).collect();
    let mut positions = cnc::positions(&axes, namespaces, session).await?.into_iter();
    let place = |node: &NodeName| match node.place() {
        Place::Node { namespace, id } => {
            node::at(namespace.as_deref(), id, namespaces).map(|value| Position { value, unit: None })
        }
        Place::Axis(_) => {
            let found = positions.next().unwrap_or_else(|| Err("it was not looked for".to_owned()));
            found.map_err(|problem| format!("{node}: {problem}"))
        }
    };
    Ok(settings.nodes.iter().map(place).collect())
}

/// Whether a node with this status will have no values in this session.
fn is_no_node(status: StatusCode) -> bool {
    let never = [
        StatusCode::BadNodeIdUnknown,
        StatusCode::BadNodeIdInvalid,
        StatusCode::BadAttributeIdInvalid,
        StatusCode::BadUserAccessDenied,
        StatusCode::BadNotReadable,
        StatusCode::BadUnexpectedError,
    ];
    never.iter().any(|no| no.sub_code() == status.sub_code())
}

/// The property `EngineeringUnits` of each node that has one.
async fn units_of(nodes: &[&Position], session: &Session) -> Result<Vec<Option<ServerUnit>>, Stop> {
    let path = |node: &&Position| BrowsePath {
        starting_node: node.value.clone(),
        relative_path: RelativePath {
            elements: Some(vec![RelativePathElement {
                reference_type_id: ReferenceTypeId::HasProperty.into(),
                is_inverse: false,
                include_subtypes: true,
                target_name: QualifiedName::new(0, "EngineeringUnits"),
            }]),
        },
    };
    let paths: Vec<BrowsePath> = nodes.iter().map(path).collect();
    let found = match session.translate_browse_paths_to_node_ids(&paths).await {
        Ok(found) => found,
        // A small server that knows no paths names no units either.
        Err(error) if error.status() == StatusCode::BadServiceUnsupported => Vec::new(),
        Err(error) => return Err(error.into()),
    };
    let own = |place: usize| Some(found.get(place)?.targets.as_ref()?.first()?.target_id.node_id.clone());
    let property =
        |(place, node): (usize, &&Position)| Some((place, value_of(&node.unit.clone().or_else(|| own(place))?)));
    let properties: Vec<(usize, ReadValueId)> = nodes.iter().enumerate().filter_map(property).collect();
    let mut units = vec![None; nodes.len()];
    if properties.is_empty() {
        return Ok(units);
    }
    let questions: Vec<ReadValueId> = properties.iter().map(|(_, question)| question.clone()).collect();
    let answers = session.read(&questions, TimestampsToReturn::Neither, 0.0).await?;
    for ((place, _), answer) in properties.iter().zip(answers) {
        let told = match answer.value {
            Some(Variant::ExtensionObject(object)) => object.into_inner_as::<EUInformation>(),
            _ => None,
        };
        // One that is there and cannot be read is a unit that is not known.
        units[*place] = Some(told.map_or_else(unreadable, |unit| ServerUnit {
            namespace: unit.namespace_uri.as_ref().to_owned(),
            id: unit.unit_id,
            shown: unit.display_name.text.as_ref().to_owned(),
        }));
    }
    Ok(units)
}

fn unreadable() -> ServerUnit {
    ServerUnit { namespace: String::new(), id: 0, shown: "unreadable".to_owned() }
}

/// Asks the server to tell what changes.
async fn subscribe(
    settings: &Settings,
    every: Duration,
    nodes: &[Option<NodeId>],
    shared: &Arc<Shared>,
    session: &Session,
) -> Result<(), Stop> {
    let signs = settings.silent_after.as_secs_f64() / SIGNS_OF_LIFE / every.as_secs_f64();
    // A count of a subscription: from 1, and far from where times overflow.
    let keep_alive = signs.clamp(1.0, 1e6) as u32;
    let listener = Listener { shared: Arc::clone(shared), sequence: None };
    let id = session.create_subscription(every, keep_alive * 10, keep_alive, 0, 0, true, listener).await?;
    let item = |(place, node): (usize, &NodeId), has_filter: bool| {
        // A value that is the same with a new time is news: the axis was there at that instant, too.
        let filter = DataChangeFilter {
            trigger: DataChangeTrigger::StatusValueTimestamp,
            deadband_type: 0,
            deadband_value: 0.0,
        };
        let filter = if has_filter { ExtensionObject::from_message(filter) } else { ExtensionObject::null() };
        let parameters = MonitoringParameters {
            client_handle: place as u32 + 1,
            sampling_interval: every.as_secs_f64() * 1e3,
            filter,
            queue_size: KEPT,
            discard_oldest: true,
        };
        MonitoredItemCreateRequest::new(value_of(node), MonitoringMode::Reporting, parameters)
    };
    let wanted: Vec<(usize, &NodeId)> =
        nodes.iter().enumerate().filter_map(|(k, node)| Some((k, node.as_ref()?))).collect();
    let request = |has_filter| wanted.iter().map(|one| item(*one, has_filter)).collect::<Vec<_>>();
    let mut made = session.create_monitored_items(id, TimestampsToReturn::Both, request(true)).await?;
    let refuses = [StatusCode::BadMonitoredItemFilterUnsupported, StatusCode::BadFilterNotAllowed];
    if made.iter().any(|one| refuses.contains(&one.result.status_code)) {
        shared.give(Event::Told(
            "the server tells only values that change, and none that is the same at a later time".to_owned(),
        ));
        let good: Vec<u32> = made
            .iter()
            .filter(|one| one.result.status_code.is_good())
            .map(|one| one.result.monitored_item_id)
            .collect();
        if !good.is_empty() {
            session.delete_monitored_items(id, &good).await?;
        }
        made = session.create_monitored_items(id, TimestampsToReturn::Both, request(false)).await?;
    }
    for ((place, _), one) in wanted.iter().zip(&made) {
        let (name, status) = (&settings.nodes[*place], one.result.status_code);
        if !status.is_good() {
            return Err(Stop::Lost(format!("node {name} cannot be subscribed: {status}")));
        }
        let (asked_ms, revised_ms) = (every.as_secs_f64() * 1e3, one.result.revised_sampling_interval);
        if revised_ms > asked_ms * 1.001 {
            shared.give(Event::Told(format!(
                "the server looks at node {name} every {revised_ms} ms, not every {asked_ms} ms"
            )));
        }
    }
    Ok(())
}

/// Takes what the server tells unasked.
struct Listener {
    shared: Arc<Shared>,
    /// Number of the message that comes next.
    sequence: Option<u32>,
}

impl OnSubscriptionNotificationCore for Listener {
    fn on_subscription_notification(&mut self, message: NotificationMessage, _: MonitoredItemMap<'_>) {
        let arrived_ns = now_ns();
        self.shared.hear();
        let data = message.notification_data.unwrap_or_default();
        if self.sequence.is_some_and(|next| next != message.sequence_number) {
            self.shared.break_off(format!("messages were lost before number {}", message.sequence_number));
        }
        // One without news has the number of the next that has some; 0 is left out.
        let is_news = u32::from(!data.is_empty());
        self.sequence = Some(message.sequence_number.wrapping_add(is_news).max(1));
        let mut values = Vec::new();
        for part in data {
            if let Some(changes) = part.inner_as::<DataChangeNotification>() {
                values.extend(changes.monitored_items.iter().flatten().filter_map(|item| {
                    let node = usize::try_from(item.client_handle).ok()?.checked_sub(1)?;
                    Some(told(node, &item.value))
                }));
            } else if let Some(change) = part.inner_as::<StatusChangeNotification>() {
                self.shared.break_off(format!("the server ended the subscription: {}", change.status));
            }
        }
        let server_ns = ns_of(&message.publish_time);
        self.shared.give(Event::Values(Values { arrived_ns, server_ns, is_answer: false, values }));
    }
}

/// Reads all nodes at once.
async fn ask(nodes: &[Option<NodeId>], shared: &Shared, session: &Session) -> Result<(), Stop> {
    let wanted: Vec<(usize, &NodeId)> =
        nodes.iter().enumerate().filter_map(|(k, node)| Some((k, node.as_ref()?))).collect();
    let questions = wanted.iter().map(|(_, node)| value_of(node)).collect();
    let question =
        Read::new(session).nodes_to_read(questions).timestamps_to_return(TimestampsToReturn::Both).max_age(0.0);
    let answer = question.send(session.channel()).await?;
    let arrived_ns = now_ns();
    shared.hear();
    let server_ns = ns_of(&answer.response_header.timestamp);
    let results = answer.results.unwrap_or_default();
    if results.len() != wanted.len() {
        return Err(Stop::Lost(format!("{} values were asked for, and {} came", wanted.len(), results.len())));
    }
    let values = wanted.iter().zip(&results).map(|((node, _), value)| told(*node, value)).collect();
    shared.give(Event::Values(Values { arrived_ns, server_ns, is_answer: true, values }));
    Ok(())
}

/// A value as it is told; only a good number is one.
fn told(node: usize, told: &DataValue) -> NodeValue {
    let status = told.status();
    let value = match &told.value {
        _ if !status.is_good() => Err(format!("its status is {status}")),
        None => Err("it has no value".to_owned()),
        Some(value) => number(value).ok_or_else(|| "its value is no number".to_owned()),
    };
    let source_ns = told.source_timestamp.as_ref().and_then(ns_of);
    NodeValue { node, value, source_ns, is_after_loss: status.overflow() && status.is_good() }
}

fn number(value: &Variant) -> Option<f64> {
    let number = match *value {
        Variant::Double(value) => value,
        Variant::Float(value) => f64::from(value),
        Variant::SByte(value) => f64::from(value),
        Variant::Byte(value) => f64::from(value),
        Variant::Int16(value) => f64::from(value),
        Variant::UInt16(value) => f64::from(value),
        Variant::Int32(value) => f64::from(value),
        Variant::UInt32(value) => f64::from(value),
        // Counts beyond 2^53 lose their last digits: no count of a scale is as large.
        Variant::Int64(value) => value as f64,
        Variant::UInt64(value) => value as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

/// Nanoseconds since 1970; `None` of a time that means none, which any before 1970 does. No difference of two of them overflows.
fn ns_of(time: &DateTime) -> Option<i64> {
    if time.is_null() {
        return None;
    }
    let since_1970 = time.ticks().checked_sub(TICKS_1601_TO_1970)?.checked_mul(100)?;
    (since_1970 >= 0).then_some(since_1970)
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_good_number_is_a_value_and_its_time_is_the_sources() {
        let at = DateTime::ymd_hms(2023, 11, 14, 22, 13, 20);
        let good = told(3, &DataValue::new_at(1.5, at));
        let expected =
            NodeValue { node: 3, value: Ok(1.5), source_ns: Some(1_700_000_000_000_000_000), is_after_loss: false };
        assert_eq!(good, expected);
        assert_eq!(told(3, &DataValue::value_only(1.5)).source_ns, None);
        let null = DataValue { source_timestamp: Some(DateTime::null()), ..DataValue::value_only(7_i32) };
        assert_eq!((told(3, &null).source_ns, told(3, &null).value), (None, Ok(7.0)), "a time that means none");
        let old = DataValue::new_at(1.5, DateTime::ymd_hms(1700, 1, 1, 0, 0, 0));
        assert_eq!(told(3, &old).source_ns, None, "its distance from another overflows, and would pass for none");
        let overflown = DataValue::new_at_status(1.5, at, StatusCode::from(0x0000_0480));
        assert!(told(3, &overflown).is_after_loss && told(3, &overflown).value.is_ok());
        for (bad, words) in [
            (DataValue::new_at_status(1.5, at, StatusCode::BadSensorFailure), "BadSensorFailure"),
            (DataValue::new_at_status(1.5, at, StatusCode::UncertainLastUsableValue), "UncertainLastUsableValue"),
            (DataValue::value_only(f64::NAN), "no number"),
            (DataValue::value_only(true), "no number"),
            (DataValue::value_only("1.5"), "no number"),
            (DataValue::null(), "no value"),
        ] {
            let problem = told(3, &bad).value.unwrap_err();
            assert!(problem.contains(words), "{problem}");
        }
    }
}
