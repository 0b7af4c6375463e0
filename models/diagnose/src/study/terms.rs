//! What was found, as effects of a machine model: parameters with their joint covariance, and what has no place in a model.
//!
//! Place in the flow: last step of a study of runs or vectors; whoever knows the machine makes the model of it. Each kind of
//! data says what its candidates are there ([`super::candidate::ModelTerm`]). Uncertainties are those of the diagnosis, with
//! what the correlation of the noise leaves open. Between the places of a table nobody measured: what lies there is as large as
//! neighbours depart from the straight line through theirs, less where the table is seen to be smooth, by the order of
//! interpolation that shows at twice the step. Before the first and behind the last it is as large as neighbours differ, with the distance
//! likewise. Where a wave goes as well as another, it may be as large as the wave.

use super::candidate::{Between, ModelTerm, Open, Study};
use super::fit::Fit;
use super::told::Doubts;
use crate::columns::range;
use abbe_geometry::effects::Shape;
use abbe_geometry::model::Difference;
use abbe_geometry::seen::TEMPERATURE;
use abbe_geometry::unseen_expansion::UnseenExpansion;
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::collections::{BTreeMap, BTreeSet};

/// Order of interpolation that a smooth table reaches.
const MOST_ORDER: f64 = 2.0;
/// Order that a table has at least: however rough an axis is, what it does does not jump next to a place.
const LEAST_ORDER: f64 = 0.25;
/// Departures for each that is independent.
const SHARED: f64 = 1.5;
/// Degrees of freedom from which a deviation counts as known, and the fewest that are believed in.
const MANY: f64 = 1e3;
const FEWEST: f64 = 3.0;
/// Probability below the upper end of an interval that holds 95 %, and that end for a deviation known.
const COVERED: f64 = 0.975;
const NORMAL: f64 = 1.96;

/// An effect of a machine model.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// Effect of the study that it is, or is part of.
    pub of: String,
    /// Name in the registry of effects.
    pub effect: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// Values of its parameters, SI.
    pub values: Vec<f64>,
}

/// All that a model can take.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Terms {
    /// In the order of the effects found.
    pub list: Vec<Term>,
    /// Covariance of all values, packed lower triangle row by row, SI.
    pub covariance: Vec<f64>,
    /// Range of each quantity that was logged or that the terms read, in the unit of its name.
    pub covariates: BTreeMap<String, (f64, f64)>,
    /// How far temperatures that the terms read stood from the others that were logged.
    pub differences: Vec<Difference>,
    /// What the rows leave open of the expansion of each scale with each temperature that was logged.
    pub unseen_expansions: Vec<UnseenExpansion>,
    /// Smallest and largest reading of X, Y, Z (m) where they were measured.
    pub readings_m: [Option<(f64, f64)>; 3],
    /// Standard deviation of one reading (m) along X, Y, Z, where it was measured.
    pub deviations_m: [Option<f64>; 3],
    /// Effects found that a model cannot hold, with the reason.
    pub left_out: Vec<(String, String)>,
    /// What was not measured, and stands in the uncertainty with what is usual.
    pub untold: Vec<String>,
    /// Logged quantities of which parts of the machine were measured in different ranges, in words.
    pub apart: Vec<String>,
}

/// A value of a model as a combination of what was fitted.
struct Value {
    /// Place in the fit, number of the parameter, factor.
    made_of: Vec<((usize, usize), f64)>,
    value: f64,
    /// Variance that no fit knows of (m²).
    beside: f64,
}

