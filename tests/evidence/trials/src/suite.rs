//! The scenarios of the bench: every effect, pairs, effects without a name, poor plans, and machines without any.
//!
//! Place in the flow: the runner goes through them. Sizes with `*` are about the literature's; the bench scales them.

use abbe_geometry::error_function::FunctionKind;
use abbe_identify::OrderChoice;
use abbe_virtual_machine::instrument::{Correlated, Outliers};
use abbe_virtual_machine::machine::Roughness;

use crate::scenario::{Family, MachineKind, PlanKind, Scenario, SizedBy};

/// Factors of the power curve.
pub const FACTORS: [f64; 5] = [1.2, 1.5, 2.0, 3.0, 5.0];

/// As rough as a worn guideway, but without waves: a wave that repeats is a periodic error, and naming it one no fault.
const BUMPY: Roughness = Roughness { half_waves: 4, decay: 1.8, bumps: 8 };

/// Every effect alone: name of the scenario and template.
const SINGLE: &[(&str, &str)] = &[
    ("expansion", "scale_expansion axis=$axis per_kelvin_um_m=10* fixed_at_mm=0"),
    ("expansion fixed in the middle", "scale_expansion axis=$axis per_kelvin_um_m=10* fixed_at_mm=300"),
    ("bow", "gradient_bow urad_per_m_kelvin=10*"),
    ("warming", "warm_up final_x_um=1* final_y_um=-2* final_z_um=4* time_constant_s=4000"),
    ("play", "backlash axis=$axis size_um=1*"),
    ("friction", "hysteresis axis=$axis size_um=1* travel_mm=10"),
    ("lagged expansion", "lagged_expansion axis=$axis per_kelvin_um_m=10* fixed_at_mm=0 lag_s=1500"),
    ("play growing", "backlash axis=$axis size_um=0.5* growth_um=1*"),
    ("inertia", "acceleration axis=$axis about=$next urad_per_m_s2=8*"),
    ("lag", "speed_lag axis=$axis lag_us=10*"),
    ("periodic", "periodic_scale axis=$axis size_um=0.5* pitch_mm=$pitch phase_deg=$phase"),
    ("twist", "carriage_twist carrying=x carriage=y twist_urad=5*"),
    ("load", "table_load um_per_kg=0.3*"),
    ("air in the beam", "refraction range_share=1* dead_path_share=0"),
    ("dead path", "dead_path unseen_mm=500*"),
    ("tracer centre", "gimbal sin_az_um=0.3* sin_2az_um=0.2* sin_2el_um=0.2*"),
    ("drift", "station_drift rate_x_um_h=2* rate_y_um_h=1* rate_z_um_h=-1*"),
    ("stand", "stand_jump station=1 after_s=600 x_um=2* y_um=-1* z_um=1*"),
    ("incidence", "reflector_incidence size_um=0.5* looks_z=-1"),
    ("holders", "reflector_offset size_um=1* seed=$seed"),
    ("jump", "zero_jump station=1 after_s=600 shift_um=2*"),
    ("moisture", "moisture_bow urad_per_m_percent=4*"),
    ("screw", "screw axis=$axis growth_um_m=20* fixed_at_mm=0 time_constant_s=4000"),
    ("column", "column_bow axis=z toward=x urad_per_m_kelvin=20* lag_s=1500"),
    ("air along the beam", "beam_gradient kelvin_per_m=0.3*"),
    ("splice", "splice axis=$axis size_um=3* at_mm=310"),
];

/// One line out of two hundred: its shift (µm) is given, for it hardly reaches the verification error.
const RUN: (&str, &str) = ("run, by its shift in um", "outlying_run line=$line shift_um=1*");
const RUN_LEVELS: [f64; 5] = [0.3, 0.6, 1.5, 5.0, 50.0];

/// Smooth effects without a name: what they depend on.
const UNDESCRIBED: &[(&str, &str)] = &[
    (
        "air and y",
        "undescribed seed=$seed of=temp_air_c of_from=19.5 of_to=20.9 and=y_mm and_from=0 and_to=600 along=$axis size_um=1*",
    ),
    (
        "bridge and x",
        "undescribed seed=$seed of=temp_bridge_top_c of_from=19.7 of_to=21.9 and=x_mm and_from=0 and_to=800 along=$axis size_um=1*",
    ),
    (
        "x and z",
        "undescribed seed=$seed of=x_mm of_from=0 of_to=800 and=z_mm and_from=0 and_to=600 along=$axis size_um=1*",
    ),
    (
        "load and y",
        "undescribed seed=$seed of=load_kg of_from=0 of_to=10 and=y_mm and_from=0 and_to=600 along=$axis size_um=1*",
    ),
    (
        "pressure and z",
        "undescribed seed=$seed of=pressure_hpa of_from=1003 of_to=1015 and=z_mm and_from=0 and_to=600 along=$axis size_um=1*",
    ),
];

