//! What a settled fit leaves open of the expansion of each scale with each temperature that was logged.
//!
//! Place in the flow: the last step of [`crate::identify()`], and of a diagnosis; [`abbe_geometry::unseen_expansion`] widens coordinates by
//! it. The expansion of one axis (and the push of the tip along it, which is not told from where the scale is fixed) is a pair of columns
//! beside all that the fit has: C, with Λ = CᵀC − CᵀJVJᵀC left of its information, and a prior of a scale of steel or glass that
//! nobody compensates. What is open is the second moment of the posterior,
//!
//! > s² = a² + u_a²,   a = (Λ/φ + P)⁻¹ Cᵀr/φ,   u_a² = (Λ/φ + P)⁻¹,
//!
//! φ the misfit of the fit. So what the data show, and no diagnosis adopted, is in it as well. A campaign at one temperature
//! leaves the prior. What the fit takes of the columns, V JᵀC, is by how much its parameters may be off together (the consider covariance of
//! Schmidt 1966, as in Tapley, Schutz and Born 2004, Statistical Orbit Determination, 6.3). Where an effect of the fit already holds what
//! a temperature does along an axis, its covariance says it. A squareness error that goes with a temperature is such a pair, too: the tip goes
//! along one axis with the reading of another. A scale that all lengths of the instrument have in common is such a column as
//! well: the lengths themselves. Nothing shows it, so that what is declared of it is open whatever the data say. Lengths in m.

use crate::identified::Identified;
use crate::linear::dot;
use crate::rows::{Rows, parameters_of};
use crate::term::CampaignRow;
use abbe_geometry::effects::{CovariateSource, CovariateValue, Effect, State, along_columns, is_derived};
use abbe_geometry::model::FittedEffect;
use abbe_geometry::seen::TEMPERATURE;
use abbe_geometry::unseen_expansion::{UnseenExpansion, UnseenExpansions};
use abbe_geometry::{Axis, ErrorId};
use abbe_measurement::campaign::{Campaign, Covariate};
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;

/// Expansion of a scale that nobody compensates (1/K, k = 1): steel and glass grow by 8 to 12 µm/(m·K).
const EXPANSION: f64 = 10e-6;
/// Push of the tip with it (m/K): a scale is fixed within a few metres.
const PUSH: f64 = 30e-6;

/// Turn of one axis against another (rad/K): a structure of steel one side of which stays a quarter of a kelvin behind.
const TURN: f64 = 3e-6;
/// Push of the tip with that (m/K): the place that stays where it is lies within a metre.
const PUSH_OF_TURN: f64 = 3e-6;
/// What an effect of the fit holds is open to no more than that (m/K): rows tell nothing of it beside the effect.
const HELD: f64 = 1e-12;

/// An expansion and a push.
const PAIR: usize = 2;

/// Rows at which an effect is looked at.
const LOOKED_AT: usize = 8;
/// Share of a motion that is rounding.
const ROUNDING: f64 = 1e-9;

/// The row of a campaign with all temperatures raised.
struct Warmer<'a> {
    row: CampaignRow<'a>,
    raised_k: f64,
}

impl CovariateSource for Warmer<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        match self.row.covariate(name) {
            CovariateValue::Fresh(value) if name.ends_with(TEMPERATURE) => CovariateValue::Fresh(value + self.raised_k),
            other => other,
        }
    }
}

/// What the data of a fit leave open of the expansion of each scale with each temperature that was logged, and of the scale that all lengths
/// have in common. `is_kept` says which effects of the fit the model keeps.
pub fn unseen_expansions(
    fit: &Identified,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    is_kept: &dyn Fn(&FittedEffect) -> bool,
) -> UnseenExpansions {
    let logged: Vec<&Covariate> = logged_temperatures(campaign).collect();
    let mut all = UnseenExpansions::default();
    if logged.is_empty() {
        all.absorbed.extend(common_scale(fit, instrument, campaign));
        return all;
    }
    let asked = Asked { fit, rows: Rows::new(fit, instrument, campaign), campaign };
    all.absorbed.extend(is_declared(instrument).then(|| asked.common_scale(instrument.common_per_metre)));
    let logged: Vec<Logged> = logged.into_iter().filter_map(|column| asked.logged(column)).collect();
    let unseen = |column: &Logged| UnseenExpansion { sensor: column.name.to_owned(), ..UnseenExpansion::default() };
    all.by_sensor = logged.iter().map(unseen).collect();
    for motion in Motion::of_scales().into_iter().chain(asked.motions_of_squareness(is_kept)) {
        let is_held = asked.is_held(&motion, is_kept);
        let of_motion = asked.of_motion(&logged, &motion);
        let open: Vec<Open> = (0..logged.len()).map(|sensor| asked.open((&motion, &of_motion), sensor)).collect();
        for (own, open) in all.by_sensor.iter_mut().zip(&open) {
            let (per_kelvin, at_c) = motion.kept_in(own);
            *at_c = open.at_c;
            *per_kelvin = if is_held { 0.0 } else { open.per_kelvin() };
        }
        // Temperatures of one machine go together: the one that may hide most stands for all.
        let most = open.iter().max_by(|a, b| a.hidden().total_cmp(&b.hidden()));
        if let Some(open) = most.filter(|_| !is_held) {
            all.absorbed.extend(asked.absorbed(open));
        }
    }
    all
}

