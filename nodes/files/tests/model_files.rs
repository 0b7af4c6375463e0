//! A model comes back bit for bit, and nothing but the whole, unchanged model is accepted.

use crate::common::model;
use abbe_files::{FileError, ModelFile, hex};
use abbe_geometry::machine::{Machine, Side};
use proptest::prelude::*;
use sha2::{Digest, Sha256};

fn load(bytes: &[u8]) -> Result<(ModelFile, [u8; 32]), FileError> {
    ModelFile::from_bytes(bytes, "m.json")
}

/// The file with the text of its model changed and the hash made right again.
fn forged(change: impl Fn(&str) -> String) -> Vec<u8> {
    let text = String::from_utf8(model(1).to_bytes("m").unwrap().0).unwrap();
    let start = text.find("\"model\":").unwrap() + 8;
    let body = change(&text[start..text.len() - 1]);
    assert_ne!(body, text[start..text.len() - 1], "nothing was changed");
    let hash = hex(&Sha256::digest(body.as_bytes()));
    format!("{{\"format\":\"abbe-model\",\"version\":1,\"sha256\":\"{hash}\",\"model\":{body}}}").into_bytes()
}

#[track_caller]
fn refused(bytes: &[u8], parts: &[&str]) {
    let message = load(bytes).unwrap_err().to_string();
    assert!(message.starts_with("m.json"), "{message}");
    parts.iter().for_each(|part| assert!(message.contains(part), "{message:?} does not say {part:?}"));
}

#[test]
fn a_model_comes_back_bit_for_bit() {
    for seed in 0..20 {
        let before = model(seed);
        let (bytes, digest) = before.to_bytes("m").unwrap();
        let (after, digest_read) = load(&bytes).unwrap();
        // Debug prints every number with all its digits, and a zero with its sign.
        assert_eq!(format!("{:?}", after.model.parts()), format!("{:?}", before.model.parts()));
        assert_eq!(format!("{after:?}"), format!("{before:?}"));
        assert_eq!((digest_read, after.sha256().unwrap()), (digest, digest));
        assert_eq!(after.to_bytes("m").unwrap().0, bytes, "the same model gives the same bytes");
    }
}

#[test]
fn every_model_says_what_its_numbers_mean() {
    let text = String::from_utf8(model(1).to_bytes("m").unwrap().0).unwrap();
    for part in [
        "error = actual - indicated",
        "ram reference point",
        "SI: m, rad",
        "tool_side",
        "\"EXX\"",
        "\"C0Y\"",
        "abbe 0.1.0",
    ] {
        assert!(text.contains(part), "{part}");
    }
}

#[test]
fn saving_and_loading_for_a_machine() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    let digest = model(1).save(&path).unwrap();
    let own = model(1).model.parts().machine.clone();
    assert_eq!(ModelFile::load_for(&path, &own).unwrap().1, digest);
    let other = Machine { name: "fyxz".to_owned(), ..own };
    let error = ModelFile::load_for(&path, &other).unwrap_err().to_string();
    for part in ["model.json, key machine.name", "\"bridge_xyz\"", "not of \"fyxz\"", "identify one"] {
        assert!(error.contains(part), "{error:?} does not say {part:?}");
    }
    let error = ModelFile::load(&folder.path().join("none.json")).unwrap_err().to_string();
    assert!(error.contains("none.json: cannot read the model"), "{error}");
}

#[test]
fn regress_a_machine_file_that_contradicts_the_model_is_refused_with_both_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    model(1).save(&path).unwrap();
    let own = model(1).model.parts().machine.clone();
    // What belongs to the identification may be another.
    let finer = Machine { repeatability_m: [1e-7; 3], ..own.clone() };
    ModelFile::load_for(&path, &finer).unwrap();
    let elsewhere = Machine { frame_id: "cmm_base".to_owned(), ..own.clone() };
    let mut table = own.clone();
    table.joints[0].side = Side::Workpiece;
    let mut turned = own.clone();
    turned.joints.swap(0, 1);
    let mut longer = own;
    longer.stroke_m[0].1 = 1.25;
    for (machine, parts) in [
        (elsewhere, ["model.json, key machine.frame_id", "\"bridge_xyz\"", "\"cmm_base\""]),
        (table, ["model.json, key machine.chain", "of the chain bed, X, Y, Z", "says X, bed, Y, Z"]),
        (longer, ["model.json, key machine.stroke_m", "stroke of X from 0 to 800 mm", "says 0 to 1250 mm"]),
        (turned, ["model.json, key machine.chain", "of the chain bed, X, Y, Z", "says bed, Y, X, Z"]),
    ] {
        let error = ModelFile::load_for(&path, &machine).unwrap_err().to_string();
        for part in parts.into_iter().chain(["correct the machine file, or identify the model again"]) {
            assert!(error.contains(part), "{error:?} does not say {part:?}");
        }
    }
}

