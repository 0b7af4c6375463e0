//! Every answer ends with the command that follows from it, and the program takes that command as it stands.
//!
//! Place in the flow: from a campaign to its evidence, each command in the folder of the one before. The commands are those that the
//! program lists: one that is new belongs here, or into a list below.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, text};
use crate::common::printed::{follows, listed};
use crate::common::program::{Ran, Started, abbe};

/// Commands whose answers are held by the tests that make them, with the file.
const ELSEWHERE: [(&str, &str); 9] = [
    ("capture", "capture.rs"),
    ("compare", "residual.rs"),
    ("demo", "demo.rs"),
    ("guideway", "calibrations.rs"),
    ("plan", "plan.rs"),
    ("points", "points.rs"),
    ("predict", "residual.rs"),
    ("sphere", "calibrations.rs"),
    ("train", "residual.rs"),
];
/// Commands that answer nothing, and why.
const WITHOUT: [(&str, &str); 5] = [
    ("completions", "prints what a shell reads"),
    ("launch", "goes on until it is told to stop; its nodes say what they did as JSON"),
    ("man", "writes what man reads, and says nothing"),
    ("node", "goes on until it is told to stop"),
    ("proxy", "goes on until it is told to stop"),
];

/// A folder in which commands answer, and those that did.
struct Answers {
    bench: Bench,
    seen: BTreeSet<String>,
}

impl Answers {
    fn ran(&mut self, words: &str) -> Ran {
        let words: Vec<&str> = words.split(' ').collect();
        self.seen.insert(words[0].to_owned());
        let mut command = abbe(words);
        command.current_dir(self.bench.path(""));
        Started::start(command).finish()
    }

    /// Runs a command; its answer leads on to this other one.
    #[track_caller]
    fn lead(&mut self, words: &str, next: &str) {
        let said = self.ran(words).ok();
        let letters = [" um ", " um,", " um\n", " um)", " urad", " +- ", "chi2 per", " -> "]
            .into_iter()
            .find(|sign| said.contains(sign));
        assert_eq!(letters, None, "pages have a sign for it: {said}");
        follows(&self.bench.path(""), &said, next);
    }
}

/// Runs of one axis that scatter by some tenths of a micrometre.
fn runs() -> String {
    let mut rows = "axis,target_mm,direction,cycle,measured_mm\n".to_owned();
    for cycle in 1..=5 {
        for (k, target) in [10.0, 47.0, 111.0, 180.0, 260.0, 333.0].into_iter().enumerate() {
            for direction in ["+", "-"] {
                let off = 0.0005 * ((7 * cycle + 3 * k) as f64 + if direction == "+" { 0.0 } else { 2.0 }).sin();
                rows += &format!("X,{target},{direction},{cycle},{:.5}\n", target + off);
            }
        }
    }
    rows
}

/// Error vectors of a wave at few points: methods that interpolate take long for many.
fn vectors() -> String {
    let row = |k: usize| {
        let [x, y, z] = [1.3, 2.1, 0.7].map(|step| 300.0 + 250.0 * (step * k as f64).sin());
        let [a, b] = [x, y].map(|mm| 2.0 * (mm / 90.0).sin());
        format!("{x:.3},{y:.3},{z:.3},{a:.4},{b:.4},{:.4}\n", a * b)
    };
    format!("x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um\n{}", (0..30).map(row).collect::<String>())
}

