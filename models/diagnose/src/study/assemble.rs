//! From the effects found to the diagnosis: ladder, gains, rivals, noise, what to measure next.
//!
//! Place in the flow: last step of every study, after [`super::answer`].

use super::answer::Answer;
use super::candidate::{Open, Study};
use super::confirm::p_beside;
use super::contradictions::contradictions;
use super::fit::{Fit, Fitted};
use super::judge::judge;
use super::noise_words::{looks, noise, notes_of_displays, rejected};
use super::outcome::{Ambiguity, Blocks, Effect, LackOfFit, LeftOver, Parameter, Rung, StudyDiagnosis};
use super::outliers::outliers;
use super::placing::{placed, tried};
use super::scatter_left::scatter_left;
use super::scored::{COMPARABLE, Scored};
use super::search::{Found, Observe, StudyOptions, score_all};
use super::series::independent;
use super::significance::{probability, uncertainties};
use super::terms::{Terms, terms};
use super::told::{ANOTHER_ORDER, Doubts, doubts};
use super::view::View;
use super::waves::tell_aliases;
use crate::error::DiagnoseError;
use crate::linear::{column, in_the_worst_way};
use abbe_geometry::unseen_expansion::UnseenExpansion;
use abbe_identify::symmetric_eigen;
use faer::Mat;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Alias share from which an effect found is mostly the model's own.
pub(super) const ALIASED: f64 = 0.95;
/// Error that no instrument shows: what is less is rounding of numbers (m).
const NOTHING_M: f64 = 1e-12;
/// What was not looked at because the user vouches for it.
const CHECKED: &str = "That neither the instrument nor what was measured on drifted is as declared: what goes with the time was taken for the machine's.";
/// What a study that was stopped is worth.
const PARTIAL: &str = "The study was stopped on request: what it had found by then is here, more may be missing, and no step was judged on data that the search did not see.";
/// The same where only the comparison with what goes straight is missing.
const NOT_COMPARED: &str = "The study was stopped on request, before it was asked whether forms that go straight with a quantity predict better than those found.";
/// Variance that a period adds to that of a phase.
const OF_PERIOD: f64 = 2.0;