/// Temperatures that a sensor gave, and none that was made of another.
pub(crate) fn logged_temperatures(campaign: &Campaign) -> impl Iterator<Item = &Covariate> {
    campaign.covariates.iter().filter(|column| column.name.ends_with(TEMPERATURE) && !is_derived(&column.name))
}

/// Whether an effect stretches a scale with a temperature: what the data leave open of that is in [`unseen_expansions`].
pub fn is_expansion(
    effect: &dyn Effect,
    fit: &Identified,
    (instrument, campaign): (RangeUncertainty, &Campaign),
) -> bool {
    let asked = Asked { fit, rows: Rows::new(fit, instrument, campaign), campaign };
    let scales = Motion::of_scales();
    asked.reads_one_and(effect, &|effect, reading| scales.iter().any(|scale| asked.does(effect, reading, scale)))
}

/// The tip goes along one axis, the more the farther another is out: an expansion where both are the same, else a squareness error.
struct Motion {
    along: Axis,
    with: Axis,
    /// Place of the squareness error in the machine, and along times what a radian of it does.
    squareness: Option<(usize, f64)>,
    /// Whether an effect that the model keeps moves the tip along where all temperatures rise alike, and so has the push already.
    is_pushed: bool,
}

impl Motion {
    fn of_scales() -> [Motion; 3] {
        Axis::ALL.map(|axis| Motion { along: axis, with: axis, squareness: None, is_pushed: false })
    }

    /// Of what is open with a temperature, its own: by the kelvin, and the temperature that it is counted from.
    fn kept_in<'a>(&self, unseen: &'a mut UnseenExpansion) -> (&'a mut f64, &'a mut f64) {
        match self.squareness {
            Some((k, _)) => (&mut unseen.squareness_per_kelvin[k], &mut unseen.squareness_at_c[k]),
            None => (&mut unseen.per_kelvin[self.with.index()], &mut unseen.at_c[self.with.index()]),
        }
    }

    /// Standard deviations of what nobody compensates (1/K or rad/K, and m/K).
    fn usual(&self) -> [f64; PAIR] {
        match self.squareness {
            Some(_) if self.is_pushed => [TURN, HELD],
            Some(_) => [TURN, PUSH_OF_TURN],
            None => [EXPANSION, PUSH],
        }
    }

    /// The same of the other axis of a squareness error: which of both turns is a matter of the frame.
    fn seen_from_the_other(&self) -> Motion {
        Motion { along: self.with, with: self.along, ..*self }
    }
}

/// By how much all parameters are off together, where all lengths are longer by one standard uncertainty of the scale that they have in
/// common; `None` where none is declared.
pub(crate) fn common_scale(fit: &Identified, instrument: RangeUncertainty, campaign: &Campaign) -> Option<Vec<f64>> {
    let asked = || Asked { fit, rows: Rows::new(fit, instrument, campaign), campaign };
    is_declared(instrument).then(|| asked().common_scale(instrument.common_per_metre))
}

fn is_declared(instrument: RangeUncertainty) -> bool {
    instrument.common_per_metre > 0.0
}

/// A temperature at each reading that counts (°C).
struct Logged<'c> {
    name: &'c str,
    values_c: Vec<f64>,
}

struct Asked<'a> {
    fit: &'a Identified,
    rows: Rows<'a>,
    campaign: &'a Campaign,
}

/// Columns of a motion about the middle of an axis and of a push along it: pairs, one of each temperature less its mean, and last one
/// without a temperature. About another temperature, a pair is less so much of the last.
struct OfMotion<'c> {
    logged: &'c [Logged<'c>],
    mean_c: Vec<f64>,
    /// V JᵀC: what the fit takes of each for its own; free parameters by columns.
    reach: Mat<f64>,
    /// CᵀC − CᵀJVJᵀC.
    left: Mat<f64>,
    /// Cᵀr.
    gradient: Vec<f64>,
}

