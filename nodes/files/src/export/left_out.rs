//! What an effect does that a table leaves out: where it is zero, so that the table holds, and how large it is where it was measured.
//!
//! Place in the flow: beside [`super::About`], for heads and warnings. A model and one of its effects, which follows logged quantities, in;
//! words out. The effect is looked at as it moves the tip (m, machine frame) at readings over those that were identified. What moves all
//! points alike is a matter of zero; where an effect is zero at no value of what it follows, the table holds best where its square is least
//! over the readings, free of its mean: a bow beside a line does not move that. Quantities run over the range that
//! was logged; zero may lie beyond it, as that of an expansion that was measured in a warm room.

use super::{fixed, is_sign};
use abbe_geometry::Vector3;
use abbe_geometry::axis::Axis;
use abbe_geometry::chain::{ErrorValues, chain_point};
use abbe_geometry::effects::{CovariateSource, CovariateValue, Shape, ShapeValue, State, tip_columns};
use abbe_geometry::model::{FittedEffect, MachineModel};

/// Readings of each axis at which an effect is looked at.
const NODES: usize = 5;
/// Widths of what was measured, one unit at least, beyond which nobody looks for where an effect is zero.
const WIDTHS: f64 = 10.0;
/// Values of a quantity over its range at which an effect is looked at.
const SCAN: usize = 65;
/// Cuts of the stretch about the best of them; each leaves two thirds.
const CUTS: usize = 40;
/// Quantities beyond which nothing is looked at: three values of each.
const MOST_QUANTITIES: usize = 4;
/// What is left of an effect (m), or of its size (share), that is zero.
const ZERO_M: f64 = 1e-9;
const ZERO_SHARE: f64 = 1e-3;

/// Values of the quantities that an effect follows.
struct Logged<'a> {
    names: &'a [String],
    values: &'a [f64],
}

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        let place = self.names.iter().position(|own| own == name);
        place.map_or(CovariateValue::Missing, |place| CovariateValue::Fresh(self.values[place]))
    }
}

/// What motions are told against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Against {
    Nothing,
    /// That of the first place.
    First,
    Mean,
}

/// An effect over what was identified.
struct Looked<'a> {
    model: &'a MachineModel,
    fitted: &'a FittedEffect,
    tip_m: [f64; 3],
    names: Vec<String>,
    ranges: Vec<(f64, f64)>,
    /// Readings (m), the first that of the lower ends.
    places_m: Vec<[f64; 3]>,
}

/// Words behind the name of an effect, each with its own semicolon; empty where the effect moves no tip or its quantities have no range.
/// `tip_m` is the offset of the tip (m, ram frame).
pub(super) fn words(model: &MachineModel, fitted: &FittedEffect, tip_m: [f64; 3]) -> String {
    let declared = declared_zero(&fitted.shape);
    let Some(looked) = Looked::new(model, fitted, tip_m) else { return declared.unwrap_or_default() };
    let Some(size) = looked.size_words() else { return declared.unwrap_or_default() };
    let zero = declared.or_else(|| looked.zero_words()).unwrap_or_default();
    format!("{zero}; {size}")
}

/// Where the shape itself says that the effect begins.
fn declared_zero(shape: &Shape) -> Option<String> {
    match (shape.0.get("by"), shape.0.get("by_zero")) {
        (Some(ShapeValue::Text(name)), Some(ShapeValue::Number(zero))) => Some(holds_at(name, &zero.to_string())),
        _ => None,
    }
}

fn holds_at(name: &str, value: &str) -> String {
    format!("; the table holds at {name} = {value}")
}

/// A value of a quantity, without the digits of its computation.
fn shown(value: f64) -> String {
    ((value * 1e3).round() / 1e3 + 0.0).to_string()
}

fn um(value_m: f64) -> String {
    fixed(value_m * 1e6, 2)
}

/// What a change by one is called.
fn per(name: &str) -> String {
    match name {
        _ if name.ends_with("_c") => "K".to_owned(),
        _ => format!("unit of {name}"),
    }
}