#[test]
fn a_model_with_a_number_that_is_not_finite_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    let mut file = model(1);
    file.instrument.constant_m = f64::NAN;
    let error = file.save(&path).unwrap_err().to_string();
    assert!(error.contains("key instrument") && error.contains("not finite"), "{error}");
    assert!(!path.exists());
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    let (bytes, _) = model(1).to_bytes("m").unwrap();
    for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1, bytes.len() - 2]) {
        refused(&bytes[..length], &["cut off", "identify the model again"]);
    }
}

#[test]
fn other_files_and_later_versions_are_refused() {
    let (bytes, _) = model(1).to_bytes("m").unwrap();
    let text = String::from_utf8(bytes).unwrap();
    refused(text.replace("abbe-model", "abbe-report").as_bytes(), &["key format", "abbe-report", "abbe identify"]);
    refused(
        text.replace("\"version\":1", "\"version\":2,\"new\":0").as_bytes(),
        &["key version", "version 2 is not known"],
    );
    refused(b"name = \"bridge\"", &["line 1", "no model file"]);
    refused(text.replace("\"version\":1", "\"version\":1,\"extra\":0").as_bytes(), &["unknown field `extra`"]);
    refused(
        text.replace("bridge_xyz", "bridge_xyy").as_bytes(),
        &["key sha256", "does not match its hash", "copy the file again"],
    );
}

#[test]
fn a_file_of_earlier_software_that_says_nothing_of_chords_is_read() {
    let bytes = forged(|body| {
        let (before, rest) = body.split_at(body.find("\"of_chords_packed\"").unwrap());
        let after = &rest[rest.find(']').unwrap() + 1..];
        format!("{}{after}", before.trim_end().trim_end_matches(','))
    });
    let (read, whole) = (load(&bytes).unwrap().0, model(1));
    assert_eq!(read.model.parts().chord_covariance, Vec::<f64>::new());
    assert_eq!(read.model.parts().covariance, whole.model.parts().covariance);
}

/// The file as software wrote it that knew no turn of the ram: no such entry, three rows less in the covariance.
#[test]
fn a_file_of_earlier_software_that_says_nothing_of_the_ram_is_read_as_one_that_does_not_know() {
    let whole = model(1);
    let place = whole.model.layout().ram_turn();
    let without = |packed: &[f64]| -> Vec<f64> {
        let size = whole.model.machine_parameters() + 4;
        let kept = (0..size).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let kept = kept.zip(packed).filter(|((i, j), _)| !place.contains(i) && !place.contains(j));
        kept.map(|(_, value)| *value).collect()
    };
    let text = |packed: &[f64]| serde_json::to_string(packed).unwrap();
    let parts = whole.model.parts();
    let bytes = forged(|body| {
        let (before, rest) = body.split_at(body.find("\"ram_turn\"").unwrap());
        let after = rest[rest.find('}').unwrap() + 1..].trim_start_matches(',');
        let earlier = format!("{before}{}", after.trim_start())
            .replace("squareness, turn of the ram, effect", "squareness, effect");
        let earlier = earlier.replace(&text(&parts.covariance), &text(&without(&parts.covariance)));
        let earlier = earlier.replace(&text(&parts.chord_covariance), &text(&without(&parts.chord_covariance)));
        // Nor of expansions that nobody saw.
        let absorbed = &parts.quality.unseen_expansions.absorbed[0];
        let earlier = earlier.replace(&text(absorbed), &text(&vec![0.0; absorbed.len()]));
        let (before, rest) = earlier.split_at(earlier.find("\"u_ram_turn_rad\"").unwrap());
        format!("{before}{}", rest[rest.find("],").unwrap() + 2..].trim_start())
    });
    let read = load(&bytes).unwrap().0.model;
    // Zero about the middle of the offsets, as uncertain as a ram that nobody measured; everything else is as it was.
    assert_eq!(read.parts().offset_centre_m, [0.0; 3]);
    assert_eq!(read.ram_turn(), [(0.0, abbe_geometry::machine::USUAL_RAM_TURN_RAD); 3]);
    assert_eq!(without(&read.parts().covariance), without(&parts.covariance));
    assert_eq!(without(&read.parts().chord_covariance), without(&parts.chord_covariance));
    assert_eq!(read.parts().coefficients[..place.start], parts.coefficients[..place.start]);
    assert!(place.clone().all(|k| (0..place.start).all(|other| read.covariance(k, other) == 0.0)));
    // Written again, it is a file of this software.
    let again = ModelFile { model: read, ..model(1) };
    assert_eq!(format!("{:?}", load(&again.to_bytes("m").unwrap().0).unwrap().0), format!("{again:?}"));
}

