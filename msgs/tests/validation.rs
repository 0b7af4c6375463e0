//! What arrives is checked: each way a message can be wrong is refused by name, and the standard
//! messages never carry what is not there.

use crate::common;
use abbe_msgs::standard::{JointState, PointStamped};
use abbe_msgs::{
    CorrectedCoordinates, CorrectionStatus, Covariates, Message, MessageError, RangeResidual, ResidualStatus,
    ScaleReading, Sha256, Stamp, Text, TracerReading,
};

#[track_caller]
fn assert_refused<M: Message>(ros: M::Ros, words: &str) {
    let error = M::from_ros(ros).unwrap_err().to_string();
    assert!(error.contains(words), "'{error}' should contain '{words}'");
}

#[test]
fn wrong_scale_readings_are_refused() {
    let good = common::scales().to_ros();
    let mut ros = good.clone();
    ros.covariate_values.pop();
    assert_refused::<ScaleReading>(ros, "have 2, 1 and 2 entries");
    let mut ros = good.clone();
    ros.covariate_names[1] = ros.covariate_names[0].clone();
    assert_refused::<ScaleReading>(ros, "'temp_scale_x_c' occurs twice");
    let mut ros = good.clone();
    ros.covariate_values[0] = f64::NAN;
    assert_refused::<ScaleReading>(ros, "'temp_scale_x_c': value is NaN");
    let mut ros = good.clone();
    ros.covariate_age_s[0] = f64::INFINITY;
    assert_refused::<ScaleReading>(ros, "'temp_scale_x_c': age_s is inf");
    let mut ros = good.clone();
    ros.covariate_names = (0..33).map(|n| format!("c{n}_c")).collect();
    ros.covariate_values = vec![0.0; 33];
    ros.covariate_age_s = vec![0.0; 33];
    assert_refused::<ScaleReading>(ros, "more than 32 covariates");
    let mut ros = good.clone();
    ros.header.frame_id = "f".repeat(65);
    assert_refused::<ScaleReading>(ros, "header.frame_id: text of 65 bytes is longer than 64");
    let mut ros = good;
    ros.header.stamp.nanosec = 1_000_000_000;
    assert_refused::<ScaleReading>(ros, "1000000000 nanoseconds");
}

#[test]
fn a_reading_that_is_not_a_number_arrives_so_that_it_can_be_answered() {
    let mut ros = common::scales().to_ros();
    ros.reading_m[1] = f64::NAN;
    let sample = ScaleReading::from_ros(ros).unwrap();
    assert!(sample.reading_m[1].is_nan());
    let mut answer = common::corrected();
    answer.reading_m = sample.reading_m;
    answer.corrected_m = sample.reading_m;
    assert_refused::<CorrectedCoordinates>(answer.to_ros(), "reading_m is NaN");
    answer.corrected_valid = false;
    answer.status = CorrectionStatus::Rejected;
    assert!(CorrectedCoordinates::from_ros(answer.to_ros()).is_ok());
}

#[test]
fn wrong_tracer_readings_are_refused() {
    let mut ros = common::tracer().to_ros();
    ros.length_m = f64::NEG_INFINITY;
    assert_refused::<TracerReading>(ros, "length_m is -inf");
    let mut ros = common::tracer().to_ros();
    ros.u_length_m = -1.0e-7;
    assert_refused::<TracerReading>(ros, "u_length_m is -0.0000001");
    let mut ros = common::tracer().to_ros();
    ros.station = "S\0x".to_owned();
    assert_refused::<TracerReading>(ros, "station: text contains a NUL at byte 1");
}

#[test]
fn wrong_corrected_coordinates_are_refused() {
    let mut ros = common::corrected().to_ros();
    ros.status = 11;
    assert_refused::<CorrectedCoordinates>(ros, "status 11 of abbe_msgs/msg/CorrectedCoordinates");
    let mut ros = common::corrected().to_ros();
    ros.corrected_valid = false;
    assert_refused::<CorrectedCoordinates>(ros.clone(), "contradicts status EXTRAPOLATED");
    ros.status = CorrectionStatus::OtherPublisher as u8;
    assert_refused::<CorrectedCoordinates>(ros, "contradicts status OTHER_PUBLISHER");
    let mut ros = common::corrected().to_ros();
    ros.status = CorrectionStatus::NoModel as u8;
    assert_refused::<CorrectedCoordinates>(ros, "contradicts status NO_MODEL");
    for status in [CorrectionStatus::OtherFrame, CorrectionStatus::SeveralSources, CorrectionStatus::Inactive] {
        let mut ros = common::corrected().to_ros();
        ros.status = status as u8;
        assert_refused::<CorrectedCoordinates>(ros, &format!("contradicts status {}", status.name()));
        let withheld = common::corrected().withheld(status);
        assert!(CorrectedCoordinates::from_ros(withheld.to_ros()).is_ok());
        assert_eq!(withheld.corrected_point_in_machine_m(), None);
    }
    let mut ros = common::corrected().to_ros();
    ros.covariance_m2[4] = f64::NAN;
    assert_refused::<CorrectedCoordinates>(ros, "covariance_m2 is NaN");
}

