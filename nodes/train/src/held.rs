//! Residual vectors held against each other before anything learns from them.
//!
//! Place in the flow: samples as read in, those that do not contradict all others out, with what was left out in words. One vector of
//! 60 µm among hundreds would decide which method is the best, bend it about its place, and widen every interval. Method:
//! `abbe_field::kriging::judge_samples`, as `abbe interpolate` does it.

use crate::off_text::off_text;
use abbe_field::Samples;
use abbe_field::kriging::{KrigingError, KrigingOptions, LeftOut, judge_samples};
use anyhow::Context;

/// Vectors that are named.
const NAMED: usize = 10;

/// Vectors that were held against each other.
pub(crate) struct Held {
    /// Those that are left, by all inputs.
    pub(crate) field: Samples,
    /// The same by the position alone, where there are other inputs.
    pub(crate) alone: Option<Samples>,
    /// Each that was left out, in words.
    pub(crate) left_out: Vec<String>,
}

/// Holds the vectors of a file against each other, and says on the terminal what comes of it. Where too many contradict the others, or
/// where it cannot be done, all stay: the held-out figures of what is trained grade them.
pub(crate) fn hold(file: &str, field: Samples, alone: Option<Samples>) -> anyhow::Result<Held> {
    let words = |one: &LeftOut| off_text(&field, one.index, one.component, one.off_m, one.deviations.abs());
    match judge_samples(&field, &KrigingOptions::usual(field.u_m().is_some())) {
        Ok(judged) if judged.left_out.is_empty() => Ok(Held { field, alone, left_out: Vec::new() }),
        Ok(judged) => {
            let left_out: Vec<String> = judged.left_out.iter().map(words).collect();
            let all = field.count();
            eprintln!(
                "abbe: warning: {file}: {} of {all} vectors contradict all others and are left out: {}",
                left_out.len(),
                list(&left_out)
            );
            let part = |samples: &Samples| samples.part(&judged.kept).with_context(|| file.to_owned());
            let alone = alone.as_ref().map(part).transpose()?;
            Ok(Held { field: part(&field)?, alone, left_out })
        }
        Err(KrigingError::TooManyGross { gross, vectors }) => {
            let texts: Vec<String> = gross.iter().map(words).collect();
            eprintln!(
                "abbe: warning: {file}: {} of {vectors} vectors contradict all others, which is more than accidents; none is left out: {}; \
                 check these, and whether all vectors are of one machine in one state",
                texts.len(),
                list(&texts)
            );
            Ok(Held { field, alone, left_out: Vec::new() })
        }
        Err(error) => {
            eprintln!("abbe: warning: {file}: the vectors were not held against each other: {error}");
            Ok(Held { field, alone, left_out: Vec::new() })
        }
    }
}

fn list(texts: &[String]) -> String {
    let more = if texts.len() > NAMED { "; ..." } else { "" };
    format!("{}{more}", texts.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join("; "))
}