#[test]
fn models_that_do_not_fit_together_are_refused_even_with_the_right_hash() {
    let cases: [(&str, &str, &[&str]); 11] = [
        ("\"reversal\"", "\"revresal\"", &["key effects.revresal", "unknown effect", "known are", "reversal"]),
        ("\"EXX\": {", "\"EXW\": {", &["key error_functions.EXX", "missing"]),
        ("\"C0Y\": {", "\"C1Y\": {", &["C0Y in rad is missing"]),
        ("error = actual - indicated, of", "error = indicated - actual, of", &["key sign_convention"]),
        ("\"packed\": [", "\"packed\": [0.5,", &["covariance holds", "numbers, but"]),
        ("\"of_chords_packed\": [", "\"of_chords_packed\": [0.5,", &["covariance of chords holds", "numbers, but"]),
        ("\"degree\": 2", "\"degree\": 3", &["coefficients in", "are needed for this machine"]),
        ("\"degree\": 2", "\"degree\": 99", &["degree 1 to 10"]),
        ("\"unit\": \"rad\"", "\"unit\": \"deg\"", &["deg"]),
        ("\"temp_y_c\"", "\"temp\\nN1851 Y 99\"", &["key effects", "holds a control character"]),
        ("\"seed\": 7", "\"seeds\": 7", &["unknown field `seeds`"]),
    ];
    for (from, to, parts) in cases {
        refused(&forged(|body| body.replacen(from, to, 1)), parts);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_flipped_bit_is_refused(position in any::<prop::sample::Index>(), bit in 0u32..8) {
        static BYTES: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
        let mut bytes = BYTES.get_or_init(|| model(1).to_bytes("m").unwrap().0).clone();
        let index = position.index(bytes.len());
        bytes[index] ^= 1u8 << bit;
        prop_assert!(load(&bytes).is_err(), "bit {} of byte {} went unnoticed", bit, index);
    }

    /// What no hash protects from: text that was changed and hashed again is refused or makes sense, without panic.
    #[test]
    fn a_changed_model_with_the_right_hash_never_panics(
        position in any::<prop::sample::Index>(),
        byte in prop::sample::select(b"0123456789-e.,[]{}\"XYZ".to_vec()),
    ) {
        static BODY: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
        let body = BODY.get_or_init(|| {
            let bytes = model(1).to_bytes("m").unwrap().0;
            let start = bytes.windows(8).position(|window| window == b"\"model\":").unwrap() + 8;
            // Nearly all of a model is its covariance; leaving it out lets changes fall on what has structure.
            let end = bytes.windows(8).position(|window| window == b"\"packed\"").unwrap();
            [&bytes[start..end], b"\"packed\": []}}"].concat()
        });
        let mut body = body.clone();
        let index = position.index(body.len());
        body[index] = byte;
        let hash = hex(&Sha256::digest(&body));
        let mut file = format!("{{\"format\":\"abbe-model\",\"version\":1,\"sha256\":\"{hash}\",\"model\":").into_bytes();
        file.extend(body);
        file.push(b'}');
        prop_assert!(load(&file).is_err(), "a model without covariance was accepted");
    }
}
