//! A foreign machine before and after its diagnosis.
//!
//! Place in the flow: hands the plain arrays of the foreign simulator to the program and what comes out to the foreign score.

use super::machine::Build;
use super::score::{Corrected, Worth, worth};
use super::surroundings::COLUMNS;
use super::{Foreign, RANGE, REPEATABILITY_M, Verified, foreign};
use abbe_diagnose::{DiagnoseOptions, Diagnosis, diagnose, mended, with_left_out};
use abbe_geometry::Axis;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State, Travel};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
use abbe_identify::{IdentifyOptions, identify};
use abbe_measurement::campaign::{Campaign, Covariate, RangeReading};
use abbe_measurement::instrument::RangeUncertainty;

/// A diagnosis of a foreign machine.
pub(crate) struct Judged {
    pub(crate) foreign: Foreign,
    pub(crate) diagnosis: Diagnosis,
}

/// Before and after, at points within the usual surroundings and beyond them.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) inside: (Worth, Worth),
    pub(crate) beyond: (Worth, Worth),
}

/// Diagnoses a machine that suffers from these causes.
pub(crate) fn judged(machine: &str, forms: &[&str], seed: u64, options: &DiagnoseOptions) -> Judged {
    let foreign = foreign(machine, forms, seed);
    let range = RangeUncertainty { constant_m: RANGE.0, per_metre: RANGE.1, common_per_metre: 0.0 };
    let described = description(&foreign);
    let (campaign, _) = mended(&campaign(&foreign));
    let diagnosis = diagnose(&described, &[], range, &campaign, options, &mut |_| true).unwrap();
    Judged { foreign, diagnosis }
}

/// Identifies a machine that suffers from these causes, as it is: what comes out, alone and with what lines left out show.
pub(crate) fn identified(machine: &str, forms: &[&str], seed: u64) -> [Worth; 2] {
    let foreign = foreign(machine, forms, seed);
    let range = RangeUncertainty { constant_m: RANGE.0, per_metre: RANGE.1, common_per_metre: 0.0 };
    let campaign = campaign(&foreign);
    let fit = identify(&description(&foreign), range, &campaign, &IdentifyOptions::default(), &mut |_| true).unwrap();
    let widened = with_left_out(&fit, range, &campaign).unwrap();
    [&fit.model, &widened.model].map(|model| of(model, &foreign.inside))
}

impl Judged {
    pub(crate) fn outcome(&self) -> Outcome {
        let (before, after) = (&self.diagnosis.before.model, &self.diagnosis.model);
        let both = |points: &[Verified]| (of(before, points), of(after, points));
        Outcome { inside: both(&self.foreign.inside), beyond: both(&self.foreign.beyond) }
    }

    pub(crate) fn names(&self) -> Vec<&str> {
        self.diagnosis.found.iter().map(|found| found.name).collect()
    }
}

/// What a model makes of these points, one after the other; those that it refuses to correct are left out. Sides that follow over a
/// travel are made from the points as they come, and missing until they are settled.
pub(crate) fn of(model: &MachineModel, points: &[Verified]) -> Worth {
    let mut travels: Vec<(String, Travel)> =
        model.reads().into_iter().filter_map(|name| Some((name.clone(), Travel::of(&name)?))).collect();
    let corrected = |point: &Verified| {
        let side = |(name, travel): &mut (String, Travel)| {
            let logged = COLUMNS.iter().position(|known| *known == travel.logged_side()).map(|k| point.logged[k]);
            let now = travel.push(point.reading_m, logged).filter(|now| now.is_settled)?;
            Some((name.clone(), now.side))
        };
        let covariates = &Logged { point, sides: travels.iter_mut().filter_map(side).collect() };
        let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates };
        let correction = correct(model, &state);
        let covariance = correction.covariance_m2.filter(|_| correction.status != Status::Rejected)?;
        let u_m = std::array::from_fn(|d| covariance[(d, d)].sqrt());
        Some(Corrected { position_m: correction.position_m.into(), u_m, actual_m: point.actual_m })
    };
    worth(&points.iter().filter_map(corrected).collect::<Vec<_>>())
}

struct Logged<'a> {
    point: &'a Verified,
    sides: Vec<(String, f64)>,
}

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.point.time_s);
        }
        let logged = COLUMNS.iter().position(|known| *known == name).map(|k| self.point.logged[k]);
        let side = || self.sides.iter().find(|(known, _)| known == name).map(|(_, side)| *side);
        logged.or_else(side).map_or(CovariateValue::Missing, CovariateValue::Fresh)
    }
}

pub(crate) fn campaign(foreign: &Foreign) -> Campaign {
    let reading = |r: &super::Reading| RangeReading {
        station: r.station as u32,
        line: r.line as u32,
        time_s: r.time_s,
        reading_m: r.reading_m,
        offset_m: r.offset_m,
        length_m: r.length_m,
    };
    let column = |(k, name): (usize, &&str)| Covariate {
        name: (*name).to_owned(),
        values: foreign.readings.iter().map(|r| r.logged[k]).collect(),
    };
    Campaign {
        stations: (1..=foreign.stations).map(|k| format!("S{k}")).collect(),
        lines: (1..=foreign.lines).map(|k| format!("L{k}")).collect(),
        readings: foreign.readings.iter().map(reading).collect(),
        covariates: COLUMNS.iter().enumerate().map(column).collect(),
    }
}

pub(crate) fn description(foreign: &Foreign) -> Machine {
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    let side = |axis| if foreign.build == Build::Table && axis == Axis::X { Side::Workpiece } else { Side::Tool };
    Machine {
        name: "foreign".to_owned(),
        frame_id: "machine".to_owned(),
        joints: Axis::ALL.map(|axis| Joint { axis, side: side(axis) }),
        stroke_m: foreign.stroke_m,
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(FunctionKind::BSpline { intervals: 9 }); 18],
        repeatability_m: [REPEATABILITY_M; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}
