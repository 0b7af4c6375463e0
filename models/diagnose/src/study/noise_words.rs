//! What the noise is like, which rows were rejected, and what was looked at before anything is called noise.
//!
//! Place in the flow: from the last view of a study into the diagnosis.

use super::candidate::Study;
use super::outcome::{Correlation, Judgement, LackOfFit, Look, RejectedRow, SeriesNoise};
use super::outliers::Outliers;
use super::search::{Found, StudyOptions};
use super::view::{Kept, View};
use abbe_measurement::chance::beyond;
use statrs::distribution::{ChiSquared, ContinuousCDF};

const UM: f64 = 1e6;
/// Share of a record over which slow noise may be correlated before it is a drift that nobody described.
const WANDERS: f64 = 0.5;
/// Share of its step that a display must hide to be spoken of, and share of the scatter (in its square) that rounding makes.
const WORTH_SAYING: f64 = 0.05;
const MUCH_OF_IT: f64 = 0.1;
/// Rejected rows named in one sentence.
const NAMED: usize = 5;

/// The noise of each chain.
pub(super) fn noise(view: &View) -> Vec<SeriesNoise> {
    let one = |chain: &Kept| SeriesNoise {
        of: chain.of.clone(),
        sigma_um: chain.noise.sigma * chain.unit_m * UM,
        neighbours: correlation(chain),
        rows: chain.rows.len(),
    };
    view.chains().iter().map(one).collect()
}

/// Displays whose rounding is much of the scatter: said where nothing else is found, too, for a finer one is what would help.
fn rounded(view: &View) -> impl Iterator<Item = Look> {
    view.chains().iter().filter_map(|chain| {
        let step_um = chain.step? * chain.unit_m * UM;
        let (rounding_um, scatter_um) = (step_um / 12f64.sqrt(), chain.noise.sigma * chain.unit_m * UM);
        (rounding_um.powi(2) > MUCH_OF_IT * scatter_um.powi(2)).then(|| Look {
            what: format!("display of {}", chain.of),
            says: format!(
                "all readings are whole multiples of {step_um:.3} µm, and rounding alone makes {rounding_um:.3} µm of their scatter of \
                 {scatter_um:.3} µm: an error smaller than a step shows only in the mean of many, and one that is the same in all \
                 repeats may not show at all; a finer display tells more"
            ),
            is_noise: None,
        })
    })
}

/// Displays that hide more than the scatter shows.
pub(super) fn notes_of_displays(view: &View) -> Vec<String> {
    let one = |chain: &Kept| {
        let (step_um, hidden_um) = (chain.step? * chain.unit_m * UM, chain.hidden() * chain.unit_m * UM);
        (hidden_um > WORTH_SAYING * step_um).then(|| {
            format!(
                "{} is shown in steps of {step_um:.3} µm and scatters by no more than that: what it hides (u = {hidden_um:.3} µm, no mean \
                 makes it less) is in every uncertainty. A finer display would show more.",
                chain.of
            )
        })
    };
    view.chains().iter().filter_map(one).collect()
}

fn correlation(chain: &Kept) -> Option<Correlation> {
    let theta = chain.noise.theta;
    (!chain.noise.is_assumed_white()).then(|| Correlation {
        value: theta.neighbours(),
        interval: (chain.noise.neighbours_at(0.025), chain.noise.neighbours_at(0.975)),
        slow_share: theta.share,
        steps: (theta.rho > 0.0).then(|| -theta.rho.ln().recip()),
    })
}

/// Rejected rows.
pub(super) fn rejected(study: &dyn Study, gross: &Outliers) -> Vec<RejectedRow> {
    let one = |row: &super::outliers::Rejected| RejectedRow {
        name: study.row_name(row.row),
        residual_um: row.residual * study.row_unit_m(row.row) * UM,
        deviations: row.deviations,
    };
    gross.rejected.iter().map(one).collect()
}

