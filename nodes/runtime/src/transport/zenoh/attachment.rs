//! What rmw_zenoh sends beside a message: who sent it, its number, and when.
//!
//! Place in the flow: made by the writer, read as the message arrives. Without it a message has no number by which a loss
//! would show, so it is refused.
//!
//! Source: rmw_zenoh_cpp, `AttachmentData`, serialised by zenoh-ext: number and time (ns since 1970) as `i64`, little endian,
//! then the identity of the sender behind its length. Versions 0.2.0 to 0.2.3 (the first of Jazzy) put the name of each
//! field, behind its length, before it; both are read, the later form is written.

/// Number of the fields' bytes where the identity has 16.
const LENGTH: usize = 33;
/// Bytes of an identity.
const GID: u8 = 16;
/// Names of the fields in the earlier form.
const NAMES: [&str; 3] = ["sequence_number", "source_timestamp", "source_gid"];

/// Number, time and sender of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Attachment {
    /// Counts the messages of one publisher from 1.
    pub(super) number: i64,
    /// When it was sent (ns since 1970).
    pub(super) sent_ns: i64,
    /// The publisher.
    pub(super) gid: [u8; GID as usize],
}

impl Attachment {
    pub(super) fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(LENGTH);
        bytes.extend(self.number.to_le_bytes());
        bytes.extend(self.sent_ns.to_le_bytes());
        bytes.push(GID);
        bytes.extend(self.gid);
        bytes
    }

    /// Nothing where the bytes are none of the two forms.
    pub(super) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        read(bytes, [""; 3]).or_else(|| read(bytes, NAMES))
    }
}

fn read(bytes: &[u8], names: [&str; 3]) -> Option<Attachment> {
    let (number, rest) = bytes_of(named(bytes, names[0])?)?;
    let (sent_ns, rest) = bytes_of(named(rest, names[1])?)?;
    let gid = named(rest, names[2])?.strip_prefix(&[GID])?;
    let attachment = Attachment {
        number: i64::from_le_bytes(number),
        sent_ns: i64::from_le_bytes(sent_ns),
        gid: gid.try_into().ok()?,
    };
    (attachment.number >= 0).then_some(attachment)
}

/// What follows a name and its length; all where there is none.
fn named<'a>(bytes: &'a [u8], name: &str) -> Option<&'a [u8]> {
    if name.is_empty() {
        return Some(bytes);
    }
    bytes.strip_prefix(&[u8::try_from(name.len()).ok()?])?.strip_prefix(name.as_bytes())
}

fn bytes_of(bytes: &[u8]) -> Option<([u8; 8], &[u8])> {
    bytes.split_first_chunk().map(|(first, rest)| (*first, rest))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn attachment() -> Attachment {
        Attachment { number: 7, sent_ns: 0x0102_0304_0506_0708, gid: [0xab; 16] }
    }

    #[test]
    fn it_is_written_as_rmw_zenoh_writes_it_and_read_in_either_form() {
        let bytes = attachment().to_bytes();
        let expected = [&[7, 0, 0, 0, 0, 0, 0, 0, 8, 7, 6, 5, 4, 3, 2, 1, 16][..], &[0xab; 16]].concat();
        assert_eq!(bytes, expected);
        assert_eq!(Attachment::from_bytes(&bytes), Some(attachment()));
        let [number, time, gid] = NAMES.map(|name| [&[name.len() as u8], name.as_bytes()].concat());
        let earlier = [&number, &bytes[..8], &time, &bytes[8..16], &gid, &bytes[16..]].concat();
        assert_eq!(earlier.len(), 77);
        assert_eq!(Attachment::from_bytes(&earlier), Some(attachment()));
    }

    #[test]
    fn what_is_too_long_too_short_or_of_a_negative_number_is_none() {
        let bytes = attachment().to_bytes();
        assert_eq!(Attachment::from_bytes(&bytes[..32]), None);
        assert_eq!(Attachment::from_bytes(&[&bytes[..], &[0]].concat()), None);
        assert_eq!(Attachment::from_bytes(&Attachment { number: -1, ..attachment() }.to_bytes()), None);
        assert_eq!(Attachment::from_bytes(&[]), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            if let Some(found) = Attachment::from_bytes(&bytes) {
                prop_assert!(found.number >= 0);
            }
        }
    }
}
