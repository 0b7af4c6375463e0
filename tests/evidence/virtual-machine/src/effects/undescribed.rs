//! An effect nobody has a name for: a random smooth function of two logged quantities moves the tip.
//!
//! Equation: tip_d = size · g(p, q) / rms(g), g = Σ aᵢⱼ cos(π(i·p + j·q) + φᵢⱼ) for i + j = 1…3, p and q the two
//! quantities scaled from their stated ranges to [0, 1]; the rms is taken over that square.

use super::{Effect, Moment};
use crate::error::{SimulationError, require_finite};
use crate::machine::{Axis, JointErrors};
use crate::random::{Purpose, normal, stream, uniform};

/// One quantity and the range over which the function is laid out.
#[derive(Debug, Clone, PartialEq)]
struct Quantity {
    /// Name of its campaign column, such as `temp_air_c` or `y_mm`.
    name: String,
    /// Lower and upper value, in the column's unit.
    range: [f64; 2],
}

/// A random smooth displacement of the tip.
#[derive(Debug, Clone, PartialEq)]
pub struct Undescribed {
    quantities: [Quantity; 2],
    direction: Axis,
    size_m: f64,
    terms: Vec<[f64; 4]>,
}

impl Undescribed {
    /// Draws the function; `size_m` is its rms over the ranges of its quantities.
    ///
    /// # Errors
    /// Names the key that makes no sense.
    pub fn new(
        seed: u64,
        quantities: [(&str, [f64; 2]); 2],
        direction: Axis,
        size_m: f64,
    ) -> Result<Self, SimulationError> {
        let mut generator = stream(seed, Purpose::Undescribed);
        let mut terms = Vec::new();
        for i in 0..=3_u32 {
            for j in 0..=(3 - i) {
                if i + j == 0 {
                    continue;
                }
                let size = normal(&mut generator) / f64::from(i + j);
                let phase = uniform(&mut generator, 0.0, std::f64::consts::TAU);
                terms.push([size, f64::from(i), f64::from(j), phase]);
            }
        }
        let mut effect = Self {
            quantities: quantities.map(|(name, range)| Quantity { name: name.to_owned(), range }),
            direction,
            size_m,
            terms,
        };
        effect.check()?;
        let rms = effect.rms();
        for term in &mut effect.terms {
            term[0] /= rms;
        }
        Ok(effect)
    }

    fn shape(&self, p: f64, q: f64) -> f64 {
        self.terms.iter().map(|[size, i, j, phase]| size * (std::f64::consts::PI * (i * p + j * q) + phase).cos()).sum()
    }

    fn rms(&self) -> f64 {
        const STEPS: u32 = 64;
        let at = |step: u32| (f64::from(step) + 0.5) / f64::from(STEPS);
        let mut total = 0.0;
        for row in 0..STEPS {
            for column in 0..STEPS {
                total += self.shape(at(row), at(column)).powi(2);
            }
        }
        total.sqrt() / f64::from(STEPS)
    }
}

impl Effect for Undescribed {
    fn name(&self) -> &'static str {
        "undescribed"
    }

    fn check(&self) -> Result<(), SimulationError> {
        require_finite("size_m", &[self.size_m])?;
        for quantity in &self.quantities {
            let [low, high] = quantity.range;
            require_finite(&quantity.name, &[low, high])?;
            if low >= high {
                return Err(SimulationError::new(
                    &quantity.name,
                    format!("range [{low}, {high}] is empty"),
                    "give [lower, upper]",
                ));
            }
            if !super::known_quantity(&quantity.name) {
                return Err(SimulationError::new(
                    &quantity.name,
                    "no such quantity",
                    "use the name of a campaign column",
                ));
            }
        }
        Ok(())
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let mut scaled = [0.0; 2];
        for (out, quantity) in scaled.iter_mut().zip(&self.quantities) {
            // `check` refused unknown names, so nothing is left out here.
            let Some(value) = moment.quantity(&quantity.name) else {
                return;
            };
            let [low, high] = quantity.range;
            *out = (value - low) / (high - low);
        }
        errors.tip_m[self.direction.index()] += self.size_m * self.shape(scaled[0], scaled[1]);
    }
}
