//! Hosts that multicast does not reach, from `ROS_STATIC_PEERS`: they are announced to one by one.
//!
//! Place in the flow: read at the start of a node, handed to its gateway, and kept up there as long as the participant is in
//! the graph. Rules as in ROS 2 Jazzy: names or addresses with `;` between them, empty ones ignored; every participant that a
//! host may have is announced to, at the ports of the domain. It is enough that one of two hosts names the other.
//!
//! A name is looked up again and again: its host may get another address, or be known only when the network is up.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV4, ToSocketAddrs};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{DiscoveryRange, EnvironmentError, RosError};
use crate::gateway::{Introduced, discovery_port};

const VARIABLE: &str = "ROS_STATIC_PEERS";
/// Participants of a host that are announced to: those of lower number. Each takes the lowest that is free on its host.
const PARTICIPANTS: u16 = 32;
/// Time between announcements.
const ANNOUNCE_EVERY: Duration = Duration::from_secs(3);
/// How long a stand-in lives: shorter than the time until its name is used again, so that it is a new one then. The library
/// announces itself at once to whoever is new, and every 10 s to everybody else.
const STAND_IN_FOR: Duration = Duration::from_secs(4);
/// Names of stand-ins that take turns.
const TURNS: u32 = 4;
/// Longest name of a host (RFC 1035).
const LONGEST_NAME: usize = 253;

/// Hosts to announce a participant to.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StaticPeers(Vec<String>);

impl StaticPeers {
    /// Those that the environment of this process names.
    ///
    /// # Errors
    /// When one of them can be no host, or `range` keeps DDS on this one.
    pub fn from_environment(range: DiscoveryRange) -> Result<Self, EnvironmentError> {
        Self::of(&std::env::var(VARIABLE).unwrap_or_default(), range)
    }

    /// The same of a text.
    ///
    /// # Errors
    /// As [`StaticPeers::from_environment`].
    pub fn of(text: &str, range: DiscoveryRange) -> Result<Self, EnvironmentError> {
        let refused = |value: &str, remedy: Cow<'static, str>| {
            Err(EnvironmentError { variable: VARIABLE, value: value.to_owned(), remedy })
        };
        let entries: Vec<&str> = text.split(';').map(str::trim).filter(|entry| !entry.is_empty()).collect();
        if entries.is_empty() && !text.trim().is_empty() {
            return refused(text, "it names no host; write names or addresses with ; between them, or unset it".into());
        }
        for entry in &entries {
            if let Some(remedy) = why_no_host(entry) {
                return refused(text, format!("'{entry}' {remedy}").into());
            }
            if range == DiscoveryRange::Localhost && !is_this_host(entry) {
                let remedy = "is another host, and ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST or ROS_LOCALHOST_ONLY=1 keeps DDS on this one; \
                              unset that, or leave the host out";
                return refused(text, format!("'{entry}' {remedy}").into());
            }
        }
        Ok(Self(entries.into_iter().map(str::to_owned).collect()))
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Announces a participant to them until what is returned is dropped.
    pub(super) fn meet(self, participant: Introduced) -> Result<Meeting, RosError> {
        // Each on its own: the name of one host may take long to be found.
        let meet = |(place, host): (usize, String)| {
            let (until, dropped) = channel::<()>();
            let place = u32::try_from(place).unwrap_or_default();
            let keep = move || {
                let mut peer = Peer::new(host);
                for number in 1.. {
                    peer.announce(participant, place, number);
                    if dropped.recv_timeout(ANNOUNCE_EVERY) != Err(RecvTimeoutError::Timeout) {
                        return;
                    }
                }
            };
            // Nobody waits for it: it may be in the middle of asking for a name.
            let spawned = thread::Builder::new().name("static-peer".into()).spawn(keep);
            spawned.map(|_| until).map_err(|source| RosError::Thread { what: "a peer", source })
        };
        Ok(Meeting { _until: self.0.into_iter().enumerate().map(meet).collect::<Result<_, _>>()? })
    }
}

/// Why an entry can be the name or address of no host.
fn why_no_host(entry: &str) -> Option<&'static str> {
    if entry.parse::<Ipv6Addr>().is_ok() || entry.starts_with('[') {
        return Some("is an address of IPv6, which the DDS library does not speak; name the address of IPv4");
    }
    if let Ok(address) = entry.parse::<Ipv4Addr>() {
        let is_host = !(address.is_unspecified() || address.is_broadcast() || address.is_multicast());
        return (!is_host).then_some("is the address of no single host; name each host");
    }
    if entry.split_once(':').is_some_and(|(_, port)| port.bytes().all(|byte| byte.is_ascii_digit())) {
        return Some("has a port; the ports are those of the domain, so name the host alone");
    }
    if entry.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') {
        return Some("is no address of IPv4; write four numbers from 0 to 255");
    }
    let is_name = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
    if entry.len() > LONGEST_NAME || !entry.bytes().all(is_name) {
        return Some("is no name or address of a host; write them with ; between them");
    }
    None
}

fn is_this_host(entry: &str) -> bool {
    entry == "localhost" || entry.parse::<Ipv4Addr>().is_ok_and(|address| address.is_loopback())
}

/// The announcing of a participant to its peers; it ends when this is dropped.
#[derive(Debug)]
pub(super) struct Meeting {
    _until: Vec<Sender<()>>,
}

