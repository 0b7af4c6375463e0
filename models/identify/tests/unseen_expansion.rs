//! A campaign that cannot show an expansion, or a squareness error that goes with a temperature, says so at another temperature.
//!
//! Place in the flow: lean campaigns in which the temperature goes from station to station, on machines whose X expands, or whose Y turns
//! against X, by as much as stations and errors hide. Identified models correct points of another day, three kelvin warmer. Coordinates in
//! the machine frame.

use crate::common::{INSTRUMENT, SPLINE, description};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{CovariateSource, CovariateValue, Shape, State};
use abbe_geometry::machine::Machine;
use abbe_geometry::model::MachineModel;
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_identify::{EffectTerm, IdentifyOptions, identify, identify_with, in_parallel, unseen_expansions};
use abbe_virtual_machine::effects::{Effect, Moment};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::machine::JointErrors;
use abbe_virtual_machine::plan::{PlanRecipe, presets};
use abbe_virtual_machine::verification::VerificationPoint;
use abbe_virtual_machine::{
    Axis, SimulationConfig, SimulationError, TruthRecipe, simulate_campaign, verification_points,
};
use std::sync::Arc;

const MACHINES: u64 = 48;
const POINTS: usize = 100;
/// Quantile of the normal distribution for 95 %.
const QUANTILE: f64 = 1.96;
/// Where the room is in the end, and the other day (°C).
const ROOM_C: f64 = 21.0;
const OTHER_DAY_C: f64 = 24.0;
/// As a scale does that is compensated for another material (1/K).
const EXPANSION: f64 = 3e-6;

const SCALE_OF_X: (Axis, Axis) = (Axis::X, Axis::X);
/// As a bridge does one leg of which stays a sixth of a kelvin behind (rad/K).
const TURN: f64 = 2e-6;

/// Along `along` with the reading of `with`, by a kelvin of the scale of that axis (m/(m·K), or rad/K).
#[derive(Debug, Clone, Copy)]
struct Going {
    along: Axis,
    with: Axis,
    per_kelvin: f64,
    /// Reading at which nothing moves (m).
    fixed_at_m: f64,
}

impl Going {
    /// About the middle of the strokes.
    fn new(along: Axis, with: Axis, per_kelvin: f64, stroke_m: &[[f64; 2]; 3]) -> Going {
        let [low_m, high_m] = stroke_m[with.index()];
        Going { along, with, per_kelvin, fixed_at_m: 0.5 * (low_m + high_m) }
    }

    fn m(&self, reading_m: [f64; 3], value_c: f64) -> f64 {
        self.per_kelvin * (value_c - 20.0) * (reading_m[self.with.index()] - self.fixed_at_m)
    }
}

impl Effect for Going {
    fn name(&self) -> &'static str {
        "going"
    }

    fn check(&self) -> Result<(), SimulationError> {
        Ok(())
    }

    fn disturb_machine(&self, moment: &Moment, errors: &mut JointErrors) {
        let value_c = moment.environment.scale_c()[self.with.index()];
        errors.linear_m[self.with.index()][self.along.index()] += self.m(moment.reading_m, value_c);
    }
}

/// One temperature everywhere.
struct Everywhere(f64);

impl CovariateSource for Everywhere {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name.ends_with("_c") { CovariateValue::Fresh(self.0) } else { CovariateValue::Missing }
    }
}

/// What a machine's model says on the other day.
struct Judged {
    /// Share of the X coordinates within the 95 % interval, and without what the campaign could not show.
    held: f64,
    held_without: f64,
    /// Rms of the stated standard uncertainty along X at the temperature of the campaign (m), and without.
    u_m: f64,
    u_without_m: f64,
}

/// A lean campaign of a machine that goes so, and the machine as its maker describes it.
fn simulated(seed: u64, (along, with): (Axis, Axis), per_kelvin: f64) -> (SimulationConfig, Machine, Going) {
    let mut truth = TruthRecipe { seed, ..TruthRecipe::default() }.bridge_xyz().unwrap();
    let mut recipe = PlanRecipe {
        selection: abbe_virtual_machine::plan::LineSelection::Drawn(12),
        points: [6, 9],
        close_station: false,
        ..presets::case_like(truth.stroke_m, seed)
    };
    recipe.stations_m.truncate(4);
    let plan = recipe.build().unwrap();
    truth.ram_turn.about_m = plan.mean_offset_m();
    let machine = description(&truth, SPLINE);
    let mut environment = EnvironmentConfig::constant();
    for channel in &mut environment.channels[..7] {
        (channel.mean, channel.settling, channel.settling_time_s, channel.noise) = (ROOM_C, -2.0, 6000.0, 0.05);
    }
    let going = Going::new(along, with, per_kelvin, &truth.stroke_m);
    let effects: Vec<Arc<dyn Effect>> = vec![Arc::new(going)];
    let config = SimulationConfig { seed, machine: truth, plan, instrument: INSTRUMENT, environment, effects };
    (config, machine, going)
}

