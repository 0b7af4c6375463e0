//! The machine or its instrument? What else explains what was found, and how far that answer is from it.
//!
//! Place in the flow: after the search, before anything goes into a model. An instrument whose frame or scale drifts, or a plate that
//! warms, leaves what a machine that drifts leaves. An effect of the time that is not seen beside such a drift of the same course is not
//! known to be the machine's: it stays out of the model, or in it with an uncertainty that reaches to nothing. So does an error of
//! position that a drift explains as well, and a scale whose instrument changed its own by as much. Where it is seen beside, its
//! uncertainty reaches to what it is then. Both answers lie in the 95 % interval; a covariance of rank one holds that all parameters of an
//! effect go from one to the other together.

use super::combinations::combinations;
use super::fit::{Fit, LEFT};
use super::outcome::{Ambiguity, Effect};
use super::scored::COMPARABLE;
use super::significance::probability_beside;
use super::view::View;
use crate::error::DiagnoseError;
use crate::linear::{column, joined};
use abbe_identify::in_parallel;
use faer::Mat;
use std::collections::BTreeMap;

/// Standard uncertainties, of the distance of two answers, from which k = 2 about one reaches the other, and a fifth beyond: half of all scatter about
/// the other would lie outside without that.
pub(super) const REACHES: f64 = 0.6;
/// Share of its size that a parameter keeps beside an instrument's drift, from which it is mostly the machine's; and share of the largest
/// signature from which a parameter counts in that.
const KEEPS: f64 = 0.5;
const COUNTS: f64 = 0.3;
/// What tells an error of position from a drift.
pub(super) const ANOTHER_ORDER: &str = "measure the same positions once more in another order, or there and back";

/// What a drift of an instrument does to the size of an effect that stands still.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Changed {
    /// Candidate that is the drift.
    pub(crate) by: usize,
    /// How far the parameters go on either side while the rows are taken.
    pub(crate) reach: Vec<f64>,
}

/// What is open of what was found.
#[derive(Debug, Default)]
pub(super) struct Doubts {
    /// By place in the fit: why it stays out of a model.
    pub(super) left_out: BTreeMap<usize, String>,
    /// Place in the fit, and how far another answer is, of each parameter, as a standard uncertainty.
    pub(super) apart: Vec<(usize, Vec<f64>)>,
    pub(super) ambiguities: Vec<Ambiguity>,
    /// What the fit took of each expansion that nothing shows: of all places in the fit, by how much their parameters may be off together.
    pub(super) absorbed: Vec<Vec<Vec<f64>>>,
}

impl Doubts {
    /// Covariance of two parameters (place in the fit, number).
    pub(super) fn covariance(&self, (a, i): (usize, usize), (b, j): (usize, usize)) -> f64 {
        let of_both = self.apart.iter().filter(|(place, _)| a == b && *place == a);
        let apart: f64 = of_both.map(|(_, apart)| apart[i] * apart[j]).sum();
        apart + self.absorbed.iter().map(|off| off[a][i] * off[b][j]).sum::<f64>()
    }

    /// Widens what is reported of the effect at a place in the fit.
    pub(super) fn widen(&self, place: usize, effect: &mut Effect) {
        for (k, parameter) in effect.parameters.iter_mut().enumerate() {
            let wide = parameter.u.hypot(self.covariance((place, k), (place, k)).sqrt());
            if parameter.u > 0.0 {
                parameter.half_95 *= wide / parameter.u;
            }
            parameter.u = wide;
        }
    }

    fn add(&mut self, place: usize, apart: impl IntoIterator<Item = f64>) {
        self.apart.push((place, apart.into_iter().map(|apart| apart * REACHES).collect()));
    }
}

/// Looks for other answers to each of the effects found, which stand in the order of the fit.
pub(super) fn doubts(view: &View, fit: &Fit, effects: &[Effect], significance: f64) -> Result<Doubts, DiagnoseError> {
    let mut doubts = Doubts::default();
    let study = &*view.study;
    let instrument = Instrument::new(view, fit)?;
    let explained = by_a_drift(view, fit, significance)?;
    for (place, fitted) in fit.added.iter().enumerate() {
        let candidate = &study.candidates()[fitted.candidate];
        let Some(effect) = effects.iter().find(|effect| effect.name == candidate.name) else { continue };
        if instrument.in_place_of.contains(&fitted.candidate) {
            let (is_told, beside) = instrument.beside(view, &fitted.values, fitted.candidate, significance)?;
            if is_told {
                doubts.add(place, fitted.values.iter().zip(beside).map(|(value, beside)| value - beside));
                continue;
            }
            let (rival, decided_by) = study.instrument_words();
            doubts.ambiguities.push(Ambiguity {
                effects: vec![effect.name.clone(), rival.to_owned()],
                because: "the machine or its instrument: either leaves these data, and nothing in them tells which"
                    .to_owned(),
                decided_by: decided_by.to_owned(),
            });
            if study.keeps_doubted() {
                doubts.add(place, fitted.values.iter().copied());
            } else {
                let because = format!("{rival} leaves the same, and these data cannot tell: {decided_by}");
                doubts.left_out.insert(place, because);
            }
        } else if let Some(drift) = explained.get(&fitted.candidate) {
            doubts.ambiguities.push(Ambiguity {
                effects: vec![effect.name.clone(), study.candidates()[*drift].name.clone()],
                because: "a drift of the instrument in the place of it, and of what else it explains, goes as well"
                    .to_owned(),
                decided_by: ANOTHER_ORDER.to_owned(),
            });
            doubts.add(place, fitted.values.iter().copied());
        }
        if let Some(changed) = study.changed_by_instrument(fitted.candidate, &fit.values()) {
            let by = &study.candidates()[changed.by].name;
            let is_within = |(value, reach): (&f64, &f64)| value.abs() <= 2.0 * reach;
            doubts.ambiguities.push(Ambiguity {
                effects: vec![effect.name.clone(), by.clone()],
                because: "which of the sizes that it had meanwhile is that of the machine, nothing in these data tells"
                    .to_owned(),
                decided_by: study.instrument_words().1.to_owned(),
            });
            if !study.keeps_doubted() && fitted.values.iter().zip(&changed.reach).all(is_within) {
                let because = format!("{by} is as large, so that all of it may be the instrument's");
                doubts.left_out.insert(place, because);
            } else {
                doubts.add(place, changed.reach);
            }
        }
    }
    // Of a size that changed by what may be the instrument, nobody knows which was the machine's.
    let left_out = doubts.left_out.keys().map(|place| fit.added[*place].candidate);
    let untold: Vec<usize> = left_out.chain(explained.into_values()).collect();
    for (place, fitted) in fit.added.iter().enumerate() {
        if untold.iter().any(|with| study.grows(fitted.candidate, *with)) {
            doubts.add(place, fitted.values.iter().copied());
        }
    }
    Ok(doubts)
}

