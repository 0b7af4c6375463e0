//! The server's end of a service, for callers of either kind: what Fast DDS sends, and what Cyclone DDS sends.
//!
//! Place in the flow: under every service of a node. ROS 2 does not say how a call is written in DDS, and its two usual
//! implementations differ: Fast DDS ("enhanced") sends the request alone and names the call beside it; Cyclone DDS puts
//! 16 bytes before request and reply, which the caller gets back. A server has one topic for the calls of both, so each
//! is read as what it is: a request that fills its bytes exactly is alone, one that does so after 16 bytes has that head.
//! What is neither is dropped, and told of in the log the 1st, 2nd, 4th, 8th … time. A reply waits for the reader of its caller.
//!
//! Source: OMG RPC over DDS 1.0, section 7.8.2 (enhanced mapping); the head of Cyclone DDS as its ROS 2 layer documents it
//! (`cdds_request_header_t`: identity and number of the caller, 8 bytes each).

use std::cell::Cell;
use std::fmt;
use std::future::poll_fn;
use std::marker::PhantomData;
use std::sync::Arc;
use std::task::Poll;

use futures::StreamExt;
use ros2_client::dds::rustdds::serialization::{deserialize_from_cdr_with_rep_id, to_writer_with_rep_id};
use ros2_client::dds::rustdds::{GUID, RepresentationIdentifier};
use ros2_client::service::Server;
use ros2_client::{Message, Node, ServiceMapping, ServiceTypeName};
use serde::de::{DeserializeOwned, SeqAccess, Visitor};
use serde::ser::SerializeTuple;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::endpoint::{dds_name, endpoint_error};
use super::matched::Matched;
use super::{RosError, service_qos};

/// Names of topics of replies begin and end so (ROS 2 on DDS).
const REPLIES: &str = "rr";
const REPLY: &str = "Reply";
/// Head of requests and replies of Cyclone DDS.
const HEAD: usize = 16;
/// Writers pad a message to a multiple of four or eight bytes.
const MAX_PADDING: usize = 7;
/// Longest request that is read.
const LONGEST: usize = 64 * 1024;
const ENCODING: RepresentationIdentifier = RepresentationIdentifier::CDR_LE;

/// An empty request, which CDR gives one unused byte.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct EmptyRequest {
    structure_needs_at_least_one_member: u8,
}

/// A service that is open.
pub(super) struct Service<Request, Reply> {
    name: String,
    matched: Arc<Matched>,
    /// Of the replies, as DDS has it.
    topic: String,
    server: Server<Bytes, Bytes>,
    refused: Cell<u64>,
    /// The last caller of which no reader was found.
    without_reader: Cell<Option<GUID>>,
    of: PhantomData<fn(Request) -> Reply>,
}

impl<Request: DeserializeOwned, Reply: Serialize> Service<Request, Reply> {
    /// Opens the service `name`, an absolute name, of type `package/srv/service`.
    pub(super) fn open(
        node: &mut Node,
        matched: &Arc<Matched>,
        name: &str,
        package: &str,
        service: &str,
    ) -> Result<Self, RosError> {
        let server = node.create_server(
            ServiceMapping::Enhanced,
            &dds_name(name)?,
            &ServiceTypeName::new(package, service),
            service_qos(),
            service_qos(),
        );
        let server = server.map_err(|source| endpoint_error("service", name, source))?;
        let (matched, topic) = (Arc::clone(matched), format!("{REPLIES}{name}{REPLY}"));
        let (name, refused, without_reader) = (name.to_owned(), Cell::new(0), Cell::new(None));
        Ok(Self { name, matched, topic, server, refused, without_reader, of: PhantomData })
    }

    /// Answers every request with `reply`, for ever.
    pub(super) async fn serve(&self, mut reply: impl AsyncFnMut(Request) -> Reply) {
        let mut requests = self.server.receive_request_stream();
        while let Some(request) = requests.next().await {
            let (id, Bytes(bytes)) = match request {
                Ok(request) => request,
                Err(error) => {
                    self.refuse(&error);
                    continue;
                }
            };
            let Some((head, request)) = read::<Request>(&bytes) else {
                self.refuse(&format!("{} bytes that are not a request of this service", bytes.len()));
                continue;
            };
            let bytes = written(head, &reply(request).await);
            self.await_reader(id.writer_gid.into());
            let sent = match bytes {
                Ok(bytes) => self.server.async_send_response(id, Bytes(bytes)).await.map_err(|error| error.to_string()),
                Err(reason) => Err(reason),
            };
            if let Err(error) = sent {
                tracing::warn!(service = self.name, error, "could not answer");
            }
            yield_once().await;
        }
    }