impl OfMotion<'_> {
    /// Of a pair about a temperature so far from the mean (K), element by element.
    fn about(&self, sensor: usize, moved_k: f64, of: impl Fn(usize) -> f64) -> [f64; PAIR] {
        let last = PAIR * self.logged.len();
        std::array::from_fn(|j| of(PAIR * sensor + j) - moved_k * of(last + j))
    }

    fn reach(&self, sensor: usize, moved_k: f64) -> Mat<f64> {
        let row = |i: usize| self.about(sensor, moved_k, |j| self.reach[(i, j)]);
        Mat::from_fn(self.reach.nrows(), PAIR, |i, j| row(i)[j])
    }

    fn left(&self, sensor: usize, moved_k: f64) -> [[f64; PAIR]; PAIR] {
        let row = |i: usize, k: usize| self.about(sensor, moved_k, |j| self.left[(i, j)])[k];
        let by_column: [[f64; PAIR]; PAIR] = std::array::from_fn(|k| self.about(sensor, moved_k, |i| row(i, k)));
        std::array::from_fn(|i| std::array::from_fn(|k| by_column[k][i]))
    }

    fn gradient(&self, sensor: usize, moved_k: f64) -> [f64; PAIR] {
        self.about(sensor, moved_k, |j| self.gradient[j])
    }
}

/// What the rows leave open of a motion with one temperature.
struct Open {
    at_c: f64,
    /// Rms distance of the readings from that (K).
    away_k: f64,
    /// Second moments of the expansion or turn (1/K or rad/K) and of the push (m/K).
    second: [[f64; PAIR]; PAIR],
    /// What the fit takes of each: free parameters by unit.
    reach: Mat<f64>,
}

impl Open {
    fn per_kelvin(&self) -> f64 {
        self.second[0][0].sqrt()
    }

    fn hidden(&self) -> f64 {
        self.per_kelvin() * self.away_k
    }
}