#[test]
fn every_answer_ends_with_the_next_command() {
    let mut answers = Answers { bench: Bench::empty(), seen: BTreeSet::new() };
    let machine = text(&machine());
    answers.lead(&format!("simulate --machine {machine} --seed 4 --out ."), "identify");
    answers.lead(&format!("simulate --machine {machine} --seed 4 --trials 1"), "simulate");
    answers.lead(&format!("identify --machine {machine} --campaign campaign.csv --out model.json"), "verify");
    answers.lead("verify --model model.json --points verify.csv --html verify.html", "correct");
    answers.lead("correct --model model.json --in verify.csv --out corrected.csv", "verify");
    let piped = answers.ran("correct --model model.json --in verify.csv --out -");
    assert!(!piped.errors.contains("next, ") && !piped.ok().contains("next, "), "a stream is data");
    answers.lead("export --model model.json --format csv --out tables.csv", "conformity");
    answers.lead("volumetric --model model.json --out map --steps 3 --offset-mm 0,0,-60", "export");
    answers.lead("residuals --model model.json --campaign verify.csv --out residuals.csv", "train");
    answers
        .lead(&format!("fit-points --machine {machine} --points verify.csv --u-um 0.05 --out fitted.json"), "verify");
    // Through a bag, and what comes out of it again.
    answers.lead(&format!("convert --machine {machine} --campaign campaign.csv --out bag"), "identify");
    answers.lead("correct --model model.json --in bag --out again", "verify");
    answers.lead("recover --bag again --out recovered", "replay");
    answers.lead("replay --bag recovered --model model.json", "verify");
    // What needs no model.
    let centres = Path::new(&machine).with_file_name("../data/zhang2016_centres.csv");
    answers.lead(&format!("probe-pose --centres {}", text(&centres)), "diagnose");
    answers.bench.write("vectors.csv", vectors());
    answers.bench.write("at.csv", "x_mm,y_mm,z_mm\n300,300,300\n");
    answers.lead("interpolate --vectors vectors.csv --at at.csv --out errors.csv", "interpolate");
    answers.lead("interpolate --vectors vectors.csv --splits 1", "interpolate");
    answers.bench.write("runs.csv", runs());
    answers.lead("conformity --runs runs.csv --out figures", "diagnose");
    answers.lead("conformity --runs runs.csv --out certified --pdf runs.pdf", "diagnose");
    answers.lead("diagnose --campaign runs.csv --out causes", "plan");
    answers.lead("papers --paper 2011 --effort 0.01 --out papers", "papers");

    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system");
    for (command, file) in ELSEWHERE {
        let source = fs::read_to_string(sources.join(file)).unwrap();
        assert!(source.contains("follows("), "{file} does not look at what follows from abbe {command}");
    }
    let others = ELSEWHERE.iter().chain(&WITHOUT).map(|(command, _)| (*command).to_owned());
    assert!(others.clone().all(|command| !answers.seen.contains(&command)), "a command stands in two lists");
    let known: BTreeSet<String> = answers.seen.iter().cloned().chain(others).collect();
    assert_eq!(known, listed().into_iter().collect(), "each command that the program lists");
}

/// A map of which nothing was measured: terminal and page say so, and the next one is where something was.
#[test]
fn regress_a_map_of_nothing_that_was_measured_says_so_on_page_and_terminal_and_leads_back() {
    let bench = Bench::identified(4);
    let (model, out) = (bench.text("model.json"), bench.text("map"));
    let nowhere = Started::start(abbe([
        "volumetric",
        "--model",
        &model,
        "--out",
        &out,
        "--steps",
        "3",
        "--offset-mm",
        "0,0,-900",
    ]))
    .finish();
    assert_says(&nowhere.errors, &["27 of 27 points are outside", "no point of the map is inside"]);
    let page = bench.read("map/report.html");
    assert_says(
        &page,
        &["Failed — Outside of what was measured", "27 of 27 points lie outside", "its uncertainty is a lower bound"],
    );
    let said = String::from_utf8(nowhere.output).unwrap();
    let again = follows(&bench.path(""), &said, "volumetric");
    assert_says(&page, &["to map it at the offsets of the campaign"]);
    let inside = Started::start(abbe(again.split(' ').skip(1))).finish().ok();
    follows(&bench.path(""), &inside, "export");
    assert!(!bench.read("map/report.html").contains("Failed —"));
}

/// Pages of tables, where they are asked for: the same rows as without, and what the data say.
#[test]
fn pages_of_verified_and_corrected_points_say_what_they_were_made_from() {
    let bench = Bench::identified(4);
    let [model, points] = ["model.json", "verify.csv"].map(|name| bench.text(name));
    let ran = |words: &str| {
        let words = words.replace("{}", &bench.text(""));
        let own = ["--model", &model].into_iter().chain(words.split(' ').skip(1));
        Started::start(abbe(words.split(' ').take(1).chain(own))).finish()
    };
    ran(&format!("verify --points {points} --html {{}}/verify.html")).ok();
    ran(&format!("correct --in {points} --out {{}}/corrected.csv")).ok();
    ran(&format!(
        "correct --in {points} --out {{}}/again.csv --html {{}}/corrected.html --pdf {{}}/corrected.pdf --operator A.Person"
    ))
    .ok();
    assert!(bench.read("again.csv") == bench.read("corrected.csv"));
    let [verified, corrected] = ["verify.html", "corrected.html"].map(|name| bench.read(name));
    assert_says(&verified, &["<code>abbe correct --model …/model.json --in READINGS.csv"]);
    assert_says(
        &corrected,
        &["Corrected coordinates of bridge_xyz", "400 rows of verify.csv", "of 400; 0 rejected", "A.Person"],
    );
    for page in [&verified, &corrected] {
        assert_says(page, &["<dt>Temperature</dt><dd>", " °C</dd>", "verify.csv, SHA-256 ", "<dt>Software</dt>"]);
    }
    assert!(fs::read(bench.path("corrected.pdf")).unwrap().starts_with(b"%PDF-"));
}