/// Effects that stand still and are not seen beside a drift of the instrument, with that drift, where it goes as well in the place of all of
/// these: a plate that warms while a raster goes through it bends both components at once.
fn by_a_drift(view: &View, fit: &Fit, significance: f64) -> Result<BTreeMap<usize, usize>, DiagnoseError> {
    let (study, set) = (&*view.study, fit.set());
    let still: Vec<usize> = set.iter().copied().filter(|k| !study.passes(*k)).collect();
    let drifts: Vec<usize> = (0..study.candidates().len())
        .filter(|k| !still.is_empty() && study.is_of_instrument(*k) && !set.contains(k))
        .collect();
    let one = |drift: &usize| -> Vec<usize> {
        let with = |rest: Vec<usize>| Fit::settle(view, &[vec![*drift], rest].concat());
        let less = |out: &[usize]| set.iter().copied().filter(|k| !out.contains(k)).collect::<Vec<usize>>();
        let is_explained =
            |k: &usize| with(less(&[*k])).is_ok_and(|without| without.score(view, *k).0.p_value > significance);
        let explained: Vec<usize> = still.iter().copied().filter(is_explained).collect();
        let Ok(instead) = with(less(&explained)) else { return Vec::new() };
        let columns = |fit: &Fit| fit.linear.jacobian().ncols() as f64;
        let loss = fit.linear.degrees().max(1.0) * (instead.linear.chi2() / fit.linear.chi2()).ln();
        let price = (columns(fit) - columns(&instead)) * (view.len().max(2) as f64).ln();
        if loss - price < COMPARABLE { explained } else { Vec::new() }
    };
    let all = in_parallel(&drifts, one);
    let mut explained = BTreeMap::new();
    for (drift, own) in drifts.iter().zip(all) {
        own.into_iter().for_each(|k| _ = explained.entry(k).or_insert(*drift));
    }
    Ok(explained)
}

/// What an instrument does in the place of all effects of the machine that go with the time: one drift of it leaves several of these.
struct Instrument {
    in_place_of: Vec<usize>,
    /// The fit with all the others, and the instrument's columns (not whitened).
    without: Fit,
    columns: Mat<f64>,
}

impl Instrument {
    fn new(view: &View, fit: &Fit) -> Result<Instrument, DiagnoseError> {
        let (mut in_place_of, mut others, mut columns) = (Vec::new(), Vec::new(), Vec::new());
        for candidate in fit.set() {
            let own = view.study.instrument_beside(candidate);
            if own.ncols() > 0 {
                in_place_of.push(candidate);
                columns.push(view.picked(&own));
            } else {
                others.push(candidate);
            }
        }
        let columns = if columns.is_empty() { Mat::zeros(view.len(), 0) } else { joined(&columns) };
        Ok(Instrument { in_place_of, without: Fit::settle(view, &others)?, columns })
    }

    /// Whether an effect found is seen beside it, and its parameters then; what cannot be told of them is zero.
    fn beside(
        &self,
        view: &View,
        values: &[f64],
        candidate: usize,
        significance: f64,
    ) -> Result<(bool, Vec<f64>), DiagnoseError> {
        let columns = view.columns(&self.without.point, candidate);
        let linear = self.without.with_columns(view.whitened(&self.columns).as_ref())?;
        let own = linear.project(view.whitened(&columns).as_ref());
        let map = combinations(&own.left, &own.alone, LEFT);
        let seen = map.transpose() * &own.left * &map;
        let gradient = map.transpose() * column(&own.gradient);
        // Combinations are at right angles in what is left of them.
        let solved = Mat::from_fn(map.ncols(), 1, |k, _| gradient[(k, 0)] / seen[(k, k)].max(f64::MIN_POSITIVE));
        let solved = map * solved;
        let beside: Vec<f64> = (0..values.len()).map(|k| solved[(k, 0)]).collect();
        let size = |k: usize| values[k].abs() * own.alone[(k, k)].sqrt();
        let largest = (0..values.len()).map(size).fold(0.0, f64::max);
        let keeps = |k: usize| size(k) >= COUNTS * largest && beside[k] * values[k].signum() >= KEEPS * values[k].abs();
        let is_told = (0..values.len()).any(keeps)
            && probability_beside(view, &self.without, &self.columns, &columns)? <= significance;
        Ok((is_told, beside))
    }
}
