//! The verdict in words, made from the figures and from nothing else.
//!
//! Place in the flow: first sentence of report, JSON and terminal. It never looks at verification points: they score.

use super::readable;
use super::record::{Effect, ErrorFigures, Record};
use crate::text::{fixed, significant};

impl Record {
    /// What the diagnosis says, in a few sentences; for [`Record::verdict`].
    pub fn words(&self) -> String {
        let mut sentences = vec![self.finding()];
        if self.enriched {
            sentences.push(
                "The error functions had too few coefficients and got more; what that explains is geometry, not an \
                 effect."
                    .to_owned(),
            );
        }
        if !self.effects.is_empty() || self.enriched {
            sentences.push(self.gain());
            if self.detection.after.has_structure == Some(true) {
                sentences.push(
                    "The residual after still has structure that noise lacks, and no candidate explains it.".to_owned(),
                );
            }
        }
        sentences.join(" ")
    }

    fn finding(&self) -> String {
        if !self.effects.is_empty() {
            let list: Vec<String> = self.effects.iter().map(named).collect();
            return format!("The model lacks: {}.", list.join("; "));
        }
        if self.enriched {
            return "No effect is missing.".to_owned();
        }
        if self.consistent_with_noise {
            return "Consistent with noise: nothing is missing that these data can show.".to_owned();
        }
        format!("Something is there that no candidate explains. {}", self.detection.before.words)
    }

    fn gain(&self) -> String {
        let what = &self.held_out.blocks;
        match (self.before.held_out_rms_um, self.after.held_out_rms_um) {
            (Some(before), Some(after)) => format!(
                "The error on {what} goes from {}{} to {} µm{}.",
                significant(before, 3),
                interval(&self.before),
                significant(after, 3),
                interval(&self.after)
            ),
            _ => match &self.held_out.missing_because {
                Some(reason) => format!("There is no error on {what}: {reason}."),
                None => format!("There is no error on {what}."),
            },
        }
    }
}

fn interval(figures: &ErrorFigures) -> String {
    match figures.held_out_interval_um {
        Some((low, high)) => format!(" (95 %: {} to {})", significant(low, 3), significant(high, 3)),
        None => String::new(),
    }
}

/// An effect with its first parameter.
fn named(effect: &Effect) -> String {
    let label = if effect.kind == "empirical" { format!("{} (not explained)", effect.label()) } else { effect.label() };
    let [parameter] = effect.parameters.as_slice() else {
        return match effect.size_um {
            Some(size_um) => format!("{label}, {} µm rms in the readings", significant(size_um, 2)),
            None => label,
        };
    };
    match readable(parameter) {
        (Some(value), Some(u), _, unit, decimals) => {
            format!("{label}, {} ± {} {unit} (k = 1)", fixed(value, decimals), fixed(u, decimals))
        }
        _ => label,
    }
}

/// A share absorbed, in words.
pub(super) fn alias_words(share: Option<f64>) -> &'static str {
    match share {
        None => "not known",
        Some(share) if share < 0.5 => "stands apart from the geometry",
        Some(share) if share < 0.9 => "partly like geometry: larger uncertainty",
        Some(share) if share < 0.99 => "mostly like geometry: measure more before trusting the size",
        Some(_) => "nearly the same as geometry: do not trust the size",
    }
}