/// Terms of a fit; `u` are the uncertainties of its parameters from the scatter, `doubts` what else they may be, `open` what tells of the rest,
/// `unseen` the expansions that it leaves open.
pub(super) fn terms(
    study: &dyn Study,
    fit: &Fit,
    u: &[Vec<f64>],
    doubts: &Doubts,
    (open, unseen): (&Open, Vec<UnseenExpansion>),
) -> Terms {
    let mut terms = Terms { readings_m: study.readings_m(), apart: study.apart(), ..Terms::default() };
    // The uncertainties reported hold more than the fit's own: correlations keep, deviations grow.
    let wider = |(a, i): (usize, usize)| {
        let own = fit.added[a].u[i];
        if own > 0.0 { u[a][i] / own } else { 1.0 }
    };
    let covariance =
        |x: (usize, usize), y: (usize, usize)| wider(x) * fit.covariance(x, y) * wider(y) + doubts.covariance(x, y);
    let mut values: Vec<Value> = Vec::new();
    for (place, fitted) in fit.added.iter().enumerate() {
        let of = study.candidates()[fitted.candidate].name.clone();
        let own = match doubts.left_out.get(&place).cloned().map_or_else(|| study.model_terms(fitted.candidate), Err) {
            Ok(own) => own,
            Err(reason) => {
                terms.left_out.push((of, reason));
                continue;
            }
        };
        for ModelTerm { effect, mut shape, map, table } in own {
            let mut own = Vec::with_capacity(map.nrows());
            for row in 0..map.nrows() {
                let made_of: Vec<_> = (0..map.ncols())
                    .map(|k| ((place, k), map[(row, k)]))
                    .filter(|(_, factor)| *factor != 0.0)
                    .collect();
                let value = made_of.iter().map(|((_, k), factor)| factor * fitted.values[*k]).sum();
                own.push(Value { made_of, value, beside: 0.0 });
            }
            if let Some(table) = &table {
                let ((gaps, order), beyond) = match table.between {
                    Between::Departures => (between(&table.places_m, &own, &covariance), apart(&own)),
                    // Two waves of one size differ by as much, wherever they are.
                    Between::Alias => {
                        let size = fitted.values.iter().map(|value| value * value).sum();
                        ((vec![size; table.places_m.len() - 1], 0.0), size)
                    }
                };
                let steps = table.places_m.len() - 1;
                let open = gaps.into_iter().chain([beyond, beyond]);
                own.extend(open.map(|beside| Value { made_of: Vec::new(), value: 0.0, beside }));
                let mean_m = (table.places_m[steps] - table.places_m[0]) / steps as f64;
                shape = shape.number("between_order", order).number("beyond_m", mean_m);
            }
            add(&mut terms.list, &mut values, Term { of: of.clone(), effect, shape, values: Vec::new() }, own);
        }
        for name in study.model_covariates(fitted.candidate) {
            for own in differences(&name, &study.logged_at(fitted.candidate)) {
                narrow(&mut terms.differences, own);
            }
            terms.covariates.extend(study.model_range(&name).map(|range| (name, range)));
        }
    }
    if !terms.list.is_empty() {
        terms.unseen_expansions = unseen;
    }
    // Where nothing was found there is no model to be told it.
    let untold = if terms.list.is_empty() { Vec::new() } else { study.untold(open) };
    for own in untold {
        let ModelTerm { effect, shape, .. } = own.term;
        let range = own.reads.and_then(|name| Some((study.model_range(&name)?, name)));
        terms.covariates.extend(range.map(|(range, name)| (name, range)));
        terms.list.push(Term { of: own.what.clone(), effect, shape, values: vec![0.0; own.u.len()] });
        terms.untold.extend(own.is_usual.then_some(own.what));
        values.extend(own.u.iter().map(|u| Value { made_of: Vec::new(), value: 0.0, beside: u * u }));
    }
    for name in study.logged() {
        terms.covariates.extend(study.model_range(&name).map(|range| (name, range)));
    }
    for (row, a) in values.iter().enumerate() {
        for (column, b) in values[..=row].iter().enumerate() {
            let beside = if row == column { a.beside } else { 0.0 };
            terms.covariance.push(of_two(&a.made_of, &b.made_of, &covariance) + beside);
        }
    }
    terms
}

/// Adds a term of these values; where the model has the same already, as the linear errors of two angular errors of one axis may be, that has
/// both.
fn add(list: &mut Vec<Term>, values: &mut Vec<Value>, term: Term, own: Vec<Value>) {
    let is_same = |other: &Term| other.effect == term.effect && other.shape == term.shape;
    let place = list.iter().position(is_same).unwrap_or_else(|| {
        list.push(Term { values: vec![0.0; own.len()], ..term });
        values.extend(own.iter().map(|_| Value { made_of: Vec::new(), value: 0.0, beside: 0.0 }));
        list.len() - 1
    });
    let first: usize = list[..place].iter().map(|term| term.values.len()).sum();
    for (k, more) in own.into_iter().enumerate() {
        list[place].values[k] += more.value;
        let value = &mut values[first + k];
        value.made_of.extend(more.made_of);
        value.value += more.value;
        value.beside += more.beside;
    }
}