/// What no form of an error function follows, and nobody may give a cause.
const WEAR: (&str, &str) = ("wear of a narrow place", "wear axis=$axis across=$next size_um=1* at_mm=130 width_mm=20");

/// Triples, by their names in [`SINGLE`].
const TRIPLES: &[[&str; 3]] = &[
    ["expansion", "play", "load"],
    ["bow", "lag", "periodic"],
    ["warming", "twist", "drift"],
    ["lagged expansion", "friction", "inertia"],
];

/// Effects on other machines and in few readings, by their names in [`SINGLE`].
const ELSEWHERE: &[(&str, MachineKind, PlanKind, &str)] = &[
    ("expansion, FYXZ", MachineKind::Fyxz, PlanKind::CaseLike, "expansion"),
    ("play, FYXZ", MachineKind::Fyxz, PlanKind::CaseLike, "play"),
    ("expansion, moving table", MachineKind::MovingTable, PlanKind::CaseLike, "expansion"),
    ("periodic, moving table", MachineKind::MovingTable, PlanKind::CaseLike, "periodic"),
    ("expansion, gantry of 4 m", MachineKind::Gantry, PlanKind::CaseLike, "expansion"),
    ("play, gantry of 4 m", MachineKind::Gantry, PlanKind::CaseLike, "play"),
    ("friction, bridge of 0.3 m", MachineKind::SmallBridge, PlanKind::CaseLike, "friction"),
    ("expansion, few readings", MachineKind::Bridge, PlanKind::Few, "expansion"),
    ("play, few readings", MachineKind::Bridge, PlanKind::Few, "play"),
    ("warming, few readings", MachineKind::Bridge, PlanKind::Few, "warming"),
];

/// Pairs, by their names in [`SINGLE`].
const PAIRS: &[[&str; 2]] = &[
    ["expansion", "play"],
    ["expansion", "periodic"],
    ["bow", "inertia"],
    ["warming", "play"],
    ["load", "lag"],
    ["drift", "expansion"],
    ["play", "periodic"],
    ["air in the beam", "bow"],
    ["twist", "load"],
];

/// Effects that their plan hides, at the literature's sizes and three times that: one direction and one offset (plan
/// A), one load a station, or a sag by the carriage alone, which the carriage's own straightness and angle describe.
const ALIASED: &[(&str, PlanKind, &str)] = &[
    ("play, plan A", PlanKind::A, "backlash axis=x size_um=1*"),
    ("lag, plan A", PlanKind::A, "speed_lag axis=x lag_us=10*"),
    (
        "periodic at the step, plan A",
        PlanKind::A,
        "periodic_scale axis=x size_um=0.5* pitch_mm=54.857142857 phase_deg=$phase",
    ),
    ("bow, plan A", PlanKind::A, "gradient_bow urad_per_m_kelvin=10*"),
    ("tracer centre, plan A", PlanKind::A, "gimbal sin_az_um=0.3* sin_2az_um=0.2* sin_2el_um=0.2*"),
    ("load, one a station", PlanKind::CaseLike, "table_load um_per_kg=0.1*"),
    ("sag", PlanKind::CaseLike, "carriage_sag carrying=x carriage=y sag_um=2* twist_urad=5*"),
];

/// With one offset on the ram's axis these turn a point about itself, or do what a straightness does.
const HELD_ON_PLAN_A: &[&str] = &["ECY", "EAZ", "EBZ", "ECZ"];

/// All scenarios.
pub fn scenarios() -> Vec<Scenario> {
    let mut out = vec![Scenario::plain("nothing", Family::Clean)];
    out.push(Scenario { roughness: BUMPY, ..Scenario::plain("nothing, rough machine", Family::Clean) });
    out.push(on(PlanKind::A, Scenario::plain("nothing, plan A", Family::Clean)));
    out.push(on(PlanKind::C, Scenario::plain("nothing, plan C", Family::Clean)));
    for (name, machine) in [
        ("nothing, FYXZ", MachineKind::Fyxz),
        ("nothing, moving table", MachineKind::MovingTable),
        ("nothing, gantry of 4 m", MachineKind::Gantry),
        ("nothing, bridge of 0.3 m", MachineKind::SmallBridge),
    ] {
        out.push(Scenario { machine, ..Scenario::plain(name, Family::Clean) });
    }
    out.push(on(PlanKind::Few, Scenario::plain("nothing, few readings", Family::Clean)));
    out.extend(adverse());
    out.extend(correlated());
    let with = |name: &str, family, injected: Vec<&'static str>, levels: &[f64]| {
        // What the load does can only be seen where the load changes on a station.
        let is_of_load = injected.iter().any(|text| text.contains("load"));
        let plan = if is_of_load { PlanKind::LoadByLine } else { PlanKind::CaseLike };
        Scenario { injected, levels: levels.to_vec(), plan, ..Scenario::plain(name, family) }
    };
    out.extend(SINGLE.iter().map(|(name, template)| with(name, Family::Single, vec![*template], &FACTORS)));
    out.push(Scenario { sized_by: SizedBy::Size, ..with(RUN.0, Family::Single, vec![RUN.1], &RUN_LEVELS) });
    out.extend(UNDESCRIBED.iter().map(|(name, template)| with(name, Family::Undescribed, vec![*template], &FACTORS)));
    out.push(with(WEAR.0, Family::Undescribed, vec![WEAR.1], &FACTORS));
    let templates = |names: &[&str]| -> Vec<&'static str> {
        SINGLE.iter().filter(|(name, _)| names.contains(name)).map(|(_, template)| *template).collect()
    };
    for names in TRIPLES {
        out.push(with(&names.join(", "), Family::Triple, templates(names), &[2.0, 3.0]));
    }
    out.extend(ELSEWHERE.iter().map(|(name, machine, plan, effect)| Scenario {
        machine: *machine,
        ..on(*plan, with(name, Family::Elsewhere, templates(&[*effect]), &[2.0, 3.0]))
    }));
    for names in PAIRS {
        out.push(with(&names.join(" and "), Family::Pair, templates(names), &[2.0, 3.0]));
    }
    out.extend(ALIASED.iter().map(|(name, plan, template)| Scenario {
        sized_by: SizedBy::Size,
        ..on(*plan, with(name, Family::Aliased, vec![*template], &[1.0, 3.0]))
    }));
    out
}

