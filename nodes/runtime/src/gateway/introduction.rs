//! Tells a participant of others: of itself, so that its own writers and readers find each other, and of hosts that
//! multicast does not reach.
//!
//! Place in the flow: under the gateway's heartbeat, and under `ros/static_peers.rs`. One packet after RTPS 2.5, sections
//! 8.5.3 and 9.6, from a socket of ours to the port where the participant listens for announcements.
//!
//! - A participant hears its own announcement where multicast comes back to it, and then matches its own endpoints. On a loopback
//!   interface without the multicast flag it hears nothing, because nobody announces themselves to themselves by unicast: it gets
//!   its own announcement once more. A second participant would do as well, but each takes one of the twelve places that such a
//!   loopback has.
//! - The library announces itself to the participants that it knows, at once where one is new, and knows no way to be told where
//!   others might be. So it is told of a stand-in that listens for announcements, and for nothing else, at each of those places.

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::time::Duration;

/// Gain and offsets of the well-known ports (RTPS 2.5, section 9.6.2.3).
const PORT_BASE: u16 = 7400;
const DOMAIN_GAIN: u16 = 250;
const PARTICIPANT_GAIN: u16 = 2;
const DISCOVERY_OFFSET: u16 = 10;
const DATA_OFFSET: u16 = 11;

/// Protocol 2.4; vendor 1.18, the library whose participant this is.
const PROTOCOL: [u8; 4] = [2, 4, 0, 0];
const VENDOR: [u8; 4] = [0x01, 0x12, 0, 0];
/// Announcer and detector of participants, publications, subscriptions and topics, and messages between participants.
const BUILTIN_ENDPOINTS: u32 = 0b11_1111 | 0b11 << 10 | 0b11 << 28;
const READER: [u8; 4] = [0, 1, 0, 0xc7];
const WRITER: [u8; 4] = [0, 1, 0, 0xc2];
const PARTICIPANT: [u8; 4] = [0, 0, 1, 0xc1];
const UDP_V4: i32 = 1;

/// Of these the one that hears announcements of participants.
const DETECTOR: u32 = 0b10;

/// A participant on this host, as its announcement describes it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Introduced {
    pub(crate) guid_prefix: [u8; 12],
    pub(crate) domain_id: u16,
    pub(crate) participant_id: u16,
}

/// What an announcement says.
struct Announcement<'a> {
    guid_prefix: [u8; 12],
    endpoints: u32,
    hears_announcements_at: &'a [SocketAddrV4],
    takes_samples_at: &'a [SocketAddrV4],
    /// How long it holds, in whole seconds.
    lease: Duration,
}

/// Where participant `participant_id` of a domain listens for the announcements of others.
pub(crate) fn discovery_port(domain_id: u16, participant_id: u16) -> u16 {
    PORT_BASE + DOMAIN_GAIN * domain_id + DISCOVERY_OFFSET + PARTICIPANT_GAIN * participant_id
}

impl Introduced {
    /// Sends the participant its own announcement, the `number`-th one, good for `lease`.
    pub(super) fn introduce(self, number: u32, lease: Duration) -> std::io::Result<()> {
        self.tell(&self.own(&self.own_places(), lease), number)
    }

    /// Tells the participant, for the `number`-th time, of a stand-in: another participant that listens at these places.
    pub(crate) fn tell_of(
        self,
        stand_in: [u8; 12],
        places: &[SocketAddrV4],
        number: u32,
        lease: Duration,
    ) -> std::io::Result<()> {
        self.tell(
            &Announcement {
                guid_prefix: stand_in,
                endpoints: DETECTOR,
                hears_announcements_at: places,
                takes_samples_at: &[],
                lease,
            },
            number,
        )
    }

    /// Where it listens for samples, and for what readers say of them.
    pub(crate) fn data_port(self) -> u16 {
        discovery_port(self.domain_id, self.participant_id) + (DATA_OFFSET - DISCOVERY_OFFSET)
    }

    fn own_places(self) -> [SocketAddrV4; 2] {
        let ports = [discovery_port(self.domain_id, self.participant_id), self.data_port()];
        ports.map(|port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port))
    }

    fn own(self, places: &[SocketAddrV4; 2], lease: Duration) -> Announcement<'_> {
        Announcement {
            guid_prefix: self.guid_prefix,
            endpoints: BUILTIN_ENDPOINTS,
            hears_announcements_at: &places[..1],
            takes_samples_at: &places[1..],
            lease,
        }
    }

    fn tell(self, announcement: &Announcement<'_>, number: u32) -> std::io::Result<()> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        socket.send_to(&announcement.packet(number), self.own_places()[0])?;
        Ok(())
    }
}

impl Announcement<'_> {
    fn packet(&self, number: u32) -> Vec<u8> {
        let mut packet = b"RTPS".to_vec();
        packet.extend([PROTOCOL[0], PROTOCOL[1], VENDOR[0], VENDOR[1]]);
        packet.extend(self.guid_prefix);
        let parameters = self.parameters();
        let length = u16::try_from(20 + parameters.len()).unwrap_or(u16::MAX);
        // DATA, little endian, with a payload; 16 bytes from here to where inline parameters would be.
        packet.extend([0x15, 0b101]);
        packet.extend(length.to_le_bytes());
        packet.extend([0, 0, 16, 0]);
        packet.extend(READER);
        packet.extend(WRITER);
        packet.extend(0_i32.to_le_bytes());
        packet.extend(number.to_le_bytes());
        packet.extend(parameters);
        packet
    }

    fn parameters(&self) -> Vec<u8> {
        // A list of parameters in CDR, little endian.
        let mut list = vec![0, 3, 0, 0];
        let mut add = |name: u16, value: &[u8]| {
            list.extend(name.to_le_bytes());
            list.extend(u16::try_from(value.len()).unwrap_or_default().to_le_bytes());
            list.extend(value);
        };
        add(0x0015, &PROTOCOL);
        add(0x0016, &VENDOR);
        add(0x0050, &[&self.guid_prefix[..], &PARTICIPANT].concat());
        add(0x0058, &self.endpoints.to_le_bytes());
        self.hears_announcements_at.iter().for_each(|place| add(0x0032, &locator(*place)));
        self.takes_samples_at.iter().for_each(|place| add(0x0031, &locator(*place)));
        let seconds = i32::try_from(self.lease.as_secs()).unwrap_or(i32::MAX);
        add(0x0002, &[seconds.to_le_bytes(), [0; 4]].concat());
        add(0x0001, &[]);
        list
    }
}

fn locator(place: SocketAddrV4) -> Vec<u8> {
    let (address, port) = (place.ip().octets(), u32::from(place.port()));
    [&UDP_V4.to_le_bytes()[..], &port.to_le_bytes(), &[0; 12], &address].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_and_lengths_are_those_of_the_standard() {
        let introduced = Introduced { guid_prefix: [7; 12], domain_id: 3, participant_id: 2 };
        let places = introduced.own_places();
        assert_eq!(places.map(|place| place.port()), [7400 + 750 + 10 + 4, 7400 + 750 + 11 + 4]);
        let packet = introduced.own(&places, Duration::from_secs(50)).packet(1);
        assert_eq!(&packet[..8], b"RTPS\x02\x04\x01\x12");
        // The submessage ends with the packet, and every parameter is a multiple of four bytes.
        assert_eq!(usize::from(u16::from_le_bytes([packet[22], packet[23]])), packet.len() - 24);
        assert_eq!(packet.len() % 4, 0);
    }
}