fn judged(seed: u64, axes: (Axis, Axis), per_kelvin: f64) -> Judged {
    let (mut config, machine, going) = simulated(seed, axes, per_kelvin);
    let campaign = simulate_campaign(&config).unwrap().campaign;
    let found = identify(&machine, INSTRUMENT.range, &campaign, &IdentifyOptions::default(), &mut |_| true).unwrap();
    let without = found.model.with_unseen_expansions(UnseenExpansions::default()).unwrap();
    config.effects.clear();
    let points = verification_points(&config, POINTS, seed + 1000).unwrap();
    let share = |model: &MachineModel| {
        let of = |point: &VerificationPoint| {
            let away_m = going.m(point.reading_m, OTHER_DAY_C);
            let (x_m, u_m) = at(model, point.reading_m, point.offset_m, OTHER_DAY_C);
            (x_m - point.actual_in_machine_m[0] - away_m, u_m)
        };
        let errors: Vec<(f64, f64)> = points.iter().map(of).collect();
        // Where the scale is fixed moves all points alike, and whoever measures a part aligns to it.
        let common_m = errors.iter().map(|(error_m, _)| error_m).sum::<f64>() / POINTS as f64;
        let inside = errors.iter().filter(|(error_m, u_m)| (error_m - common_m).abs() <= QUANTILE * u_m);
        inside.count() as f64 / POINTS as f64
    };
    let column = &campaign.covariate("temp_scale_x_c").unwrap().values;
    let mean_c = column.iter().flatten().sum::<f64>() / column.len() as f64;
    let stated_m = |model: &MachineModel| {
        let square = points.iter().map(|point| at(model, point.reading_m, point.offset_m, mean_c).1.powi(2));
        (square.sum::<f64>() / POINTS as f64).sqrt()
    };
    Judged {
        held: share(&found.model),
        held_without: share(&without),
        u_m: stated_m(&found.model),
        u_without_m: stated_m(&without),
    }
}

/// X and its standard uncertainty (m).
fn at(model: &MachineModel, reading_m: [f64; 3], offset_m: [f64; 3], value_c: f64) -> (f64, f64) {
    let corrected = correct(model, &State { reading_m, offset_m, covariates: &Everywhere(value_c) });
    (corrected.position_m.x, corrected.covariance_m2.unwrap()[(0, 0)].sqrt())
}

fn mean(all: &[Judged], of: fn(&Judged) -> f64) -> f64 {
    all.iter().map(of).sum::<f64>() / all.len() as f64
}

/// What goes so is held on the other day, and would not be without what the campaign leaves open.
fn assert_held(axes: (Axis, Axis), per_kelvin: f64) {
    let seeds: Vec<u64> = (1..=MACHINES).collect();
    let all = in_parallel(&seeds, |seed| judged(*seed, axes, per_kelvin));
    let (held, without) = (mean(&all, |one| one.held), mean(&all, |one| one.held_without));
    assert!(held >= 0.95, "{held:.3} of the coordinates within their 95 % interval, without it {without:.3}");
    assert!(without < 0.85, "these campaigns would not show it: {without:.3}");
}

#[test]
fn regress_an_expansion_that_stations_hide_stands_in_the_uncertainty_at_another_temperature() {
    assert_held(SCALE_OF_X, EXPANSION);
}

#[test]
fn regress_a_turn_that_stations_hide_stands_in_the_uncertainty_at_another_temperature() {
    assert_held((Axis::X, Axis::Y), TURN);
}

#[test]
fn a_machine_that_does_not_expand_is_hardly_less_certain_where_it_was_measured() {
    let seeds: Vec<u64> = (1..=MACHINES).collect();
    let all = in_parallel(&seeds, |seed| judged(*seed, SCALE_OF_X, 0.0));
    let (u_m, without_m) = (mean(&all, |one| one.u_m), mean(&all, |one| one.u_without_m));
    assert!(u_m < 1.15 * without_m, "{:.3} instead of {:.3} µm", u_m * 1e6, without_m * 1e6);
    let held = mean(&all, |one| one.held);
    assert!(held >= 0.95, "{held:.3}");
}

/// An expansion that the model has is in its covariance; one that bends by a difference of temperatures says nothing of all of them.
#[test]
fn what_an_effect_of_the_model_stretches_is_not_stated_twice() {
    let (config, machine, _) = simulated(1, SCALE_OF_X, EXPANSION);
    let campaign = simulate_campaign(&config).unwrap().campaign;
    let expansion = Shape::new().text("axis", "x").text("sensor", "temp_scale_x_c");
    let bow = Shape::new().text("axis", "y").text("toward", "x").text("form", "free");
    let bow = bow.text("warm", "temp_bridge_top_c").text("cold", "temp_bridge_bottom_c");
    let terms = [("scale_expansion", expansion), ("column_bow", bow)]
        .map(|(name, shape)| EffectTerm::new(name, shape, &machine).unwrap());
    let found =
        identify_with(&machine, INSTRUMENT.range, &campaign, &terms, &IdentifyOptions::default(), &mut |_| true)
            .unwrap();
    let all = unseen_expansions(&found, INSTRUMENT.range, &campaign, &|_| true);
    assert_eq!(all.by_sensor.len(), 7);
    for unseen in &all.by_sensor {
        let [x, y, z] = unseen.per_kelvin;
        assert!(x == 0.0 && y > 0.0 && z > 0.0, "{unseen:?}");
    }
    // A column that bows toward X as its sides part is no turn by a temperature of all.
    assert!(all.by_sensor.iter().all(|unseen| unseen.squareness_per_kelvin.iter().all(|open| *open > 0.0)));
    assert_eq!(all.absorbed.len(), 4 + 6, "two directions of each axis and each squareness error that nothing holds");
    // What only describes a course is not in the model that corrects, and holds nothing.
    let without =
        unseen_expansions(&found, INSTRUMENT.range, &campaign, &|fitted| fitted.effect.name() == "column_bow");
    assert!(without.by_sensor.iter().all(|unseen| unseen.per_kelvin[0] > 0.0));
}
