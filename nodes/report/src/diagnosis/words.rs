//! The verdict in words, made from the figures and from nothing else.
//!
//! Place in the flow: first sentence of report, JSON and terminal. It never looks at verification points: they score.

use super::readable;
use super::record::{Averaged, Effect, ErrorFigures, Record};
use super::shaped::for_readers;
use crate::text::{fixed, listed, significant};

/// Candidates set aside that are named at most.
const SET_ASIDE: usize = 3;
/// Odds against the effect found from which the first sentence names what may stand in its place: one to three.
const NEARLY_AS_LIKELY: f64 = 1.0 / 3.0;
/// Share of an effect that the model's own errors could imitate from which the verdict says so.
const NEARLY_GEOMETRY: f64 = 0.98;
/// Kind of an effect that describes and explains nothing.
const EMPIRICAL: &str = "empirical";
/// Kinds of other causes that it names at most.
const RIVALS: usize = 3;
/// Probability below which scatter is not what was declared.
const UNDECLARED: f64 = 1e-4;

impl Record {
    /// What the diagnosis says, in a few sentences; for [`Record::verdict`].
    pub fn words(&self) -> String {
        let mut sentences = vec![self.finding()];
        sentences.extend(self.not_adopted.iter().map(|because| format!("Nothing was adopted: {because}.")));
        sentences.extend(self.not_told_apart());
        sentences.extend(self.surer_than_its_size());
        sentences.extend(self.set_aside_words());
        if self.enriched {
            sentences.push(
                match self.set_aside.is_empty() {
                    true => {
                        "The error functions had too few coefficients and got more; what that explains is geometry, not an effect."
                    }
                    false => {
                        "The error functions had too few coefficients and got more; what that explains is geometry, unless it is what \
                         was set aside."
                    }
                }
                .to_owned(),
            );
        }
        if !self.effects.is_empty() || self.enriched {
            sentences.push(self.gain());
            sentences.extend(self.corrects_nothing().map(str::to_owned));
            if self.detection.after.has_structure == Some(true) {
                sentences.push(
                    "The residual after still has structure that noise lacks and that no candidate explains."
                        .to_owned(),
                );
            }
        }
        sentences.join(" ")
    }

    /// That the new model is worse where the truth is known; nothing where it is not, or where that may be chance.
    pub fn grown(&self) -> Option<String> {
        let (_, most) = self.verification.as_ref()?.gain_interval_um2?;
        let um = |figures: &super::ErrorFigures| figures.verify_rms_um.map(|um| significant(um, 3));
        let (before, after) = (um(&self.before)?, um(&self.after)?);
        let with = match self.effects.is_empty() {
            true => "with the fit made anew, though no effect is new in it",
            false => "with what was found, so that is not what acts there",
        };
        (most < 0.0).then(|| {
            format!(
                "At the points whose actual position is known the error grows from {before} to {after} µm {with}: keep the model that you have."
            )
        })
    }

    /// Causes of another kind that explain these data as well as one that was found: elsewhere, or later, they say something else.
    fn not_told_apart(&self) -> Option<String> {
        let is_described = |name: &str| self.considered.iter().any(|own| own.name == name && own.kind == EMPIRICAL);
        let of = |effect: &Effect| {
            let own = kind_of(&effect.name, &effect.title);
            let mut others: Vec<&str> = Vec::new();
            for rival in effect.cannot_be_told_from.iter().filter(|rival| !is_described(&rival.name)) {
                let other = kind_of(&rival.name, &rival.title);
                if other != own && !others.contains(&other) {
                    others.push(other);
                }
            }
            (!others.is_empty()).then(|| format!("{own} from {}", listed(&others, RIVALS, " or ")))
        };
        let named = self.effects.iter().filter(|effect| effect.kind != EMPIRICAL);
        let list: Vec<String> = named.filter_map(of).collect();
        (!list.is_empty()).then(|| format!("These data do not tell {}.", list.join(", nor ")))
    }

