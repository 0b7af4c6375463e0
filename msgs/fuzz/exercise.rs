//! What every parser of this crate must survive: any bytes at all, without a panic.
//!
//! Shared by the fuzz targets beside this file and by the property tests of the crate.

use std::path::Path;

use abbe_msgs::{
    CorrectedCoordinates, Message, RangeResidual, RosType, ScaleReading, TracerReading, bag, cdr, standard,
};

/// Reads the bytes as a bag and decodes every message as every type.
pub fn read_bag(bytes: &[u8]) {
    for message in bag::messages_from(Path::new("any.mcap"), bytes) {
        let Ok(message) = message else { return };
        let _ = message.decode::<ScaleReading>();
        decode_cdr(&message.cdr);
    }
}

/// Recovers what the bytes hold as a bag.
pub fn recover_bag(bytes: &[u8]) {
    let mut kept = 0;
    let recovery = bag::recover_from(Path::new("any.mcap"), std::io::Cursor::new(bytes), |_| {
        kept += 1;
        Ok(())
    });
    let Ok(file) = recovery else { return };
    assert_eq!(file.messages_saved, kept);
    assert!(file.faults.iter().all(|fault| !fault.to_string().is_empty()));
}

/// Decodes the bytes as every message; what decodes must encode and decode to the same again.
pub fn decode_cdr(bytes: &[u8]) {
    decode_sample::<ScaleReading>(bytes);
    decode_sample::<TracerReading>(bytes);
    decode_sample::<CorrectedCoordinates>(bytes);
    decode_sample::<RangeResidual>(bytes);
    decode_ros::<standard::Header>(bytes);
    decode_ros::<standard::PointStamped>(bytes);
    decode_ros::<standard::JointState>(bytes);
    decode_ros::<standard::DiagnosticArray>(bytes);
}

fn decode_sample<M: Message>(bytes: &[u8]) {
    let Some(ros) = decode_ros::<M::Ros>(bytes) else {
        return;
    };
    // A sample that is taken must keep everything the message held. Compared as bytes, because a
    // reading may be NaN.
    if let Ok(sample) = M::from_ros(ros.clone()) {
        assert_eq!(cdr::encode(&sample.to_ros()).ok(), cdr::encode(&ros).ok());
    }
}

fn decode_ros<R: RosType>(bytes: &[u8]) -> Option<R> {
    let ros = cdr::decode::<R>(bytes).ok()?;
    let written = cdr::encode(&ros).ok()?;
    let again = cdr::decode::<R>(&written).ok();
    assert_eq!(again.and_then(|ros| cdr::encode(&ros).ok()), Some(written));
    Some(ros)
}
