//! Every effect alone and, where poses are few, every two together, and which of them look the same from these poses.
//!
//! Place in the flow: beside the search, because so few poses often leave several explanations. Best prediction of poses
//! left out first; a set that one pose alone determines is listed with fewer directions judged and comes last.

use crate::error::DiagnoseError;
use crate::study::assemble::{ALIASED, parameters};
use crate::study::fit::Fit;
use crate::study::judge::judge;
use crate::study::outcome::{Alternative, Ambiguity, StudyDiagnosis};
use crate::study::view::View;
use abbe_measurement::chance::beyond;
use statrs::distribution::FisherSnedecor;

/// Poses up to which pairs are listed: with more the search tells them apart.
const FEW: usize = 12;

/// All single effects, and all pairs where poses are few.
pub(super) fn alternatives(view: &View) -> Result<Vec<Alternative>, DiagnoseError> {
    let base = Fit::settle(view, &[])?;
    let testable = testable(view, &base);
    let mut sets: Vec<Vec<usize>> = testable.iter().map(|k| vec![*k]).collect();
    let few = if view.blocks().len() <= FEW { testable.as_slice() } else { &[] };
    for (i, a) in few.iter().enumerate() {
        sets.extend(testable[i + 1..].iter().map(|b| vec![*a, *b]));
    }
    let rows = base.linear.residuals().len() as f64;
    let mut list = Vec::with_capacity(sets.len());
    for set in sets {
        // A pair that contains itself twice over settles nowhere; the aliases name it.
        let Ok(fit) = Fit::settle(view, &set) else { continue };
        let used = base.linear.degrees() - fit.linear.degrees();
        let gain = base.linear.degrees() * (base.linear.chi2() / fit.linear.chi2()).ln();
        list.push(Alternative {
            effects: set.iter().map(|k| view.study.candidates()[*k].name.clone()).collect(),
            judgement: judge(view, &fit),
            parameters: fit
                .added
                .iter()
                .flat_map(|fitted| parameters(&*view.study, fitted, fit.linear.degrees()))
                .collect(),
            p_value: p_of(&base, &fit),
            evidence: gain - used * rows.ln(),
        });
    }
    let all = list.iter().map(|item| item.judgement.held_out.judged).max().unwrap_or(0);
    let key = |item: &Alternative| (item.judgement.held_out.judged < all, item.judgement.held_out.rms_um);
    list.sort_by(|a, b| {
        let ((a_fewer, a_rms), (b_fewer, b_rms)) = (key(a), key(b));
        a_fewer.cmp(&b_fewer).then(a_rms.total_cmp(&b_rms))
    });
    Ok(list)
}

/// Effects that look like another one from these poses.
pub(super) fn name_aliases(view: &View, diagnosis: &mut StudyDiagnosis) -> Result<(), DiagnoseError> {
    let base = Fit::settle(view, &[])?;
    let testable = testable(view, &base);
    for a in &testable {
        let columns = view.columns(&base.point, *a);
        let alone = base.linear.project((*columns).as_ref()).left;
        for b in testable.iter().filter(|b| *b > a) {
            let other = view.columns(&base.point, *b);
            if columns.ncols() != other.ncols() {
                continue;
            }
            let left = base.with_columns((*other).as_ref())?.project((*columns).as_ref()).left;
            let trace = |matrix: &faer::Mat<f64>| (0..matrix.ncols()).map(|k| matrix[(k, k)]).sum::<f64>();
            let share = 1.0 - trace(&left) / trace(&alone);
            if share > ALIASED {
                let [first, second] = [a, b].map(|k| &view.study.candidates()[*k]);
                let decided_by = first.decided_by.clone();
                if !diagnosis.next_measurements.contains(&decided_by) {
                    diagnosis.next_measurements.push(decided_by.clone());
                }
                diagnosis.not_identifiable.push(Ambiguity {
                    effects: vec![first.name.clone(), second.name.clone()],
                    because: format!("from these poses {:.1} % of one looks like the other", share * 100.0),
                    decided_by,
                });
            }
        }
    }
    Ok(())
}

/// F test of a fit against the base model.
fn p_of(base: &Fit, fit: &Fit) -> f64 {
    let (used, rest) = (base.linear.degrees() - fit.linear.degrees(), fit.linear.degrees());
    let f = ((base.linear.chi2() - fit.linear.chi2()) / used) / fit.linear.noise_factor();
    FisherSnedecor::new(used, rest).map_or(1.0, |distribution| beyond(&distribution, f))
}

fn testable(view: &View, base: &Fit) -> Vec<usize> {
    (0..view.study.candidates().len()).filter(|k| base.score(view, *k).0.degrees > 0).collect()
}
