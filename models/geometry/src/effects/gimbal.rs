//! Gimbal of the tracer: the length changes with the direction of the sight, as its axes do not meet in one point.
//!
//! Formula: range += Σ over sin k·az, cos k·az (k from 1) and sin k·el, cos k·el (k from 2) up to the harmonic `harmonics`, the
//! second without that key; azimuth and elevation of the sight about the machine's z axis, the same at every station.
//! With `stations` each of them has harmonics of its own, from the second, since a tracer is seldom set up turned the same way.
//! Inputs: direction of the sight. Typical 0.1–0.3 µm. Straight up there is no azimuth, and its harmonics add nothing. The
//! first harmonics look like a station that stands elsewhere: only many stations that are turned the same way tell them apart.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "gimbal",
    title: "gimbal of the tracer",
    formula: "range += sum over k of s_k sin k az + c_k cos k az, and of a_k sin k el + b_k cos k el from k = 2",
    typical: "0.1-0.3 µm",
    source: "geometry of two turning axes that do not meet, and of errors of the sphere that is followed",
    needs: "sights in many directions from each station",
    decided_by: "measure the same points again with the tracer turned by 90 degrees at the same place",
    construct,
    propose,
    refine: None,
};
/// Highest harmonic.
const MOST: usize = 6;
/// Harmonics without the key: the names of parameters in model files follow from it.
const USUAL: usize = 2;
/// Largest amplitude believed (m).
const PLAUSIBLE_M: f64 = 10e-6;

#[derive(Debug)]
struct Gimbal {
    harmonics: usize,
    /// Stations with harmonics of their own; none where all share them.
    stations: Vec<String>,
}

/// One column: the harmonic of an angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Angle {
    Azimuth,
    Elevation,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let mut effect = Gimbal { harmonics: USUAL, stations: Vec::new() };
    if shape.0.contains_key("harmonics") {
        effect.harmonics = reader.count("harmonics", MOST)?;
    }
    if shape.0.contains_key("stations") {
        effect.stations = reader.texts("stations")?.to_vec();
        if effect.harmonics < 2 {
            return Err(reader.wrong("harmonics", "must be 2 or more where stations have their own"));
        }
    }
    reader.finish()?;
    Ok(Box::new(effect))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let mut shapes = vec![Shape::new(), Shape::new().number("harmonics", 3.0), Shape::new().number("harmonics", 4.0)];
    if !observed.stations.is_empty() {
        let own = |harmonics: f64| Shape::new().number("harmonics", harmonics).texts("stations", observed.stations);
        shapes.extend([2.0, 3.0].map(own));
    }
    shapes
}

impl Gimbal {
    /// Angle and order of each pair of columns.
    fn orders(&self) -> impl Iterator<Item = (Angle, usize)> + use<> {
        let first = if self.stations.is_empty() { 1 } else { 2 };
        let azimuth = (first..=self.harmonics).map(|k| (Angle::Azimuth, k));
        azimuth.chain((2..=self.harmonics).map(|k| (Angle::Elevation, k)))
    }
}

impl Effect for Gimbal {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let names = self.orders().flat_map(|(angle, order)| {
            let angle = if angle == Angle::Azimuth { "az" } else { "el" };
            let order = if order == 1 { String::new() } else { order.to_string() };
            ["sin", "cos"].map(|wave| format!("{wave}_{order}{angle}"))
        });
        let names: Vec<String> = names.collect();
        let spec = |name: String| ParameterSpec::new(name, "m", PLAUSIBLE_M);
        if self.stations.is_empty() {
            return names.into_iter().map(spec).collect();
        }
        let of = |station: &String| names.iter().map(|name| spec(format!("{name}_{station}"))).collect::<Vec<_>>();
        self.stations.iter().flat_map(of).collect()
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let place = match self.stations.as_slice() {
            [] => 0,
            stations => match stations.iter().position(|station| station == sight.station) {
                Some(place) => place,
                None => return Ok(()),
            },
        };
        let direction = sight.ray.direction;
        let level = direction.xy().norm();
        let azimuth = (level > 0.0).then(|| multiples(direction.y / level, direction.x / level));
        let elevation = multiples(direction.z, level);
        let first = place * 2 * self.orders().count();
        for (k, (angle, order)) in self.orders().enumerate() {
            let waves = if angle == Angle::Azimuth { azimuth } else { Some(elevation) };
            let Some((sine, cosine)) = waves.map(|waves| waves[order - 1]) else { continue };
            part(first + 2 * k, sine);
            part(first + 2 * k + 1, cosine);
        }
        Ok(())
    }
}

/// Sine and cosine of the multiples of an angle, given those of the angle.
fn multiples(sine: f64, cosine: f64) -> [(f64, f64); MOST] {
    let mut waves = [(sine, cosine); MOST];
    for k in 1..MOST {
        let (s, c) = waves[k - 1];
        waves[k] = (s * cosine + c * sine, c * cosine - s * sine);
    }
    waves
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{One, machine, range_m};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn harmonics_are_those_of_azimuth_and_elevation() {
        let effect = construct(&Shape::new(), &machine()).unwrap();
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        let (az, el) = (200_f64.to_radians(), 35_f64.to_radians());
        let read = |direction: Vector3<f64>, k: usize| {
            let sight = Sight { station: "S1", line: "L", ray: Ray { direction, range_m: 1.0 } };
            range_m(effect.as_ref(), &state, &sight, &std::array::from_fn::<f64, 6, _>(|i| f64::from(u8::from(i == k))))
        };
        let direction = Vector3::new(el.cos() * az.cos(), el.cos() * az.sin(), el.sin());
        let (double, high) = (2.0 * az, 2.0 * el);
        let expected = [az.sin(), az.cos(), double.sin(), double.cos(), high.sin(), high.cos()];
        (0..6).for_each(|k| assert!((read(direction, k) - expected[k]).abs() < 1e-15, "{k}"));
        let up = (0..6).map(|k| read(Vector3::z(), k)).collect::<Vec<_>>();
        assert_eq!(up, [0.0, 0.0, 0.0, 0.0, 0.0, -1.0]);
    }

    #[test]
    fn stations_may_have_harmonics_of_their_own() {
        let names = ["S1", "S2"].map(str::to_owned);
        let effect = construct(&Shape::new().number("harmonics", 3.0).texts("stations", &names), &machine()).unwrap();
        let known: Vec<String> = effect.parameters().into_iter().map(|spec| spec.name).collect();
        assert_eq!(known.len(), 16);
        assert_eq!((known[0].as_str(), known[15].as_str()), ("sin_2az_S1", "cos_3el_S2"));
        let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
        let (az, el) = (0.7_f64, 0.4_f64);
        let direction = Vector3::new(el.cos() * az.cos(), el.cos() * az.sin(), el.sin());
        let read = |station: &str, k: usize| {
            let sight = Sight { station, line: "L", ray: Ray { direction, range_m: 1.0 } };
            let unit: Vec<f64> = (0..16).map(|i| f64::from(u8::from(i == k))).collect();
            range_m(effect.as_ref(), &state, &sight, &unit)
        };
        assert!((read("S2", 8) - (2.0 * az).sin()).abs() < 1e-15 && (read("S2", 15) - (3.0 * el).cos()).abs() < 1e-15);
        assert_eq!((read("S1", 8), read("S3", 8)), (0.0, 0.0));
        let first = Shape::new().number("harmonics", 1.0).texts("stations", &names);
        assert!(construct(&first, &machine()).unwrap_err().to_string().contains("harmonics"));
    }
}
