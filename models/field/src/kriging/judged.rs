//! Kriging of vectors that were held against each other.
//!
//! Place in the flow: what `abbe interpolate` answers with, and what residual models are trained on. [`super::gross`] accuses vectors;
//! here each stands trial against the fit without any accused: it is left out if what was measured there is further than six deviations from what that predicts,
//! declared uncertainty and scatter included, and improbable by chance among so many vectors (Student's t). What belongs to a
//! feature of the field that several neighbouring vectors show stays. Many such vectors are no accidents, and then nothing is
//! answered. The rest is fitted again; by how much it scatters beyond its declared uncertainty, is told.

use super::averaged::{Averaged, AveragedKriging, check_planes};
use super::gross::{self, Neighbourhood};
use super::{COMPONENTS, KrigingError, KrigingOptions};
use crate::measured::MeasuredField;
use crate::samples::Samples;
use nalgebra::Vector3;

/// Share of the vectors up to which gross ones are accidents, and a number that always may be.
const SHARE: f64 = 0.05;
const ALWAYS: usize = 1;
/// Scatter over declared uncertainty from which the vectors contradict it.
const CONTRADICTS: f64 = 1.5;
/// Vectors that a message names.
const NAMED: usize = 5;
/// Trials of the accused at most: each may acquit some.
const TRIALS: usize = 4;

/// A vector that is left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// Index in the field.
    pub index: usize,
    /// Component that is furthest off, in deviations.
    pub component: usize,
    /// Measured error less what the others predict (m).
    pub off_m: f64,
    /// The same over its standard uncertainty.
    pub deviations: f64,
}

impl LeftOut {
    /// Letter of the component.
    pub fn axis(&self) -> &'static str {
        COMPONENTS[self.component]
    }
}

/// What holding vectors against each other found.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// Vectors that are left out, in order.
    pub left_out: Vec<LeftOut>,
    /// Indices of the others, ascending.
    pub kept: Vec<usize>,
    /// By component, scatter of the vectors over the uncertainty that they declare, where it is more than one and a half.
    pub contradicted: [Option<f64>; 3],
    /// By component, what the vectors scatter by that declare no uncertainty, and what is taken for noise of theirs (m, k = 1).
    pub taken_for_noise_m: Option<Vector3<f64>>,
    /// By component, by how much u was widened beyond what covariance and scatter make it, at least 1.
    pub widening: Vector3<f64>,
}

/// Fits the vectors that do not contradict all others.
///
/// # Errors
/// What no field can be made of, and vectors of which too many contradict the others.
pub fn judge(field: &MeasuredField, options: &KrigingOptions) -> Result<(AveragedKriging, Judgement), KrigingError> {
    check_planes(field)?;
    let (averaged, judgement) = held(&Samples::from(field), options)?;
    let part = field.part(&judgement.kept)?;
    check_planes(&part)?;
    Ok((AveragedKriging::of(averaged, &part, options), judgement))
}

/// Which vectors by any inputs contradict all others.
///
/// # Errors
/// As [`judge`].
pub fn judge_samples(samples: &Samples, options: &KrigingOptions) -> Result<Judgement, KrigingError> {
    held(samples, options).map(|(_, judgement)| judgement)
}

fn held(samples: &Samples, options: &KrigingOptions) -> Result<(Averaged, Judgement), KrigingError> {
    let all: Vec<usize> = (0..samples.count()).collect();
    let mut accused = gross::suspects(samples, options)?;
    for _ in 0..TRIALS {
        let kept: Vec<usize> = all.iter().copied().filter(|k| !accused.contains(k)).collect();
        let part = samples.part(&kept)?;
        let fit = Averaged::fit(&part, options)?;
        let guilty = tried(samples, options, &fit, &accused)?;
        if guilty.len() == accused.len() {
            check_share(&guilty, all.len())?;
            let contradicted = contradicted(&part, &fit);
            let widening = fit.widening();
            let is_declared = declared_m(&part, options).is_some();
            let taken_for_noise_m = (!is_declared).then(|| fit.noise_variance_m2().map(f64::sqrt));
            return Ok((fit, Judgement { left_out: guilty, kept, contradicted, taken_for_noise_m, widening }));
        }
        accused = guilty.iter().map(|one| one.index).collect();
    }
    Err(KrigingError::Undecided)
}

