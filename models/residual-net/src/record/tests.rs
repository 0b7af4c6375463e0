//! Laws of a record: what is written comes back, and what is damaged does not.

use super::*;
use crate::model::tests::{random_model, warm_model};

#[test]
fn a_model_read_back_predicts_the_same_bits() {
    for kind in ResidualMethod::ALL {
        let model = random_model(kind, 7);
        let again = ResidualModel::from_record(model.to_record()).unwrap();
        assert_eq!(again.to_record(), model.to_record());
        for k in 0..50 {
            let at = Vector3::new(f64::from(k) * 0.013, f64::from(k) * 0.011, 0.3);
            assert_eq!(again.predict(at.as_slice()), model.predict(at.as_slice()));
        }
    }
}

#[test]
fn every_entry_is_needed_and_no_other_is_taken() {
    for kind in [ResidualMethod::KrigingNetwork, ResidualMethod::PerceptronKriging] {
        every_entry_of(kind);
    }
}

fn every_entry_of(kind: ResidualMethod) {
    let whole = random_model(kind, 8).to_record();
    for name in whole.numbers.keys() {
        let mut record = whole.clone();
        record.numbers.remove(name);
        assert_eq!(ResidualModel::from_record(record).unwrap_err(), RecordError::Missing(name.clone()));
    }
    for name in whole.texts.keys() {
        let mut record = whole.clone();
        record.texts.insert(name.clone(), "of another kind".into());
        assert!(matches!(ResidualModel::from_record(record), Err(RecordError::Text { .. })), "{name}");
    }
    for name in whole.arrays.keys() {
        let mut record = whole.clone();
        record.arrays.remove(name);
        assert_eq!(ResidualModel::from_record(record).unwrap_err(), RecordError::Missing(name.clone()));
        let mut record = whole.clone();
        record.arrays.entry(name.clone()).and_modify(|array| array.values.truncate(2));
        assert!(matches!(ResidualModel::from_record(record), Err(RecordError::Shape { .. })), "{name}");
    }
    let mut record = whole.clone();
    record.numbers.insert("momentum".into(), 1.0);
    assert_eq!(ResidualModel::from_record(record).unwrap_err(), RecordError::Unknown("momentum".into()));
    let mut record = whole.clone();
    record.kind = "kriging".into();
    assert!(matches!(ResidualModel::from_record(record), Err(RecordError::Unknown(_))));
    let mut record = whole;
    record.kind = "oracle".into();
    assert_eq!(ResidualModel::from_record(record).unwrap_err(), RecordError::Kind("oracle".into()));
}

#[test]
fn sizes_that_are_none_and_weights_that_are_no_numbers_are_refused() {
    let whole = random_model(ResidualMethod::Network, 9).to_record();
    for (name, value) in [("width", 8.5), ("heads", -1.0), ("heads", 3.0), ("members", 1e300), ("width", f64::NAN)] {
        let mut record = whole.clone();
        record.numbers.insert(name.into(), value);
        assert!(ResidualModel::from_record(record).is_err(), "{name} {value}");
    }
    for value in [f64::NAN, f64::INFINITY, 0.1] {
        let mut record = whole.clone();
        record.arrays.entry("member_1".into()).and_modify(|array| array.values[5] = value);
        let error = ResidualModel::from_record(record).unwrap_err();
        assert!(matches!(error, RecordError::Parameters { member: 1, .. }), "{value}: {error}");
    }
}

#[test]
fn inputs_come_back_by_name_with_scale_and_range_and_a_plain_model_has_no_word_of_them() {
    for kind in ResidualMethod::ALL {
        let model = warm_model(kind, 7);
        let record = model.to_record();
        assert_eq!((record.texts["input_3"].as_str(), record.arrays["input_scale"].values[3]), ("temp_air_c", 6.0));
        assert_eq!(record.arrays["input_high"].values[3], 22.0);
        assert!(!record.arrays.contains_key("point_m") && record.arrays["length_x"].shape == [4]);
        let again = ResidualModel::from_record(record.clone()).unwrap();
        assert_eq!(again.to_record(), record);
        let at = [0.2, 0.3, 0.1, 20.7];
        assert_eq!(again.predict(&at), model.predict(&at));
        let mut moved = record.clone();
        moved.arrays.entry("input_low".into()).and_modify(|low| low.values[3] = 10.0);
        assert_eq!(ResidualModel::from_record(moved).unwrap_err(), RecordError::Range);
        let mut nameless = record;
        nameless.texts.remove("input_3");
        assert!(matches!(ResidualModel::from_record(nameless), Err(RecordError::Shape { .. })));
        let plain = random_model(kind, 7).to_record();
        let of_inputs = |name: &String| name.starts_with("input");
        assert!(!plain.arrays.keys().chain(plain.texts.keys()).any(of_inputs));
    }
}
