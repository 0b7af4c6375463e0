//! No bytes make the readers panic: arbitrary ones, and bags and messages damaged at random.

#![allow(clippy::unwrap_used, clippy::panic)] // helpers of tests fail the test

mod common;
#[path = "../fuzz/exercise.rs"]
#[allow(unreachable_pub)] // it is the public face of the fuzz targets
mod exercise;

use abbe_msgs::{Message, bag::BagWriter, cdr};
use proptest::prelude::*;

/// A small bag with several types.
fn bag_bytes() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.mcap");
    let mut writer = BagWriter::create(&path).unwrap();
    for n in 0..5 {
        writer.write("scales", &common::scales(), n).unwrap();
        writer.write("corrected", &common::corrected(), n).unwrap();
        writer.write_ros("diagnostics", &common::diagnostics(), n).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// An MCAP file of these records: opcode and body, with the length in between.
fn mcap_of(records: &[(u8, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    for (opcode, body) in records {
        bytes.push(*opcode);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
    }
    bytes.extend(mcap::MAGIC);
    bytes
}

/// The body of an uncompressed chunk without checksum around these records.
fn chunk_of(records: &[u8]) -> Vec<u8> {
    let mut body = vec![0; 16]; // first and last time
    body.extend((records.len() as u64).to_le_bytes());
    body.extend([0; 4]); // no checksum
    body.extend([0; 4]); // no compression
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(records);
    body
}

#[test]
fn a_record_longer_than_its_chunk_is_an_error() {
    let mut records = vec![0x05];
    records.extend(1000_u64.to_le_bytes());
    records.extend([0; 22]);
    let bytes = mcap_of(&[(0x06, chunk_of(&records)), (0x0f, vec![0; 2000])]);
    let read: Vec<_> = abbe_msgs::bag::messages_from("crafted".as_ref(), bytes.as_slice()).collect();
    assert!(matches!(read.as_slice(), [Err(_)]), "{read:?}");
}

#[test]
fn a_text_longer_than_its_record_is_an_error() {
    // Found by fuzzing: the length alone made the MCAP reader reserve gigabytes.
    let mut schema = vec![1, 0];
    schema.extend(u32::MAX.to_le_bytes());
    let mut channel = vec![1, 0, 1, 0];
    channel.extend([0; 8]); // no topic, no encoding
    channel.extend(8_u32.to_le_bytes());
    channel.extend([0, 0, 0, 0]);
    channel.extend(u32::MAX.to_le_bytes());
    let mut half_pair = vec![1, 0, 1, 0];
    half_pair.extend([0; 8]);
    half_pair.extend(4_u32.to_le_bytes()); // a key without its value
    half_pair.extend([0, 0, 0, 0]);
    half_pair.extend(u32::MAX.to_le_bytes());
    let mut chunk = vec![0; 28];
    chunk.extend(u32::MAX.to_le_bytes());
    let records = [(0x03, schema), (0x04, channel), (0x04, half_pair), (0x06, chunk)];
    for record in records {
        let bytes = mcap_of(&[record]);
        let read: Vec<_> = abbe_msgs::bag::messages_from("crafted".as_ref(), bytes.as_slice()).collect();
        assert!(matches!(read.as_slice(), [Err(_)]), "{read:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn arbitrary_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        exercise::read_bag(&bytes);
        exercise::decode_cdr(&bytes);
    }

    #[test]
    fn arbitrary_records_are_survived(
        records in prop::collection::vec(
            (0_u8..0x11, prop::collection::vec(any::<u8>(), 0..80)), 0..8),
    ) {
        exercise::read_bag(&mcap_of(&records));
        let inner = mcap_of(&records);
        exercise::read_bag(&mcap_of(&[(0x06, chunk_of(&inner[8..inner.len() - 8]))]));
    }

    #[test]
    fn arbitrary_payloads_behind_a_true_header_are_survived(
        payload in prop::collection::vec(prop_oneof![Just(0_u8), 0_u8..8, any::<u8>()], 0..400),
        order in 0_u8..2,
    ) {
        let bytes = [&[0, order, 0, 0], payload.as_slice()].concat();
        exercise::decode_cdr(&bytes);
    }
}

proptest! {
    #[test]
    fn damaged_messages_are_survived(at in any::<prop::sample::Index>(), byte: u8) {
        for ros in [
            cdr::encode(&common::scales().to_ros()).unwrap(),
            cdr::encode(&common::corrected().to_ros()).unwrap(),
            cdr::encode(&common::diagnostics()).unwrap(),
        ] {
            let mut bytes = ros;
            let at = at.index(bytes.len());
            bytes[at] = byte;
            exercise::decode_cdr(&bytes);
        }
    }

    #[test]
    fn damaged_bags_are_survived(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
        length in any::<prop::sample::Index>(),
    ) {
        let mut bytes = bag_bytes();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        exercise::read_bag(&bytes);
        exercise::read_bag(&bytes[..length.index(bytes.len())]);
    }
}