/// Searches and says what was found.
pub(super) fn diagnose(
    study: &mut dyn Study,
    options: &StudyOptions,
    observe: &mut Observe,
) -> Result<StudyDiagnosis, DiagnoseError> {
    let rows = refuse_nothing(study)?;
    let measured = (0..rows).filter(|row| study.is_measured(*row)).count();
    let first = outliers(study, &[], |_| true)?;
    let answer = Answer::of(study, (rows, &first), options, observe)?;
    let Answer { found, gross, unseen, unconfirmed, .. } = answer;
    let left_out = gross.rows(study);
    let mut view = View::new(study, rows, |row| !left_out.contains(&row));
    let base = view.adapt(&[])?;
    let p_before = lack_of_fit(&view, &base)?;
    let ladder = ladder(&mut view, &found.set)?;
    let last = view.adapt(&found.set)?;
    tell_aliases(&mut view, &found.set)?;
    // In the noise that is left when all is found: what is missing is no noise, and the errors before and after can be compared.
    let bare = Fit::settle(&view, &[])?;
    let (before, left) = (judge(&view, &bare), left(&view, &bare, &last));
    let p_after = lack_of_fit(&view, &last)?;
    let after = judge(&view, &last);
    let lack_of_fit = p_before.map(|(of, p_before)| LackOfFit {
        of,
        p_before,
        p_after: p_after.map(|(_, p)| p).filter(|_| !last.added.is_empty()),
    });
    let noise = noise(&view);
    let u = uncertainties(&mut view, &last)?;
    let u = with_beside(&view, &last, u);
    let mut effects = effects(&mut view, &last, &u)?;
    let contradictions = contradictions(&view, &last, options.significance)?;
    let doubts = match options.instrument_checked {
        true => Doubts::default(),
        false => doubts(&view, &last, &effects, options.significance)?,
    };
    let known = |candidate| known(&view, &last, candidate);
    let values = |candidate| {
        last.added.iter().find(|own| own.candidate == candidate).map_or_else(Vec::new, |own| own.values.clone())
    };
    let instead = |candidate| instead(&view, &last, &effects, candidate);
    let is_kept = |row| !left_out.contains(&row);
    let open = Open { found: &found.set, is_kept: &is_kept, known: &known, instead: &instead, values: &values };
    let expansions = view.study.unseen_expansions(&open);
    let doubts = Doubts { absorbed: absorbed(&view, &last, &expansions), ..doubts };
    let terms = with_deviations(terms(&*view.study, &last, &u, &doubts, (&open, expansions)), &view, &last);
    effects.iter_mut().enumerate().for_each(|(place, effect)| doubts.widen(place, effect));
    let mut looked = looks(&view, &gross, &found, &before, lack_of_fit.as_ref(), options);
    looked.extend(unconfirmed);
    looked.extend(scatter_left(&view, &last, options.significance)?);
    let not_identifiable = [not_identifiable(&*view.study, &effects, &found), doubts.ambiguities].concat();
    let is_open = !contradictions.is_empty() || looked.iter().any(|look| look.is_noise == Some(false));
    let consistent_with_noise = effects.is_empty() && !is_open;
    let next_measurements = next_measurements(&not_identifiable);
    let hidden = notes_of_displays(&view);
    let checked = options.instrument_checked.then(|| CHECKED.to_owned()).into_iter().collect();
    let stopped = if unseen.after.is_some() { NOT_COMPARED } else { PARTIAL };
    let partial = found.is_stopped.then(|| stopped.to_owned()).into_iter().collect();
    let is_full = effects.len() >= options.most_effects;
    let full = is_full.then(|| {
        format!("The search takes {} effects at most, and ended there: more may be missing.", options.most_effects)
    });
    let full = full.into_iter().collect();
    let study: &dyn Study = &*view.study;
    Ok(StudyDiagnosis {
        of: study.of(),
        rows: measured,
        blocks: Blocks { what: study.block_word().to_owned(), count: study.blocks().len() },
        consistent_with_noise,
        effects,
        before,
        after,
        unseen,
        noise,
        rejected: rejected(study, &gross),
        left,
        looked,
        ladder,
        considered: found.considered,
        alternatives: Vec::new(),
        lack_of_fit,
        not_identifiable,
        hidden: study.hidden(),
        contradictions,
        untestable: study.untestable(),
        next_measurements,
        terms,
        is_stopped: found.is_stopped,
        notes: [partial, full, study.notes(), hidden, checked].concat(),
    })
}

/// What two fits leave of each row.
fn left(view: &View, before: &Fit, after: &Fit) -> Vec<LeftOver> {
    let both = before.raw_residuals.iter().zip(&after.raw_residuals).zip(view.kept());
    let one = |((before, after), row): ((&f64, &f64), &usize)| {
        let (given, component) = view.study.given(*row)?;
        let unit_m = view.study.row_unit_m(*row);
        Some(LeftOver { row: given, component, before_m: before * unit_m, after_m: after * unit_m })
    };
    both.filter_map(one).collect()
}

/// Number of rows, where any of them is off by what an instrument shows beyond what the base model takes out.
fn refuse_nothing(study: &dyn Study) -> Result<usize, DiagnoseError> {
    let local = study.local(&[])?;
    let (basis, observed) = (independent(&local.base), column(&local.residual));
    let left = &observed - &basis * (basis.transpose() * &observed);
    if (0..left.nrows()).all(|row| (left[(row, 0)] * study.row_unit_m(row)).abs() < NOTHING_M) {
        return Err(DiagnoseError::Data {
            problem: "all errors are zero: every reading is what it should be, to the last digit".to_owned(),
            remedy: "give readings of an instrument that resolves the errors of the machine".to_owned(),
        });
    }
    Ok(local.residual.len())
}

/// Uncertainties with what the scatter of the rows does not show.
fn with_beside(view: &View, fit: &Fit, mut u: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for (k, (own, fitted)) in u.iter_mut().zip(&fit.added).enumerate() {
        let beside = view.study.u_beside(fitted.candidate);
        let hidden = hidden_by_display(view, fit, k);
        let beside = beside.into_iter().zip(hidden);
        own.iter_mut().zip(beside).for_each(|(u, (beside, hidden))| *u = u.hypot(beside).hypot(hidden));
        own.iter_mut().zip(by_period(view, fit, k)).for_each(|(u, open)| *u = u.hypot(open));
    }
    u
}