/// How far a temperature stood from each other one that was logged with it.
fn differences(name: &str, logged: &[&BTreeMap<String, f64>]) -> Vec<Difference> {
    let others: BTreeSet<&String> = logged.iter().flat_map(|row| row.keys()).collect();
    let is_other = |other: &&&String| other.ends_with(TEMPERATURE) && other.as_str() != name;
    let of = |less: &&String| {
        let values = logged.iter().filter_map(|row| Some(row.get(name)? - row.get(*less)?));
        let (low, high) = range(values);
        (low <= high).then(|| Difference { name: name.to_owned(), less: (*less).clone(), range: (low, high) })
    };
    match name.ends_with(TEMPERATURE) {
        true => others.iter().filter(is_other).filter_map(of).collect(),
        false => Vec::new(),
    }
}

/// Two effects that read a temperature: the narrower range holds for both, and all that was measured where they have none in common.
fn narrow(all: &mut Vec<Difference>, own: Difference) {
    let Some(known) = all.iter_mut().find(|known| known.name == own.name && known.less == own.less) else {
        return all.push(own);
    };
    let ((low, high), (from, to)) = (known.range, own.range);
    let both = (low.max(from), high.min(to));
    known.range = if both.0 <= both.1 { both } else { (low.min(from), high.max(to)) };
}

type Place = (usize, usize);

fn of_two(a: &[(Place, f64)], b: &[(Place, f64)], covariance: &impl Fn(Place, Place) -> f64) -> f64 {
    a.iter().map(|(i, x)| b.iter().map(|(j, y)| x * y * covariance(*i, *j)).sum::<f64>()).sum()
}

/// Mean square of the difference of neighbours (m²).
fn apart(values: &[Value]) -> f64 {
    let squares = values.windows(2).map(|pair| (pair[1].value - pair[0].value).powi(2));
    squares.sum::<f64>() / values.len().saturating_sub(1).max(1) as f64
}

/// What may lie halfway between each two places of a table (variance, m²), and the order of interpolation that it shows: near zero where a
/// place says little of what is near it.
///
/// A value departs from the chord of its neighbours by what a reach as long hides. Departures of neighbours and of those beyond them grow
/// with their reach to the power of twice the order, and so does what each gap may hold: places in close pairs say nothing of wide gaps.
fn between(places_m: &[f64], values: &[Value], covariance: &impl Fn(Place, Place) -> f64) -> (Vec<f64>, f64) {
    let departures = |reach: usize| -> Vec<Departure> {
        let places = reach..places_m.len().saturating_sub(reach);
        places.map(|k| Departure::of([k - reach, k, k + reach], places_m, values, covariance)).collect()
    };
    let gaps_m = || places_m.windows(2).map(|pair| pair[1] - pair[0]);
    let (short, long) = (departures(1), departures(2));
    if short.is_empty() {
        // Two places: nothing tells how bent it is between them but how much they differ.
        let most = values.iter().map(|v| v.value.powi(2)).fold(0.0, f64::max);
        return (gaps_m().map(|_| most).collect(), LEAST_ORDER);
    }
    let (seen, noise) = (mean(&short, |d| d.square - d.variance), mean(&short, |d| d.variance));
    let reach_m = mean(&short, |d| d.reach_m.ln()).exp();
    let order = if long.is_empty() || seen <= noise {
        0.0
    } else {
        let grown = (mean(&long, |d| d.square - d.variance) / seen).max(1.0).ln();
        let open = (scatter(&short) + scatter(&long)).sqrt();
        let further = mean(&long, |d| d.reach_m.ln()) - reach_m.ln();
        if further > 0.0 { (0.5 * (grown - open) / further).clamp(0.0, MOST_ORDER) } else { 0.0 }
    };
    let square = mean(&short, |d| d.square) * widened(&short);
    let halfway = |gap_m: f64| square * (0.5 * gap_m / reach_m).powf(2.0 * order);
    (gaps_m().map(halfway).collect(), order.max(LEAST_ORDER))
}

/// Variance of the logarithm of a mean square, by how the squares scatter: neighbours share values, so that there are two for every three.
fn scatter(departures: &[Departure]) -> f64 {
    let own = mean(departures, |d| d.square);
    if own <= 0.0 || departures.len() < 2 {
        return 0.0;
    }
    let square = mean(departures, |d| (d.square / own - 1.0).powi(2));
    SHARED * square / (departures.len() - 1) as f64
}

