//! A foreign machine before and after its diagnosis.
//!
//! Place in the flow: hands the plain arrays of the foreign simulator to the program and what comes out to the foreign score.

use super::machine::Build;
use super::score::{Corrected, Worth, worth};
use super::surroundings::COLUMNS;
use super::{Foreign, RANGE, REPEATABILITY_M, Verified, foreign};
use abbe_diagnose::{Diagnosis, Options, diagnose};
use abbe_geometry::Axis;
use abbe_geometry::correct::{Status, correct};
use abbe_geometry::effects::{CovariateSource, CovariateValue, State};
use abbe_geometry::error_function::Kind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::model::MachineModel;
use abbe_geometry::rotation::RotationForm;
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
pub(crate) fn judged(machine: &str, forms: &[&str], seed: u64, options: &Options) -> Judged {
    let foreign = foreign(machine, forms, seed);
    let range = RangeUncertainty { constant_m: RANGE.0, per_metre: RANGE.1 };
    let described = description(&foreign);
    let campaign = campaign(&foreign);
    let diagnosis = diagnose(&described, &[], range, &campaign, options, &mut |_| true).unwrap();
    Judged { foreign, diagnosis }
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

/// What a model makes of these points; those that it refuses to correct are left out.
pub(crate) fn of(model: &MachineModel, points: &[Verified]) -> Worth {
    let corrected = |point: &Verified| {
        let state = State { reading_m: point.reading_m, offset_m: point.offset_m, covariates: &Logged(point) };
        let correction = correct(model, &state);
        let covariance = correction.covariance_m2.filter(|_| correction.status != Status::Rejected)?;
        let u_m = std::array::from_fn(|d| covariance[(d, d)].sqrt());
        Some(Corrected { position_m: correction.position_m.into(), u_m, actual_m: point.actual_m })
    };
    worth(&points.iter().filter_map(corrected).collect::<Vec<_>>())
}

struct Logged<'a>(&'a Verified);

impl CovariateSource for Logged<'_> {
    fn covariate(&self, name: &str) -> CovariateValue {
        if name == "time_s" {
            return CovariateValue::Fresh(self.0.time_s);
        }
        let place = COLUMNS.iter().position(|known| *known == name);
        place.map_or(CovariateValue::Missing, |k| CovariateValue::Fresh(self.0.logged[k]))
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
        kinds: [Some(Kind::BSpline { intervals: 9 }); 18],
        repeatability_m: [REPEATABILITY_M; 3],
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    }
}
