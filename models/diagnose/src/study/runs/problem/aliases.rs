//! Waves that the targets of an axis do not tell from the one that was found.
//!
//! Place in the flow: the study of runs says them in words, and its models hold them between the targets.

use super::super::shape::Shape;
use super::Runs;
use crate::study::outcome::Ambiguity;

/// Periods named in one sentence.
const NAMED: usize = 4;

impl Runs {
    /// Frequencies (1/m) at which a wave that was found gives the same errors, or nearly.
    pub(super) fn aliases_of(&self, candidate: usize) -> Vec<f64> {
        let (axis, Shape::Periodic(period_m)) = &self.shapes[candidate] else { return Vec::new() };
        match self.axes[*axis].step_m {
            Some(step_m) => [-1.0, 1.0].map(|sign| step_m.recip() + sign / period_m).to_vec(),
            None => self.aliases.get(&candidate).cloned().unwrap_or_default(),
        }
    }

    /// Targets that are too few, or at equal steps, make a short period look like a long one.
    pub(super) fn aliases_in_words(&self, found: &[usize]) -> Vec<Ambiguity> {
        let mut list = Vec::new();
        for candidate in found {
            let aliases = self.aliases_of(*candidate);
            if aliases.is_empty() {
                continue;
            }
            let periods: Vec<String> = aliases.iter().take(NAMED).map(|f| format!("{:.4} mm", 1e3 / f)).collect();
            let periods = periods.join(", ");
            let because = match self.axes[self.shapes[*candidate].0].step_m {
                Some(step_m) => format!(
                    "targets at equal steps of {:.4} mm: periods of {periods} and shorter ones give the same errors",
                    step_m * 1e3
                ),
                None => format!("at these targets periods of {periods} go nearly as well"),
            };
            let decided_by = "measure a stretch at irregular steps, or at a tenth of the shortest period suspected";
            let effects = vec![self.candidates[*candidate].name.clone()];
            list.push(Ambiguity { effects, because, decided_by: decided_by.to_owned() });
        }
        list
    }
}
