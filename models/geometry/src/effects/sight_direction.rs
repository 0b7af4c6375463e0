//! The instrument errs by direction in a smooth way that nobody has a formula for: a worn bearing, a sphere out of round, a
//! reflector holder that is seen from behind.
//!
//! Formula: range += Σ c_lm Y_lm(u), real spherical harmonics of the sight u from degree 2 up to the shape's, each of mean
//! square one over all directions. The same at every station, or with coefficients of its own where the shape lists
//! stations, which need not be set up turned the same way. Degrees 0 and 1 are dead path and station. They span the same
//! functions in every frame, so it does not matter how the instrument was turned. It acts on the range only: a corrected
//! coordinate never sees it, and what the range does is not moved into the tip for want of a better place.

use super::known::{Known, Observed};
use super::shape::{EffectError, Reader, Shape};
use super::{CovariateProblem, Effect, ParameterSpec, Sight, State};
use crate::machine::Machine;
use nalgebra::Vector3;

/// Entry in the registry.
pub(super) const KNOWN: Known = Known {
    name: "sight_direction",
    title: "instrument error by direction",
    formula: "range += sum c_lm Y_lm(u), real spherical harmonics of the direction of the sight",
    typical: "0.1-2 um",
    source: "a smooth function on the sphere, whatever its cause",
    needs: "sights in many directions from each station",
    decided_by: "measure the same points again with the tracer turned by 90 degrees at the same place",
    construct,
    propose,
    refine: None,
};
/// Lowest degree that is not a station or a dead path.
const FIRST: usize = 2;
/// Highest degree.
const MOST: usize = 8;
/// Degrees tried for all stations together, and for each of them.
const COMMON: [usize; 3] = [3, 4, 6];
const OF_EACH: [usize; 2] = [2, 3];
/// Largest coefficient believed (m).
const PLAUSIBLE_M: f64 = 10e-6;

#[derive(Debug)]
struct SightDirection {
    degree: usize,
    /// None: all alike.
    stations: Vec<String>,
}

fn construct(shape: &Shape, _machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    let mut reader = Reader::new(KNOWN.name, shape);
    let degree = reader.count("degree", MOST)?;
    if degree < FIRST {
        return Err(reader.wrong("degree", "must be at least 2: lower ones are dead path and station"));
    }
    let stations = if shape.0.contains_key("stations") { reader.texts("stations")?.to_vec() } else { Vec::new() };
    reader.finish()?;
    Ok(Box::new(SightDirection { degree, stations }))
}

fn propose(observed: &Observed) -> Vec<Shape> {
    let of = |degree: usize| Shape::new().number("degree", degree as f64);
    let common = COMMON.into_iter().map(of);
    match observed.stations.len() {
        0 | 1 => common.collect(),
        _ => common.chain(OF_EACH.into_iter().map(|d| of(d).texts("stations", observed.stations))).collect(),
    }
}

impl SightDirection {
    /// Coefficients of one station.
    fn count(&self) -> usize {
        (self.degree + 1).pow(2) - FIRST.pow(2)
    }
}

impl Effect for SightDirection {
    fn name(&self) -> &'static str {
        KNOWN.name
    }

    fn parameters(&self) -> Vec<ParameterSpec> {
        let orders = |l: usize| (0..=2 * l).map(move |k| (l, k as i64 - l as i64));
        let all = || (FIRST..=self.degree).flat_map(orders);
        let spec = |name: String| ParameterSpec::new(name, "m", PLAUSIBLE_M);
        match self.stations.is_empty() {
            true => all().map(|(l, m)| spec(format!("c_{l}_{m}"))).collect(),
            false => {
                let of =
                    |station: &String| all().map(|(l, m)| spec(format!("c_{l}_{m}_{station}"))).collect::<Vec<_>>();
                self.stations.iter().flat_map(of).collect()
            }
        }
    }

    fn range(&self, _state: &State, sight: &Sight, part: &mut dyn FnMut(usize, f64)) -> Result<(), CovariateProblem> {
        let first = match self.stations.is_empty() {
            true => 0,
            false => match self.stations.iter().position(|station| station == sight.station) {
                Some(place) => place * self.count(),
                None => return Ok(()),
            },
        };
        harmonics(&sight.ray.direction, self.degree, &mut |k, value| part(first + k, value));
        Ok(())
    }
}