/// A host, and what was found of it.
struct Peer {
    host: String,
    addresses: BTreeSet<Ipv4Addr>,
    /// Why it had none, when it was last said.
    told: Option<String>,
}

impl Peer {
    fn new(host: String) -> Self {
        Peer { host, addresses: BTreeSet::new(), told: None }
    }

    fn announce(&mut self, participant: Introduced, place: u32, number: u32) {
        self.look_up();
        let ports = (0..PARTICIPANTS).map(|id| discovery_port(participant.domain_id, id));
        let places: Vec<_> = ports
            .flat_map(|port| self.addresses.iter().map(move |address| SocketAddrV4::new(*address, port)))
            .collect();
        if places.is_empty() {
            return;
        }
        let stand_in = stand_in(participant.guid_prefix, place, number % TURNS);
        if let Err(error) = participant.tell_of(stand_in, &places, number, STAND_IN_FOR) {
            tracing::debug!(%error, host = self.host, "the participant could not be told of a peer");
        }
    }

    /// Its addresses now; those from before, where it cannot be asked.
    fn look_up(&mut self) {
        match addresses(&self.host) {
            Ok(found) => {
                if self.told.take().is_some() {
                    tracing::info!("{VARIABLE}: '{}' has an address now, and is announced to", self.host);
                }
                self.addresses = found;
            }
            Err(reason) if self.told.as_ref() != Some(&reason) => {
                let after = if self.addresses.is_empty() {
                    "nobody is announced to there until it has"
                } else {
                    "its last ones are used"
                };
                tracing::warn!(
                    "{VARIABLE}: '{}' has no address of IPv4 ({reason}); {after}. Is the name right, and does this host find names?",
                    self.host
                );
                self.told = Some(reason);
            }
            Err(_) => {}
        }
    }
}

fn addresses(host: &str) -> Result<BTreeSet<Ipv4Addr>, String> {
    let found = (host, 0).to_socket_addrs().map_err(|error| error.to_string())?;
    let v4 = |address| match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    };
    let found: BTreeSet<Ipv4Addr> = found.filter_map(v4).collect();
    if found.is_empty() { Err("only of IPv6".to_owned()) } else { Ok(found) }
}

/// The name of a stand-in: nobody but the participant itself hears of it.
fn stand_in(participant: [u8; 12], place: u32, turn: u32) -> [u8; 12] {
    let mut name = participant;
    let own = u32::from_le_bytes([name[8], name[9], name[10], name[11]]);
    name[8..].copy_from_slice(&own.wrapping_add(1 + place * TURNS + turn).to_le_bytes());
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peers(text: &str) -> Result<StaticPeers, EnvironmentError> {
        StaticPeers::of(text, DiscoveryRange::Subnet)
    }

    #[test]
    fn hosts_stand_with_semicolons_between_them_and_empty_ones_are_none() {
        let hosts = |text: &str| peers(text).unwrap().0;
        assert_eq!(hosts(";192.168.0.7; cmm-2.shop.example ;;"), ["192.168.0.7", "cmm-2.shop.example"]);
        assert!(peers("").unwrap().is_empty() && peers("  ").unwrap().is_empty());
    }

    #[test]
    fn what_can_be_no_host_is_refused_by_its_name() {
        for (entry, says) in [
            ("192.168.0.7:7412", "has a port"),
            ("cmm-2:7412", "has a port"),
            ("fe80::1", "IPv6"),
            ("[fe80::1]:7412", "IPv6"),
            ("192.168.0.256", "four numbers"),
            ("192.168.0", "four numbers"),
            ("0.0.0.0", "no single host"),
            ("239.255.0.1", "no single host"),
            ("192.168.0.7,192.168.0.8", "; between them"),
            ("udp/192.168.0.7", "; between them"),
            ("cmm 2", "; between them"),
        ] {
            let error = peers(&format!("10.0.0.1;{entry}")).unwrap_err().to_string();
            assert!(error.contains(&format!("'{entry}'")) && error.contains(says), "{error}");
        }
        assert!(peers(";").unwrap_err().to_string().contains("names no host"));
    }

    #[test]
    fn a_node_that_stays_on_this_host_has_peers_on_this_host_alone() {
        assert_eq!(StaticPeers::of("localhost;127.0.0.2", DiscoveryRange::Localhost).unwrap().0.len(), 2);
        let error = StaticPeers::of("localhost;10.0.0.1", DiscoveryRange::Localhost).unwrap_err().to_string();
        assert!(error.contains("'10.0.0.1' is another host"), "{error}");
    }

    #[test]
    fn stand_ins_are_new_when_it_is_their_turn_again_and_nobody_else() {
        // The library looks for who is gone every 2 s.
        assert!(ANNOUNCE_EVERY * TURNS > STAND_IN_FOR + Duration::from_secs(2));
        let own = [0xff; 12];
        let names: BTreeSet<_> =
            (0..3).flat_map(|place| (0..TURNS).map(move |turn| stand_in(own, place, turn))).chain([own]).collect();
        assert_eq!(names.len(), 13);
    }

    #[test]
    fn a_name_without_an_address_is_found_again_when_it_has_one() {
        let mut peer = Peer::new("no-such-host.invalid".to_owned());
        peer.look_up();
        assert!(peer.told.is_some() && peer.addresses.is_empty());
        peer.host = "127.0.0.1".to_owned();
        peer.look_up();
        assert!(peer.told.is_none() && peer.addresses.contains(&Ipv4Addr::LOCALHOST));
    }
}
