//! What `abbe capture` shows while it runs, and what it leaves.
//!
//! Place in the flow: around `abbe_graph::capture`. On a terminal a bar with points, expected uncertainty and time left; elsewhere a
//! line for each line of the plan. At the end `campaign.csv`, `report.json` and `report.html`. Micrometres, k = 1.

mod page;

use crate::next::Next;
use crate::provenance::hashed;
use crate::verdict::{self, remark};
use abbe_files::{JournalEntry, MachineFile, write_atomically, write_campaign};
use abbe_graph::capture::{CapturedCampaign, Capturer, Shown, SoFar, Told, so_far, volume_of};
use abbe_identify::verdict::{Finding, Grade};
use abbe_report::{Identity, MetaItem, Report, digits, to_json};
use abbe_runtime::Shutdown;
use anyhow::Context;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

/// Points over which the pace is taken.
const PACE: usize = 60;

/// What is shown while it runs.
pub(crate) struct Screen {
    bar: Option<ProgressBar>,
    promised_um: Option<f64>,
    /// The uncertainty so far, or why there is none.
    so_far: Result<(usize, f64), String>,
    /// When the last points came.
    pace: VecDeque<Instant>,
}

impl Screen {
    pub(crate) fn new(capturer: &Capturer, promised_um: Option<f64>, goes_on: bool, was_cut: bool) -> Screen {
        let (done, all) = (capturer.done(), capturer.wanted());
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:24} {pos} of {len} points, {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = ProgressBar::with_draw_target(Some(all as u64), ProgressDrawTarget::stderr()).with_style(style);
            bar.enable_steady_tick(Duration::from_millis(500));
            bar
        });
        let so_far = Err("no line is captured yet".to_owned());
        let screen = Screen { bar, promised_um, so_far, pace: VecDeque::new() };
        if goes_on {
            screen.say(&format!("going on: {done} of {all} points are captured already"));
        }
        if was_cut {
            screen.say("the journal ended in the middle of a reading, which is lost; its point will be measured again");
        }
        screen
    }

    /// A line on standard error; who does not read it does not stop a capture.
    fn say(&self, words: &str) {
        let write = || drop(writeln!(std::io::stderr(), "abbe: {words}"));
        match &self.bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
    }

    pub(crate) fn show(&mut self, capturer: &Capturer, shown: &Shown) {
        match shown {
            Shown::Link(words) => self.say(words),
            Shown::SoFar(Ok(SoFar { readings, u_m, findings, .. })) => {
                self.so_far = Ok((*readings, *u_m));
                for finding in findings {
                    self.say(&format!("of {readings} readings so far: {}", remark(finding).text));
                }
            }
            Shown::SoFar(Err(why)) => self.so_far = Err(why.clone()),
            Shown::Told(told) => self.told(capturer, told),
        }
        if let Some(bar) = &self.bar {
            bar.set_position(capturer.done() as u64);
            bar.set_message(self.words(capturer));
        }
    }

    fn told(&mut self, capturer: &Capturer, told: &Told) {
        match told {
            Told::Entry(JournalEntry::Taken(_)) => {
                self.pace.push_back(Instant::now());
                while self.pace.len() > PACE {
                    self.pace.pop_front();
                }
            }
            Told::Entry(_) => {}
            Told::Note(words) | Told::Warning(words) => self.say(words),
            Told::Ask(words) => {
                self.say(&format!("all points of this set-up are captured. Now {words}; press Enter when it stands"));
            }
            Told::LineDone(line) => {
                let (done, all) = (capturer.done(), capturer.wanted());
                let name = &capturer.planned().lines[*line].name;
                self.say(&format!("line {name}: {done} of {all} points, {}", self.words(capturer)));
            }
            Told::AllDone => self.say("all points are captured"),
        }
    }

    /// Uncertainty so far and time left.
    fn words(&self, capturer: &Capturer) -> String {
        let promised =
            self.promised_um.map_or(String::new(), |um| format!(" (planned: {} µm)", digits::uncertainty(um)));
        let u = match &self.so_far {
            Ok((readings, u_m)) => format!("{} µm{promised} after {readings} readings", digits::uncertainty(u_m * 1e6)),
            Err(_) => format!("not yet{promised}"),
        };
        let left = match (self.pace.front(), self.pace.back()) {
            (Some(first), Some(last)) if self.pace.len() > 2 => {
                let each_s = (*last - *first).as_secs_f64() / (self.pace.len() - 1) as f64;
                let left = capturer.wanted() - capturer.done();
                time_words(each_s * left as f64)
            }
            _ => "not known yet".to_owned(),
        };
        format!("uncertainty of a corrected point so far: {u}; time left: {left}")
    }

    pub(crate) fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

fn time_words(seconds: f64) -> String {
    match seconds {
        s if s >= 5400.0 => format!("{:.1} h", s / 3600.0),
        s if s >= 90.0 => format!("{:.0} min", s / 60.0),
        s => format!("{s:.0} s"),
    }
}