/// What the period of a wave leaves open of its sine and cosine: it was fitted as well, and is known no better than the phase. At places
/// evenly about their middle it turns the phase, on average over them, by as much as that is uncertain itself, and twice as much in square
/// about the ends.
fn by_period(view: &View, fit: &Fit, k: usize) -> [f64; 2] {
    let fitted = &fit.added[k];
    let is_wave =
        view.study.candidates()[fitted.candidate].stands_apart && view.study.frequency(fitted.candidate).is_some();
    let (true, [sine, cosine]) = (is_wave, fitted.values.as_slice()) else { return [0.0; 2] };
    let size = sine.hypot(*cosine).max(f64::MIN_POSITIVE);
    // Along the phase: where the wave does not grow.
    let along = [-cosine / size, sine / size];
    let of = |i: usize, j: usize| along[i] * along[j] * fit.covariance((k, i), (k, j));
    let variance = of(0, 0) + 2.0 * of(0, 1) + of(1, 1);
    along.map(|share| share.abs() * (OF_PERIOD * variance).max(0.0).sqrt())
}

/// Standard uncertainty of the first parameter of a candidate that a fit does not have, beside what it has; `None` where the rows do not
/// determine it.
fn known(view: &View, fit: &Fit, candidate: usize) -> Option<f64> {
    let columns = view.columns(&fit.point, candidate);
    let left = fit.linear.project(view.whitened(&columns).as_ref());
    let count = columns.ncols();
    let scale: Vec<f64> = (0..count).map(|k| left.alone[(k, k)].sqrt()).collect();
    if scale.iter().any(|scale| *scale <= 0.0) {
        return None;
    }
    let left = Mat::from_fn(count, count, |i, j| left.left[(i, j)] / (scale[i] * scale[j]));
    let (values, vectors) = symmetric_eigen(&left)?;
    let variance: f64 = (0..count).map(|k| vectors[(0, k)].powi(2) / values[k].max(f64::MIN_POSITIVE)).sum();
    Some(variance.sqrt() / scale[0])
}

/// First parameter of a candidate in the place of the effects that have it for a rival; `None` where there are none.
fn instead(view: &View, fit: &Fit, effects: &[Effect], candidate: usize) -> Option<f64> {
    let candidates = view.study.candidates();
    let is_rival = |effect: &&Effect| effect.rivals.contains(&candidates[candidate].name);
    let replaced: Vec<&str> = effects.iter().filter(is_rival).map(|effect| effect.name.as_str()).collect();
    if replaced.is_empty() {
        return None;
    }
    let stays = |k: &usize| !replaced.contains(&candidates[*k].name.as_str());
    let rest: Vec<usize> = fit.set().into_iter().filter(stays).collect();
    let with = Fit::settle(view, &[rest, vec![candidate]].concat()).ok()?;
    with.added.last()?.values.first().copied()
}

/// What the parameters of a fit take of each expansion that the data leave open: by how much they may be off together.
fn absorbed(view: &View, fit: &Fit, unseen: &[UnseenExpansion]) -> Vec<Vec<Vec<f64>>> {
    let columns = view.study.unseen_columns(unseen);
    if columns.ncols() == 0 {
        return Vec::new();
    }
    let linear = &fit.linear;
    let taken = linear.covariance() * (linear.jacobian().transpose() * view.whitened(&view.picked(&columns)));
    let of = |fitted: &Fitted, column: usize| -> Vec<f64> {
        let own = |j: usize| taken[(fitted.first + j, column)];
        let value = |i: usize| (0..fitted.map.ncols()).map(|j| fitted.map[(i, j)] * own(j)).sum();
        (0..fitted.map.nrows()).map(value).collect()
    };
    (0..columns.ncols()).map(|column| fit.added.iter().map(|fitted| of(fitted, column)).collect()).collect()
}

/// What rounding by a display leaves open of each column's size, beside the base, if it acts in the worst way.
fn hidden_by_display(view: &View, fit: &Fit, k: usize) -> Vec<f64> {
    let columns = view.columns(&fit.point, fit.added[k].candidate);
    if view.chains().iter().all(|chain| chain.hidden() == 0.0) {
        return vec![0.0; columns.ncols()];
    }
    let first = fit.added.first().map_or(fit.raw_columns.ncols(), |fitted| fitted.first);
    let base = independent(&fit.raw_columns.subcols(0, first).to_owned());
    let columns = &*columns - &base * (base.transpose() * &*columns);
    let rows = || view.chains().iter().flat_map(|chain| chain.rows.iter().map(|row| (*row, chain.hidden())));
    (0..columns.ncols()).map(|j| in_the_worst_way(rows().map(|(row, u)| (columns[(row, j)], u)))).collect()
}

