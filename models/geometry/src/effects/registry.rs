//! The registry of effects: one line each.
//!
//! Place in the flow: diagnosis goes through [`REGISTRY`]; model files are read through [`construct`].

use super::known::Known;
use super::shape::{EffectError, Shape};
use super::{
    Effect, acceleration, axis_term, carriage_sag, column_bow, dead_path, empirical, gimbal, gradient_bow, hysteresis,
    moisture_bow, outlying_run, periodic_scale, range_bend, reflector_incidence, reflector_offset, refraction,
    reversal, scale_expansion, scale_growth, scale_step, speed_lag, stand_jump, station_drift, table_load, warm_up,
    zero_jump,
};
use crate::machine::Machine;

/// Every effect: the one place where a new one is entered.
pub const REGISTRY: &[Known] = &[
    acceleration::KNOWN,
    axis_term::KNOWN,
    carriage_sag::KNOWN,
    column_bow::KNOWN,
    dead_path::KNOWN,
    empirical::KNOWN,
    gimbal::KNOWN,
    gradient_bow::KNOWN,
    hysteresis::KNOWN,
    moisture_bow::KNOWN,
    outlying_run::KNOWN,
    periodic_scale::KNOWN,
    range_bend::KNOWN,
    reflector_incidence::KNOWN,
    reflector_offset::KNOWN,
    refraction::KNOWN,
    reversal::KNOWN,
    scale_expansion::KNOWN,
    scale_growth::KNOWN,
    scale_step::KNOWN,
    speed_lag::KNOWN,
    stand_jump::KNOWN,
    station_drift::KNOWN,
    table_load::KNOWN,
    warm_up::KNOWN,
    zero_jump::KNOWN,
];

/// The registered effect of that name.
pub fn known(name: &str) -> Option<&'static Known> {
    REGISTRY.iter().find(|entry| entry.name == name)
}

/// The effect of that name with that shape on that machine.
pub fn construct(name: &str, shape: &Shape, machine: &Machine) -> Result<Box<dyn Effect>, EffectError> {
    match known(name) {
        Some(entry) => (entry.construct)(shape, machine),
        None => {
            let known = REGISTRY.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ");
            Err(EffectError::Unknown { name: name.to_owned(), known })
        }
    }
}
