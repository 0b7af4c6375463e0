//! Chen 2020: its published figures, computed again.
//!
//! Place in the flow: called through [`crate::PAPERS`]. Stations from nominal points (Tables 1-3), interpolation of the
//! volumetric error (Table 5). Source: Chen, Zhang, Liang, Tang, Shi 2020, Chinese Journal of Lasers 47(12), 1204001.

mod fields;
mod interpolation;
mod setup;
mod stations;

use crate::figure::{Figure, PaperError, Settings};

/// How the paper is cited.
const PAPER: &str = "Chen 2020";

/// All figures of the paper.
pub(crate) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let mut all = stations::figures(settings)?;
    all.extend(interpolation::figures(settings)?);
    Ok(all)
}

/// A computation of this paper that failed.
fn failed(place: &'static str) -> impl Fn(String) -> PaperError {
    move |problem| PaperError { paper: PAPER, place, problem }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::Verdict;

    /// Least number of runs of every simulation.
    const QUICK: Settings = Settings { seed: 1, effort: 1e-3 };

    #[test]
    fn every_figure_is_computed_and_what_theory_fixes_comes_out() {
        let all = figures(&QUICK).unwrap();
        assert!(all.iter().all(|figure| !figure.reproduced.contains("NaN") && !figure.reproduced.contains("inf")));
        let verdict = |what: &str| all.iter().find(|figure| figure.what.contains(what)).map(|figure| figure.verdict);
        assert_eq!(verdict("without errors of machine"), Some(Verdict::Reproduced));
        // On smooth fields the ranking of the paper turns round, whatever the seed; a part of the runs says so and judges nothing.
        assert_eq!(verdict("typical machine, no noise"), Some(Verdict::NotJudged));
        let reason =
            |what: &str| all.iter().find(|figure| figure.what.contains(what)).map(|figure| figure.reason.as_str());
        assert!(
            reason("typical machine, no noise").unwrap().contains("less on 0 of"),
            "{:?}",
            reason("typical machine")
        );
        assert_eq!(all.iter().filter(|figure| figure.place == "Table 3").count(), 8);
    }
}
