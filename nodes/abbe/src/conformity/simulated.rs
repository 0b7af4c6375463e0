//! The length test of ISO 10360-2 on the virtual machine, before and after its correction by an identified model.
//!
//! Place in the flow: `abbe conformity --machine M --seed N`. A machine is simulated, a campaign measured and identified;
//! then the same gauges are touched in the same order by the machine as it is and as the model corrects it. The model sees the
//! campaign only.

use super::lengths::{self, STANDARD};
use super::{Limits, Product, departure_callout};
use crate::command::simulate;
use crate::pipeline::software;
use abbe_conformity::DecisionRule;
use abbe_conformity::length::{
    LengthErrors, LengthPlan, LengthTest, MeasuringVolume, OffsetPlane, Probing, e0_lines, evaluate, offset_lines,
};
use abbe_files::read_machine;
use abbe_geometry::Vector3;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::MachineModel;
use abbe_identify::{Options, Progress, identify};
use abbe_report::{Heading, MetaItem, Report, Section};
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::length_test::{MachineAtTouch, length_test};
use abbe_virtual_machine::plan::presets::CASE_OFFSETS_M;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::{SimulationConfig, simulate_campaign};
use anyhow::ensure;
use serde_json::json;
use std::path::Path;

/// Seed, machine and effects of a simulated test.
pub(crate) struct Simulated<'a> {
    pub(crate) machine: &'a Path,
    pub(crate) seed: u64,
    pub(crate) effects: &'a [String],
    /// 0 for E0; otherwise the two diagonals of the YZ plane with the tip so far across (m).
    pub(crate) tool_offset_m: f64,
}

/// Measures before and after.
pub(crate) fn run(
    asked: &Simulated,
    limits: &Limits,
    rule: &DecisionRule,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> anyhow::Result<Product> {
    let machine = read_machine(asked.machine)?;
    let mut config = simulate::config(&machine, asked.seed)?;
    config.effects = asked.effects.iter().map(|text| from_text(text)).collect::<Result<_, _>>()?;
    let campaign = simulate_campaign(&config)?.campaign;
    let model = identify(&machine.machine, machine.instrument, &campaign, &Options::default(), observe)?.model;
    let before = measured(&config, asked, |at| Some(at.indicated_m()))?;
    let after = measured(&config, asked, |at| corrected_m(&model, at))?;
    let mut words = format!("machine {}, seed {}\n\nbefore correction, ", machine.machine.name, asked.seed);
    words.push_str(&lengths::words(&before, limits, rule)?);
    words.push_str("\nafter correction, ");
    words.push_str(&lengths::words(&after, limits, rule)?);
    let json = json!({
        "machine": machine.machine.name, "seed": asked.seed, "effects": asked.effects, "software": software(),
        "before": lengths::figures(&before, limits, rule)?,
        "after": lengths::figures(&after, limits, rule)?,
    });
    let report = report(&machine.machine.name, asked, [&before, &after], limits, rule)?;
    Ok(Product { words, json, report })
}

fn measured(
    config: &SimulationConfig,
    asked: &Simulated,
    believed_m: impl Fn(&MachineAtTouch) -> Option<[f64; 3]>,
) -> anyhow::Result<LengthErrors> {
    let volume = MeasuringVolume::new(config.machine.stroke_m.map(|[lower, upper]| (lower, upper)))?;
    let stylus_m = Vector3::from(CASE_OFFSETS_M[0]);
    let lines = match asked.tool_offset_m {
        0.0 => e0_lines(&volume),
        offset_m => offset_lines(&volume, OffsetPlane::Yz, offset_m)?,
    };
    let lines: Vec<_> = lines.into_iter().map(|line| line.with_stylus(stylus_m)).collect();
    let travel_m = lines.iter().map(|line| (line.name.clone(), line.travel_m())).collect();
    let mut refused = false;
    let lengths = length_test(config, &lines, &LengthPlan::default(), asked.seed, |at| {
        believed_m(at).unwrap_or_else(|| {
            refused = true;
            at.indicated_m()
        })
    })?;
    ensure!(!refused, "the model refuses to correct a reading of the length test; it is of another machine");
    Ok(evaluate(
        LengthTest { tool_offset_m: asked.tool_offset_m, probing: Probing::Bidirectional, travel_m },
        &lengths,
    )?)
}

fn corrected_m(model: &MachineModel, at: &MachineAtTouch) -> Option<[f64; 3]> {
    let covariates = Logged(at);
    let state = State { reading_m: at.reading_m, offset_m: at.offset_m, covariates: &covariates };
    let correction = correct(model, &state);
    (correction.status != Status::Rejected).then(|| correction.position_m.into())
}

/// What the simulated machine logs at a touch.
struct Logged<'a>(&'a MachineAtTouch);

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.0.time_s);
        }
        let place = covariate_names().position(|known| known == name);
        place.map_or(CovariateValue::Missing, |k| CovariateValue::Fresh(self.0.covariates[k]))
    }
}

fn report(
    machine: &str,
    asked: &Simulated,
    [before, after]: [&LengthErrors; 2],
    limits: &Limits,
    rule: &DecisionRule,
) -> anyhow::Result<Report> {
    let chapter = |title: &str| Section::Heading(Heading { title: title.to_owned(), intro: None });
    let mut sections = vec![chapter("Before correction")];
    sections.extend(lengths::sections(before, limits, rule)?);
    sections.push(chapter("After correction"));
    sections.extend(lengths::sections(after, limits, rule)?);
    sections.push(departure_callout(STANDARD, &after.departures));
    let item = |label: &str, value: String| MetaItem { label: label.to_owned(), value: Some(value) };
    let mut meta = vec![item("machine", machine.to_owned()), item("seed", asked.seed.to_string())];
    meta.extend(asked.effects.iter().map(|effect| item("effect", effect.clone())));
    Ok(Report {
        title: "Length measurement error before and after correction".to_owned(),
        lead: Some(
            "The same gauges, touched in the same order by a simulated machine as it is and as its model corrects it."
                .to_owned(),
        ),
        meta,
        main_plot: None,
        footer: Some(software()),
        sections,
    })
}