impl Looked<'_> {
    fn new<'a>(model: &'a MachineModel, fitted: &'a FittedEffect, tip_m: [f64; 3]) -> Option<Looked<'a>> {
        let names = fitted.effect.covariates();
        let identified = &model.parts().identified;
        let range = |name: &String| identified.covariates.get(name).copied();
        let ranges: Vec<(f64, f64)> = names.iter().map(range).collect::<Option<_>>()?;
        if names.is_empty() || names.len() > MOST_QUANTITIES {
            return None;
        }
        let node_m = |axis: usize, k: usize| {
            let (low_m, high_m) = identified.reading_m[axis];
            let share = (k % NODES) as f64 / (NODES - 1) as f64;
            if share < 1.0 { low_m + share * (high_m - low_m) } else { high_m }
        };
        let place = |k: usize| [node_m(0, k), node_m(1, k / NODES), node_m(2, k / NODES.pow(2))];
        let places_m = (0..NODES.pow(3)).map(place).collect();
        Some(Looked { model, fitted, tip_m, names, ranges, places_m })
    }

    /// Motion of the tip (m) at a reading (m) with these values of the quantities.
    fn at(&self, reading_m: [f64; 3], values: &[f64]) -> Option<Vector3<f64>> {
        let by_error = chain_point(&self.model.parts().machine, reading_m, self.tip_m, &ErrorValues::ZERO).by_error;
        let logged = Logged { names: &self.names, values };
        let state = State { reading_m, offset_m: self.tip_m, covariates: &logged };
        let effect = self.fitted.effect.as_ref();
        let columns = tip_columns(effect, self.fitted.parameters.len(), &state, &by_error).ok()?;
        Some(columns.iter().zip(&self.fitted.parameters).map(|(column, value)| column * *value).sum())
    }

    /// The same at all places.
    fn all(&self, values: &[f64], against: Against) -> Option<Vec<Vector3<f64>>> {
        let all: Vec<Vector3<f64>> =
            self.places_m.iter().map(|place_m| self.at(*place_m, values)).collect::<Option<_>>()?;
        let common = match against {
            Against::Nothing => Vector3::zeros(),
            Against::First => all[0],
            Against::Mean => all.iter().sum::<Vector3<f64>>() / all.len() as f64,
        };
        Some(all.into_iter().map(|moved| moved - common).collect())
    }

    fn middle(&self) -> Vec<f64> {
        self.ranges.iter().map(|(low, high)| 0.5 * (low + high)).collect()
    }

    /// Ends and middles of all ranges, each with each.
    fn corners(&self) -> Vec<Vec<f64>> {
        let three = self.ranges.iter().map(|(low, high)| [*low, 0.5 * (low + high), *high]);
        three.fold(vec![Vec::new()], |known, own| {
            known.iter().flat_map(|values| own.map(|value| [values.as_slice(), &[value]].concat())).collect()
        })
    }

    /// Largest component at any place and corner (m).
    fn largest_m(&self, against: Against) -> Option<f64> {
        let corners = self.corners().into_iter().map(|values| self.all(&values, against));
        corners.map(|all| Some(largest_m(&all?))).try_fold(0.0, |most: f64, own| Some(most.max(own?)))
    }

    /// Where it is zero, or least.
    fn zero_words(&self) -> Option<String> {
        let place = self.names.iter().position(|name| !is_sign(name))?;
        let others: String = (0..self.names.len())
            .filter(|k| *k != place)
            .map(|k| format!(" with {} = {}", self.names[k], shown(self.middle()[k])))
            .collect();
        let name = &self.names[place];
        for against in [Against::Nothing, Against::Mean] {
            let largest_m = self.largest_m(against)?;
            let (value, left_m) = self.least(place, against)?;
            if left_m <= ZERO_M.max(ZERO_SHARE * largest_m) {
                let but = if against == Against::Mean { ", but for a shift of all points alike" } else { "" };
                return Some(holds_at(name, &shown(value)) + &others + but);
            }
            if against == Against::Mean {
                return Some(format!(
                    "; zero at no {name}: the table holds best at {name} = {}{others}, within {} um{}",
                    shown(value),
                    um(left_m),
                    self.slope_words(place).unwrap_or_default()
                ));
            }
        }
        None
    }

    /// Value of a quantity at which the motion is least by its square, the others in the middle, and its largest component there (m).
    fn least(&self, place: usize, against: Against) -> Option<(f64, f64)> {
        let with = |value: f64| {
            let mut values = self.middle();
            values[place] = value;
            self.all(&values, against)
        };
        let square_m2 = |value: f64| Some(with(value)?.iter().map(Vector3::norm_squared).sum::<f64>());
        let (low, high) = self.ranges[place];
        let step = if high > low { (high - low) / (SCAN - 1) as f64 } else { 0.0 };
        let mut best = (low, square_m2(low)?);
        for k in 1..SCAN {
            let value = low + step * k as f64;
            let own = (value, square_m2(value)?);
            best = if own.1 < best.1 { own } else { best };
        }
        let (mut from, mut to) = ((best.0 - step).max(low), (best.0 + step).min(high));
        for _ in 0..CUTS {
            let [a, b] = [from + (to - from) / 3.0, to - (to - from) / 3.0];
            if square_m2(a)? < square_m2(b)? { to = b } else { from = a }
        }
        let refined = (0.5 * (from + to), square_m2(0.5 * (from + to))?);
        best = if refined.1 < best.1 { refined } else { best };
        // What grows in proportion may begin beyond what was measured.
        let reach = if high > low { high } else { low + 1.0 };
        let (first, last) = (with(low)?, with(reach)?);
        let products = |f: fn(&Vector3<f64>, &Vector3<f64>) -> f64| -> f64 {
            first.iter().zip(&last).map(|(first, last)| f(first, &(last - first))).sum()
        };
        let square = products(|_, slope| slope.norm_squared());
        if square > 0.0 {
            let value = low - (reach - low) * products(|first, slope| first.dot(slope)) / square;
            // What would begin far from all that was measured says nothing.
            let far = WIDTHS * (high - low).max(1.0);
            if (low - far..=high + far).contains(&value) {
                let own = (value, square_m2(value)?);
                best = if own.1 <= best.1 { own } else { best };
            }
        }
        Some((best.0, largest_m(&with(best.0)?)))
    }

    /// The place and the direction in which it does most against the first place, or at all where that is nothing.
    fn most(&self) -> Option<(usize, Axis, Against)> {
        for against in [Against::First, Against::Nothing] {
            let mut most = (0, Axis::X, 0.0);
            for values in self.corners() {
                for (place, moved) in self.all(&values, against)?.into_iter().enumerate() {
                    for axis in Axis::ALL {
                        let size_m = moved[axis.index()].abs();
                        // Of places that differ by rounding, the first.
                        most = if size_m > most.2 + 1e-15 { (place, axis, size_m) } else { most };
                    }
                }
            }
            if most.2 > ZERO_M {
                return Some((most.0, most.1, against));
            }
        }
        None
    }

    /// How much it does over what was measured.
    fn size_words(&self) -> Option<String> {
        let (place, axis, against) = self.most()?;
        let mut range = (f64::INFINITY, f64::NEG_INFINITY);
        for values in self.corners() {
            let moved_m = self.all(&values, against)?[place][axis.index()];
            range = (range.0.min(moved_m), range.1.max(moved_m));
        }
        let logged = self.names.iter().zip(&self.ranges);
        let logged: Vec<String> =
            logged.map(|(name, (low, high))| format!("{name} {} to {}", shown(*low), shown(*high))).collect();
        let (from_m, at_m) = (self.places_m[0], self.places_m[place]);
        let moved = Axis::ALL.into_iter().filter(|axis| at_m[axis.index()] != from_m[axis.index()]);
        let ends: Vec<String> = moved
            .map(|axis| {
                let [at, from] = [at_m, from_m].map(|m| fixed(m[axis.index()] * 1e3, 1));
                format!("{} {at} against {from} mm", axis.letter())
            })
            .collect();
        let whereabouts = match against {
            Against::First => format!("at {}", ends.join(", ")),
            Against::Nothing | Against::Mean => "at all points alike".to_owned(),
        };
        Some(format!(
            "over {} it is {} to {} um along {} {whereabouts}",
            logged.join(" and "),
            um(range.0),
            um(range.1),
            axis.letter()
        ))
    }

    /// By how much it changes there with a quantity at the middle of its range.
    fn slope_words(&self, quantity: usize) -> Option<String> {
        let (place, axis, against) = self.most()?;
        let (low, high) = self.ranges[quantity];
        let step = 0.01 * (high - low);
        let with = |by: f64| {
            let mut values = self.middle();
            values[quantity] += by;
            Some(self.all(&values, against)?[place][axis.index()])
        };
        let slope_m = (with(step)? - with(-step)?) / (2.0 * step);
        let name = &self.names[quantity];
        let words =
            format!(", and moves by {} um per {} at {}", um(slope_m), per(name), shown(self.middle()[quantity]));
        slope_m.is_finite().then_some(words)
    }
}

fn largest_m(all: &[Vector3<f64>]) -> f64 {
    all.iter().map(Vector3::amax).fold(0.0, f64::max)
}
