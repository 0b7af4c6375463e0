//! The pieces of RTPS 2.5 that packets of our own are made of, beside those of the DDS library.
//!
//! Place in the flow: under [`super::writer`], which acknowledges in the name of readers that lag, and [`super::first_call`], which asks for a
//! sample once more. Everything is little endian.

const PROTOCOL: [u8; 2] = [2, 4];
const VENDOR: [u8; 2] = [0x01, 0x12];
const ACKNACK: u8 = 0x06;
/// Little endian.
pub(super) const ENDIANNESS: u8 = 0b01;
/// For an ACKNACK: no answer is asked for.
const FINAL: u8 = 0b10;

/// Bytes of the part of a GUID that names the participant.
pub(super) const PREFIX: usize = 12;

/// Who speaks: version of the protocol, maker, participant (section 8.3.7, and within INFO_SRC).
pub(super) fn speaker(prefix: &[u8]) -> Vec<u8> {
    [&PROTOCOL, &VENDOR, prefix].concat()
}

/// The head of a packet.
pub(super) fn head(prefix: &[u8]) -> Vec<u8> {
    [b"RTPS".as_slice(), &speaker(prefix)].concat()
}

/// An ACKNACK (section 8.3.8.1) from a reader to a writer: it has all samples before `base`; `lacks_base` asks for that one.
pub(super) fn acknack(reader: &[u8; 16], writer: &[u8; 16], base: u64, lacks_base: bool, count: i32) -> Vec<u8> {
    let lacking: &[u32] = if lacks_base { &[1 << 31] } else { &[] };
    let mut body = [&reader[PREFIX..], &writer[PREFIX..]].concat();
    body.extend(((base >> 32) as u32).to_le_bytes());
    body.extend((base as u32).to_le_bytes());
    body.extend((lacking.len() as u32).to_le_bytes());
    body.extend(lacking.iter().flat_map(|bits| bits.to_le_bytes()));
    body.extend(count.to_le_bytes());
    let mut submessage = vec![ACKNACK, ENDIANNESS | FINAL];
    submessage.extend((body.len() as u16).to_le_bytes());
    submessage.extend(body);
    submessage
}
