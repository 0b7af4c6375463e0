//! A residual model comes back bit for bit; one of another machine, model, layout or with one bit changed is refused.
//! Residual vectors come back from a file with what they are of.

use abbe_files::{
    DataSource, FileError, LoadedResidual, ResidualFile, ResidualOrigin, ResidualOwner, hex, read_residual_origin,
    read_residual_vectors_file, write_residual_vectors,
};
use abbe_geometry::Vector3;
use abbe_geometry::effects::NoCovariates;
use abbe_geometry::residual_field::ResidualField;
use abbe_measurement::residual_vector::ResidualVector;
use abbe_residual_net::ResidualModel;
use abbe_residual_net::record::{Array, Record};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

const MODEL: [u8; 32] = [0xab; 32];

fn load(bytes: &[u8]) -> Result<(ResidualFile, [u8; 32]), FileError> {
    ResidualFile::from_bytes(bytes, "r.json")
}

/// A small field by kriging, with numbers that use all digits.
fn record() -> Record {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut numbers =
        |count: usize, scale: f64| -> Vec<f64> { (0..count).map(|_| scale * rng.random_range(-1.0..1.0)).collect() };
    let points: Vec<f64> =
        (0..27).flat_map(|k| [f64::from(k % 3) * 0.4, f64::from(k / 3 % 3) * 0.3, f64::from(k / 9) * 0.31]).collect();
    let mut arrays = BTreeMap::from([
        ("point_m".to_owned(), Array { shape: vec![27, 3], values: points }),
        ("residual_m".to_owned(), Array { shape: vec![27, 3], values: numbers(81, 1e-6) }),
        ("calibration".to_owned(), Array { shape: vec![3], values: vec![1.1, 0.9, 1.05] }),
    ]);
    let mut scalars = BTreeMap::new();
    for axis in ["x", "y", "z"] {
        arrays.insert(format!("length_{axis}_m"), Array { shape: vec![3], values: vec![0.31, 0.27, 0.41] });
        arrays.insert(format!("weights_{axis}_per_m"), Array { shape: vec![27], values: numbers(27, 0.7) });
        scalars.extend([
            (format!("signal_{axis}_m"), 1.3e-6),
            (format!("noise_{axis}_m"), 2.1e-7),
            (format!("seen_{axis}"), 0.6),
            (format!("trend_{axis}_m"), 1e-7),
        ]);
    }
    let texts = BTreeMap::from([("kernel".to_owned(), "matern-5/2".to_owned())]);
    Record { kind: "kriging".to_owned(), numbers: scalars, texts, arrays }
}

fn file() -> ResidualFile {
    ResidualFile {
        model: ResidualModel::from_record(record()).unwrap(),
        owner: Some(ResidualOwner { machine: "bridge_xyz".to_owned(), model_sha256: MODEL }),
        data: vec![DataSource { file: "residuals.csv".to_owned(), sha256: "12".repeat(32) }],
        seed: 7,
        complete: true,
        config: serde_json::json!({ "epochs": 100 }),
        validation: serde_json::json!({ "mse_um2": 0.25 }),
        software: "abbe 0.1.0".to_owned(),
    }
}

/// The file with the text of its content changed and the hash made right again.
fn forged(change: impl Fn(&str) -> String) -> Vec<u8> {
    let text = String::from_utf8(file().to_bytes("r").unwrap().0).unwrap();
    let start = text.find("\"residual\":").unwrap() + 11;
    let body = change(&text[start..text.len() - 1]);
    assert_ne!(body, text[start..text.len() - 1], "nothing was changed");
    let hash = hex(&Sha256::digest(body.as_bytes()));
    format!("{{\"format\":\"abbe-residual\",\"version\":2,\"sha256\":\"{hash}\",\"residual\":{body}}}").into_bytes()
}

#[track_caller]
fn refused(bytes: &[u8], parts: &[&str]) {
    let message = load(bytes).err().unwrap().to_string();
    assert!(message.starts_with("r.json"), "{message}");
    parts.iter().for_each(|part| assert!(message.contains(part), "{message:?} does not say {part:?}"));
}