#[test]
fn wrong_residuals_are_refused() {
    let mut ros = common::residual().to_ros();
    ros.status = 8;
    assert_refused::<RangeResidual>(ros, "status 8 of abbe_msgs/msg/RangeResidual");
    let mut ros = common::residual().to_ros();
    ros.status = ResidualStatus::UnknownStation as u8;
    assert_refused::<RangeResidual>(ros, "contradicts status UNKNOWN_STATION");
    let mut ros = common::residual().to_ros();
    ros.residual_m = f64::NAN;
    assert_refused::<RangeResidual>(ros, "residual_m is NaN");
}

#[test]
fn what_is_not_there_is_none() {
    let mut corrected = common::corrected();
    assert_eq!(corrected.corrected_point_in_machine_m(), Some(corrected.corrected_m));
    assert!(PointStamped::from_corrected(&corrected).is_some());
    corrected.corrected_valid = false;
    assert_eq!(corrected.corrected_point_in_machine_m(), None);
    assert_eq!(corrected.covariance_of_corrected_m2(), None);
    assert_eq!(PointStamped::from_corrected(&corrected), None);
    let mut residual = common::residual();
    assert_eq!(residual.residual(), Some((1.0e-6, 0.3e-6)));
    residual.residual_valid = false;
    assert_eq!(residual.residual(), None);
    assert_eq!(common::scales().covariates.get("temp_scale_y_c"), None);
}

#[test]
fn covariates_are_found_by_name() {
    let found = common::scales().covariates.get("temp_scale_x_c").unwrap();
    assert_eq!((found.value, found.age_s), (20.125, 0.5));
    let mut table = Covariates::new();
    let long = "c".repeat(33);
    assert!(table.push(&long, 1.0, 0.0).is_err());
    assert!(table.push("", 1.0, 0.0).is_err());
    assert!(table.is_empty(), "a refused covariate leaves no trace");
}

#[test]
fn joint_states_carry_the_scales() {
    let scales = common::scales();
    let joints = JointState::from_scales(&scales, ["x_axis", "y_axis", "z_axis"]);
    assert_eq!(joints.name, ["x_axis", "y_axis", "z_axis"]);
    assert_eq!(joints.position, scales.reading_m);
    assert_eq!(joints.header.stamp.to_stamp(), Ok(scales.stamp));
    assert!(joints.velocity.is_empty() && joints.effort.is_empty());
}

#[test]
fn seconds_become_the_nearest_nanosecond() {
    let stamp = |sec, nanosec| Stamp::new(sec, nanosec).unwrap();
    assert_eq!(Stamp::from_seconds(0.001), Ok(stamp(0, 1_000_000)));
    assert_eq!(Stamp::from_seconds(-0.25), Ok(stamp(-1, 750_000_000)));
    assert_eq!(Stamp::from_seconds(0.999_999_999_9), Ok(stamp(1, 0)));
    assert_eq!(Stamp::from_seconds(2_147_483_647.5), Ok(stamp(i32::MAX, 500_000_000)));
    assert_eq!(stamp(-1, 750_000_000).to_seconds(), -0.25);
    assert_eq!(stamp(-1, 750_000_000).to_string(), "-0.250000000");
    assert_eq!(stamp(12, 34).to_string(), "12.000000034");
    for seconds in [f64::NAN, f64::INFINITY, 2_147_483_648.0, -2_147_483_649.0] {
        let error = Stamp::from_seconds(seconds).unwrap_err();
        assert!(matches!(error, MessageError::StampRange { .. }), "{seconds}");
    }
    assert!(Stamp::from_nanos(i64::MAX).is_err());
}

#[test]
fn text_is_kept_whole_or_refused() {
    let text = Text::<4>::new("µm").unwrap();
    assert_eq!(text, "µm");
    assert_eq!(format!("{text:>4}|{text:?}"), "  µm|\"µm\"");
    assert!(Text::<4>::new("µmµ").is_err());
    assert!(Text::<4>::default().is_empty());
}

#[test]
fn hashes_are_short_for_people() {
    let hash = Sha256::of(b"abc");
    assert_eq!(hash.to_string(), "ba7816bf8f01");
    assert!(hash.to_hex().starts_with("ba7816bf8f01cfea414140de5dae2223"));
    assert_eq!(Sha256::NONE.to_string(), "none");
}
