//! The model file that comes of positioning runs or residual vectors.
//!
//! Place in the flow: what a study found ([`Terms`]) and the machine it was found on in; a model out that corrects just that, as
//! `correct`, `export` and the live nodes take it. Error functions, squareness and stations stay at zero: nobody measured them
//! here, and the file says so to everyone who loads it.

use crate::pipeline::software;
use abbe_diagnose::study::{StudyDiagnosis, Terms};
use abbe_files::{DataSource, Doubt, MachineFile, ModelFile};
use abbe_geometry::Axis;
use abbe_geometry::layout::Layout;
use abbe_geometry::machine::Machine;
use abbe_geometry::model::{FitQuality, FittedEffect, IdentifiedVolume, MachineModel, ModelParts, packed};
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_identify::verdict::Grade;
use anyhow::Context;
use serde_json::{Value, json};

/// Distance beyond the stroke that an axis may have been measured at, as limit switches allow (m).
const BESIDE_M: f64 = 1e-3;

/// Errors that were found on a machine, as a model of it; `None` where there is nothing to correct.
pub(super) fn model(
    diagnosis: &StudyDiagnosis,
    machine: &MachineFile,
    source: DataSource,
    options: Value,
) -> anyhow::Result<Option<ModelFile>> {
    let terms = &diagnosis.terms;
    if terms.list.is_empty() {
        return Ok(None);
    }
    let words = || format!("{}: what was found does not fit machine {}", source.file, machine.machine.name);
    let parts = parts(diagnosis, &machine.machine).with_context(words)?;
    let model = MachineModel::new(parts).with_context(words)?;
    let effects: Vec<Value> =
        diagnosis.effects.iter().map(|e| json!({ "name": e.name, "p_value": e.p_value })).collect();
    Ok(Some(ModelFile {
        model,
        order: machine.order,
        instrument: machine.instrument,
        absolute_range: machine.absolute_range,
        residual_network: None,
        data: vec![source],
        seed: None,
        options,
        evidence: json!({ "study": diagnosis.of, "effects": effects }),
        doubts: [nothing_else(diagnosis), doubts(diagnosis, &machine.machine)].concat(),
        software: software(),
    }))
}

fn parts(diagnosis: &StudyDiagnosis, given: &Machine) -> anyhow::Result<ModelParts> {
    let terms = &diagnosis.terms;
    let mut machine = Machine { kinds: [None; abbe_geometry::ErrorId::COUNT], ..given.clone() };
    for (repeatability_m, deviation_m) in machine.repeatability_m.iter_mut().zip(terms.deviations_m) {
        *repeatability_m = deviation_m.unwrap_or(*repeatability_m);
    }
    let offset_m = machine.default_offset_m.unwrap_or([0.0; 3]);
    let layout = Layout::new(&machine, offset_m)?;
    let effects = terms
        .list
        .iter()
        .map(|term| MachineModel::fitted_effect(term.effect, term.shape.clone(), &machine, term.values.clone()));
    let effects = effects.collect::<Result<Vec<FittedEffect>, _>>()?;
    let strokes = machine.stroke_m;
    let used = diagnosis.rows - diagnosis.rejected.len();
    Ok(ModelParts {
        coefficients: vec![0.0; layout.len()],
        offset_centre_m: offset_m,
        covariance: covariance(&layout, &machine, terms),
        chord_covariance: Vec::new(),
        effects,
        stations: Vec::new(),
        identified: IdentifiedVolume {
            reading_m: Axis::ALL.map(|axis| terms.readings_m[axis.index()].unwrap_or(strokes[axis.index()])),
            offset_m: offset_m.map(|offset_m| (offset_m, offset_m)),
            covariates: terms.covariates.clone(),
            differences: terms.differences.clone(),
        },
        quality: FitQuality {
            readings: used,
            rejected: diagnosis.rejected.len(),
            // Where no uncertainty is declared the residuals say it, and hold to it by that.
            chi2_per_dof: diagnosis.after.chi2_per_dof.unwrap_or(1.0),
            residual_rms_m: diagnosis.after.rms_um / 1e6,
            // A study takes its noise from its own residuals: all of it is in the covariance.
            unexplained_m: [0.0; 3],
            wanders: None,
            unseen_expansions: UnseenExpansions { by_sensor: terms.unseen_expansions.clone(), ..Default::default() },
        },
        machine,
    })
}

