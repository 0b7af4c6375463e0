//! The length test of ISO 10360-2 on the virtual machine, before and after its correction by an identified model.
//!
//! Place in the flow: `abbe conformity --machine M --seed N`. A machine is simulated, a campaign measured and identified;
//! then the same gauges are touched in the same order by the machine as it is, as the model corrects it and, where there is one,
//! as model and residual model do. The models see the campaign only.

use super::lengths;
use super::{Limits, Outside, Product, pictures};
use crate::command::simulate;
use crate::pipeline::software;
use crate::provenance::{file_name, hashed};
use crate::residual::{inputs_of, load_residual, residual_meta, with_residual};
use crate::tally::Tally;
use abbe_conformity::DecisionRule;
use abbe_conformity::length::{
    LengthErrors, LengthPlan, LengthTest, MeasuringVolume, OffsetPlane, Probing, e0_lines, evaluate, offset_lines,
};
use abbe_files::{MachineFile, ModelFile, hex, read_machine};
use abbe_geometry::Vector3;
use abbe_geometry::correct::{Correction, Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::model::MachineModel;
use abbe_graph::step::OwnedField;
use abbe_identify::{IdentifyOptions, Progress, identify};
use abbe_report::{Callout, Heading, Identity, KeyFigure, KeyFigures, MetaItem, Quantity, Report, Section};
use abbe_virtual_machine::effects::from_text;
use abbe_virtual_machine::length_test::{MachineAtTouch, length_test};
use abbe_virtual_machine::plan::presets::CASE_OFFSETS_M;
use abbe_virtual_machine::simulate::covariate_names;
use abbe_virtual_machine::{SimulationConfig, simulate_campaign};
use anyhow::ensure;
use serde_json::json;
use std::cell::RefCell;
use std::path::Path;

/// Seed, machine and effects of a simulated test.
pub(crate) struct Simulated<'a> {
    pub(crate) machine: &'a Path,
    pub(crate) seed: u64,
    pub(crate) effects: &'a [String],
    /// Raw volumetric error (rms, µm).
    pub(crate) volumetric_um: f64,
    /// 0 for E0; otherwise the two diagonals of the YZ plane with the tip so far across (m).
    pub(crate) tool_offset_m: f64,
    /// Model to correct with; without one, a campaign is simulated and identified.
    pub(crate) model: Option<&'a Path>,
    /// Residual model that belongs to it.
    pub(crate) residual: Option<&'a Path>,
}

/// One state of the machine with its length errors.
struct Stage {
    title: &'static str,
    /// Key in JSON.
    key: &'static str,
    errors: LengthErrors,
}