/// What few departures must be widened by: as Student's interval is wider than that of a deviation known.
fn widened(departures: &[Departure]) -> f64 {
    let degrees = 2.0 / scatter(departures).max(f64::MIN_POSITIVE);
    if degrees > MANY {
        return 1.0;
    }
    let student = StudentsT::new(0.0, 1.0, degrees.max(FEWEST)).map_or(1.0, |t| t.inverse_cdf(COVERED));
    (student / NORMAL).powi(2).max(1.0)
}

/// How far a value lies from the chord of two others.
struct Departure {
    /// Square (m²).
    square: f64,
    /// What noise makes of that (m²).
    variance: f64,
    /// Harmonic mean of both distances (m).
    reach_m: f64,
}

impl Departure {
    fn of(
        [low, k, high]: [usize; 3],
        places_m: &[f64],
        values: &[Value],
        covariance: &impl Fn(Place, Place) -> f64,
    ) -> Departure {
        let (below_m, above_m) = (places_m[k] - places_m[low], places_m[high] - places_m[k]);
        let share = below_m / (below_m + above_m);
        let parts = [(low, share - 1.0), (k, 1.0), (high, -share)];
        let departure: f64 = parts.iter().map(|(k, factor)| factor * values[*k].value).sum();
        let made_of: Vec<(Place, f64)> = parts
            .iter()
            .flat_map(|(k, factor)| values[*k].made_of.iter().map(move |(place, own)| (*place, factor * own)))
            .collect();
        let variance = of_two(&made_of, &made_of, covariance);
        Departure { square: departure * departure, variance, reach_m: 2.0 * below_m * above_m / (below_m + above_m) }
    }
}

fn mean(departures: &[Departure], of: impl Fn(&Departure) -> f64) -> f64 {
    departures.iter().map(of).sum::<f64>() / departures.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(places_m: &[f64], value: impl Fn(f64) -> f64) -> (f64, f64) {
        let own = |x: &f64| Value { made_of: Vec::new(), value: value(*x), beside: 0.0 };
        let (gaps, order) = between(places_m, &places_m.iter().map(own).collect::<Vec<_>>(), &|_, _| 0.0);
        (gaps.into_iter().fold(0.0, f64::max).sqrt(), order)
    }

    #[test]
    fn a_smooth_table_is_known_between_its_places_and_a_rough_one_is_not() {
        let places: Vec<f64> = (0..9).map(|k| f64::from(k) / 8.0).collect();
        // A parabola a·x² departs from its chord by a·h²/4 halfway.
        let (smooth, order) = of(&places, |x| 8e-6 * x * x);
        assert!((smooth - 8e-6 / 256.0).abs() < 1e-12, "{smooth}");
        assert!((order - 2.0).abs() < 1e-9, "{order}");
        // Up and down from place to place: each is 2 µm off the chord of its neighbours.
        let (rough, order) = of(&places, |x| if (x * 8.0).round() % 2.0 == 1.0 { 2e-6 } else { 0.0 });
        assert!((rough - 2e-6).abs() < 1e-15 && order == LEAST_ORDER, "{rough} {order}");
    }

    /// A screw of which a measured slit had targets 0.2 mm apart, in pairs every 10 mm: U was 2 µm all over gaps in which errors of 16 µm lay.
    #[test]
    fn regress_close_pairs_of_places_say_nothing_of_the_wide_gaps_between_them() {
        let pairs: Vec<f64> = (0..5).flat_map(|k| [f64::from(k) * 0.01, f64::from(k) * 0.01 + 0.0002]).collect();
        let walk = [0.0, -1.1, 18.9, 14.6, -16.0, -8.7, -23.2, -20.8, 12.0, 25.4].map(|um| um * 1e-6);
        let own: Vec<Value> = walk.iter().map(|m| Value { made_of: Vec::new(), value: *m, beside: 0.0 }).collect();
        let (gaps, order) = between(&pairs, &own, &|_, _| 0.0);
        let um: Vec<f64> = gaps.iter().map(|variance| variance.sqrt() * 1e6).collect();
        assert!(um.iter().step_by(2).all(|narrow| *narrow < 6.0), "{um:?}");
        assert!(um.iter().skip(1).step_by(2).all(|wide| (10.0..30.0).contains(wide)), "{um:?}");
        assert!((LEAST_ORDER..1.0).contains(&order), "{order}");
    }
}
