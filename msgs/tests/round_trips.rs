//! Samples survive sample -> ROS -> CDR -> ROS -> sample, and nothing less than a whole message is
//! taken for one.

use crate::common;
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, Covariates, Message, RangeResidual, ResidualStatus, RosType, ScaleReading,
    Sha256, Stamp, Text, TracerReading, cdr, standard,
};
use proptest::prelude::*;

fn stamps() -> impl Strategy<Value = Stamp> {
    (any::<i32>(), 0..1_000_000_000_u32).prop_map(|(sec, ns)| Stamp::new(sec, ns).unwrap())
}

fn texts<const N: usize>() -> impl Strategy<Value = Text<N>> {
    prop::collection::vec(prop::char::range('\u{1}', '\u{2fff}'), 0..=N).prop_map(|letters| {
        let mut text = String::new();
        for letter in letters {
            if text.len() + letter.len_utf8() <= N {
                text.push(letter);
            }
        }
        Text::new(&text).unwrap()
    })
}

fn finite() -> impl Strategy<Value = f64> {
    prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO
}

fn hashes() -> impl Strategy<Value = Sha256> {
    any::<[u8; 32]>().prop_map(Sha256::from_bytes)
}

fn covariates() -> impl Strategy<Value = Covariates> {
    prop::collection::btree_map("[a-z_]{1,32}", (finite(), finite()), 0..=32).prop_map(|entries| {
        let mut table = Covariates::new();
        for (name, (value, age_s)) in entries {
            table.push(&name, value, age_s).unwrap();
        }
        table
    })
}

prop_compose! {
    // Readings may be anything, NaN included: the corrector is to answer those.
    fn scale_readings()(
        stamp in stamps(), sequence: u64, reading_m: [f64; 3], offset_m: [f64; 3],
        covariates in covariates(), frame_id in texts(),
    ) -> ScaleReading {
        ScaleReading { stamp, sequence, reading_m, offset_m, covariates, frame_id }
    }
}

prop_compose! {
    fn tracer_readings()(
        stamp in stamps(), sequence: u64, length_m in finite(), u in finite(),
        frame_id in texts(), station in texts(), line in texts(),
    ) -> TracerReading {
        TracerReading { stamp, sequence, length_m, u_length_m: u.abs(), frame_id, station, line }
    }
}

prop_compose! {
    fn corrected_coordinates()(
        stamp in stamps(), sequence: u64, vectors in prop::array::uniform6([finite(), finite(), finite()]),
        covariance_m2 in prop::array::uniform9(finite()), model_sha256 in hashes(),
        residual_model_sha256 in hashes(), frame_id in texts(),
        status in prop::sample::select(CorrectionStatus::ALL.as_slice()), free: bool,
    ) -> CorrectedCoordinates {
        let [reading_m, offset_m, geometric, effect, residual, corrected_m] = vectors;
        CorrectedCoordinates {
            stamp, sequence, reading_m, offset_m, geometric_correction_m: geometric,
            effect_correction_m: effect, residual_correction_m: residual, corrected_m,
            covariance_m2, model_sha256, residual_model_sha256, frame_id, status,
            corrected_valid: match status {
                CorrectionStatus::InVolume
                | CorrectionStatus::Extrapolated
                | CorrectionStatus::OutOfOrder
                | CorrectionStatus::OtherPublisher => true,
                CorrectionStatus::Rejected
                | CorrectionStatus::NoModel
                | CorrectionStatus::OtherFrame
                | CorrectionStatus::SeveralSources
                | CorrectionStatus::Inactive => false,
                CorrectionStatus::CovariateMissing | CorrectionStatus::Stale => free,
            },
        }
    }
}

prop_compose! {
    fn range_residuals()(
        stamp in stamps(), sequence: u64, lengths in [finite(), finite(), finite(), finite()],
        model_sha256 in hashes(), frame_id in texts(), station in texts(),
        status in prop::sample::select(ResidualStatus::ALL.as_slice()),
    ) -> RangeResidual {
        let [measured_length_m, predicted_length_m, residual_m, u] = lengths;
        RangeResidual {
            stamp, sequence, measured_length_m, predicted_length_m, residual_m,
            u_residual_m: u.abs(), model_sha256, frame_id, station, status,
            residual_valid: matches!(status, ResidualStatus::Consistent | ResidualStatus::OutOfBounds),
        }
    }
}

