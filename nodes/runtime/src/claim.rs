//! A name that one process of this host holds at a time: a run, or the right to publish a topic.
//!
//! Place in the flow: taken before a run's nodes are started and before a node publishes, so that a second one is refused
//! while it starts instead of mixing its samples with those of the first. The name is that of a socket in the abstract
//! namespace of Linux: taken in one step, free the moment its holder ends, however it ends, and no file. It reaches as far
//! as loopback does, a network namespace; publishers elsewhere are noticed by those who take their samples
//! ([`crate::Subscribe::interleaved`]).

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

use thiserror::Error;

use crate::RunId;
use crate::ros::Domain;
use crate::transport::TransportKind;

/// Bytes an abstract name has room for.
const ROOM: usize = 100;

/// A name that is held until this is dropped.
#[derive(Debug)]
pub struct Claim {
    _socket: UnixDatagram,
}

/// Why a name cannot be held.
#[derive(Debug, Error)]
pub enum ClaimError {
    /// Another launcher has the run.
    #[error("run {run} is in use: another launch with this name is running; stop it, or give this one another --run")]
    RunInUse {
        /// The run.
        run: RunId,
    },
    /// Another process of the run publishes the topic.
    #[error(
        "run {run} has a publisher of {topic} already; stop it, or give this node another --run: two at a time would mix \
         their samples"
    )]
    PublishedInRun {
        /// The run.
        run: RunId,
        /// The topic.
        topic: String,
    },
    /// Another process of this host publishes the topic over DDS or Zenoh.
    #[error(
        "ROS domain {domain} has a publisher of {topic} on this host already, such as a second launch in one namespace; stop \
         it, or give this one another namespace or ROS_DOMAIN_ID: two at a time would mix their samples"
    )]
    PublishedInDomain {
        /// The domain.
        domain: u16,
        /// The topic.
        topic: String,
    },
    /// The system refuses.
    #[error("the name {name} cannot be held on this host: {source}")]
    System {
        /// The name.
        name: String,
        /// Why.
        source: io::Error,
    },
}

impl Claim {
    /// Holds a run, for a launcher.
    ///
    /// # Errors
    /// When another launcher holds it.
    pub fn of_run(run: &RunId) -> Result<Claim, ClaimError> {
        take(&format!("run/{run}"), || ClaimError::RunInUse { run: run.clone() })
    }

    /// Holds the right to publish `topic`, an absolute name, over the shared memory of a run.
    ///
    /// # Errors
    /// When another process holds it.
    pub fn in_run(run: &RunId, topic: &str) -> Result<Claim, ClaimError> {
        let taken = || ClaimError::PublishedInRun { run: run.clone(), topic: topic.to_owned() };
        take(&format!("run/{run}{topic}"), taken)
    }

    /// Holds the right to publish `topic`, an absolute name, over `kind` in `domain`.
    ///
    /// # Errors
    /// When another process of this host holds it.
    pub fn in_domain(domain: Domain, kind: TransportKind, topic: &str) -> Result<Claim, ClaimError> {
        let taken = || ClaimError::PublishedInDomain { domain: domain.id(), topic: topic.to_owned() };
        let over = if kind == TransportKind::Dds { String::new() } else { format!("/{kind}:") };
        take(&format!("domain/{}{over}{topic}", domain.id()), taken)
    }
}

fn take(what: &str, taken: impl FnOnce() -> ClaimError) -> Result<Claim, ClaimError> {
    let mut name = format!("abbe/{what}");
    if name.len() > ROOM {
        // Longer topics are told apart by a hash of the whole.
        name = format!("abbe/{}", abbe_msgs::Sha256::of(name.as_bytes()).to_hex());
    }
    let bound = SocketAddr::from_abstract_name(&name).and_then(|address| UnixDatagram::bind_addr(&address));
    match bound {
        Ok(socket) => Ok(Claim { _socket: socket }),
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => Err(taken()),
        Err(source) => Err(ClaimError::System { name, source }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_run_and_a_topic_are_held_by_one_at_a_time() {
        let (run, other) = (RunId::unique(), "other-run-of-this-test".parse().unwrap());
        let (first, topic) = (Claim::of_run(&run).unwrap(), "/cmm/corrected");
        let error = Claim::of_run(&run).unwrap_err().to_string();
        assert!(error.contains(run.as_str()) && error.contains("--run"), "{error}");
        let publisher = Claim::in_run(&run, topic).unwrap();
        assert!(matches!(Claim::in_run(&run, topic), Err(ClaimError::PublishedInRun { .. })));
        assert!(Claim::in_run(&run, "/cmm/geometric/corrected").is_ok() && Claim::in_run(&other, topic).is_ok());
        drop((first, publisher));
        assert!(Claim::of_run(&run).is_ok() && Claim::in_run(&run, topic).is_ok());
    }

    #[test]
    fn a_topic_of_a_domain_is_held_once_over_each_transport() {
        let (domain, topic) = (Domain::default(), format!("/cmm{}/corrected", std::process::id()));
        let _dds = Claim::in_domain(domain, TransportKind::Dds, &topic).unwrap();
        let _zenoh = Claim::in_domain(domain, TransportKind::Zenoh, &topic).unwrap();
        for kind in [TransportKind::Dds, TransportKind::Zenoh] {
            assert!(matches!(Claim::in_domain(domain, kind, &topic), Err(ClaimError::PublishedInDomain { .. })));
        }
    }

    #[test]
    fn names_longer_than_the_system_takes_are_told_apart() {
        let run = RunId::unique();
        let [one, other] = ["a", "b"].map(|end| format!("/{}/{end}", "x".repeat(200)));
        let _held = Claim::in_run(&run, &one).unwrap();
        assert!(Claim::in_run(&run, &one).is_err() && Claim::in_run(&run, &other).is_ok());
    }
}