#[test]
fn what_its_own_training_says_against_a_model_is_known() {
    let mut file = file();
    assert_eq!(file.doubts().count(), 0);
    file.validation = serde_json::json!({"recommendation": {"method": "zero"}});
    file.complete = false;
    let said: Vec<_> = file.doubts().collect();
    assert!(said[0].contains("no residual model") && said[1].contains("--resume"), "{said:?}");
}

#[test]
fn a_residual_model_comes_back_bit_for_bit_and_predicts_the_same_bits() {
    let (bytes, digest) = file().to_bytes("r").unwrap();
    let (after, digest_read) = load(&bytes).unwrap();
    assert_eq!(after.model.to_record(), file().model.to_record());
    assert_eq!((after.owner.clone(), after.seed, after.complete), (file().owner, 7, true));
    assert_eq!((&after.data, &after.config, &after.validation), (&file().data, &file().config, &file().validation));
    assert_eq!((digest_read, after.to_bytes("r").unwrap().0), (digest, bytes), "the same model gives the same bytes");
    let point_m = Vector3::new(0.123, 0.234, 0.345);
    let loaded = LoadedResidual::new(after.model, digest_read);
    assert_eq!(loaded.predict(&point_m, &NoCovariates).unwrap(), file().model.predict(point_m.as_slice()));
    assert_eq!(loaded.sha256(), digest);
}

#[test]
fn every_residual_model_says_what_its_numbers_mean() {
    let text = String::from_utf8(file().to_bytes("r").unwrap().0).unwrap();
    for part in ["error = actual - indicated", "SI: m, machine frame", "belongs_to", "bridge_xyz", "validation", "seed"]
    {
        assert!(text.contains(part), "{part}");
    }
}

#[test]
fn only_the_machine_and_the_model_that_it_belongs_to_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("residual.json");
    let digest = file().save(&path).unwrap();
    assert_eq!(ResidualFile::load_for_model(&path, "bridge_xyz", &MODEL).unwrap().1, digest);
    let says = |error: FileError, parts: &[&str]| {
        let error = error.to_string();
        parts.iter().for_each(|part| assert!(error.contains(part), "{error:?} does not say {part:?}"));
    };
    let error = ResidualFile::load_for(&path, "fyxz").err().unwrap();
    says(error, &["residual.json, key belongs_to", "\"bridge_xyz\", not of \"fyxz\"", "train one"]);
    let error = ResidualFile::load_for_model(&path, "bridge_xyz", &[1; 32]).err().unwrap();
    says(error, &["key belongs_to.model_sha256", "abababab", "01010101", "train on the residuals of this model"]);
    let unowned = ResidualFile { owner: None, ..file() };
    unowned.save(&path).unwrap();
    let error = ResidualFile::load_for(&path, "bridge_xyz").err().unwrap();
    says(error, &["does not say which geometric model it belongs to", "train it again with --model"]);
}

#[test]
fn a_file_cut_off_anywhere_is_refused() {
    let (bytes, _) = file().to_bytes("r").unwrap();
    for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1, bytes.len() - 2]) {
        refused(&bytes[..length], &["cut off", "train the residual model again"]);
    }
}

#[test]
fn other_files_and_later_versions_are_refused() {
    let text = String::from_utf8(file().to_bytes("r").unwrap().0).unwrap();
    refused(text.replace("abbe-residual", "abbe-model").as_bytes(), &["key format", "abbe-model", "abbe train"]);
    refused(text.replace("\"version\":2", "\"version\":1").as_bytes(), &["key version", "version 1 is not known"]);
    refused(text.replace("\"residual\":", "\"model\":").as_bytes(), &["holds no such content"]);
    refused(text.replace("bridge_xyz", "bridge_xyy").as_bytes(), &["key sha256", "does not match its hash"]);
}