/// Compares by bytes, so that NaN and the sign of zero count.
fn assert_round_trip<M: Message>(sample: &M) {
    let bytes = cdr::encode(&sample.to_ros()).unwrap();
    let back = M::from_ros(cdr::decode(&bytes).unwrap()).unwrap();
    assert_eq!(cdr::encode(&back.to_ros()).unwrap(), bytes);
    assert_eq!((back.stamp(), back.sequence()), (sample.stamp(), sample.sequence()));
}

proptest! {
    #[test]
    fn scale_readings_survive(sample in scale_readings()) {
        assert_round_trip(&sample);
    }

    #[test]
    fn tracer_readings_survive(sample in tracer_readings()) {
        assert_round_trip(&sample);
        let back = TracerReading::from_ros(sample.to_ros());
        prop_assert_eq!(back, Ok(sample));
    }

    #[test]
    fn corrected_coordinates_survive(sample in corrected_coordinates()) {
        assert_round_trip(&sample);
        let back = CorrectedCoordinates::from_ros(sample.to_ros());
        prop_assert_eq!(back, Ok(sample));
    }

    #[test]
    fn range_residuals_survive(sample in range_residuals()) {
        assert_round_trip(&sample);
        let back = RangeResidual::from_ros(sample.to_ros());
        prop_assert_eq!(back, Ok(sample));
    }

    #[test]
    fn stamps_survive_nanoseconds(stamp in stamps()) {
        prop_assert_eq!(Stamp::from_nanos(stamp.to_nanos()), Ok(stamp));
    }

    // Within 2^22 s (48 days) an f64 resolves better than half a nanosecond.
    #[test]
    fn near_stamps_survive_seconds(nanos in -4_194_304_000_000_000_i64..4_194_304_000_000_000) {
        let stamp = Stamp::from_nanos(nanos).unwrap();
        prop_assert_eq!(Stamp::from_seconds(stamp.to_seconds()), Ok(stamp));
    }
}

fn assert_no_part_is_taken_for_the_whole<R: RosType>(ros: &R) {
    let bytes = cdr::encode(ros).unwrap();
    for length in 0..bytes.len() {
        let part = cdr::decode::<R>(&bytes[..length]);
        assert!(part.is_err(), "{} cut off at {length}", R::ROS_TYPE);
    }
    let mut longer = bytes.clone();
    longer.extend([0; 3]);
    assert_eq!(cdr::decode::<R>(&longer).unwrap(), *ros, "padding is allowed");
    longer.push(0);
    assert!(cdr::decode::<R>(&longer).is_err(), "more than padding is not");
}

#[test]
fn messages_cut_off_at_any_byte_are_errors() {
    assert_no_part_is_taken_for_the_whole(&common::scales().to_ros());
    assert_no_part_is_taken_for_the_whole(&ScaleReading::default().to_ros());
    assert_no_part_is_taken_for_the_whole(&common::tracer().to_ros());
    assert_no_part_is_taken_for_the_whole(&common::corrected().to_ros());
    assert_no_part_is_taken_for_the_whole(&common::residual().to_ros());
    assert_no_part_is_taken_for_the_whole(&common::point());
    assert_no_part_is_taken_for_the_whole(&common::joints());
    assert_no_part_is_taken_for_the_whole(&common::diagnostics());
}

#[test]
fn both_byte_orders_are_read_and_other_encodings_named() {
    let time = standard::Time { sec: 1, nanosec: 2 };
    assert_eq!(cdr::decode::<standard::Time>(&[0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]).unwrap(), time);
    assert_eq!(cdr::decode::<standard::Time>(&[0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]).unwrap(), time);
    let xcdr2 = cdr::decode::<standard::Time>(&[0, 7, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    assert!(xcdr2.unwrap_err().to_string().contains("0x0007"));
}
