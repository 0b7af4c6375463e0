//! No bytes make the readers panic: arbitrary ones, and bags and messages damaged at random.

#[path = "../fuzz/exercise.rs"]
#[allow(unreachable_pub)] // it is the public face of the fuzz targets
mod exercise;

use crate::common;
use std::ops::Range;
use std::sync::OnceLock;

use abbe_msgs::bag::{BagMessage, BagWriter, FileRecovery, recover_from};
use abbe_msgs::{Message, Stamp, cdr};
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
        exercise::recover_bag(&bytes);
        exercise::decode_cdr(&bytes);
    }

    #[test]
    fn arbitrary_records_are_survived(
        records in prop::collection::vec(
            (0_u8..0x11, prop::collection::vec(any::<u8>(), 0..80)), 0..8),
    ) {
        exercise::read_bag(&mcap_of(&records));
        exercise::recover_bag(&mcap_of(&records));
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
    fn any_stamp_and_any_number_of_seconds_is_survived(sec: i32, nanosec: u32, bits: u64, nanos: i64) {
        if let Ok(stamp) = Stamp::new(sec, nanosec) {
            prop_assert_eq!(Stamp::from_nanos(stamp.to_nanos()), Ok(stamp));
            prop_assert!(stamp.to_seconds().is_finite() && !stamp.to_string().is_empty());
        }
        let _ = Stamp::from_nanos(nanos);
        let seconds = f64::from_bits(bits);
        let fits = (-2_147_483_648.0..2_147_483_648.0).contains(&seconds);
        // The last half nanosecond before the end rounds up to it.
        prop_assert!(Stamp::from_seconds(seconds).is_ok() == fits || (seconds - 2_147_483_648.0).abs() < 1e-6);
    }

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
        exercise::recover_bag(&bytes);
    }
}

/// A message as it was written: topic, time, bytes.
type Written = (String, u64, Vec<u8>);

fn content(message: &BagMessage) -> Written {
    (message.topic().to_owned(), message.log_time_ns, message.cdr.clone())
}

/// A bag in many chunks: its bytes, its messages, and of each chunk its place and how many messages it holds.
struct Whole {
    bytes: Vec<u8>,
    written: Vec<Written>,
    chunks: Vec<(Range<usize>, usize)>,
}

fn whole() -> &'static Whole {
    static WHOLE: OnceLock<Whole> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("whole.mcap");
        let mut writer = BagWriter::create(&path).unwrap();
        for n in 0..60 {
            writer.write("scales", &abbe_msgs::ScaleReading { sequence: n, ..common::scales() }, n).unwrap();
            writer.write("corrected", &common::corrected(), n).unwrap();
            if n % 7 == 6 {
                writer.flush().unwrap();
            }
            if n == 30 {
                writer.write_ros("diagnostics", &common::diagnostics(), n).unwrap();
            }
        }
        writer.finish().unwrap();
        let bytes = std::fs::read(path).unwrap();
        let (file, written) = recovered(&bytes);
        assert!(file.is_complete() && written.len() == 121, "{file:?}");
        Whole { chunks: chunks(&bytes), bytes, written }
    })
}

/// The chunks of a whole file by walking over its records.
fn chunks(bytes: &[u8]) -> Vec<(Range<usize>, usize)> {
    let (mut chunks, mut at) = (Vec::new(), 8);
    while at + 9 < bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        let next = at + 9 + length;
        match bytes[at] {
            0x06 => chunks.push((at..next, 0)),
            // Index of one topic of the chunk before: two numbers a message, after topic and length.
            0x07 => chunks.last_mut().unwrap().1 += (length - 6) / 16,
            _ => {}
        }
        at = next;
    }
    chunks
}

fn recovered(bytes: &[u8]) -> (FileRecovery, Vec<Written>) {
    let mut kept = Vec::new();
    let keep = |message: BagMessage| {
        kept.push(content(&message));
        Ok(())
    };
    let file = recover_from("damaged.mcap".as_ref(), std::io::Cursor::new(bytes), keep).unwrap();
    (file, kept)
}

/// Nothing is invented and the order is kept: what was saved is what was written, with parts left out.
fn left_out(saved: &[Written]) -> usize {
    let mut written = whole().written.iter();
    assert!(saved.iter().all(|message| written.any(|other| other == message)), "a message was invented");
    whole().written.len() - saved.len()
}

