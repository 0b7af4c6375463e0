//! Under which names each effect of the simulator may be found, and why: the one table of right answers.
//!
//! Place in the flow: the bench holds what a diagnosis found against it. Left the simulator's name, right the name in
//! model files; what must agree beside the name is what a reader would act on.

use abbe_trials::Accepted;
use abbe_trials::attribution::Same;

const AXIS: &[Same] = &[Same::Word("axis", "axis")];
const SIDE: &[Same] = &[Same::Word("axis", "axis"), Same::Word("toward", "toward")];
/// The simulator turns the carrying joint about its own axis.
const CARRIED: &[Same] =
    &[Same::Word("carrying", "carrying"), Same::Word("carriage", "carriage"), Same::Word("carrying", "about")];
const CARRIED_SEEN_FROM_THE_OTHER: &[Same] =
    &[Same::Word("carrying", "carriage"), Same::Word("carriage", "carrying"), Same::Word("carrying", "about")];

const fn row(injected: &'static str, found: &'static str, same: &'static [Same], reason: &'static str) -> Accepted {
    Accepted { injected, found, same, reason }
}

/// Right answers. A smooth effect without a name and a worn place have none: only an empirical term may describe it.
pub(crate) const ACCEPTED: &[Accepted] = &[
    row("acceleration", "acceleration", AXIS, "the carriage that is accelerated twists, about whichever axis"),
    row("backlash", "reversal", AXIS, "ISO 230-2 calls the play of an axis its reversal value"),
    row("beam_gradient", "range_bend", &[], "what air along the beam adds goes with the square of the range"),
    row("carriage_sag", "carriage_sag", CARRIED, "which beam gives way under which carriage"),
    row("carriage_twist", "carriage_sag", CARRIED, "the same pair of axes; the model's form holds products of both"),
    row(
        "carriage_twist",
        "carriage_sag",
        CARRIED_SEEN_FROM_THE_OTHER,
        "a turn by the product of both positions; which of the two joints turns differs by a lever times that product, \
         and the model's form gives either joint heights of that shape",
    ),
    row("column_bow", "column_bow", SIDE, "that axis and side, by whichever difference of sensors that drift alike"),
    row("dead_path", "dead_path", &[], "one air for all stations"),
    row("gimbal", "gimbal", &[], "harmonics of one instrument"),
    row("moisture_bow", "moisture_bow", &[], "the one arch by moisture"),
    row("gradient_bow", "gradient_bow", &[], "the one arch under a gradient"),
    row("hysteresis", "hysteresis", AXIS, "the axis; over which travel is part of its size"),
    row("lagged_expansion", "scale_expansion", AXIS, "that axis, by a sensor or by what follows one"),
    row("outlying_run", "outlying_run", &[Same::Word("line", "line")], "that line and no other"),
    row("periodic_scale", "periodic_scale", &PERIOD, "axis, and the period to 2 %: its double is another cause"),
    row("reflector_incidence", "reflector_incidence", &[], "one reflector"),
    row("reflector_offset", "reflector_offset", &[], "all holders in one effect"),
    row("refraction", "refraction", &[], "the air along the beam"),
    row("scale_expansion", "scale_expansion", AXIS, "that axis, by whichever of its sensors that drift alike"),
    row("screw", "scale_growth", AXIS, "that axis, with one time constant in the place of two"),
    row("speed_lag", "speed_lag", AXIS, "the axis that lags"),
    row("splice", "scale_step", &PLACE, "the same axis and place: between the readings on both sides of it"),
    row("stand_jump", "stand_jump", &[], "one station"),
    row("station_drift", "station_drift", &[], "all stands in one effect"),
    row("table_load", "table_load", &[], "one table"),
    row("zero_jump", "zero_jump", &[], "one station"),
    row("warm_up", "warm_up", &[], "growth of the head with time"),
];

const PLACE: [Same; 2] = [Same::Word("axis", "axis"), Same::Length("at_mm", "from_m", 0.15)];
const PERIOD: [Same; 2] = [Same::Word("axis", "axis"), Same::Length("pitch_mm", "period_m", 0.02)];

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::effects::REGISTRY;
    use abbe_virtual_machine::effects::examples;

    #[test]
    fn every_effect_of_the_simulator_has_an_answer_that_the_registry_knows() {
        let injected = examples().filter_map(|text| text.split_whitespace().next());
        for name in injected.filter(|name| !["undescribed", "wear"].contains(name)) {
            let rows: Vec<_> = ACCEPTED.iter().filter(|row| row.injected == name).collect();
            assert!(!rows.is_empty(), "{name} has no right answer");
            for row in rows {
                assert!(REGISTRY.iter().any(|known| known.name == row.found), "{} is not registered", row.found);
                assert!(!row.reason.is_empty());
            }
        }
    }
}
