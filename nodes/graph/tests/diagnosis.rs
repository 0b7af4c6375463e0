//! Evidence for diagnoses: what the program is given, what becomes of the model it proposes, and that it ends with the
//! node. The program here is a shell script in place of `abbe diagnose`.

use crate::common::{bench, other_bench};
use abbe_files::{ModelFile, read_campaign_file};
use abbe_geometry::effects::Shape;
use abbe_graph::diagnosis_run::{DiagnosisRun, Job, Outcome};
use abbe_identify::{EffectTerm, IdentifyOptions, TIME, identify_with};
use abbe_measurement::campaign::Campaign;
use abbe_msgs::Sha256;
use std::fs;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use std::thread;
use std::time::{Duration, Instant};

const MACHINE: &str = "bridge_xyz";
/// Longest that a script may take on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(30);
/// Finds the folder among the arguments, as a program would.
const HEAD: &str = "#!/bin/sh\nset -e\ntest \"$1 $2 $4 $6\" = 'diagnose --model --campaign --out'\nout=$7\n";

/// A folder with the model in use, a better one, and a program.
struct Place {
    folder: tempfile::TempDir,
    in_use: Sha256,
    better: Sha256,
}

impl Place {
    fn new(script: &str) -> Place {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let save = |file: ModelFile, name: &str| Sha256::from_bytes(file.save(&path(name)).unwrap());
        let in_use = save(bench().model_file(MACHINE), "model.json");
        let better = save(other_bench().model_file(MACHINE), "better.json");
        fs::write(path("program"), format!("{HEAD}cd '{}'\n{script}\n", folder.path().display())).unwrap();
        fs::set_permissions(path("program"), fs::Permissions::from_mode(0o755)).unwrap();
        Place { folder, in_use, better }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn job(&self, adopt: bool) -> Job {
        Job {
            program: self.path("program"),
            model_file: self.path("model.json"),
            machine: bench().machine.machine.clone(),
            in_use: self.in_use,
            campaign: bench().campaign.clone(),
            folder: self.path("diagnoses"),
            adopt,
        }
    }

    fn held(&self) -> Sha256 {
        Sha256::from_bytes(ModelFile::load(&self.path("model.json")).unwrap().1)
    }
}

/// What somebody who asked is told at the start, and what comes of it.
fn run(job: Job) -> (Result<String, String>, Result<String, String>) {
    let (told, start) = sync_channel(1);
    let mut run = DiagnosisRun::start(job, Some(told)).unwrap();
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(outcome) = run.outcome() {
            return (start.recv().unwrap(), outcome);
        }
        assert!(Instant::now() < deadline, "no outcome");
        thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn the_program_is_given_the_readings_and_the_model_in_use() {
    let place = Place::new("echo looking; cp \"$3\" seen.json; cp \"$5\" seen.csv");
    let (told, outcome) = run(place.job(false));
    let folder = place.path("diagnoses/0001");
    assert_eq!(told.unwrap(), format!("started, see {}", folder.display()));
    assert!(outcome.unwrap().contains("proposes no model"));
    assert_eq!(fs::read(place.path("seen.json")).unwrap(), fs::read(place.path("model.json")).unwrap());
    let seen = read_campaign_file(&place.path("seen.csv"), None).unwrap().campaign;
    assert_eq!((seen.readings.len(), &seen.lines), (bench().campaign.readings.len(), &bench().campaign.lines));
    assert_eq!(fs::read_to_string(folder.join("diagnose.log")).unwrap(), "looking\n");
    assert!(run(place.job(false)).0.unwrap().ends_with("0002"), "no diagnosis overwrites another");
}

#[test]
fn a_proposed_model_is_put_into_use_only_where_that_is_wanted() {
    let place = Place::new("cp better.json \"$out/model.json\"");
    let words = run(place.job(false)).1.unwrap();
    assert!(words.contains("copy") && words.contains(&place.better.to_string()), "{words}");
    assert_eq!(place.held(), place.in_use);
    let words = run(place.job(true)).1.unwrap();
    assert!(words.contains("put into use"), "{words}");
    assert_eq!(place.held(), place.better);
}

#[test]
fn a_model_that_a_person_put_there_meanwhile_is_not_overwritten() {
    let place = Place::new("cp better.json \"$out/model.json\"; cp other.json model.json");
    let mut other = other_bench().model_file(MACHINE);
    other.software = "another".to_owned();
    let other = Sha256::from_bytes(other.save(&place.path("other.json")).unwrap());
    let words = run(place.job(true)).1.unwrap();
    assert!(words.contains("has changed since"), "{words}");
    assert_eq!(place.held(), other);
}

#[test]
fn a_model_that_cannot_be_used_is_never_put_into_use() {
    for script in ["head -c 1000 better.json > \"$out/model.json\"", "cp stranger.json \"$out/model.json\""] {
        let place = Place::new(script);
        other_bench().model_file("moving_table").save(&place.path("stranger.json")).unwrap();
        let problem = run(place.job(true)).1.unwrap_err();
        assert!(problem.contains("model.json"), "{problem}");
        assert_eq!(place.held(), place.in_use);
    }
}

/// The model of the machine with an effect that is smooth in one quantity, whose name the samples must carry.
fn model_that_asks_for(quantity: &str) -> ModelFile {
    let bench = bench();
    let machine = &bench.machine.machine;
    let shape = Shape::new().text("acts", "z").number("degree", 1.0);
    let shape = shape.text("p", quantity).number("p_low", 0.0).number("p_high", 20_000.0);
    let term = EffectTerm::new("empirical", shape, machine).unwrap();
    let (instrument, options) = (bench.machine.instrument, IdentifyOptions::default());
    let fit = identify_with(machine, instrument, &bench.campaign, &[term], &options, &mut |_| true).unwrap();
    ModelFile { model: fit.model, ..bench.model_file(MACHINE) }
}

/// The campaign without one of its covariates.
fn without(name: &str) -> Campaign {
    let mut campaign = bench().campaign.clone();
    assert!(campaign.covariate(name).is_some(), "{name} was logged");
    campaign.covariates.retain(|covariate| covariate.name != name);
    campaign
}

#[test]
fn a_model_that_corrects_by_what_no_live_sample_carries_is_not_put_into_use() {
    let place = Place::new("cp asking.json \"$out/model.json\"");
    let propose =
        |quantity: &str| Sha256::from_bytes(model_that_asks_for(quantity).save(&place.path("asking.json")).unwrap());
    let adopt = |campaign: Campaign| run(Job { campaign, ..place.job(true) }).1.unwrap();
    propose("temp_air_c");
    let words = adopt(without("temp_air_c"));
    assert!(words.contains("not put into use: it corrects by temp_air_c"), "{words}");
    assert_eq!(place.held(), place.in_use);
    // Every campaign has the time since it began, but no live sample has.
    propose(TIME);
    let words = adopt(bench().campaign.clone());
    assert!(words.contains(&format!("not put into use: it corrects by {TIME}")), "{words}");
    assert_eq!(place.held(), place.in_use);
    let asking = propose("temp_air_c");
    let words = adopt(bench().campaign.clone());
    assert!(words.contains("is put into use"), "{words}");
    assert_eq!(place.held(), asking);
}

#[test]
fn a_program_that_fails_is_quoted() {
    let place = Place::new("echo 'abbe: nothing fits' >&2; exit 3");
    let (told, outcome) = run(place.job(true));
    assert!(told.is_ok());
    let problem = outcome.unwrap_err();
    assert!(problem.contains("nothing fits") && problem.contains("3"), "{problem}");
    let written = Outcome::read(&place.path("diagnoses/0001")).unwrap().unwrap();
    assert_eq!(written, Outcome { finished: false, words: problem, put_into_use: None });
}

#[test]
fn the_folder_says_what_came_of_it_once_it_has_ended() {
    let place = Place::new("cp better.json \"$out/model.json\"; test ! -e \"$out/outcome.json\"");
    let words = [false, true].map(|adopt| run(place.job(adopt)).1.unwrap());
    let adopted = [None, Some(place.better.to_hex())];
    for (folder, (words, put_into_use)) in ["0001", "0002"].into_iter().zip(words.into_iter().zip(adopted)) {
        let written = Outcome::read(&place.path("diagnoses").join(folder)).unwrap().unwrap();
        assert_eq!(written, Outcome { finished: true, words, put_into_use });
    }
    let under_way = place.path("diagnoses/0003");
    fs::create_dir(&under_way).unwrap();
    assert_eq!(Outcome::read(&under_way).unwrap(), None);
}

#[test]
fn what_cannot_start_says_why_to_whoever_asked() {
    let place = Place::new("true");
    let gone = Job { program: place.path("none"), ..place.job(false) };
    let changed = Job { in_use: place.better, ..place.job(false) };
    fs::write(place.path("file"), "").unwrap();
    let nowhere = Job { folder: place.path("file/diagnoses"), ..place.job(false) };
    for (job, says) in [(gone, "none"), (changed, "not the one in use"), (nowhere, "diagnosis_folder")] {
        let (told, outcome) = run(job);
        let problem = outcome.unwrap_err();
        assert!(problem.contains(says), "{problem}");
        assert_eq!(told.unwrap_err(), problem);
    }
}

#[test]
fn the_program_ends_with_the_node() {
    let place = Place::new("echo $$ > pid.part; mv pid.part pid; exec sleep 600");
    let run = DiagnosisRun::start(place.job(false), None).unwrap();
    let deadline = Instant::now() + PATIENCE;
    while !place.path("pid").exists() {
        assert!(Instant::now() < deadline, "the program does not start");
        thread::sleep(Duration::from_millis(5));
    }
    let pid = fs::read_to_string(place.path("pid")).unwrap();
    drop(run);
    assert!(!PathBuf::from(format!("/proc/{}", pid.trim())).exists(), "process {pid} outlives the node");
}