/// With what one reading scatters along each axis, and beside it what was found there and has no place in a model.
fn with_deviations(mut terms: Terms, view: &View, fit: &Fit) -> Terms {
    let is_left_out = |fitted: &&Fitted| {
        let name = &view.study.candidates()[fitted.candidate].name;
        terms.left_out.iter().any(|(own, _)| own == name)
    };
    let moved = |fitted: &Fitted| &*view.columns(&fit.point, fitted.candidate) * column(&fitted.values);
    let left_out: Vec<_> = fit.added.iter().filter(is_left_out).map(moved).collect();
    for chain in view.chains() {
        if let Some(axis) = chain.along {
            let all = |row: &usize| left_out.iter().map(|moved| moved[(*row, 0)]).sum::<f64>();
            let square = chain.rows.iter().map(|row| all(row).powi(2)).sum::<f64>() / chain.rows.len() as f64;
            // Noise that is taken to be slow hides what was not claimed: the rows show it all the same.
            let left =
                chain.rows.iter().map(|row| fit.raw_residuals[*row].powi(2)).sum::<f64>() / chain.rows.len() as f64;
            let own = chain.noise.sigma.max(left.sqrt());
            terms.deviations_m[axis.index()] = Some(own.hypot(square.sqrt()) * chain.unit_m);
        }
    }
    terms
}

/// Parameters of a candidate in a fit, with the degrees of freedom that their uncertainty rests on.
pub(super) fn parameters(study: &dyn Study, fitted: &Fitted, degrees: f64) -> Vec<Parameter> {
    let specs = &study.candidates()[fitted.candidate].parameters;
    let reach = StudentsT::new(0.0, 1.0, degrees.max(1.0)).map_or(1.96, |t| t.inverse_cdf(0.975));
    let parameter = |(k, spec): (usize, &abbe_geometry::effects::ParameterSpec)| Parameter {
        name: spec.name.clone(),
        value: fitted.values[k],
        unit: spec.unit,
        u: fitted.u[k],
        half_95: reach * fitted.u[k],
        plausible: spec.plausible,
    };
    specs.iter().enumerate().map(parameter).collect()
}

/// Degrees of freedom of the rows that a candidate acts on.
fn degrees(view: &View, fit: &Fit, candidate: usize) -> f64 {
    let chains = view.touched(&view.columns(&fit.point, candidate));
    fit.part(view, &chains).degrees
}

fn effects(view: &mut View, last: &Fit, u: &[Vec<f64>]) -> Result<Vec<Effect>, DiagnoseError> {
    let set = last.set();
    let after = judge(view, last);
    let mut effects = Vec::with_capacity(set.len());
    for (k, fitted) in last.added.iter().enumerate() {
        let (without, p_value) = p_beside(view, &set, fitted.candidate)?;
        let mut all = score_all(view, &without);
        placed(view, &without, &set, &mut all);
        let Some(own) = all.iter().find(|scored| scored.candidate == fitted.candidate) else { continue };
        let study = &*view.study;
        let candidate = &study.candidates()[fitted.candidate];
        let is_rival = |other: &&Scored| {
            let is_other = !set.contains(&other.candidate);
            is_other
                && own.evidence - other.evidence < COMPARABLE
                && study.candidates()[other.candidate].family != candidate.family
        };
        let mut rivals: Vec<_> = all.iter().filter(is_rival).collect();
        rivals.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let fitted = Fitted { u: u[k].clone(), ..fitted.clone() };
        effects.push(Effect {
            name: candidate.name.clone(),
            formula: candidate.formula.clone(),
            kind: candidate.kind,
            covariates: candidate.covariates.clone(),
            p_value,
            alias_share: own.score.alias_share,
            parameters: parameters(study, &fitted, degrees(view, last, fitted.candidate)),
            held_out_gain_um: judge(view, &without).held_out.rms_um - after.held_out.rms_um,
            rivals: rivals.iter().map(|scored| study.candidates()[scored.candidate].name.clone()).collect(),
        });
    }
    Ok(effects)
}