/// Everything that must have been looked at.
pub(super) fn looks(
    view: &View,
    gross: &Outliers,
    found: &Found,
    before: &Judgement,
    lack_of_fit: Option<&LackOfFit>,
    options: &StudyOptions,
) -> Vec<Look> {
    let mut looks = vec![outlying(&*view.study, gross)];
    looks.extend(view.chains().iter().map(order));
    looks.extend(view.study.questions().into_iter().map(|question| {
        let own = |k: &usize| found.considered.iter().find(|c| c.name == view.study.candidates()[*k].name);
        let least = question.candidates.iter().filter_map(own).map(|c| c.p_holm).min_by(f64::total_cmp);
        let is_found = found.set.iter().any(|k| question.candidates.contains(k));
        Look {
            what: question.what,
            says: match least {
                None => "the data cannot tell".to_owned(),
                Some(_) if is_found => "found".to_owned(),
                Some(p) if p <= options.significance => {
                    format!("p = {p:.1e} if noise were as estimated, but not beyond what slow noise may do, or not repeated by the blocks")
                }
                Some(p) => format!("nothing (smallest p after Holm {p:.2})"),
            },
            // What noise as estimated does not do is told, whether slower noise may or not.
            is_noise: least.filter(|p| is_found || *p > options.significance).map(|_| !is_found),
        }
    }));
    looks.extend(lack_of_fit.map(|test| Look {
        what: test.of.clone(),
        says: format!("what they leave between them has p = {:.1e} by chance", test.p_before),
        is_noise: Some(test.p_before > options.significance),
    }));
    looks.extend(rounded(view));
    looks.extend(scatter(before, options.significance));
    looks
}

fn outlying(study: &dyn Study, gross: &Outliers) -> Look {
    let named = |rows: &[usize]| {
        let names: Vec<String> = rows.iter().take(NAMED).map(|row| study.row_name(*row)).collect();
        let more = rows.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        format!("{}{more}", names.join("; "))
    };
    let rejected: Vec<usize> = gross.rejected.iter().map(|rejected| rejected.row).collect();
    let mut says: Vec<String> = Vec::new();
    if !rejected.is_empty() {
        says.push(format!("rejected as gross errors: {}", named(&rejected)));
    }
    says.extend(gross.too_many.iter().map(|(of, rows)| {
        format!(
            "{} rows of {of} stand apart, too many to be accidents, and none of them was rejected: {}",
            rows.len(),
            named(rows)
        )
    }));
    if says.is_empty() {
        let words =
            if study.chains().is_empty() { "not looked for in data of this kind" } else { "no row stands apart" };
        says.push(words.to_owned());
    }
    Look { what: "outliers".to_owned(), says: says.join("; "), is_noise: Some(gross.too_many.is_empty()) }
}

fn order(chain: &Kept) -> Look {
    let what = format!("order of measurement, {}", chain.of);
    let Some(found) = correlation(chain) else {
        let says = "too few rows to tell whether their noise is correlated; it was taken as independent".to_owned();
        return Look { what, says, is_noise: None };
    };
    let (low, high) = found.interval;
    let says = format!("neighbours correlate by {:.2} (95 %: {low:.2} to {high:.2})", found.value);
    let wanders = found.steps.is_some_and(|steps| found.slow_share > 0.5 && steps > WANDERS * chain.rows.len() as f64);
    match wanders {
        true => {
            let says = format!("{says}: over this record that is a drift that no candidate describes");
            Look { what, says, is_noise: Some(false) }
        }
        false => Look { what, says, is_noise: Some(true) },
    }
}

/// χ² against the declared uncertainties; nothing where none are declared.
fn scatter(before: &Judgement, significance: f64) -> Option<Look> {
    let chi2_per_dof = before.chi2_per_dof?;
    let distribution = ChiSquared::new(before.degrees_of_freedom).ok()?;
    let chi2 = chi2_per_dof * before.degrees_of_freedom;
    let (above, below) = (beyond(&distribution, chi2), distribution.cdf(chi2));
    let ratio = chi2_per_dof.sqrt();
    let (says, is_noise) = if above <= significance {
        let says = format!(
            "{ratio:.2} times what was declared: either the declared uncertainties are too small, or something acts that \
             no candidate describes; without replicates the data cannot tell which. Effects were tested against the \
             scatter found, not the declared one"
        );
        (says, false)
    } else if below <= significance {
        (format!("{ratio:.2} times what was declared: the declared uncertainties are too large"), true)
    } else {
        (format!("{ratio:.2} times what was declared, as chance has it"), true)
    };
    Some(Look { what: "scatter".to_owned(), says, is_noise: Some(is_noise) })
}