/// The scenario on another plan. Those of the raster have five levels across, which only a smooth machine needs.
fn on(plan: PlanKind, scenario: Scenario) -> Scenario {
    match plan {
        PlanKind::CaseLike | PlanKind::LoadByLine | PlanKind::Few => Scenario { plan, ..scenario },
        PlanKind::A => Scenario { plan, roughness: Roughness::SMOOTH, held_zero: HELD_ON_PLAN_A, ..scenario },
        PlanKind::B | PlanKind::C => Scenario { plan, roughness: Roughness::SMOOTH, ..scenario },
    }
}

/// Machines without effect whose noise goes on from reading to reading, as much of it as there is white noise at a metre.
fn correlated() -> [Scenario; 3] {
    let of = |name: &str, neighbours, by_line| Scenario {
        correlated: Some(Correlated { deviation_m: 0.3e-6, neighbours, by_line }),
        ..Scenario::plain(name, Family::Adverse)
    };
    [
        of("noise correlated by 0.5", 0.5, false),
        of("noise correlated by 0.9", 0.9, false),
        of("noise correlated by 0.9, line by line", 0.9, true),
    ]
}

/// Machines without effect that a careless diagnosis takes for machines with one.
fn adverse() -> [Scenario; 4] {
    let rough = |name| Scenario { roughness: BUMPY, ..Scenario::plain(name, Family::Adverse) };
    [
        Scenario { kind: FunctionKind::Polynomial { degree: 3 }, ..rough("too few coefficients: cubics") },
        Scenario {
            kind: FunctionKind::Nodes { count: 5 },
            order: OrderChoice::Fixed,
            ..rough("too few coefficients: 5 nodes")
        },
        Scenario { noise: 1.5, ..Scenario::plain("noise 1.5 times the declared", Family::Adverse) },
        Scenario {
            outliers: Some(Outliers { fraction: 0.01, size_m: 20e-6 }),
            ..Scenario::plain("1 % gross outliers", Family::Adverse)
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::choices;
    use abbe_virtual_machine::effects::{examples, from_text};
    use std::collections::BTreeSet;

    #[test]
    fn names_are_unique_and_every_template_makes_an_effect() {
        let all = scenarios();
        let names: BTreeSet<_> = all.iter().map(|scenario| &scenario.name).collect();
        assert_eq!(names.len(), all.len());
        for scenario in &all {
            let config = scenario.clean_config(3).unwrap();
            for template in &scenario.injected {
                let text = choices(&config).fill(template, 1.0).unwrap();
                from_text(&text).unwrap_or_else(|problem| panic!("{text}: {problem}"));
                assert_ne!(choices(&config).fill(template, 2.0).unwrap(), text, "its size can be changed");
            }
            assert_eq!(scenario.injected.is_empty(), scenario.levels.is_empty());
        }
    }

    #[test]
    fn every_effect_of_the_simulator_is_tried_alone_and_pairs_are_pairs() {
        let first = |text: &str| text.split_whitespace().next().unwrap().to_owned();
        let single = scenarios().into_iter().filter(|scenario| scenario.injected.len() == 1);
        let tried: BTreeSet<String> = single.map(|scenario| first(scenario.injected[0])).collect();
        let known: BTreeSet<String> = examples().map(first).collect();
        assert_eq!(tried, known);
        for (family, count) in [(Family::Pair, 2), (Family::Triple, 3), (Family::Elsewhere, 1)] {
            assert!(scenarios().iter().filter(|s| s.family == family).all(|s| s.injected.len() == count));
        }
    }
}