/// The accused that the fit without them does not acquit.
fn tried(
    samples: &Samples,
    options: &KrigingOptions,
    fit: &Averaged,
    accused: &[usize],
) -> Result<Vec<LeftOut>, KrigingError> {
    if accused.is_empty() {
        return Ok(Vec::new());
    }
    let neighbourhood = Neighbourhood::of(samples, options)?;
    let off_m: Vec<(usize, Vector3<f64>)> =
        accused.iter().map(|k| (*k, samples.errors_m()[*k] - fit.predict(samples.point(*k)).0)).collect();
    let freedom = (samples.count() - accused.len()) as f64 - 5.0;
    let components = 3 * samples.count();
    let mut guilty = Vec::new();
    for (index, off) in &off_m {
        let variance = variance_m2(samples, options, fit, *index);
        let worst = (0..3).max_by(|a, b| (off[*a].powi(2) / variance[*a]).total_cmp(&(off[*b].powi(2) / variance[*b])));
        let Some(component) = worst else { continue };
        let deviations = off[component] / variance[component].sqrt();
        let is_far = gross::is_far(deviations, freedom.max(1.0), components);
        if is_far && !neighbourhood.is_feature(*index, component, &off_m) {
            guilty.push(LeftOut { index: *index, component, off_m: off[component], deviations });
        }
    }
    Ok(guilty)
}

/// Standard uncertainties that vectors declare, where they count (m).
fn declared_m<'a>(samples: &'a Samples, options: &KrigingOptions) -> Option<&'a [Vector3<f64>]> {
    options.noise.is_declared().then(|| samples.u_m()).flatten()
}

/// Variance of a measured error less what the others predict there (m²).
fn variance_m2(samples: &Samples, options: &KrigingOptions, fit: &Averaged, index: usize) -> Vector3<f64> {
    let field_m = fit.predict(samples.point(index)).1;
    let declared_m = declared_m(samples, options).map_or(Vector3::zeros(), |u_m| u_m[index]);
    field_m.component_mul(&field_m) + declared_m.component_mul(&declared_m) + fit.noise_variance_m2()
}

fn check_share(guilty: &[LeftOut], vectors: usize) -> Result<(), KrigingError> {
    let most = ALWAYS.max((SHARE * vectors as f64) as usize);
    if guilty.len() <= most {
        return Ok(());
    }
    let mut worst = guilty.to_vec();
    worst.sort_by(|a, b| b.deviations.abs().total_cmp(&a.deviations.abs()));
    Err(KrigingError::TooManyGross { gross: worst, vectors })
}

fn contradicted(part: &Samples, fit: &Averaged) -> [Option<f64>; 3] {
    let Some(u_m) = part.u_m() else { return [None; 3] };
    let noise_m = fit.noise_m();
    [0, 1, 2].map(|d| {
        let declared_m2 = u_m.iter().map(|u| u[d] * u[d]).sum::<f64>() / u_m.len() as f64;
        let ratio = (1.0 + noise_m[d] * noise_m[d] / declared_m2).sqrt();
        (ratio > CONTRADICTS).then_some(ratio)
    })
}

/// The first of them, as text.
pub(super) fn named(gross: &[LeftOut]) -> String {
    let one = |one: &LeftOut| format!("point {} {} by {:+.3} µm", one.index, one.axis(), one.off_m * 1e6);
    let shown: Vec<String> = gross.iter().take(NAMED).map(one).collect();
    let more = if gross.len() > NAMED { " ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
