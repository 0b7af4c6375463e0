//! Whether what was found is what was there.
//!
//! Place in the flow: a table of [`Accepted`] names for each injected effect (kept by the runner, with reasons) meets
//! the [`Finding`]s of one diagnosis. Empirical terms claim no cause, so they can be neither right nor false.

use std::collections::BTreeMap;

/// One effect that a diagnosis added to the model.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Finding {
    /// Its name.
    pub effect: String,
    /// Whether it claims a cause; an empirical term does not.
    pub attributed: bool,
    /// What it is about: axis, line, period and the like, as text; figures in SI.
    pub shape: BTreeMap<String, String>,
    /// Further words for the reader of a list of failures.
    pub detail: String,
}

/// A name under which an injected effect may be found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accepted {
    /// Name of the injected effect.
    pub injected: &'static str,
    /// Name of the finding.
    pub found: &'static str,
    /// What must agree beside the name.
    pub same: &'static [Same],
    /// Why this name is right.
    pub reason: &'static str,
}

/// Something that must agree between an injected effect's text and a finding's shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Same {
    /// Words under these keys, in the text and in the shape, whatever their case.
    Word(&'static str, &'static str),
    /// Lengths under these keys, in the text (mm) and in the shape (m), to this share.
    Length(&'static str, &'static str, f64),
}

/// What was found, measured against what was there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attribution {
    /// Something was found, if only an empirical term.
    pub detected: bool,
    /// Every injected effect was found under an accepted name; false where none was injected.
    pub right: bool,
    /// Some finding claims a cause that was not there.
    pub wrong: bool,
    /// Some finding is an empirical term.
    pub empirical: bool,
}

/// Measures findings against the injected effects (texts as the simulator takes them).
pub fn attribute(findings: &[Finding], injected: &[String], table: &[Accepted]) -> Attribution {
    let causes: Vec<&Finding> = findings.iter().filter(|finding| finding.attributed).collect();
    let named = |text: &String| causes.iter().any(|finding| explains(finding, text, table));
    let stray = |finding: &&&Finding| !injected.iter().any(|text| explains(finding, text, table));
    Attribution {
        detected: !findings.is_empty(),
        right: !injected.is_empty() && injected.iter().all(named),
        wrong: causes.iter().any(|finding| stray(&finding)),
        empirical: findings.iter().any(|finding| !finding.attributed),
    }
}

/// Whether a finding is an accepted name of an injected effect and agrees with it where that matters.
pub fn explains(finding: &Finding, injected: &str, table: &[Accepted]) -> bool {
    let mut parts = injected.split_whitespace();
    let name = parts.next().unwrap_or_default();
    let text: BTreeMap<&str, &str> = parts.filter_map(|part| part.split_once('=')).collect();
    let rows = table.iter().filter(|row| row.injected == name && row.found == finding.effect);
    rows.into_iter().any(|row| row.same.iter().all(|same| agrees(same, &text, &finding.shape)))
}

/// A key that either side lacks cannot agree.
fn agrees(same: &Same, text: &BTreeMap<&str, &str>, shape: &BTreeMap<String, String>) -> bool {
    match same {
        Same::Word(of_text, of_shape) => match (text.get(of_text), shape.get(*of_shape)) {
            (Some(a), Some(b)) => a.eq_ignore_ascii_case(b),
            _ => false,
        },
        Same::Length(of_text, of_shape, share) => {
            let wanted_m = text.get(of_text).and_then(|value| value.parse::<f64>().ok()).map(|mm| mm * 1e-3);
            match (wanted_m, shape.get(*of_shape).and_then(|value| value.parse::<f64>().ok())) {
                (Some(wanted_m), Some(found_m)) => (found_m / wanted_m - 1.0).abs() <= *share,
                _ => false,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &[Accepted] = &[
        Accepted { injected: "play", found: "reverse", same: &[Same::Word("axis", "axis")], reason: "" },
        Accepted { injected: "heat", found: "grow", same: &[], reason: "" },
        Accepted { injected: "wave", found: "wave", same: &[Same::Length("pitch_mm", "period_m", 0.02)], reason: "" },
    ];

    fn finding(effect: &str, shape: &[(&str, &str)]) -> Finding {
        let shape = shape.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        Finding { effect: effect.to_owned(), attributed: true, shape, detail: String::new() }
    }

    fn texts(list: &[&str]) -> Vec<String> {
        list.iter().map(|text| (*text).to_owned()).collect()
    }

    #[test]
    fn the_right_name_on_the_wrong_axis_is_wrong() {
        let injected = texts(&["play axis=x size_um=2"]);
        let right = attribute(&[finding("reverse", &[("axis", "X")])], &injected, TABLE);
        assert!(right.detected && right.right && !right.wrong);
        let other = attribute(&[finding("reverse", &[("axis", "y")])], &injected, TABLE);
        assert!(other.detected && !other.right && other.wrong);
    }

    #[test]
    fn a_period_must_agree_to_its_share() {
        let injected = texts(&["wave pitch_mm=40"]);
        for (period_m, right) in [("0.0404", true), ("0.0396", true), ("0.042", false), ("0.08", false)] {
            assert_eq!(attribute(&[finding("wave", &[("period_m", period_m)])], &injected, TABLE).right, right);
        }
        assert!(!attribute(&[finding("wave", &[])], &injected, TABLE).right, "a period that is not given");
    }

    #[test]
    fn both_of_a_pair_must_be_named_and_nothing_else() {
        let injected = texts(&["play axis=x size_um=2", "heat axis=y"]);
        let one = [finding("reverse", &[("axis", "x")])];
        assert!(!attribute(&one, &injected, TABLE).right);
        let both = [finding("reverse", &[("axis", "x")]), finding("grow", &[("axis", "z")]), finding("drift", &[])];
        let found = attribute(&both, &injected, TABLE);
        assert!(found.right && found.wrong);
    }

    #[test]
    fn an_empirical_term_detects_and_claims_nothing() {
        let term = Finding { attributed: false, ..finding("smooth", &[]) };
        let found = attribute(std::slice::from_ref(&term), &texts(&["play axis=x"]), TABLE);
        assert_eq!(found, Attribution { detected: true, right: false, wrong: false, empirical: true });
        let clean = attribute(&[], &[], TABLE);
        assert_eq!(clean, Attribution { detected: false, right: false, wrong: false, empirical: false });
    }
}