    /// Effects that the model's own errors could imitate nearly whole.
    fn surer_than_its_size(&self) -> Option<String> {
        let of = |effect: &Effect| {
            let share = effect.alias_share.filter(|share| *share >= NEARLY_GEOMETRY)?;
            Some(format!("{} ({} %)", kind_of(&effect.name, &effect.title), fixed(100.0 * share, 1)))
        };
        let list: Vec<String> = self.effects.iter().filter_map(of).collect();
        (!list.is_empty()).then(|| {
            format!(
                "Nearly all of it could stand in the errors of the machine, so do not trust its size: {}.",
                list.join("; ")
            )
        })
    }

    /// What was set aside, by title: shapes and reasons fill a page, and have their table.
    fn set_aside_words(&self) -> Option<String> {
        let mut titles: Vec<&str> = Vec::new();
        for aside in &self.set_aside {
            if !titles.contains(&aside.title.as_str()) {
                titles.push(&aside.title);
            }
        }
        let listed = listed(&titles, SET_ASIDE, "; ");
        (!titles.is_empty()).then(|| format!("Set aside, each with its reason in the table: {listed}."))
    }

    fn finding(&self) -> String {
        if !self.effects.is_empty() {
            let held = self.effects.iter().flat_map(|effect| &effect.averaged_with).filter_map(|other| other.share);
            let own_share = 1.0 - held.sum::<f64>();
            let list: Vec<String> =
                self.effects.iter().map(|effect| named(effect) + &or_else(effect, own_share)).collect();
            return format!("The model lacks: {}.", list.join("; "));
        }
        if self.enriched {
            return match self.set_aside.is_empty() {
                true => "No effect is missing.".to_owned(),
                false => "No effect was adopted.".to_owned(),
            };
        }
        let found = &self.detection.before;
        match found.p_declared.filter(|p_value| *p_value < UNDECLARED).and(found.chi2_per_dof) {
            None if self.consistent_with_noise => {
                // Without a noise of its own to be held against, what is left may be anything without the forms that were looked for.
                let is_known = found.p_declared.or(found.chi2_per_dof).is_some() || found.lack_of_fit.is_some();
                return match found.rms_um.filter(|_| !is_known) {
                    None => "Consistent with noise: nothing is missing that these data can show.".to_owned(),
                    Some(rms_um) => format!(
                        "Nothing that was looked for shows. Whether the {} µm rms that are left are noise, these data cannot tell: no \
                         uncertainties are declared, and nothing was measured twice.",
                        significant(rms_um, 3)
                    ),
                };
            }
            Some(chi2_per_dof) if self.consistent_with_noise => {
                let (size, cause) = match chi2_per_dof > 1.0 {
                    true => (
                        "more",
                        "the noise is larger than declared, or something acts without a pattern that these data show",
                    ),
                    false => ("less", "the noise is smaller than declared"),
                };
                return format!(
                    "No structure that noise lacks, but {size} scatter than declared (χ² per degree of freedom {}): {cause}.",
                    significant(chi2_per_dof, 3)
                );
            }
            _ => {}
        }
        if self.only_correlated {
            return format!(
                "No effect shows beyond errors that neighbouring readings share: those of the air, of the instrument or of \
                 something slow, which these data do not tell apart. {}",
                found.words
            );
        }
        format!("Something is there that these data attribute to no candidate. {}", self.detection.before.words)
    }