/// Messages of the chunks that damage at these bytes touches.
fn touched(damage: &Range<usize>) -> usize {
    let touches = |chunk: &Range<usize>| chunk.start < damage.end && damage.start < chunk.end;
    whole().chunks.iter().filter(|(chunk, _)| touches(chunk)).map(|(_, messages)| messages).sum()
}

#[test]
fn regress_a_chunk_that_is_missing_without_a_trace_is_told_by_the_index() {
    // All records of the rest are whole and follow each other: only the index knows better.
    let [(second, _), (third, _)] = &whole().chunks[1..3] else { panic!("{:?}", whole().chunks) };
    let mut bytes = whole().bytes.clone();
    bytes.drain(second.start..third.start);
    let (file, saved) = recovered(&bytes);
    assert!(left_out(&saved) > 0 && !file.is_complete(), "{file:?}");
    assert_eq!(file.messages_missing(), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn flipped_bytes_cost_the_chunks_they_lie_in_and_nothing_is_invented(
        at in any::<prop::sample::Index>(),
        flips in prop::collection::vec(1_u8.., 1..40),
    ) {
        let mut bytes = whole().bytes.clone();
        let at = at.index(bytes.len() - flips.len());
        for (byte, flip) in bytes[at..].iter_mut().zip(&flips) {
            *byte ^= flip;
        }
        let (file, saved) = recovered(&bytes);
        let lost = left_out(&saved);
        prop_assert!(lost <= touched(&(at..at + flips.len())), "{lost} lost: {file:?}");
        prop_assert!(lost == 0 || !file.is_complete());
        prop_assert!(file.messages_missing().is_none_or(|missing| missing == lost as u64));
    }

    #[test]
    fn a_cut_costs_what_comes_after_and_a_flip_before_it_its_own_chunk(
        at in any::<prop::sample::Index>(),
        cut in any::<prop::sample::Index>(),
        flip in prop::option::of(1_u8..),
    ) {
        let mut bytes = whole().bytes.clone();
        bytes.truncate(cut.index(bytes.len()).max(8));
        let at = at.index(bytes.len());
        bytes[at] ^= flip.unwrap_or(0);
        let (file, saved) = recovered(&bytes);
        let after = touched(&(bytes.len()..whole().bytes.len()));
        let damaged = if flip.is_some() { touched(&(at..at + 1)) } else { 0 };
        let lost = left_out(&saved);
        prop_assert!(lost <= after + damaged, "{lost} lost: {file:?}");
        prop_assert!(!file.is_complete(), "a file without its end is never taken for whole");
    }

    #[test]
    fn inserted_bytes_cost_the_chunk_they_split(
        at in any::<prop::sample::Index>(),
        inserted in prop::collection::vec(any::<u8>(), 1..300),
    ) {
        let mut bytes = whole().bytes.clone();
        let at = at.index(bytes.len());
        bytes.splice(at..at, inserted);
        let (file, saved) = recovered(&bytes);
        let lost = left_out(&saved);
        // Between bytes at - 1 and at: a chunk that begins here is not split.
        let split = whole().chunks.iter().filter(|(chunk, _)| chunk.start < at && at < chunk.end);
        let most: usize = split.map(|(_, messages)| *messages).sum();
        prop_assert!(lost <= most, "{lost} lost: {file:?}");
        prop_assert!(lost == 0 || !file.is_complete());
    }

    #[test]
    fn missing_bytes_cost_the_chunks_they_lay_in(
        at in any::<prop::sample::Index>(),
        count in 1_usize..3000,
    ) {
        let mut bytes = whole().bytes.clone();
        let at = at.index(bytes.len());
        let count = count.min(bytes.len() - at);
        bytes.drain(at..at + count);
        let (file, saved) = recovered(&bytes);
        let lost = left_out(&saved);
        // The definition of a topic that lay in both its places is missing for the chunks after, unless the index is left.
        let most = if file.messages_named.is_some() { touched(&(at..at + count)) } else { usize::MAX };
        prop_assert!(lost <= most, "{lost} lost: {file:?}");
        prop_assert!(lost == 0 || !file.is_complete());
    }
}
