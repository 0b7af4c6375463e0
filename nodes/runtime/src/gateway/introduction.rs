//! Introduces a participant to itself, so that its own writers and readers find each other.
//!
//! Place in the flow: under the gateway's heartbeat. A participant hears its own announcement where multicast comes
//! back to it, and then matches its own endpoints. On a loopback interface without the multicast flag it hears nothing,
//! because nobody announces themselves to themselves by unicast. This sends it its own announcement once more, from a
//! socket of ours to the port where it listens for those of others: one packet after RTPS 2.5, sections 8.5.3 and 9.6.
//!
//! A second participant would do as well, but each takes one of the twelve places that such a loopback has.

use std::net::{Ipv4Addr, UdpSocket};
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

/// A participant on this host, as its announcement describes it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Introduced {
    pub(crate) guid_prefix: [u8; 12],
    pub(crate) domain_id: u16,
    pub(crate) participant_id: u16,
}

impl Introduced {
    /// Sends the participant its own announcement, the `number`-th one, good for `lease`.
    pub(super) fn introduce(self, number: u32, lease: Duration) -> std::io::Result<()> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        socket.send_to(&self.packet(number, lease), (Ipv4Addr::LOCALHOST, self.port(DISCOVERY_OFFSET)))?;
        Ok(())
    }

    /// Where it listens for samples, and for what readers say of them.
    pub(crate) fn data_port(self) -> u16 {
        self.port(DATA_OFFSET)
    }

    fn port(self, offset: u16) -> u16 {
        PORT_BASE + DOMAIN_GAIN * self.domain_id + offset + PARTICIPANT_GAIN * self.participant_id
    }

    fn packet(self, number: u32, lease: Duration) -> Vec<u8> {
        let mut packet = b"RTPS".to_vec();
        packet.extend([PROTOCOL[0], PROTOCOL[1], VENDOR[0], VENDOR[1]]);
        packet.extend(self.guid_prefix);
        let announcement = self.announcement(lease);
        let length = u16::try_from(20 + announcement.len()).unwrap_or(u16::MAX);
        // DATA, little endian, with a payload; 16 bytes from here to where inline parameters would be.
        packet.extend([0x15, 0b101]);
        packet.extend(length.to_le_bytes());
        packet.extend([0, 0, 16, 0]);
        packet.extend(READER);
        packet.extend(WRITER);
        packet.extend(0_i32.to_le_bytes());
        packet.extend(number.to_le_bytes());
        packet.extend(announcement);
        packet
    }

    fn announcement(self, lease: Duration) -> Vec<u8> {
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
        add(0x0058, &BUILTIN_ENDPOINTS.to_le_bytes());
        add(0x0032, &locator(self.port(DISCOVERY_OFFSET)));
        add(0x0031, &locator(self.port(DATA_OFFSET)));
        let seconds = i32::try_from(lease.as_secs()).unwrap_or(i32::MAX);
        add(0x0002, &[seconds.to_le_bytes(), [0; 4]].concat());
        add(0x0001, &[]);
        list
    }
}

fn locator(port: u16) -> Vec<u8> {
    let address = Ipv4Addr::LOCALHOST.octets();
    [&UDP_V4.to_le_bytes()[..], &u32::from(port).to_le_bytes(), &[0; 12], &address].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_and_lengths_are_those_of_the_standard() {
        let introduced = Introduced { guid_prefix: [7; 12], domain_id: 3, participant_id: 2 };
        assert_eq!(introduced.port(DISCOVERY_OFFSET), 7400 + 750 + 10 + 4);
        assert_eq!(introduced.port(DATA_OFFSET), 7400 + 750 + 11 + 4);
        let packet = introduced.packet(1, Duration::from_secs(50));
        assert_eq!(&packet[..8], b"RTPS\x02\x04\x01\x12");
        // The submessage ends with the packet, and every parameter is a multiple of four bytes.
        assert_eq!(usize::from(u16::from_le_bytes([packet[22], packet[23]])), packet.len() - 24);
        assert_eq!(packet.len() % 4, 0);
    }
}