#[test]
fn another_layout_is_refused_even_with_the_right_hash() {
    let cases: [(&str, &str, &[&str]); 9] = [
        ("\"kind\": \"kriging\"", "\"kind\": \"oracle\"", &["key predictor", "oracle"]),
        ("\"signal_x_m\"", "\"signal_w_m\"", &["key predictor", "signal_x_m"]),
        ("\"weights_z_per_m\"", "\"weights_w_per_m\"", &["key predictor", "weights_z_per_m"]),
        ("\"matern-5/2\"", "\"linear\"", &["key predictor", "linear"]),
        ("error = actual - indicated, of", "error = indicated - actual, of", &["key sign_convention"]),
        ("SI: m, machine frame", "mm, machine frame", &["key units"]),
        ("\"seed\": 7", "\"seeds\": 7", &["unknown field `seeds`"]),
        ("\"complete\": true", "\"complete\": 1", &["invalid type", "expected a boolean"]),
        ("abababab", "xyzxyzab", &["key belongs_to.model_sha256", "64 hexadecimal digits"]),
    ];
    for (from, to, parts) in cases {
        refused(&forged(|body| body.replacen(from, to, 1)), parts);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn a_flipped_bit_is_refused(position in any::<prop::sample::Index>(), bit in 0u32..8) {
        static BYTES: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
        let mut bytes = BYTES.get_or_init(|| file().to_bytes("r").unwrap().0).clone();
        let index = position.index(bytes.len());
        bytes[index] ^= 1u8 << bit;
        prop_assert!(load(&bytes).is_err(), "bit {} of byte {} went unnoticed", bit, index);
    }
}

fn vectors() -> Vec<ResidualVector> {
    let row = |k: u8| ResidualVector {
        position_m: [0.1 * f64::from(k), 0.25, 0.5],
        residual_m: [1.2345e-6, -0.5e-6, f64::from(k) * 1e-7],
        u_m: Some([0.2e-6, 0.3e-6, 0.4e-6]),
        time_s: Some(f64::from(k) * 10.0),
        block: Some(format!("L{k}")),
        covariates: BTreeMap::from([("temp_air_c".to_owned(), 20.0 + f64::from(k))]),
        ..ResidualVector::default()
    };
    (0..3).map(row).collect()
}

#[test]
fn residual_vectors_come_back_with_the_model_they_are_of() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    let owner = ResidualOwner { machine: "bridge_xyz".to_owned(), model_sha256: MODEL };
    let origin = ResidualOrigin { owner, data_sha256: "34".repeat(32) };
    write_residual_vectors(&path, &vectors(), &origin, &["a note".to_owned()]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um,u_x_um,u_y_um,u_z_um,time_s,block,temp_air_c"),
        "{text}"
    );
    let rows = read_residual_vectors_file(&path).unwrap().rows;
    for (before, after) in vectors().iter().zip(&rows) {
        for d in 0..3 {
            assert!((before.position_m[d] - after.position_m[d]).abs() < 1e-10);
            assert!((before.residual_m[d] - after.residual_m[d]).abs() < 1e-13, "sign and unit");
            assert!((before.u_m.unwrap()[d] - after.u_m.unwrap()[d]).abs() < 1e-13);
        }
        assert_eq!((&before.block, before.time_s, &before.covariates), (&after.block, after.time_s, &after.covariates));
    }
    assert_eq!(read_residual_origin(&path).unwrap(), Some(origin));
}

#[test]
fn a_table_of_other_software_has_no_origin_and_a_wrong_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.csv");
    std::fs::write(&path, "# from elsewhere\nx_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um\n1,2,3,4,5,6\n").unwrap();
    assert_eq!(read_residual_origin(&path).unwrap(), None);
    let rows = read_residual_vectors_file(&path).unwrap().rows;
    assert_eq!((rows[0].position_m, rows[0].u_m), ([1e-3, 2e-3, 3e-3], None));
    std::fs::write(&path, "\n# abbe residuals machine=m model_sha256=12\nx_mm\n").unwrap();
    let error = read_residual_origin(&path).unwrap_err().to_string();
    assert!(error.contains("line 2, key model_sha256") && error.contains("64 hexadecimal digits"), "{error}");
    std::fs::write(&path, "# abbe residuals model_sha256=12\nx_mm\n").unwrap();
    let error = read_residual_origin(&path).unwrap_err().to_string();
    assert!(error.contains("key machine") && error.contains("lacks it"), "{error}");
}
