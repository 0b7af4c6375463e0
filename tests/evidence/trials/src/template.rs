//! Texts of effects with sizes and choices left open, filled in for one seed.
//!
//! Place in the flow: a [`crate::Scenario`] holds templates such as `backlash axis=$axis size_um=1*`; filled in they
//! are texts for the simulator's `effects::from_text`. A number with `*` is multiplied by the size that is being
//! tried; `$axis`, `$next`, `$phase`, `$pitch`, `$seed` and `$line` stand for what the seed chooses.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use crate::error::TrialError;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Shortest and longest period tried (mm), drawn evenly in its logarithm.
const PITCH_MM: [f64; 2] = [7.0, 90.0];

/// What a seed chooses in a template.
#[derive(Debug, Clone, PartialEq)]
pub struct Choices {
    axis: usize,
    phase_deg: f64,
    pitch_mm: f64,
    seed: u64,
    line: u32,
}

impl Choices {
    /// The choices of a seed among that many lines; axes take turns, so that every third seed has the same.
    pub fn new(seed: u64, lines: u32) -> Choices {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        // A stream of its own, apart from those of the simulator under the same seed.
        generator.set_stream(101);
        let share: f64 = generator.random();
        Choices {
            axis: (seed % 3) as usize,
            phase_deg: (generator.random::<f64>() * 360.0).round(),
            pitch_mm: PITCH_MM[0] * (PITCH_MM[1] / PITCH_MM[0]).powf(share),
            seed,
            line: generator.random_range(0..lines.max(1)),
        }
    }

    /// Letter of the axis that `$axis` stands for.
    pub fn axis(&self) -> &'static str {
        AXES[self.axis]
    }

    /// Fills in a template at one size.
    ///
    /// # Errors
    /// A number with `*` is none, or a `$` name is not known.
    pub fn fill(&self, template: &str, size: f64) -> Result<String, TrialError> {
        let parts: Result<Vec<String>, TrialError> =
            template.split_whitespace().map(|part| self.fill_part(part, size)).collect();
        Ok(parts?.join(" "))
    }

    fn fill_part(&self, part: &str, size: f64) -> Result<String, TrialError> {
        let Some((key, value)) = part.split_once('=') else { return Ok(part.to_owned()) };
        let wrong = |problem: &str| TrialError::Template(format!("{part}: {problem}"));
        let filled = match value {
            "$axis" => self.axis().to_owned(),
            "$next" => AXES[(self.axis + 1) % 3].to_owned(),
            "$phase" => format!("{}", self.phase_deg),
            "$pitch" => format!("{:.3}", self.pitch_mm),
            "$seed" => format!("{}", self.seed),
            "$line" => format!("{}", self.line),
            _ if value.starts_with('$') => {
                return Err(wrong("known are $axis, $next, $phase, $pitch, $seed, $line"));
            }
            _ => match value.strip_suffix('*') {
                Some(number) => format!("{}", number.parse::<f64>().map_err(|_| wrong("no number before *"))? * size),
                None => value.to_owned(),
            },
        };
        Ok(format!("{key}={filled}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_choices_are_filled_in_and_the_rest_is_kept() {
        let choices = Choices::new(4, 10);
        let text = choices.fill("backlash axis=$axis size_um=1.5* growth_um=2 from_s=60", 2.0).unwrap();
        assert_eq!(text, "backlash axis=y size_um=3 growth_um=2 from_s=60");
        let pitch = choices.fill("periodic_scale pitch_mm=$pitch", 1.0).unwrap();
        let value: f64 = pitch.split_once("pitch_mm=").unwrap().1.parse().unwrap();
        assert!((PITCH_MM[0]..PITCH_MM[1]).contains(&value));
        assert_eq!(Choices::new(4, 10), choices);
        assert_ne!(Choices::new(5, 10).pitch_mm, choices.pitch_mm);
    }

    #[test]
    fn what_is_not_known_is_refused() {
        let choices = Choices::new(1, 10);
        assert!(choices.fill("backlash axis=$axes", 1.0).is_err());
        assert!(choices.fill("backlash size_um=two*", 1.0).is_err());
    }
}