/// Nothing of geometry but the usual uncertainty of the ram's turn, then the terms.
fn covariance(layout: &Layout, machine: &Machine, terms: &Terms) -> Vec<f64> {
    let geometry = layout.len();
    let mut triangle = vec![0.0; geometry * (geometry + 1) / 2];
    for (index, u_rad) in layout.ram_turn().zip(machine.u_ram_turn_rad) {
        triangle[packed(index, index)] = u_rad * u_rad;
    }
    let mut own = terms.covariance.iter();
    let mut row = 0;
    while own.len() > row {
        triangle.extend(std::iter::repeat_n(0.0, geometry));
        triangle.extend(own.by_ref().take(row + 1));
        row += 1;
    }
    triangle
}

/// That a model holds what was found, and nothing else.
fn nothing_else(diagnosis: &StudyDiagnosis) -> Vec<Doubt> {
    let terms = &diagnosis.terms;
    let letters = |is_measured: bool| -> String {
        let own = Axis::ALL.into_iter().filter(|axis| terms.deviations_m[axis.index()].is_some() == is_measured);
        own.map(Axis::letter).collect()
    };
    warnings(vec![format!(
        "it holds what {} showed along {}, and nothing else of the machine: what was not measured is neither corrected nor in the \
         uncertainty, such as angles, straightness and squareness where only positions were measured{}",
        diagnosis.of,
        letters(true),
        if letters(false).is_empty() { String::new() } else { format!(", and all of {}", letters(false)) },
    )])
}

/// What whoever corrects with what was found must know.
pub(super) fn doubts(diagnosis: &StudyDiagnosis, machine: &Machine) -> Vec<Doubt> {
    let terms = &diagnosis.terms;
    let mut texts = Vec::new();
    let beyond = Axis::ALL.into_iter().filter_map(|axis| {
        let ((low_m, high_m), (from_m, to_m)) = (terms.readings_m[axis.index()]?, machine.stroke_m[axis.index()]);
        (low_m < from_m - BESIDE_M || high_m > to_m + BESIDE_M).then(|| {
            format!(
                "{} was measured from {:.1} to {:.1} mm, and the machine's stroke is {:.1} to {:.1} mm: readings outside it are rejected, so \
                 check frame and signs of what was measured, or the machine file",
                axis.letter(),
                low_m * 1e3,
                high_m * 1e3,
                from_m * 1e3,
                to_m * 1e3
            )
        })
    });
    texts.extend(beyond);
    texts.extend(
        diagnosis
            .contradictions
            .iter()
            .map(|what| format!("the data contradict themselves, and no uncertainty holds it: {what}")),
    );
    texts.extend(diagnosis.hidden.iter().map(|what| format!("not seen, not corrected and in no uncertainty: {what}")));
    if diagnosis.is_stopped {
        texts.push(
            "the study was stopped on request: more may be missing, and nothing was judged on data that the search did not see"
                .to_owned(),
        );
    }
    texts.extend(terms.untold.iter().map(|what| {
        format!("not known, not corrected, and in the uncertainty with what is usual: {what}; measure it, or correct only where it was measured")
    }));
    if !terms.apart.is_empty() {
        texts.push(format!(
            "its axes were measured at different values of {}: what an axis does at values at which it was not measured is known where an \
             effect says so; of temperatures its expansion is in the uncertainty otherwise, and nothing else is",
            terms.apart.join(", ")
        ));
    }
    let left_out =
        terms.left_out.iter().map(|(name, reason)| format!("{name} was found, and is not in the model: {reason}"));
    texts.extend(left_out);
    warnings(texts)
}

fn warnings(texts: Vec<String>) -> Vec<Doubt> {
    texts.into_iter().map(|text| Doubt { grade: Grade::Warning.name().to_owned(), text }).collect()
}
