//! A server of a few values that somebody else computes: a simulated machine behind OPC UA, for rehearsals.
//!
//! Place in the flow: `abbe simulate --serve opcua`. In each cycle all values are set at once, with one source timestamp; a value
//! that is missing has a bad status. Each has the property `EngineeringUnits`. Anybody may read and subscribe, nobody may write.
//! Of the address space of the standard there are the few nodes that clients ask for: what the standard has beyond them is megabytes of
//! code, which every build of Abbe would have to compile.

use crate::log::Seldom;
use crate::units::{UNECE, identifier_of};
use opcua::types::{
    DataTypeId, DataValue, DateTime, EUInformation, ExtensionObject, NodeClass, NodeId, ObjectId, ObjectTypeId,
    QualifiedName, ReferenceTypeId, StatusCode, VariableId, VariableTypeId, Variant,
};
use opcua_nodes::{DefaultTypeTree, ObjectBuilder, VariableBuilder};
use opcua_server::address_space::AddressSpace;
use opcua_server::diagnostics::NamespaceMetadata;
use opcua_server::node_manager::memory::{SimpleNodeManager, simple_node_manager};
use opcua_server::{ANONYMOUS_USER_TOKEN_ID, Server, ServerBuilder, ServerEndpoint, ServerHandle};
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::MissedTickBehavior;
use tracing::dispatcher::{Dispatch, get_default, with_default};
use tracing::subscriber::NoSubscriber;

/// Namespace of the values' nodes.
pub const NAMESPACE: &str = "urn:abbe:simulated-machine";
/// Namespace of the standard's nodes.
const STANDARD: &str = "http://opcfoundation.org/UA/";
/// Names of the two parts of the address space.
const PARTS: [&str; 2] = ["standard", "machine"];
/// `ServerState` of a server that runs.
const RUNNING: i32 = 0;
/// Values of a node that are kept for a subscription at most.
const KEPT: usize = 1000;

/// A value that is served.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Served {
    /// Its name, and its node: `s=` and this.
    pub name: &'static str,
    /// The unit that it is served in, as at the end of a name (`_mm`).
    pub unit: &'static str,
}

/// Serves these values, which `values` gives in each cycle, until told to stop.
///
/// # Errors
/// Why nothing can be served, in words.
pub fn serve(
    listener: TcpListener,
    served: &[Served],
    every: Duration,
    values: &mut dyn FnMut() -> Vec<Option<f64>>,
    is_stopped: &dyn Fn() -> bool,
) -> Result<(), String> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(|error| error.to_string())?;
    let log = get_default(Dispatch::clone);
    with_default(&Dispatch::new(Seldom::new(log)), || {
        runtime.block_on(async {
            // It would warn that it has no certificate, and needs none.
            let built = with_default(&Dispatch::new(NoSubscriber::default()), || build(&listener, every));
            let (server, handle) = built?;
            let namespace = handle.get_namespace_index(NAMESPACE).ok_or("it has no namespace of its own")?;
            let nodes = handle.node_managers();
            let [standard, machine] = PARTS.map(|part| nodes.get_by_name::<SimpleNodeManager>(part));
            let (standard, machine) = standard.zip(machine).ok_or("its nodes are missing")?;
            let ids: Vec<NodeId> = served.iter().map(|one| NodeId::new(namespace, one.name)).collect();
            reference_types(&mut handle.type_tree().write());
            standard_nodes(&mut standard.address_space().write(), &ids);
            machine_nodes(&mut machine.address_space().write(), served, &ids)?;
            let cycle = cycle((&standard, &machine, &handle), &ids, every, values, is_stopped);
            listener.set_nonblocking(true).map_err(|error| error.to_string())?;
            let listener = tokio::net::TcpListener::from_std(listener).map_err(|error| error.to_string())?;
            tokio::select! {
                ended = server.run_with(listener) => ended,
                ended = cycle => ended,
            }
        })
    })
}

fn build(listener: &TcpListener, every: Duration) -> Result<(Server, ServerHandle), String> {
    let address = listener.local_addr().map_err(|error| error.to_string())?;
    let part = |namespace: &str, name| {
        let namespace = NamespaceMetadata { namespace_uri: namespace.to_owned(), ..NamespaceMetadata::default() };
        simple_node_manager(namespace, name)
    };
    let every_ms = (every.as_secs_f64() * 1e3).max(1.0);
    let mut builder = ServerBuilder::new()
        .application_name("Abbe, a simulated machine")
        .application_uri(NAMESPACE)
        .product_uri(NAMESPACE)
        .host(address.ip().to_string())
        .port(address.port())
        .create_sample_keypair(false)
        .pki_dir("/dev/null/none")
        .add_endpoint("none", ServerEndpoint::new_none("/", &[ANONYMOUS_USER_TOKEN_ID.to_owned()]))
        .discovery_urls(vec![format!("opc.tcp://{address}/")])
        .subscription_poll_interval_ms(every_ms as u64)
        .with_node_manager(part(STANDARD, PARTS[0]))
        .with_node_manager(part(NAMESPACE, PARTS[1]));
    let limits = &mut builder.limits_mut().subscriptions;
    (limits.min_sampling_interval_ms, limits.min_publishing_interval_ms) = (every_ms, every_ms);
    limits.max_monitored_item_queue_size = KEPT;
    builder.build()
}

