//! Evidence for the change of a residual model in a running node: no sample is lost, each is corrected by one whole
//! residual model that belongs to the geometric model that made it, and a file that cannot be used changes nothing.

use crate::common::{HASH, bench, replace};
use abbe_files::{FileError, LoadedResidual, ResidualFile, ResidualOwner};
use abbe_graph::feed::Feed;
use abbe_graph::step::{GeometricStep, OwnedField, ResidualStep};
use abbe_msgs::cdr;
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading, Sha256};
use abbe_residual_net::ResidualModel;
use abbe_residual_net::record::{Array, Record};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

const MACHINE: &str = "bridge_xyz";
/// Longest that a change of the file may take to arrive on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(30);
/// Samples corrected after the last change.
const LAST_SAMPLES: usize = 100;

/// A field by kriging over the machine's volume; the seed makes another one.
fn residual_file(machine: &str, model_sha256: Sha256, seed: usize) -> ResidualFile {
    let wave = |k: usize, scale: f64| scale * ((k * 7 + seed * 13) as f64).sin();
    let list = |count: usize, scale: f64| (0..count).map(|k| wave(k, scale)).collect::<Vec<f64>>();
    let points = (0..27).flat_map(|k| [(k % 3) as f64 * 0.45, (k / 3 % 3) as f64 * 0.35, (k / 9) as f64 * 0.35 - 0.1]);
    let mut arrays = BTreeMap::from([
        ("point_m".to_owned(), Array { shape: vec![27, 3], values: points.collect() }),
        ("residual_m".to_owned(), Array { shape: vec![27, 3], values: list(81, 1e-6) }),
        ("calibration".to_owned(), Array { shape: vec![3], values: vec![1.0; 3] }),
    ]);
    let mut numbers = BTreeMap::new();
    for axis in ["x", "y", "z"] {
        arrays.insert(format!("length_{axis}_m"), Array { shape: vec![3], values: vec![0.3; 3] });
        arrays.insert(format!("weights_{axis}_per_m"), Array { shape: vec![27], values: list(27, 1e-6) });
        numbers.extend([
            (format!("signal_{axis}_m"), 1e-6),
            (format!("noise_{axis}_m"), 1e-7),
            (format!("seen_{axis}"), 1.0),
            (format!("trend_{axis}_m"), 1e-7),
        ]);
    }
    let texts = BTreeMap::from([("kernel".to_owned(), "matern-5/2".to_owned())]);
    let model = ResidualModel::from_record(Record { kind: "kriging".to_owned(), numbers, texts, arrays }).unwrap();
    ResidualFile {
        model,
        owner: Some(ResidualOwner { machine: machine.to_owned(), model_sha256: model_sha256.to_bytes() }),
        data: Vec::new(),
        seed: seed as u64,
        complete: true,
        config: Default::default(),
        validation: Default::default(),
        software: "test".to_owned(),
    }
}

fn load(path: &Path) -> Result<(OwnedField, Sha256), FileError> {
    let (file, owner, sha256) = ResidualFile::load_for(path, MACHINE)?;
    let field = Arc::new(LoadedResidual::new(file.model, sha256));
    Ok((OwnedField { field, model_sha256: Sha256::from_bytes(owner.model_sha256) }, Sha256::from_bytes(sha256)))
}

fn bytes(sample: &CorrectedCoordinates) -> Vec<u8> {
    cdr::encode(&sample.to_ros()).unwrap()
}

/// The campaign's readings in turn, over and over, corrected by the geometric model.
fn geometric(number: usize) -> CorrectedCoordinates {
    let step = GeometricStep::new(Some((Arc::clone(&bench().model), HASH)), 10.0);
    let reading = bench().scale(number % bench().campaign.readings.len());
    step.correct(&ScaleReading { sequence: number as u64, ..reading })
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !done() {
        assert!(Instant::now() < deadline, "{what}");
        thread::sleep(Duration::from_millis(5));
    }
}

fn folder(file: &ResidualFile) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("residual.json");
    file.save(&path).unwrap();
    (folder, path)
}

