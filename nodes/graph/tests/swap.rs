//! Evidence for the change of a model in a running node: no sample is lost, each is corrected by one whole model, and a
//! file that cannot be used changes nothing.

use crate::common::{bench, other_bench, replace};
use abbe_files::{FileError, ModelFile};
use abbe_geometry::model::MachineModel;
use abbe_graph::feed::Feed;
use abbe_graph::step::GeometricStep;
use abbe_msgs::cdr;
use abbe_msgs::{CorrectedCoordinates, Message, ScaleReading, Sha256};
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

type Model = Arc<MachineModel>;

fn load(path: &Path) -> Result<(Model, Sha256), FileError> {
    let (file, sha256) = ModelFile::load_for(path, &bench().machine.machine)?;
    Ok((Arc::new(file.model), Sha256::from_bytes(sha256)))
}

fn open(path: &Path) -> ((Model, Sha256), Feed<Model>) {
    Feed::open(path, load).unwrap()
}

fn bytes(sample: &CorrectedCoordinates) -> Vec<u8> {
    cdr::encode(&sample.to_ros()).unwrap()
}

/// The campaign's readings in turn, over and over.
fn reading(number: usize) -> ScaleReading {
    ScaleReading { sequence: number as u64, ..bench().scale(number % bench().campaign.readings.len()) }
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !done() {
        assert!(Instant::now() < deadline, "{what}");
        thread::sleep(Duration::from_millis(5));
    }
}

/// A folder with the first model under the name that a launch file would give.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.json");
    bench().model_file(MACHINE).save(&path).unwrap();
    (folder, path)
}

#[test]
fn every_sample_is_corrected_by_one_whole_model_while_models_alternate() {
    const SWAPS: usize = 6;
    let (_folder, path) = folder();
    let files = [bench().model_file(MACHINE), other_bench().model_file(MACHINE)];
    let (first, feed) = open(&path);
    let mut step = GeometricStep::new(Some(first), 10.0);
    let alone = files.each_ref().map(|file| {
        let model = MachineModel::new(file.model.parts().clone()).unwrap();
        GeometricStep::new(Some((Arc::new(model), Sha256::from_bytes(file.sha256().unwrap()))), 10.0)
    });
    let taken = AtomicUsize::new(0);
    let samples = thread::scope(|scope| {
        scope.spawn(|| {
            for swap in 1..=SWAPS {
                files[swap % 2].save(&path).unwrap();
                wait_until("the new model arrives", || taken.load(Ordering::Relaxed) == swap);
            }
        });
        let mut samples = Vec::new();
        // As the node's loop does it: what is ready is taken between two samples.
        let mut last = LAST_SAMPLES;
        while last > 0 {
            if let Some((model, sha256)) = feed.newest() {
                step.put_in_use(model, sha256);
                taken.fetch_add(1, Ordering::Relaxed);
            }
            samples.push(step.correct(&reading(samples.len())));
            last -= usize::from(taken.load(Ordering::Relaxed) == SWAPS);
            thread::sleep(Duration::from_micros(200));
        }
        samples
    });
    let by: Vec<usize> = samples
        .iter()
        .enumerate()
        .map(|(k, sample)| {
            let own = alone.iter().position(|alone| bytes(&alone.correct(&reading(k))) == bytes(sample));
            own.unwrap_or_else(|| panic!("sample {k} is of neither model"))
        })
        .collect();
    let changes = by.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert_eq!(changes, SWAPS, "one place of change a swap");
    assert!(
        samples.iter().enumerate().all(|(k, sample)| sample.sequence == k as u64),
        "one sample a reading, in order"
    );
    println!("{} samples, {changes} changes of model", samples.len());
}

#[test]
fn what_cannot_be_used_is_refused_by_name_and_the_model_in_use_goes_on() {
    let (_folder, path) = folder();
    let whole = std::fs::read(&path).unwrap();
    let ((_, in_use), feed) = open(&path);
    let half = whole[..whole.len() / 2].to_vec();
    let mut changed = whole.clone();
    let digit = whole.len() / 2 + whole[whole.len() / 2..].iter().position(|b| b.is_ascii_digit()).unwrap();
    changed[digit] = if whole[digit] == b'1' { b'2' } else { b'1' };
    let stranger = other_bench().model_file("moving_table").to_bytes("model").unwrap().0;
    let cases = [(half, "model.json"), (changed, "hash"), (stranger, "moving_table"), (Vec::new(), "model.json")];
    for (number, (content, says)) in cases.into_iter().enumerate() {
        replace(&path, &content);
        wait_until("the file is refused", || feed.status().refused == number as u64 + 1);
        let status = feed.status();
        let problem = status.problem.unwrap();
        assert!(problem.contains(says) && problem.contains(&in_use.to_string()), "{problem}");
        assert_eq!((status.loaded, feed.newest().is_some()), (1, false));
    }
    std::fs::remove_file(&path).unwrap();
    wait_until("a file that is gone is told", || feed.status().refused == 5);
    let sha256 = other_bench().model_file(MACHINE).save(&path).unwrap();
    wait_until("the next good file is loaded", || feed.status().loaded == 2);
    assert_eq!(feed.newest().unwrap().1, Sha256::from_bytes(sha256));
    assert_eq!(feed.status().problem, None);
}

#[test]
fn who_asks_for_a_load_is_told_what_came_of_it() {
    let (_folder, path) = folder();
    let ((_, first), feed) = open(&path);
    let reload = feed.reload();
    assert_eq!(reload.load(), Ok(first), "the file as it is");
    assert!(feed.newest().is_none(), "and nothing changes");
    let sha256 = Sha256::from_bytes(other_bench().model_file(MACHINE).save(&path).unwrap());
    assert_eq!(reload.load(), Ok(sha256));
    assert_eq!(feed.newest().unwrap().1, sha256);
    std::fs::write(&path, "{").unwrap();
    let refusal = reload.load().unwrap_err();
    assert!(refusal.contains("model.json") && refusal.contains(&sha256.to_string()), "{refusal}");
}

#[test]
fn a_file_that_is_copied_slowly_is_in_use_once_it_is_whole() {
    let (_folder, path) = folder();
    let (_, feed) = open(&path);
    let (content, _) = other_bench().model_file(MACHINE).to_bytes("model").unwrap();
    let mut grown = 0;
    while grown < content.len() {
        grown = (grown + content.len() / 20 + 1).min(content.len());
        std::fs::write(&path, &content[..grown]).unwrap();
        thread::sleep(Duration::from_millis(50));
    }
    wait_until("the whole file is loaded", || feed.status().loaded == 2);
    assert_eq!((feed.status().problem, feed.newest().is_some()), (None, true));
}