/// Every rung is judged in the noise that the last one leaves, and tested in that which the rung below leaves.
fn ladder(view: &mut View, set: &[usize]) -> Result<Vec<Rung>, DiagnoseError> {
    let mut rungs = Vec::with_capacity(set.len() + 1);
    view.adapt(set)?;
    let last = view.noises();
    for count in 0..=set.len() {
        let fit = Fit::settle(view, &set[..count])?;
        let fitted = fit.added.last();
        rungs.push(Rung {
            added: fitted.map(|fitted| view.study.candidates()[fitted.candidate].name.clone()),
            judgement: judge(view, &fit),
            p_value: None,
            alias_share: None,
            parameters: fitted.map_or_else(Vec::new, |fitted| {
                parameters(&*view.study, fitted, degrees(view, &fit, fitted.candidate))
            }),
        });
    }
    for (count, candidate) in set.iter().enumerate() {
        let below = view.adapt(&set[..count])?;
        let (score, _) = below.score(view, *candidate);
        let p = probability(view, &below, &view.columns(&below.point, *candidate))?;
        let trials = view.study.candidates().len().saturating_mul(tried(&*view.study, *candidate));
        rungs[count + 1].p_value = Some((p * trials as f64).min(1.0));
        rungs[count + 1].alias_share = Some(score.alias_share);
    }
    view.take_noises(last);
    Ok(rungs)
}

/// Replicates of what, and the probability that a fit leaves so much between them by chance; `None` where there are none,
/// or nothing is left to test.
fn lack_of_fit(view: &View, fit: &Fit) -> Result<Option<(String, f64)>, DiagnoseError> {
    let Some((of, columns)) = view.study.replicates() else {
        let test = view.study.lack_of_fit(&fit.values()).filter(|(_, score)| score.degrees > 0);
        return Ok(test.map(|(of, score)| (of, score.p_value)));
    };
    let columns = view.picked(&columns);
    match fit.score_columns(view, &columns).0.degrees {
        0 => Ok(None),
        _ => Ok(Some((of, probability(view, fit, &columns)?))),
    }
}

fn not_identifiable(study: &dyn Study, effects: &[Effect], found: &Found) -> Vec<Ambiguity> {
    let place = |name: &str| study.candidates().iter().position(|candidate| candidate.name == name);
    let decided_by =
        |name: &str| place(name).map_or_else(String::new, |place| study.candidates()[place].decided_by.clone());
    let passes = |name: &str| place(name).is_some_and(|place| study.passes(place));
    let mut list = Vec::new();
    for considered in found.considered.iter().filter(|considered| considered.tested == 0) {
        list.push(Ambiguity {
            effects: vec![considered.name.clone()],
            because: format!("{} contains it entirely", study.base_word()),
            decided_by: decided_by(&considered.name),
        });
    }
    for effect in effects {
        if !effect.rivals.is_empty() {
            let names = std::iter::once(effect.name.clone()).chain(effect.rivals.iter().cloned()).collect();
            let because = "each explains these data as well as the other, within odds of 20 to 1".to_owned();
            let is_drift_or_place = !passes(&effect.name) && effect.rivals.iter().any(|rival| passes(rival));
            let decided_by = if is_drift_or_place { ANOTHER_ORDER.to_owned() } else { decided_by(&effect.name) };
            list.push(Ambiguity { effects: names, because, decided_by });
        }
        if effect.alias_share > ALIASED {
            let because = format!("{:.1} % of its signature is the model's own", effect.alias_share * 100.0);
            let decided_by = decided_by(&effect.name);
            list.push(Ambiguity { effects: vec![effect.name.clone()], because, decided_by });
        }
    }
    for (candidate, reason) in &found.refused {
        let name = study.candidates()[*candidate].name.clone();
        let decided_by = decided_by(&name);
        list.push(Ambiguity { effects: vec![name], because: format!("not claimed: {reason}"), decided_by });
    }
    list.extend(study.ambiguities(&found.set));
    list
}

fn next_measurements(not_identifiable: &[Ambiguity]) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for ambiguity in not_identifiable {
        if !ambiguity.decided_by.is_empty() && !list.contains(&ambiguity.decided_by) {
            list.push(ambiguity.decided_by.clone());
        }
    }
    list
}
