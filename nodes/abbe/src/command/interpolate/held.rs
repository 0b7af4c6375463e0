//! Measured vectors held against each other, before any method interpolates them.
//!
//! Place in the flow: vectors as read in, the field of those that do not contradict all others out, with kriging of it, and what
//! is to be said: vectors left out with their lines, uncertainties that the vectors contradict, vectors too few to speak for
//! themselves. Method: `abbe_field::kriging::judge`.

use super::UM;
use crate::plane_field::PlaneField;
use abbe_field::MeasuredField;
use abbe_field::kriging::{AveragedKriging, Judgement, KrigingError, KrigingOptions, LeftOut, judge};
use abbe_geometry::Axis;
use abbe_report::digits;
use anyhow::{Context, bail};
use serde_json::{Value, json};
use std::path::Path;

/// Vectors below which uncertainty rests more on what is assumed of a field than on what they show of it.
const FEW: usize = 20;
/// Vectors that are named.
const NAMED: usize = 10;

/// Vectors that were held against each other.
pub(super) struct Held {
    /// Those that are left.
    pub(super) field: MeasuredField,
    /// Kriging of them, where there is one.
    pub(super) kriging: Option<AveragedKriging>,
    left_out: Vec<Value>,
    warnings: Vec<String>,
    scatter: Value,
}

/// Kriging as `interpolate` does it.
pub(super) fn options(field: &MeasuredField) -> KrigingOptions {
    KrigingOptions::usual(field.u_m().is_some())
}

/// Holds vectors against each other; where that cannot be done it is refused if kriging `must` be, and told otherwise.
pub(super) fn hold(path: &Path, read: &PlaneField, must: bool) -> anyhow::Result<Held> {
    let file = path.display();
    match judge(&read.field, &options(&read.field)) {
        Ok((kriging, judgement)) => held(path, read, kriging, &judgement),
        Err(KrigingError::TooManyGross { gross, vectors }) => {
            let texts: Vec<String> = gross.iter().map(|one| text(read, one)).collect();
            bail!(
                "{file}: {} of {vectors} vectors contradict all others, which is more than accidents: {}; check these, and whether \
                 all vectors are of one machine in one state",
                gross.len(),
                list(&texts)
            )
        }
        Err(error) if must => Err(error).with_context(|| file.to_string()),
        Err(error) => Ok(Held {
            field: read.field.clone(),
            kriging: None,
            left_out: Vec::new(),
            warnings: vec![format!("{file}: the vectors were not held against each other: {error}")],
            scatter: Value::Null,
        }),
    }
}

fn held(path: &Path, read: &PlaneField, kriging: AveragedKriging, judgement: &Judgement) -> anyhow::Result<Held> {
    let file = path.display();
    let mut warnings = Vec::new();
    let measured = |axis: &Axis| read.lacks.error != Some(*axis);
    let axes: Vec<Axis> = Axis::ALL.into_iter().filter(measured).collect();
    if !judgement.left_out.is_empty() {
        let texts: Vec<String> = judgement.left_out.iter().map(|one| text(read, one)).collect();
        warnings.push(format!(
            "{file}: {} of {} vectors contradict all others and are left out: {}",
            texts.len(),
            read.lines.len(),
            list(&texts)
        ));
    }
    let times = |axis: &Axis| judgement.contradicted[axis.index()].map(|ratio| format!("{} {ratio:.1}", axis.lower()));
    let contradicted: Vec<String> = axes.iter().filter_map(times).collect();
    if !contradicted.is_empty() {
        warnings.push(format!(
            "{file}: the vectors scatter by more than their uncertainty u: {} times. That is taken for an error that changes between the vectors, \
             and u of the answers holds it. Check the declared u, and measure more densely",
            contradicted.join(", ")
        ));
    }
    if let Some(noise_m) = judgement.taken_for_noise_m {
        let of = |axis: &Axis| format!("{} {} µm", axis.lower(), digits::result(noise_m[axis.index()] * UM));
        let noise: Vec<String> = axes.iter().map(of).collect();
        warnings.push(format!(
            "{file}: no uncertainty u is declared. What neighbouring vectors differ by ({}, k = 1) is taken for noise of theirs, and u of the answers is \
             without it; as far as it is an error that changes between them, u is too small. Declare u_x_um, u_y_um and u_z_um, and u holds what is more than that",
            noise.join(", ")
        ));
    }
    if judgement.kept.len() < FEW {
        warnings.push(format!(
            "{file}: {} vectors are few: u rests on the assumption that errors change smoothly over about a third of the \
             volume; measure {FEW} or more",
            judgement.kept.len()
        ));
    }
    let left_out = judgement.left_out.iter().map(|one| value(read, one)).collect();
    let of_axes = |of: &dyn Fn(usize) -> Value| -> serde_json::Map<String, Value> {
        axes.iter().map(|axis| (axis.lower().to_owned(), of(axis.index()))).collect()
    };
    let scatter = json!({
        "over_declared_u": of_axes(&|d| judgement.contradicted[d].map_or(Value::Null, Value::from)),
        "taken_for_noise_um": of_axes(&|d| judgement.taken_for_noise_m.map_or(Value::Null, |m| (m[d] * UM).into())),
        "u_widened_by": of_axes(&|d| judgement.widening[d].into()),
    });
    let field = read.field.part(&judgement.kept).with_context(|| file.to_string())?;
    Ok(Held { field, kriging: Some(kriging), left_out, warnings, scatter })
}

impl Held {
    /// Says on the terminal what must not be overlooked.
    pub(super) fn say(&self) {
        for warning in &self.warnings {
            eprintln!("abbe: warning: {warning}");
        }
    }

    /// The same as JSON.
    pub(super) fn json(&self) -> Value {
        json!({
            "used": self.field.points_m().len(),
            "left_out": self.left_out,
            "scatter": self.scatter,
            "warnings": self.warnings,
        })
    }
}

fn text(read: &PlaneField, one: &LeftOut) -> String {
    let [x, y, z] = <[f64; 3]>::from(read.field.points_m()[one.index] * 1e3);
    format!(
        "line {} ({x:.3} {y:.3} {z:.3}) mm: {} is {:+.3} µm off, {:.0} u",
        read.lines[one.index],
        one.axis(),
        one.off_m * UM,
        one.deviations.abs()
    )
}

fn value(read: &PlaneField, one: &LeftOut) -> Value {
    let at: [f64; 3] = (read.field.points_m()[one.index] * 1e3).into();
    json!({
        "line": read.lines[one.index], "x_mm": at[0], "y_mm": at[1], "z_mm": at[2],
        "component": one.axis(), "off_um": one.off_m * UM, "deviations": one.deviations,
    })
}

fn list(texts: &[String]) -> String {
    let shown: Vec<&str> = texts.iter().take(NAMED).map(String::as_str).collect();
    let more = if texts.len() > NAMED { "; ..." } else { "" };
    format!("{}{more}", shown.join("; "))
}
