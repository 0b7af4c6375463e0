//! The first call of a client elsewhere: asked for once more, as it comes before the node knows who sends it.
//!
//! Place in the flow: [`super::matched`] tells of each writer that a reader of ours has just been connected to. A client on Fast DDS sends
//! its first request within a millisecond of finding the service, before the DDS library here has taken in who that is; the request is dropped.
//! The library then asks with a count of 0, which Fast DDS takes for a repetition (`process_acknack` wants one above the last, and
//! begins at 0), so that the request came with its next heartbeat, 3 s later, for seven first calls of eight. So the writer is asked for its
//! first sample, once, after RTPS 2.5, section 8.3.8.1 (ACKNACK), with a count of 1. The library's own next one has that count as well and goes
//! unheard; the one after it is heard.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

use ros2_client::dds::rustdds::{DomainParticipant, GUID};

use super::rtps::{self, ENDIANNESS, PREFIX};

/// Names of topics of requests begin so (ROS 2 on DDS).
const REQUESTS: &str = "rq/";
const INFO_DST: u8 = 0x0e;
/// Above that of the library's first, which is 0.
const COUNT: i32 = 1;

/// Asks a writer elsewhere for its first sample, where it is a client's.
pub(super) fn ask_again(participant: &DomainParticipant, reader: GUID, writer: GUID) {
    let mut known = participant.discovered_writers().into_iter();
    let client = known.find(|known| known.writer_proxy.remote_writer_guid == writer);
    let is_call = |topic: &str| topic.starts_with(REQUESTS);
    let Some(client) = client.filter(|known| is_call(&known.publication_topic_data.topic_name)) else { return };
    let packet = packet(reader.to_bytes(), writer.to_bytes());
    let listens = client.writer_proxy.unicast_locator_list.into_iter().filter(|locator| locator.is_udp());
    for address in listens.map(SocketAddr::from).filter(SocketAddr::is_ipv4) {
        let sent = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| socket.send_to(&packet, address));
        if let Err(error) = sent {
            tracing::debug!(%error, %address, "a client is not asked for its first call again");
        }
    }
}

/// A question for sample 1.
fn packet(reader: [u8; 16], writer: [u8; 16]) -> Vec<u8> {
    let mut packet = rtps::head(&reader[..PREFIX]);
    packet.extend([INFO_DST, ENDIANNESS, 12, 0]);
    packet.extend(&writer[..PREFIX]);
    packet.extend(rtps::acknack(&reader, &writer, 1, true, COUNT));
    packet
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_is_as_long_as_it_says_and_names_reader_writer_and_sample() {
        let packet = packet([4; 16], [9; 16]);
        assert_eq!(packet.len(), 20 + 4 + 12 + 4 + 28);
        assert_eq!((&packet[8..20], &packet[24..36]), (&[4; 12][..], &[9; 12][..]));
        assert_eq!((&packet[40..44], &packet[44..48]), (&[4; 4][..], &[9; 4][..]));
        assert_eq!(packet[48..64], [0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0x80]);
        assert_eq!(packet[64..], [1, 0, 0, 0]);
    }
}