#[test]
fn every_sample_gets_one_whole_residual_model_while_they_alternate() {
    const SWAPS: usize = 6;
    let files = [residual_file(MACHINE, HASH, 1), residual_file(MACHINE, HASH, 2)];
    let (_folder, path) = folder(&files[0]);
    let ((first, _), feed) = Feed::open(&path, load).unwrap();
    let mut step = ResidualStep::new(Some(first), 1.0);
    let alone = files.each_ref().map(|file| {
        let folder = folder(file);
        ResidualStep::new(Some(load(&folder.1).unwrap().0), 1.0)
    });
    let taken = AtomicUsize::new(0);
    let samples = thread::scope(|scope| {
        scope.spawn(|| {
            for swap in 1..=SWAPS {
                files[swap % 2].save(&path).unwrap();
                wait_until("the new residual model arrives", || taken.load(Ordering::Relaxed) == swap);
            }
        });
        let mut samples = Vec::new();
        // As the node's loop does it: what is ready is taken between two samples.
        let mut last = LAST_SAMPLES;
        while last > 0 {
            if let Some((field, _)) = feed.newest() {
                step.put_in_use(field);
                taken.fetch_add(1, Ordering::Relaxed);
            }
            samples.push(step.correct(&geometric(samples.len()), None));
            last -= usize::from(taken.load(Ordering::Relaxed) == SWAPS);
            thread::sleep(Duration::from_micros(200));
        }
        samples
    });
    let by: Vec<usize> = samples
        .iter()
        .enumerate()
        .map(|(k, sample)| {
            let own = alone.iter().position(|alone| bytes(&alone.correct(&geometric(k), None)) == bytes(sample));
            let own = own.unwrap_or_else(|| panic!("sample {k} is of neither residual model"));
            assert_eq!(sample.residual_model_sha256, alone[own].residual_sha256(), "the switch shows in the stream");
            own
        })
        .collect();
    let changes = by.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert_eq!(changes, SWAPS, "one place of change a swap");
    assert!(samples.iter().enumerate().all(|(k, s)| s.sequence == k as u64), "one sample a sample, in order");
    assert!(samples.iter().all(|s| s.residual_correction_m != [0.0; 3]), "each moved");
    println!("{} samples, {changes} changes of residual model", samples.len());
}

#[test]
fn what_cannot_be_used_is_refused_by_name_and_the_residual_model_in_use_goes_on() {
    let good = residual_file(MACHINE, HASH, 1);
    let (_folder, path) = folder(&good);
    let whole = std::fs::read(&path).unwrap();
    let ((_, in_use), feed) = Feed::open(&path, load).unwrap();
    let half = whole[..whole.len() / 2].to_vec();
    let mut changed = whole.clone();
    let digit = whole.len() / 2 + whole[whole.len() / 2..].iter().position(|b| b.is_ascii_digit()).unwrap();
    changed[digit] = if whole[digit] == b'1' { b'2' } else { b'1' };
    let stranger = residual_file("moving_table", HASH, 1).to_bytes("r").unwrap().0;
    let unowned = ResidualFile { owner: None, ..residual_file(MACHINE, HASH, 3) }.to_bytes("r").unwrap().0;
    let model = bench().model_file(MACHINE).to_bytes("model").unwrap().0;
    let cases = [
        (half, "cut off"),
        (changed, "hash"),
        (stranger, "moving_table"),
        (unowned, "belongs to"),
        (model, "abbe-model"),
        (Vec::new(), "residual.json"),
    ];
    for (number, (content, says)) in cases.into_iter().enumerate() {
        replace(&path, &content);
        wait_until("the file is refused", || feed.status().refused == number as u64 + 1);
        let problem = feed.status().problem.unwrap();
        assert!(problem.contains(says) && problem.contains(&in_use.to_string()), "{problem}");
        assert_eq!((feed.status().loaded, feed.newest().is_some()), (1, false));
    }
    let sha256 = residual_file(MACHINE, HASH, 2).save(&path).unwrap();
    wait_until("the next good file is loaded", || feed.status().loaded == 2);
    assert_eq!(feed.newest().unwrap().1, Sha256::from_bytes(sha256));
    assert_eq!(feed.reload().load(), Ok(Sha256::from_bytes(sha256)), "and who asks is told so");
}

#[test]
fn offline_and_live_add_the_same_bits() {
    use abbe_geometry::correct::add_residual;
    use abbe_geometry::effects::NoCovariates;
    use abbe_geometry::{Matrix3, Vector3};
    let (_folder, path) = folder(&residual_file(MACHINE, HASH, 1));
    let field = load(&path).unwrap().0;
    let step = ResidualStep::new(Some(field.clone()), 1.0);
    for k in (0..bench().campaign.readings.len()).step_by(37) {
        let sample = geometric(k);
        let live = step.correct(&sample, None);
        let mut position_m = Vector3::from(sample.corrected_m);
        let mut covariance_m2 = Matrix3::from_row_slice(&sample.covariance_m2);
        let added = add_residual(&mut position_m, &mut covariance_m2, field.field.as_ref(), &NoCovariates).unwrap();
        assert_eq!(live.corrected_m, <[f64; 3]>::from(position_m));
        assert_eq!(live.residual_correction_m, <[f64; 3]>::from(added.residual_m()));
    }
}