/// What was captured, for the files.
pub(crate) struct Outcome<'a> {
    pub(crate) machine: &'a MachineFile,
    pub(crate) capturer: &'a Capturer,
    pub(crate) promised_um: Option<f64>,
    pub(crate) who: &'a Identity,
    /// What of it can be identified.
    pub(crate) captured: &'a CapturedCampaign,
    /// Files that it was captured by, with their hashes.
    pub(crate) files: Vec<MetaItem>,
    /// What to do next with a campaign that can be identified, and with one that cannot yet.
    pub(crate) next: &'a Next,
    pub(crate) go_on: &'a Next,
}

impl Outcome<'_> {
    fn following(&self, reached: &Result<SoFar, String>) -> &Next {
        if reached.is_ok() { self.next } else { self.go_on }
    }
}

/// Writes campaign and report into a folder.
pub(crate) fn write_outcome(
    outcome: &Outcome,
    folder: &Path,
    as_json: bool,
    shutdown: &Shutdown,
) -> anyhow::Result<()> {
    let (capturer, captured) = (outcome.capturer, outcome.captured);
    let file = folder.join("campaign.csv");
    let is_empty = captured.campaign.readings.is_empty();
    if !is_empty {
        write_campaign(&file, &captured.campaign)?;
    }
    // A second Ctrl-C does not wait for it.
    let volume = volume_of(capturer.planned());
    let reached = match is_empty {
        true => Err("no station can be placed by its readings yet".to_owned()),
        false => so_far(outcome.machine, &volume, &captured.campaign, || !shutdown.is_urgent()),
    };
    let value = json_of(outcome, captured, &reached);
    let text = to_json("report", &value).context("report.json")?;
    write_atomically(&folder.join("report.json"), text.as_bytes())?;
    let campaign = (!is_empty).then(|| hashed("Campaign", &file)).transpose()?;
    let report: Report = page::report(outcome, campaign, &reached);
    write_atomically(&folder.join("report.html"), report.html().context("report.html")?.as_bytes())?;
    if as_json {
        println!("{text}");
    } else {
        words(outcome, captured, &reached, &file).iter().for_each(|line| println!("{line}"));
        outcome.following(&reached).print();
    }
    Ok(())
}

fn words(outcome: &Outcome, captured: &CapturedCampaign, reached: &Result<SoFar, String>, file: &Path) -> Vec<String> {
    let capturer = outcome.capturer;
    let mut lines = Vec::new();
    if captured.campaign.readings.is_empty() {
        lines.push(format!("{}: not written, nothing can be identified yet", file.display()));
    } else {
        let (readings, stations) = (captured.campaign.readings.len(), captured.campaign.stations.len());
        lines.push(format!("{}: {readings} readings from {stations} stations", file.display()));
    }
    lines.push(format!("{} of {} points of the plan are captured", capturer.done(), capturer.wanted()));
    for (name, readings, why) in &captured.left_out {
        lines.push(format!("left out: the {readings} readings of station {name}: {why}"));
    }
    if !capturer.doubted().is_empty() {
        lines.push(format!("{} readings are in doubt, and not in it", capturer.doubted().len()));
    }
    match reached {
        Ok(found) => {
            lines.push(format!(
                "uncertainty of a corrected point: {} µm (k = 1, in space, rms over the plan)",
                digits::uncertainty(found.u_m * 1e6)
            ));
            lines.extend(found.findings.iter().map(said));
        }
        Err(why) => lines.push(format!("it cannot be identified yet: {why}")),
    }
    lines
}

/// A finding and its grade, in a line.
fn said(finding: &Finding) -> String {
    let grade = match finding.grade {
        Grade::Message => "note",
        Grade::Warning => "warning",
        Grade::Refusal => "abbe identify will refuse it",
    };
    format!("{grade}: {}", remark(finding).text)
}

fn json_of(outcome: &Outcome, captured: &CapturedCampaign, reached: &Result<SoFar, String>) -> Value {
    let capturer = outcome.capturer;
    let planned = capturer.planned();
    let open: Vec<String> =
        (0..planned.len()).filter(|point| !capturer.is_done(*point)).map(|point| planned.words(point)).collect();
    let left_out: Vec<Value> = captured
        .left_out
        .iter()
        .map(|(station, readings, why)| json!({ "station": station, "readings": readings, "why": why }))
        .collect();
    json!({
        "machine": outcome.machine.machine.name,
        "points": capturer.wanted(),
        "captured": capturer.done(),
        "open": open,
        "doubted": capturer.doubted().len(),
        "readings": captured.campaign.readings.len(),
        "stations": captured.campaign.stations,
        "left_out": left_out,
        "u_um": reached.as_ref().ok().map(|found| found.u_m * 1e6),
        "not_identified": reached.as_ref().err(),
        "findings": reached.as_ref().map_or(json!([]), |found| verdict::json(&found.findings)),
        "planned_u_um": outcome.promised_um,
        "noisier_than_declared": page::noisier(outcome),
        "software": crate::pipeline::software(),
    })
}