impl Asked<'_> {
    /// A temperature at every reading, drawn straight between those that have one: a cell that is empty does not make the scales
    /// invar. `None` where no reading that counts has one.
    fn logged<'c>(&self, column: &'c Covariate) -> Option<Logged<'c>> {
        let known = |k: usize| column.values[k].filter(|value| value.is_finite()).map(|value_c| (k, value_c));
        let told: Vec<(usize, f64)> = self.used().filter_map(known).collect();
        let (first, last) = (*told.first()?, *told.last()?);
        let mut values_c = vec![first.1; self.rows.len()];
        values_c[last.0..].fill(last.1);
        for ((a, from_c), (b, to_c)) in told.iter().zip(told.iter().skip(1)) {
            for (k, value_c) in values_c.iter_mut().enumerate().take(b + 1).skip(*a) {
                *value_c = from_c + (to_c - from_c) * (k - a) as f64 / (b - a) as f64;
            }
        }
        Some(Logged { name: &column.name, values_c })
    }

    fn used(&self) -> impl Iterator<Item = usize> {
        (0..self.rows.len()).filter(|k| self.rows.whitening[*k] > 0.0)
    }

    fn motions_of_squareness(&self, is_kept: &dyn Fn(&FittedEffect) -> bool) -> [Motion; 3] {
        let squareness = &self.fit.model.parts().machine.squareness;
        std::array::from_fn(|k| {
            let own = &squareness[k];
            let turned = own.about.direction().cross(&own.tilts.direction()).dot(&own.moves().direction());
            let motion =
                Motion { along: own.moves(), with: own.tilts, squareness: Some((k, turned)), is_pushed: false };
            let pushes = |effect: &dyn Effect, reading| {
                let by_kelvin = self.by_kelvin(effect, reading, &motion);
                by_kelvin.is_some_and(|ends| ends.iter().flatten().any(|moved| *moved != 0.0))
            };
            Motion { is_pushed: self.any(is_kept, &pushes), ..motion }
        })
    }

    /// Whether an effect that the model keeps does that where all temperatures rise alike.
    fn is_held(&self, motion: &Motion, is_kept: &dyn Fn(&FittedEffect) -> bool) -> bool {
        let other = motion.seen_from_the_other();
        self.any(is_kept, &|effect, reading| self.does(effect, reading, motion) || self.does(effect, reading, &other))
    }

    /// Whether something holds of an effect that the model keeps and that reads a temperature, at one of some readings.
    fn any(&self, is_kept: &dyn Fn(&FittedEffect) -> bool, holds: &dyn Fn(&dyn Effect, usize) -> bool) -> bool {
        let effects = self.fit.model.parts().effects.iter().filter(|fitted| is_kept(fitted));
        effects.map(|fitted| fitted.effect.as_ref()).any(|effect| self.reads_one_and(effect, holds))
    }

    /// Whether an effect reads a temperature, and something holds of it at one of some readings.
    fn reads_one_and(&self, effect: &dyn Effect, holds: &dyn Fn(&dyn Effect, usize) -> bool) -> bool {
        let reads_one = effect.covariates().iter().any(|name| name.ends_with(TEMPERATURE));
        reads_one && self.used().step_by(self.rows.len() / LOOKED_AT + 1).any(|reading| holds(effect, reading))
    }

    /// Whether what an effect does along an axis in a kelvin changes with the reading of the other.
    fn does(&self, effect: &dyn Effect, reading: usize, motion: &Motion) -> bool {
        let Some([low, high]) = self.by_kelvin(effect, reading, motion) else { return false };
        low.iter().zip(&high).any(|(low, high)| (high - low).abs() > ROUNDING * low.abs().max(high.abs()))
    }

    /// What each parameter of an effect does along an axis in a kelvin at both ends of the other, beside the readings and quantities of one row
    /// (m per unit).
    fn by_kelvin(&self, effect: &dyn Effect, reading: usize, motion: &Motion) -> Option<[Vec<f64>; 2]> {
        let at = |at_m: f64| -> Option<Vec<f64>> {
            let along = |raised_k: f64| self.along(effect, (reading, motion), (at_m, raised_k));
            Some(along(1.0)?.iter().zip(along(0.0)?).map(|(warm, cold)| warm - cold).collect())
        };
        let (low_m, high_m) = self.fit.model.parts().identified.reading_m[motion.with.index()];
        Some([at(low_m)?, at(high_m)?])
    }

    /// What each parameter of an effect moves the tip along an axis by at a reading of the other (m per unit), all temperatures of a row raised.
    fn along(
        &self,
        effect: &dyn Effect,
        (reading, motion): (usize, &Motion),
        (at_m, raised_k): (f64, f64),
    ) -> Option<Vec<f64>> {
        let own = &self.campaign.readings[reading];
        let mut reading_m = own.reading_m;
        reading_m[motion.with.index()] = at_m;
        let warmer = Warmer { row: CampaignRow { campaign: self.campaign, reading }, raised_k };
        let state = State { reading_m, offset_m: own.offset_m, covariates: &warmer };
        along_columns(effect, effect.parameters().len(), &state, motion.along).ok()
    }

    fn open(&self, (motion, of_motion): (&Motion, &OfMotion), sensor: usize) -> Open {
        let column = &of_motion.logged[sensor];
        // What the fit makes of a motion about one temperature is the distance to that at which it measured.
        let moved_k = self.taken(&of_motion.reach(sensor, 0.0), motion);
        let at_c = of_motion.mean_c[sensor] + moved_k;
        let (mut square_k2, mut count) = (0.0, 0.0);
        for k in self.used() {
            square_k2 += (column.values_c[k] - at_c).powi(2);
            count += 1.0;
        }
        let second = self.second(motion, of_motion.left(sensor, moved_k), of_motion.gradient(sensor, moved_k));
        Open { at_c, away_k: (square_k2 / count).sqrt(), second, reach: of_motion.reach(sensor, moved_k) }
    }

    /// A motion and a push with these temperatures.
    fn of_motion<'c>(&self, logged: &'c [Logged<'c>], motion: &Motion) -> OfMotion<'c> {
        let d = motion.with.index();
        let middle_m = self.fit.model.middle_m()[d];
        let count = self.used().count() as f64;
        let mean = |column: &Logged| self.used().map(|k| column.values_c[k]).sum::<f64>() / count;
        let mean_c: Vec<f64> = logged.iter().map(mean).collect();
        let mut columns = Mat::zeros(self.rows.len(), PAIR * (1 + logged.len()));
        for k in self.used() {
            let push = self.rows.along(k, ErrorId::linear(motion.along, motion.with));
            let moved = push * (self.campaign.readings[k].reading_m[d] - middle_m);
            let by = logged.iter().zip(&mean_c).map(|(column, mean_c)| column.values_c[k] - mean_c);
            for (pair, by) in by.chain([1.0]).enumerate() {
                columns[(k, PAIR * pair)] = moved * by;
                columns[(k, PAIR * pair + 1)] = push * by;
            }
        }
        (0..columns.ncols()).for_each(|j| self.rows.whiten(columns.col_as_slice_mut(j)));
        let shared = self.rows.jacobian.transpose() * &columns;
        let reach = &self.rows.covariance * &shared;
        let left = columns.transpose() * &columns - shared.transpose() * &reach;
        let gradient = (0..columns.ncols()).map(|j| dot(columns.col_as_slice(j), &self.rows.residuals)).collect();
        OfMotion { logged, mean_c, reach, left, gradient }
    }

    /// How much of such a motion stands in the first column of what the fit takes: as a slope of the positioning error, or as a squareness error.
    fn taken(&self, reach: &Mat<f64>, motion: &Motion) -> f64 {
        let (layout, axis) = (self.fit.model.layout(), motion.with);
        if let Some((k, sign)) = motion.squareness {
            let own = layout.squareness().start + k;
            return self.rows.parameters.iter().position(|p| *p == own).map_or(0.0, |column| sign * reach[(column, 0)]);
        }
        let id = ErrorId::linear(axis, axis);
        let (low_m, high_m) = self.fit.model.parts().identified.reading_m[axis.index()];
        let Some(basis) = layout.basis(id).filter(|_| high_m > low_m) else { return 0.0 };
        let own = layout.range(id);
        let mut coefficients = vec![0.0; own.len()];
        for (column, parameter) in self.rows.parameters.iter().enumerate().filter(|(_, p)| own.contains(p)) {
            coefficients[parameter - own.start] = reach[(column, 0)];
        }
        (basis.at(high_m).dot(&coefficients) - basis.at(low_m).dot(&coefficients)) / (high_m - low_m)
    }

    /// Second moments of a motion and a push of which the rows leave so much information, with this gradient.
    fn second(&self, motion: &Motion, left: [[f64; PAIR]; PAIR], gradient: [f64; PAIR]) -> [[f64; PAIR]; PAIR] {
        let usual = motion.usual();
        let factor = self.fit.evidence.chi2_per_dof.max(1.0);
        let information = |i: usize, j: usize| {
            let prior = if i == j { usual[i].powi(-2) } else { 0.0 };
            // Rounding may leave less than nothing.
            let known = if i == j { left[i][i].max(0.0) } else { left[i][j] };
            known / factor + prior
        };
        let (a, b, c) = (information(0, 0), information(0, 1), information(1, 1));
        let determinant = a * c - b * b;
        if determinant.is_nan() || determinant <= 0.0 {
            return [[usual[0].powi(2), 0.0], [0.0, usual[1].powi(2)]];
        }
        let covariance = [[c, -b], [-b, a]].map(|row| row.map(|value| value / determinant));
        let estimate = covariance.map(|row| (row[0] * gradient[0] + row[1] * gradient[1]) / factor);
        std::array::from_fn(|i| std::array::from_fn(|j| covariance[i][j] + estimate[i] * estimate[j]))
    }

    /// By how much all parameters are off together, where all lengths are longer by this scale.
    fn common_scale(&self, per_metre: f64) -> Vec<f64> {
        let mut lengths_m = Mat::zeros(self.rows.len(), 1);
        self.used().for_each(|k| lengths_m[(k, 0)] = self.campaign.readings[k].length_m);
        self.rows.whiten(lengths_m.col_as_slice_mut(0));
        let reach = &self.rows.covariance * (self.rows.jacobian.transpose() * lengths_m);
        self.of_all(|column| per_metre * reach[(column, 0)])
    }

    /// Values of the free parameters among those of all.
    fn of_all(&self, of_free: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut all = vec![0.0; parameters_of(&self.fit.model).len()];
        for (column, parameter) in self.rows.parameters.iter().enumerate() {
            all[*parameter] = of_free(column);
        }
        all
    }

    /// What the fit takes of both, as directions of all parameters, each a standard deviation long.
    fn absorbed(&self, open: &Open) -> [Vec<f64>; 2] {
        let [[a, b], [_, c]] = open.second;
        let expansion = a.sqrt();
        // Cholesky's factor.
        let along = if expansion > 0.0 { b / expansion } else { 0.0 };
        let rest = (c - along * along).max(0.0).sqrt();
        [[expansion, along], [0.0, rest]].map(|[of_expansion, of_push]| {
            self.of_all(|column| of_expansion * open.reach[(column, 0)] + of_push * open.reach[(column, 1)])
        })
    }
}