    /// That the error of the readings is not that of coordinates, where what explains the former corrects nothing.
    fn corrects_nothing(&self) -> Option<&'static str> {
        let left_out = self.effects.iter().filter(|effect| !effect.corrects).count();
        match (left_out, self.effects.len() - left_out) {
            (0, _) => None,
            (_, 0) => {
                Some("That is the error of the readings: corrected coordinates gain nothing by what only widens u.")
            }
            _ => Some("That is the error of the readings: corrected coordinates gain by what corrects alone."),
        }
    }

    fn gain(&self) -> String {
        let what = &self.held_out.blocks;
        match (self.before.held_out_rms_um, self.after.held_out_rms_um) {
            // An effect that is told by much may gain nothing on what was left out.
            (Some(before), Some(after)) if significant(before, 3) == significant(after, 3) => {
                format!("The error on {what} stays at {} µm{}.", significant(after, 3), interval(&self.after))
            }
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

/// An effect with its parameter, or the amplitude of its wave; of what has more, with what it does to the readings.
fn named(effect: &Effect) -> String {
    let label = match (effect.kind == EMPIRICAL, effect.corrects) {
        (true, true) => format!("{} (not explained)", effect.label()),
        (true, false) => {
            format!(
                "{} (not explained; not told from a course in time, so it widens u and corrects nothing)",
                effect.label()
            )
        }
        (false, _) => effect.label(),
    };
    let amplitude = effect.amplitude();
    let (parameter, what) = match (effect.parameters.as_slice(), &amplitude) {
        ([parameter], _) => (parameter, String::new()),
        (_, Some(amplitude)) => (amplitude, format!("{} ", amplitude.name)),
        _ => {
            return match effect.size_um {
                Some(size_um) => format!("{label}, {} µm rms in the readings", significant(size_um, 2)),
                None => label,
            };
        }
    };
    match readable(parameter) {
        (Some(value), Some(u), _, unit, decimals) => {
            let open = if value.abs() < 2.0 * u { ", not told from zero" } else { "" };
            format!("{label}, {what}{} ± {} {unit} (k = 1){open}", fixed(value, decimals), fixed(u, decimals))
        }
        _ => label,
    }
}

/// What an effect is called without its axis, its sensor and its constants.
fn kind_of<'a>(name: &'a str, title: &'a str) -> &'a str {
    let whole = for_readers(name, title);
    whole.split(" (").next().unwrap_or(whole)
}

/// The other explanation as an effect of its own, for its name.
fn in_place_of(effect: &Effect, other: &Averaged) -> Effect {
    let title = for_readers(&other.name, &other.title).to_owned();
    Effect { name: other.name.clone(), title, shape: other.shape.clone(), covariates: Vec::new(), ..effect.clone() }
}

/// What is hardly less likely in the place of an effect that has this share of the mean, with the odds; nothing where there is nothing.
fn or_else(effect: &Effect, own_share: f64) -> String {
    let odds = |other: &Averaged| other.share.map(|share| share / own_share);
    let near: Vec<(&Averaged, f64)> = effect
        .averaged_with
        .iter()
        .filter_map(|other| Some((other, odds(other)?)))
        .filter(|(_, odds)| *odds >= NEARLY_AS_LIKELY)
        .collect();
    if near.is_empty() {
        return String::new();
    }
    let whole = 1.0 + near.iter().map(|(_, odds)| odds).sum::<f64>();
    let percent = |odds: f64| fixed(100.0 * odds / whole, 0);
    let others: Vec<String> = near
        .iter()
        .map(|(other, odds)| format!("{} {} %", in_place_of(effect, other).label(), percent(*odds)))
        .collect();
    format!(" ({} %, or {})", percent(1.0), others.join(", or "))
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

#[cfg(test)]
mod tests {
    use super::super::{DiagnosisReport, HeldOut};
    use super::*;

    fn record() -> Record {
        let blocks = "lines that no step saw".to_owned();
        Record { held_out: HeldOut { blocks, ..HeldOut::default() }, ..Record::default() }
    }

    /// "Is it noise? None." says the wrong thing: an empty table says nothing of what was looked at.
    #[test]
    fn regress_a_page_without_tests_of_the_noise_says_what_was_looked_at_and_found() {
        let mut clean = Record { consistent_with_noise: true, ..record() };
        clean.detection.before.used = 432;
        clean.detection.before.words = "The residual is 0.4 µm rms.".to_owned();
        let page = |record: &Record| {
            let identity = Default::default();
            let report =
                DiagnosisReport { record: record.clone(), residuals: None, figures: Vec::new(), identity, next: None };
            report.html().unwrap()
        };
        let html = page(&clean);
        assert!(!html.contains("Is it noise?"));
        assert!(html.contains("no figure that tells a residual from noise"));
        for said in ["of 432 observations", "The residual is 0.4 µm rms.", "Found: nothing that noise does not have"] {
            assert!(html.contains(said), "{said}");
        }
        for empty in ["Untestable", "Cannot be identified"] {
            let after = html.split(empty).nth(1).unwrap();
            assert!(!after.get(..80).unwrap_or(after).contains("None."), "{empty}");
        }
        clean.consistent_with_noise = false;
        clean.detection.before.chi2_per_dof = Some(2.5);
        let html = page(&clean);
        assert!(html.contains("Is it noise?") && html.contains("Found: something that noise does not have"));
        assert!(!html.contains("no figure that tells a residual from noise"));
    }

    /// A clean sine of 4 µm at points measured once was "consistent with noise", which nobody had told.
    #[test]
    fn regress_scatter_that_nothing_is_held_against_is_not_called_noise() {
        let mut clean = Record { consistent_with_noise: true, ..record() };
        clean.detection.before.rms_um = Some(4.127);
        let says = clean.words();
        assert!(says.starts_with("Nothing that was looked for shows. Whether the 4.13 µm rms"), "{says}");
        clean.detection.before.chi2_per_dof = Some(1.01);
        assert!(clean.words().starts_with("Consistent with noise"), "{}", clean.words());
    }

    /// Three decimals at 40 µm are digits that nobody measured.
    #[test]
    fn regress_a_result_without_an_uncertainty_has_three_digits() {
        let mut found = Record { enriched: true, ..record() };
        found.before.held_out_rms_um = Some(41.841_2);
        found.after.held_out_rms_um = Some(0.430_17);
        let identity = Default::default();
        let report = DiagnosisReport { record: found, residuals: None, figures: Vec::new(), identity, next: None };
        let html = report.html().unwrap();
        assert!(html.contains("41.8 ") && html.contains("0.430") && !html.contains("41.84"));
    }

    /// 630 candidates were a third of a phone's page.
    #[test]
    fn regress_candidates_with_most_evidence_come_first_and_not_all_are_shown() {
        let candidate = |k: usize| super::super::Considered {
            name: format!("candidate {k} "),
            kind: "empirical".to_owned(),
            tested: 1,
            p_value: Some(0.5),
            p_holm: Some(1.0),
            evidence: Some(k as f64),
            alias_share: Some(0.1),
        };
        let found = Record { considered: (0..50).map(candidate).collect(), ..record() };
        let identity = Default::default();
        let report = DiagnosisReport { record: found, residuals: None, figures: Vec::new(), identity, next: None };
        let html = report.html().unwrap();
        assert!(html.contains("The first 20 of 50 rows"));
        assert!(html.contains("candidate 49 ") && html.contains("candidate 30 ") && !html.contains("candidate 29 "));
        assert_eq!(report.json().unwrap().matches("candidate ").count(), 50);
    }

    #[test]
    fn a_clean_residual_is_called_noise_and_nothing_more() {
        let clean = Record { consistent_with_noise: true, ..record() };
        assert!(clean.words().starts_with("Consistent with noise"), "{}", clean.words());
        assert!(!clean.words().contains("lacks") && !clean.words().contains("goes from"));
    }

    #[test]
    fn regress_scatter_that_was_not_declared_is_not_called_noise_without_a_word() {
        let mut clean = Record { consistent_with_noise: true, ..record() };
        for (chi2_per_dof, word) in [(2.47, "larger than declared"), (0.3, "smaller than declared")] {
            (clean.detection.before.chi2_per_dof, clean.detection.before.p_declared) =
                (Some(chi2_per_dof), Some(1e-30));
            let words = clean.words();
            assert!(words.contains(word) && !words.contains("Consistent"), "{words}");
        }
        (clean.detection.before.chi2_per_dof, clean.detection.before.p_declared) = (Some(1.02), Some(0.3));
        assert!(clean.words().starts_with("Consistent with noise"));
    }

    #[test]
    fn structure_without_a_name_is_not_given_one() {
        let mut unexplained = record();
        unexplained.detection.before.words = "Whole lines are off.".to_owned();
        let words = unexplained.words();
        assert!(words.contains("attribute to no candidate") && words.contains("Whole lines are off."), "{words}");
        let words = Record { only_correlated: true, ..unexplained }.words();
        assert!(words.starts_with("No effect shows beyond errors that neighbouring readings share"), "{words}");
    }

    #[test]
    fn what_stays_out_is_named_in_the_answer_and_explained_on_the_page() {
        let aside = |title: &str| super::super::SetAside {
            name: "x".to_owned(),
            title: title.to_owned(),
            shape: std::collections::BTreeMap::new(),
            because: "stations left out are predicted worse".to_owned(),
        };
        let set_aside = ["wrong reflector offset", "b", "c", "d"].map(aside).to_vec();
        let not_adopted = Some("all of it loses on lines".to_owned());
        let record = Record { set_aside, not_adopted, ..record() };
        let words = record.words();
        assert!(words.contains("Nothing was adopted: all of it loses on lines."), "{words}");
        let set_aside = "Set aside, each with its reason in the table: wrong reflector offset; b; c and 1 more.";
        assert!(words.contains(set_aside), "{words}");
        let report =
            DiagnosisReport { record, residuals: None, figures: Vec::new(), identity: Default::default(), next: None };
        assert!(report.html().unwrap().contains("stations left out are predicted worse"));
        assert!(report.json().unwrap().contains("\"set_aside\""));
    }

    /// Eight shapes of one effect with their figures and reasons took nine hundred characters of the first line.
    #[test]
    fn regress_shapes_of_one_effect_stand_once_in_the_answer() {
        let aside = |title: &str, because: &str| super::super::SetAside {
            name: "x".to_owned(),
            title: title.to_owned(),
            shape: std::collections::BTreeMap::from([("degree".to_owned(), 3.into())]),
            because: because.to_owned(),
        };
        let set_aside = vec![aside("a", "it cannot be fitted"), aside("b", "chance"), aside("a", "chance")];
        let words = Record { set_aside, ..record() }.words();
        assert!(words.ends_with("Set aside, each with its reason in the table: a; b."), "{words}");
    }

    #[test]
    fn a_gain_stands_with_both_intervals_and_a_missing_one_with_its_reason() {
        let figures = |rms: f64| ErrorFigures {
            held_out_rms_um: Some(rms),
            held_out_interval_um: Some((0.9 * rms, 1.1 * rms)),
            ..ErrorFigures::default()
        };
        let mut finer = Record { enriched: true, before: figures(0.8), after: figures(0.4), ..record() };
        let words = finer.words();
        assert!(words.contains("from 0.800 (95 %: 0.720 to 0.880) to 0.400 µm (95 %: 0.360 to 0.440)"), "{words}");
        finer.after.held_out_rms_um = None;
        finer.held_out.missing_because = Some("there are too few lines".to_owned());
        assert!(finer.words().contains("no error on lines that no step saw: there are too few lines"));
    }

    #[test]
    fn a_record_without_figures_makes_a_page_and_nulls() {
        let report = DiagnosisReport {
            record: record(),
            residuals: None,
            figures: Vec::new(),
            identity: Default::default(),
            next: None,
        };
        assert!(report.html().unwrap().contains("Not noise, and not attributed"));
        assert!(report.json().unwrap().contains("\"held_out_rms_um\": null"));
        let mut wrong = report;
        wrong.record.before.chi2_per_dof = Some(f64::NAN);
        let error = wrong.json().unwrap_err().to_string();
        assert!(error.contains("chi2_per_dof"), "{error}");
    }
}