    /// Waits for the reader of who asked, but not twice for one that did not come: it may call again and again.
    fn await_reader(&self, caller: GUID) {
        let is_known = self.without_reader.get() == Some(caller);
        if !is_known && !self.matched.await_reader(caller, &self.topic) {
            self.without_reader.set(Some(caller));
            tracing::warn!(service = self.name, "the reader of a reply is not known here; it is written all the same");
        }
    }

    fn refuse(&self, reason: &dyn fmt::Display) {
        let refused = self.refused.get() + 1;
        self.refused.set(refused);
        if refused.is_power_of_two() {
            tracing::warn!(service = self.name, refused, %reason, "dropped a request");
        }
    }
}

/// Lets what else the thread does have its turn, the end of the service among it: requests may come without a pause.
async fn yield_once() {
    let mut is_over = false;
    poll_fn(|context| {
        if std::mem::replace(&mut is_over, true) {
            return Poll::Ready(());
        }
        context.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
}

/// A request, and what precedes it.
fn read<Request: DeserializeOwned>(bytes: &[u8]) -> Option<(&[u8], Request)> {
    [0, HEAD].into_iter().find_map(|head| {
        let (head, body) = bytes.split_at_checked(head)?;
        let (request, length) = deserialize_from_cdr_with_rep_id::<Request>(body, ENCODING).ok()?;
        (body.len().checked_sub(length)? <= MAX_PADDING).then_some((head, request))
    })
}

/// A reply behind what preceded its request.
fn written(head: &[u8], reply: &impl Serialize) -> Result<Vec<u8>, String> {
    let mut body = Vec::new();
    to_writer_with_rep_id(&mut body, reply, ENCODING).map_err(|error| error.to_string())?;
    Ok([head, &body].concat())
}

/// A message as it is on the wire, without its encapsulation.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Bytes(Vec<u8>);

impl Message for Bytes {}

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = serializer.serialize_tuple(self.0.len())?;
        self.0.iter().try_for_each(|byte| bytes.serialize_element(byte))?;
        bytes.end()
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct All;
        impl<'de> Visitor<'de> for All {
            type Value = Bytes;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("bytes to the end")
            }

            // CDR does not say how many there are; the end is where no more can be read.
            fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<Bytes, A::Error> {
                let mut all = Vec::new();
                while let Ok(Some(byte)) = bytes.next_element() {
                    all.push(byte);
                }
                Ok(Bytes(all))
            }
        }
        deserializer.deserialize_tuple(LONGEST, All)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Names {
        names: Vec<String>,
    }

    fn names() -> (Names, Vec<u8>) {
        let names = Names { names: vec!["use_sim_time".to_owned(), "window".to_owned()] };
        let body = written(&[], &names).unwrap();
        (names, body)
    }

    #[test]
    fn a_request_is_read_alone_and_behind_a_head_and_its_reply_has_the_same_head() {
        let (names, body) = names();
        let (head, request) = read::<Names>(&body).unwrap();
        assert_eq!((head.len(), &request), (0, &names));
        let head: Vec<u8> = (200..200 + HEAD as u8).collect();
        let behind = [&head[..], &body].concat();
        let (found, request) = read::<Names>(&behind).unwrap();
        assert_eq!((found, &request), (&head[..], &names));
        assert_eq!(written(found, &names).unwrap(), behind);
    }

    #[test]
    fn padding_is_passed_over_and_anything_else_is_no_request() {
        let (names, mut body) = names();
        body.extend([0; 3]);
        assert_eq!(read::<Names>(&body).unwrap().1, names);
        body.extend([0; 5]);
        assert!(read::<Names>(&body).is_none());
        assert!(read::<Names>(&[]).is_none());
        assert!(read::<Names>(&[0xff; 40]).is_none());
        assert!(read::<Names>(&[0xff; HEAD + 3]).is_none());
    }

    #[test]
    fn bytes_come_to_the_end_whatever_they_are() {
        let all: Vec<u8> = (0..=255).collect();
        let (bytes, length) = deserialize_from_cdr_with_rep_id::<Bytes>(&all, ENCODING).unwrap();
        assert_eq!((bytes, length), (Bytes(all.clone()), all.len()));
        assert_eq!(written(&[], &Bytes(all.clone())).unwrap(), all);
    }
}