/// How kinds of references descend from one another: clients ask for all hierarchical ones.
fn reference_types(tree: &mut DefaultTypeTree) {
    use ReferenceTypeId as R;
    for (kind, parent) in [
        (R::HierarchicalReferences, R::References),
        (R::NonHierarchicalReferences, R::References),
        (R::HasChild, R::HierarchicalReferences),
        (R::Organizes, R::HierarchicalReferences),
        (R::Aggregates, R::HasChild),
        (R::HasProperty, R::Aggregates),
        (R::HasComponent, R::Aggregates),
        (R::HasTypeDefinition, R::NonHierarchicalReferences),
    ] {
        tree.add_type_node(&kind.into(), &parent.into(), NodeClass::ReferenceType);
    }
}

/// The nodes of the standard that clients ask for.
fn standard_nodes(space: &mut AddressSpace, ids: &[NodeId]) {
    let folder = |id: ObjectId, name: &str| {
        let folder = ObjectBuilder::new(&id.into(), QualifiedName::new(0, name), name);
        folder.has_type_definition(ObjectTypeId::FolderType)
    };
    folder(ObjectId::RootFolder, "Root").insert(space);
    folder(ObjectId::ObjectsFolder, "Objects").organized_by(ObjectId::RootFolder).insert(space);
    folder(ObjectId::Server, "Server").organized_by(ObjectId::ObjectsFolder).insert(space);
    let namespaces = [STANDARD, NAMESPACE].map(str::to_owned).to_vec();
    let variables = [
        (VariableId::Server_NamespaceArray, "NamespaceArray", DataTypeId::String, Variant::from(namespaces)),
        (VariableId::Server_ServerStatus_State, "State", DataTypeId::ServerState, Variant::from(RUNNING)),
        (
            VariableId::Server_ServerStatus_CurrentTime,
            "CurrentTime",
            DataTypeId::UtcTime,
            Variant::from(DateTime::now()),
        ),
    ];
    for (id, name, data_type, value) in variables {
        let rank = if matches!(value, Variant::Array(_)) { 1 } else { -1 };
        VariableBuilder::new(&id.into(), QualifiedName::new(0, name), name)
            .data_type(data_type)
            .value_rank(rank)
            .value(value)
            .has_type_definition(VariableTypeId::PropertyType)
            .property_of(ObjectId::Server)
            .insert(space);
    }
    for id in ids {
        space.insert_reference(&ObjectId::ObjectsFolder.into(), id, ReferenceTypeId::Organizes);
    }
}

fn machine_nodes(space: &mut AddressSpace, served: &[Served], ids: &[NodeId]) -> Result<(), String> {
    for (one, id) in served.iter().zip(ids) {
        let unit = identifier_of(one.unit).ok_or_else(|| format!("{}: unit {} is not known", one.name, one.unit))?;
        VariableBuilder::new(id, QualifiedName::new(id.namespace, one.name), one.name)
            .data_type(DataTypeId::Double)
            .value(Variant::Empty)
            .has_type_definition(VariableTypeId::BaseDataVariableType)
            .organized_by(ObjectId::ObjectsFolder)
            .insert(space);
        let unit = EUInformation {
            namespace_uri: UNECE.into(),
            unit_id: unit,
            display_name: one.unit.trim_start_matches('_').into(),
            description: one.unit.trim_start_matches('_').into(),
        };
        let property = NodeId::new(id.namespace, format!("{}.EngineeringUnits", one.name));
        VariableBuilder::new(&property, QualifiedName::new(0, "EngineeringUnits"), "EngineeringUnits")
            .data_type(DataTypeId::EUInformation)
            .value(ExtensionObject::from_message(unit))
            .has_type_definition(VariableTypeId::PropertyType)
            .property_of(id.clone())
            .insert(space);
    }
    Ok(())
}

type Parts<'a> = (&'a Arc<SimpleNodeManager>, &'a Arc<SimpleNodeManager>, &'a ServerHandle);

/// Sets all values, again and again.
async fn cycle(
    (standard, machine, handle): Parts<'_>,
    ids: &[NodeId],
    every: Duration,
    values: &mut dyn FnMut() -> Vec<Option<f64>>,
    is_stopped: &dyn Fn() -> bool,
) -> Result<(), String> {
    let clock = VariableId::Server_ServerStatus_CurrentTime.into();
    let mut due = tokio::time::interval(every);
    due.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while !is_stopped() {
        due.tick().await;
        let at = DateTime::now();
        let told = ids.iter().zip(values()).map(|(id, value)| (id, None, data_value(value, at)));
        machine.set_values(handle.subscriptions(), told).map_err(|status| status.to_string())?;
        let now = DataValue::new_at(at, at);
        standard.set_value(handle.subscriptions(), &clock, None, now).map_err(|status| status.to_string())?;
    }
    Ok(())
}

fn data_value(value: Option<f64>, at: DateTime) -> DataValue {
    match value {
        Some(value) => DataValue::new_at(value, at),
        None => DataValue { value: None, ..DataValue::new_at_status(Variant::Empty, at, StatusCode::BadNoData) },
    }
}