/// Measures before and after.
pub(crate) fn run(
    asked: &Simulated,
    limits: &Limits,
    rule: &DecisionRule,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> anyhow::Result<Product> {
    let machine = read_machine(asked.machine)?;
    let mut config = simulate::config(&machine, asked.seed, asked.volumetric_um)?;
    config.effects = asked.effects.iter().map(|text| from_text(text)).collect::<Result<_, _>>()?;
    let Correcting { model, model_sha256, residual } = correction(asked, &machine, &config, observe)?;
    let stage = |title, key, errors| Stage { title, key, errors };
    let mut stages = vec![stage("Before correction", "before", measured(&config, asked, |at| Some(at.indicated_m()))?)];
    if residual.is_some() {
        let by_geometry = measured(&config, asked, |at| position_m(&corrected(&model, None, at)))?;
        stages.push(stage("After the geometric model alone", "geometric", by_geometry));
    }
    let tally = RefCell::new(Tally::asking(inputs_of(residual.as_ref())));
    let after = measured(&config, asked, |at| {
        let correction = corrected(&model, residual.as_ref(), at);
        let mut tally = tally.borrow_mut();
        let touch = tally.rows() + 1;
        tally.add(&model, &state(at, &Logged(at)), correction.status, touch);
        position_m(&correction)
    })?;
    let tally = tally.into_inner();
    stages.push(stage("After correction", "after", after));
    let mut words = String::new();
    let mut json = json!({
        "machine": machine.machine.name, "seed": asked.seed, "effects": asked.effects, "software": software(),
        "volumetric_um": asked.volumetric_um,
    });
    for Stage { title, key, errors } in &stages {
        words.insert_str(0, &format!("{title}\n{}\n", lengths::words(errors, limits, rule)?));
        json[*key] = lengths::figures(errors, limits, rule)?;
    }
    words.push_str(&format!("machine {}, seed {}\n", machine.machine.name, asked.seed));
    let meta = made_from(asked, model_sha256.as_deref(), residual.as_ref())?;
    let report = report(meta, &stages, limits, rule)?;
    let test = "the length test";
    let outside = (!tally.is_inside()).then(|| Outside {
        words: tally.words(&model, test, "touch"),
        // A model that is identified here knows the offsets of its campaign, which the test with a tool offset leaves on purpose.
        judged: if asked.model.is_some() { tally.judge(test) } else { Ok(()) },
    });
    let verdict = stages.last().and_then(|after| lengths::verdict(&after.errors, limits, rule));
    Ok(Product { words, json, report, verdict, outside, figures: Vec::new(), method: (lengths::STANDARD, Vec::new()) })
}

/// What the machine is corrected with.
struct Correcting {
    model: MachineModel,
    /// Of the file that was named; none where the model was identified here.
    model_sha256: Option<String>,
    residual: Option<OwnedField>,
}

/// The model asked for and its residual model, or one that is identified from a campaign of the simulated machine.
fn correction(
    asked: &Simulated,
    machine: &MachineFile,
    config: &SimulationConfig,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> anyhow::Result<Correcting> {
    let Some(path) = asked.model else {
        let campaign = simulate_campaign(config)?.campaign;
        let fit = identify(&machine.machine, machine.instrument, &campaign, &IdentifyOptions::default(), observe)?;
        return Ok(Correcting { model: fit.model, model_sha256: None, residual: None });
    };
    let (file, sha256) = ModelFile::load(path)?;
    let (own, found) = (&machine.machine.name, &file.model.parts().machine.name);
    ensure!(own == found, "{}: a model of machine {found}, not of {own}", path.display());
    let residual = asked.residual.map(|residual| load_residual(residual, &file, &sha256)).transpose()?;
    Ok(Correcting { model: file.model, model_sha256: Some(hex(&sha256)), residual })
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

fn corrected(model: &MachineModel, residual: Option<&OwnedField>, at: &MachineAtTouch) -> Correction {
    let logged = Logged(at);
    with_residual(correct(model, &state(at, &logged)), residual, &logged)
}

fn state<'a>(at: &MachineAtTouch, logged: &'a Logged) -> State<'a> {
    State { reading_m: at.reading_m, offset_m: at.offset_m, covariates: logged }
}

fn position_m(correction: &Correction) -> Option<[f64; 3]> {
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

/// Before and after in one row, and the verdict on the machine as it is corrected.
fn answer(stages: &[Stage], limits: &Limits, rule: &DecisionRule) -> Vec<Section> {
    let (Some(before), Some(after)) = (stages.first(), stages.last()) else { return Vec::new() };
    let figure = |label: &str, of: &dyn Fn(&LengthErrors) -> Option<f64>| KeyFigure {
        label: label.to_owned(),
        before: of(&before.errors).map(|v| Quantity::result(v * 1e6)),
        value: of(&after.errors).map(|v| Quantity::result(v * 1e6)),
        unit: "µm".to_owned(),
        detail: Some("without and with correction".to_owned()),
        ..KeyFigure::default()
    };
    let mut figures = vec![
        figure("largest error, observed", &|errors| Some(errors.largest().0.metres())),
        figure("repeatability range, observed", &|errors| Some(errors.repeatability()?.metres())),
    ];
    if let Some(limit) = &limits.length {
        let percent = |errors: &LengthErrors| Some(Quantity::new(100.0 * lengths::most_used(errors, limit).0, 0));
        let share = figure("largest share of the limit", &|_| None);
        let (before, value) = (percent(&before.errors), percent(&after.errors));
        figures.insert(1, KeyFigure { before, value, unit: "%".to_owned(), ..share });
    }
    let mut sections = Vec::new();
    if let (Some(limit), Some(verdict)) = (&limits.length, lengths::verdict(&after.errors, limits, rule)) {
        sections.push(Section::Callout(Callout {
            tone: super::tone(verdict),
            title: format!("As corrected, against {limit}"),
            text: format!("{}. Decision rule: {}.", super::verdict_in_words(verdict), lengths::rules(limits, rule)),
        }));
    }
    sections.push(Section::KeyFigures(KeyFigures { title: "At a glance".to_owned(), figures }));
    sections
}

/// Files with their hashes, and what else the simulated machine is made of.
fn made_from(
    asked: &Simulated,
    model_sha256: Option<&str>,
    residual: Option<&OwnedField>,
) -> anyhow::Result<Vec<MetaItem>> {
    let mut meta = vec![hashed("Machine file", asked.machine)?, MetaItem::new("Seed", asked.seed.to_string())];
    meta.extend(asked.effects.iter().map(|effect| MetaItem::new("Effect", effect)));
    meta.extend(asked.model.map(|path| MetaItem::file("Model", &file_name(path), model_sha256)));
    meta.extend(residual_meta(asked.residual, residual));
    meta.push(MetaItem::software(software()));
    Ok(meta)
}

fn report(meta: Vec<MetaItem>, stages: &[Stage], limits: &Limits, rule: &DecisionRule) -> anyhow::Result<Report> {
    let mut sections = answer(stages, limits, rule);
    // The same gauges, touched alike: what one state of the machine lacks of a whole test, the others lack.
    let mut lacking: Vec<Section> = stages.iter().map(|stage| lengths::lacking(&stage.errors)).collect();
    lacking.dedup();
    sections.extend(lacking);
    let states: Vec<_> = stages
        .iter()
        .enumerate()
        .map(|(k, stage)| (stage.title, abbe_report::State::of(k, stages.len()), &stage.errors))
        .collect();
    sections.push(pictures::states_against_length(&states, limits.length.as_ref()));
    for Stage { title, errors, .. } in stages {
        sections.push(Section::Heading(Heading { title: (*title).to_owned(), intro: None }));
        sections.extend(lengths::chapter(errors, limits, rule, None)?);
    }
    Ok(Report {
        title: "Length measurement error of a simulated machine".to_owned(),
        lead: Some(
            "The same gauges, touched in the same order by the simulated machine as it is, and as its models correct it."
                .to_owned(),
        ),
        identity: Identity::default(),
        next: None,
        meta,
        main_plot: None,
        footer: Some(software()),
        sections,
    })
}