/// Real spherical harmonics of degree 2 … `degree`, each of mean square one, in the order (l, −l) … (l, l).
fn harmonics(u: &Vector3<f64>, degree: usize, part: &mut dyn FnMut(usize, f64)) {
    // cos mφ · sinᵐθ and sin mφ · sinᵐθ are polynomials of x and y, so that the poles are no exception.
    let (mut cosines, mut sines) = (vec![1.0], vec![0.0]);
    for m in 0..degree {
        let (c, s) = (cosines[m], sines[m]);
        cosines.push(u.x * c - u.y * s);
        sines.push(u.x * s + u.y * c);
    }
    for m in 0..=degree {
        // P_lm / sinᵐθ with Σ over the sphere of mean square one, by the recursion in l.
        let mut diagonal = if m == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
        (1..=m).for_each(|k| diagonal *= ((2 * k + 1) as f64 / (2 * k) as f64).sqrt());
        let (mut below, mut value) = (0.0, diagonal);
        for l in m..=degree {
            if l > m {
                let (lf, mf) = (l as f64, m as f64);
                let a = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
                let b = (((lf - 1.0).powi(2) - mf * mf) / (4.0 * (lf - 1.0).powi(2) - 1.0)).sqrt();
                (below, value) = (value, a * (u.z * value - b * below));
            }
            if l >= FIRST {
                let middle = l * l - FIRST * FIRST + l;
                part(middle + m, value * cosines[m]);
                if m > 0 {
                    part(middle - m, value * sines[m]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ray;
    use super::super::tests::{One, machine, range_m};
    use super::*;

    fn at(u: Vector3<f64>, degree: usize) -> Vec<f64> {
        let mut values = vec![f64::NAN; (degree + 1).pow(2) - 4];
        harmonics(&u, degree, &mut |k, value| values[k] = value);
        values
    }

    /// Y₂₀ = √5 (3z² − 1)/2, Y₂₂ = √15/2 (x² − y²), Y₂,₋₁ = √15 yz, Y₃₀ = √7 (5z³ − 3z)/2.
    #[test]
    fn harmonics_are_those_of_the_tables_and_orthonormal() {
        let u = Vector3::new(0.48, 0.6, 0.64);
        let values = at(u, 3);
        let expected = [
            (2, 5.0_f64.sqrt() * (3.0 * u.z * u.z - 1.0) / 2.0),
            (4, 15.0_f64.sqrt() / 2.0 * (u.x * u.x - u.y * u.y)),
            (1, 15.0_f64.sqrt() * u.y * u.z),
            (8, 7.0_f64.sqrt() * (5.0 * u.z.powi(3) - 3.0 * u.z) / 2.0),
        ];
        for (k, value) in expected {
            assert!((values[k] - value).abs() < 1e-12, "{k}: {} {value}", values[k]);
        }
        // Even in z and azimuth: a mean over the sphere to better than the grid's own error.
        let (rings, turns) = (400, 40);
        let mut products = vec![vec![0.0; 21]; 21];
        for i in 0..rings {
            let z = (2.0 * (f64::from(i) + 0.5)) / f64::from(rings) - 1.0;
            for j in 0..turns {
                let angle = std::f64::consts::TAU * f64::from(j) / f64::from(turns);
                let level = (1.0 - z * z).sqrt();
                let values = at(Vector3::new(level * angle.cos(), level * angle.sin(), z), 4);
                for (a, row) in values.iter().zip(&mut products) {
                    row.iter_mut().zip(&values).for_each(|(sum, b)| *sum += a * b / f64::from(rings * turns));
                }
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((value - f64::from(u8::from(i == j))).abs() < 1e-3, "{i} {j}: {value}");
            }
        }
    }

    #[test]
    fn each_station_has_its_own_where_they_are_listed() {
        let shape = Shape::new().number("degree", 2.0).texts("stations", &["S1", "S2"].map(str::to_owned));
        let effect = construct(&shape, &machine()).unwrap();
        assert_eq!(effect.parameters().len(), 10);
        let read = |station: &str| {
            let state = State { reading_m: [0.3; 3], offset_m: [0.0; 3], covariates: &One(0.0) };
            let sight = Sight { station, line: "L", ray: Ray { direction: Vector3::z(), range_m: 1.0 } };
            let mut parameters = [0.0; 10];
            (parameters[2], parameters[7]) = (1e-6, 2e-6);
            range_m(effect.as_ref(), &state, &sight, &parameters) / 5.0_f64.sqrt()
        };
        assert!((read("S1") - 1e-6).abs() < 1e-18 && (read("S2") - 2e-6).abs() < 1e-18 && read("S3") == 0.0);
        assert!(construct(&Shape::new().number("degree", 1.0), &machine()).is_err());
    }
}
