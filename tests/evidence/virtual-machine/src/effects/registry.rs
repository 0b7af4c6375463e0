//! Every effect by name: the one list from which an effect is made out of text.
//!
//! Place in the flow: `abbe simulate`, launch files and trials name an effect as `backlash axis=x size_um=2`; out
//! comes the effect for a [`crate::SimulationConfig`]. Units stand in the keys, SI inside. `from_s=600` on any of
//! them lets it set in at that time (s since the campaign began).

use std::sync::Arc;

use super::text::{Key, Values, given, or_zero};
use super::{
    Acceleration, Backlash, BeamGradient, CarriageSag, CarriageTwist, ColumnBow, DeadPath, Effect, Gimbal, GradientBow,
    Hysteresis, LaggedExpansion, MoistureBow, Onset, OutlyingRun, PeriodicScale, ReflectorIncidence, ReflectorOffset,
    Refraction, ScaleExpansion, Screw, SpeedLag, Splice, StandJump, StationDrift, TableLoad, Undescribed, WarmUp, Wear,
    ZeroJump,
};
use crate::error::SimulationError;

type Made = Result<Arc<dyn Effect>, SimulationError>;

/// One effect that can be named.
struct Entry {
    name: &'static str,
    keys: &'static [Key],
    /// A sensible text of this effect, shown where one is asked for.
    example: &'static str,
    make: fn(&Values) -> Made,
}

/// Key that every effect has.
const FROM: &str = "from_s";
const MICRO: f64 = 1e-6;
const MILLI: f64 = 1e-3;

const ENTRIES: &[Entry] = &[
    Entry {
        name: "acceleration",
        keys: &[given("axis"), given("about"), given("urad_per_m_s2")],
        example: "acceleration axis=y about=x urad_per_m_s2=8",
        make: |v| {
            let rad_per_m_s2 = v.number("urad_per_m_s2")? * MICRO;
            Ok(Arc::new(Acceleration { axis: v.axis("axis")?, about: v.axis("about")?, rad_per_m_s2 }))
        },
    },
    Entry {
        name: "backlash",
        keys: &[given("axis"), or_zero("size_um"), or_zero("growth_um")],
        example: "backlash axis=x size_um=2 growth_um=1",
        make: |v| {
            let (size_m, growth_m) = (v.number("size_um")? * MICRO, v.number("growth_um")? * MICRO);
            Ok(Arc::new(Backlash { axis: v.axis("axis")?, size_m, growth_m }))
        },
    },
    Entry {
        name: "beam_gradient",
        keys: &[given("kelvin_per_m")],
        example: "beam_gradient kelvin_per_m=0.5",
        make: |v| Ok(Arc::new(BeamGradient { kelvin_per_m: v.number("kelvin_per_m")? })),
    },
    Entry {
        name: "carriage_sag",
        keys: &[given("carrying"), given("carriage"), or_zero("sag_um"), or_zero("twist_urad")],
        example: "carriage_sag carrying=x carriage=y sag_um=2 twist_urad=5",
        make: |v| {
            let (sag_m, twist_rad) = (v.number("sag_um")? * MICRO, v.number("twist_urad")? * MICRO);
            let (carrying, carriage) = (v.axis("carrying")?, v.axis("carriage")?);
            Ok(Arc::new(CarriageSag { carrying, carriage, sag_m, twist_rad }))
        },
    },
    Entry {
        name: "carriage_twist",
        keys: &[given("carrying"), given("carriage"), given("twist_urad")],
        example: "carriage_twist carrying=x carriage=y twist_urad=10",
        make: |v| {
            let twist_rad = v.number("twist_urad")? * MICRO;
            Ok(Arc::new(CarriageTwist { carrying: v.axis("carrying")?, carriage: v.axis("carriage")?, twist_rad }))
        },
    },
    Entry {
        name: "column_bow",
        keys: &[given("axis"), given("toward"), given("urad_per_m_kelvin"), given("lag_s")],
        example: "column_bow axis=z toward=x urad_per_m_kelvin=50 lag_s=1500",
        make: |v| {
            let curvature_per_kelvin = v.number("urad_per_m_kelvin")? * MICRO;
            let (axis, toward, lag_s) = (v.axis("axis")?, v.axis("toward")?, v.number("lag_s")?);
            Ok(Arc::new(ColumnBow { axis, toward, curvature_per_kelvin, lag_s }))
        },
    },
    Entry {
        name: "dead_path",
        keys: &[given("unseen_mm")],
        example: "dead_path unseen_mm=800",
        make: |v| Ok(Arc::new(DeadPath { unseen_m: v.number("unseen_mm")? * MILLI })),
    },
    Entry {
        name: "gimbal",
        keys: &[or_zero("sin_az_um"), or_zero("sin_2az_um"), or_zero("sin_2el_um")],
        example: "gimbal sin_az_um=0.3 sin_2az_um=0.2 sin_2el_um=0.2",
        make: |v| Ok(Arc::new(Gimbal { sizes_m: numbers(v, ["sin_az_um", "sin_2az_um", "sin_2el_um"], MICRO)? })),
    },
    Entry {
        name: "gradient_bow",
        keys: &[given("urad_per_m_kelvin")],
        example: "gradient_bow urad_per_m_kelvin=20",
        make: |v| Ok(Arc::new(GradientBow { curvature_per_kelvin: v.number("urad_per_m_kelvin")? * MICRO })),
    },
    Entry {
        name: "hysteresis",
        keys: &[given("axis"), given("size_um"), given("travel_mm")],
        example: "hysteresis axis=x size_um=1 travel_mm=10",
        make: |v| {
            let (size_m, travel_m) = (v.number("size_um")? * MICRO, v.number("travel_mm")? * MILLI);
            Ok(Arc::new(Hysteresis { axis: v.axis("axis")?, size_m, travel_m }))
        },
    },
    Entry {
        name: "lagged_expansion",
        keys: &[given("axis"), given("per_kelvin_um_m"), or_zero("fixed_at_mm"), given("lag_s")],
        example: "lagged_expansion axis=x per_kelvin_um_m=11.5 fixed_at_mm=0 lag_s=1500",
        make: |v| {
            let (per_kelvin, fixed_at_m) = (v.number("per_kelvin_um_m")? * MICRO, v.number("fixed_at_mm")? * MILLI);
            Ok(Arc::new(LaggedExpansion { axis: v.axis("axis")?, per_kelvin, fixed_at_m, lag_s: v.number("lag_s")? }))
        },
    },
    Entry {
        name: "moisture_bow",
        keys: &[given("urad_per_m_percent")],
        example: "moisture_bow urad_per_m_percent=4",
        make: |v| Ok(Arc::new(MoistureBow { curvature_per_percent: v.number("urad_per_m_percent")? * MICRO })),
    },
    Entry {
        name: "outlying_run",
        keys: &[given("line"), given("shift_um")],
        example: "outlying_run line=17 shift_um=10",
        make: |v| Ok(Arc::new(OutlyingRun { line: v.count("line")?, shift_m: v.number("shift_um")? * MICRO })),
    },
    Entry {
        name: "periodic_scale",
        keys: &[given("axis"), given("size_um"), given("pitch_mm"), or_zero("phase_deg")],
        example: "periodic_scale axis=x size_um=0.4 pitch_mm=40 phase_deg=20",
        make: |v| {
            let (size_m, pitch_m) = (v.number("size_um")? * MICRO, v.number("pitch_mm")? * MILLI);
            let phase_rad = v.number("phase_deg")?.to_radians();
            Ok(Arc::new(PeriodicScale { axis: v.axis("axis")?, size_m, pitch_m, phase_rad }))
        },
    },
    Entry {
        name: "reflector_incidence",
        keys: &[given("size_um"), or_zero("looks_x"), or_zero("looks_y"), or_zero("looks_z")],
        example: "reflector_incidence size_um=0.5 looks_z=-1",
        make: |v| {
            let looks_along = numbers(v, ["looks_x", "looks_y", "looks_z"], 1.0)?;
            Ok(Arc::new(ReflectorIncidence { size_m: v.number("size_um")? * MICRO, looks_along }))
        },
    },
    Entry {
        name: "reflector_offset",
        keys: &[given("size_um"), given("seed")],
        example: "reflector_offset size_um=2 seed=3",
        make: |v| Ok(Arc::new(ReflectorOffset { seed: v.count("seed")?, size_m: v.number("size_um")? * MICRO })),
    },
    Entry {
        name: "refraction",
        keys: &[or_zero("range_share"), or_zero("dead_path_share")],
        example: "refraction range_share=0.5 dead_path_share=1",
        make: |v| {
            let (range_share, dead_path_share) = (v.number("range_share")?, v.number("dead_path_share")?);
            Ok(Arc::new(Refraction { range_share, dead_path_share }))
        },
    },
    Entry {
        name: "scale_expansion",
        keys: &[given("axis"), given("per_kelvin_um_m"), or_zero("fixed_at_mm")],
        example: "scale_expansion axis=x per_kelvin_um_m=11.5 fixed_at_mm=0",
        make: |v| {
            let (per_kelvin, fixed_at_m) = (v.number("per_kelvin_um_m")? * MICRO, v.number("fixed_at_mm")? * MILLI);
            Ok(Arc::new(ScaleExpansion { axis: v.axis("axis")?, per_kelvin, fixed_at_m }))
        },
    },
    Entry {
        name: "screw",
        keys: &[given("axis"), given("growth_um_m"), or_zero("fixed_at_mm"), given("time_constant_s")],
        example: "screw axis=x growth_um_m=30 fixed_at_mm=0 time_constant_s=2400",
        make: |v| {
            let (growth, fixed_at_m) = (v.number("growth_um_m")? * MICRO, v.number("fixed_at_mm")? * MILLI);
            let time_constant_s = v.number("time_constant_s")?;
            Ok(Arc::new(Screw { axis: v.axis("axis")?, growth, fixed_at_m, time_constant_s }))
        },
    },
    Entry {
        name: "speed_lag",
        keys: &[given("axis"), given("lag_us")],
        example: "speed_lag axis=x lag_us=30",
        make: |v| Ok(Arc::new(SpeedLag { axis: v.axis("axis")?, lag_s: v.number("lag_us")? * MICRO })),
    },
    Entry {
        name: "splice",
        keys: &[given("axis"), given("size_um"), given("at_mm")],
        example: "splice axis=y size_um=6 at_mm=310",
        make: |v| {
            let (size_m, at_m) = (v.number("size_um")? * MICRO, v.number("at_mm")? * MILLI);
            Ok(Arc::new(Splice { axis: v.axis("axis")?, size_m, at_m }))
        },
    },
    Entry {
        name: "stand_jump",
        keys: &[given("station"), given("after_s"), or_zero("x_um"), or_zero("y_um"), or_zero("z_um")],
        example: "stand_jump station=1 after_s=300 x_um=5 y_um=-3 z_um=2",
        make: |v| {
            let (station, after_s) = (v.count("station")?, v.number("after_s")?);
            Ok(Arc::new(StandJump { station, after_s, shift_m: numbers(v, ["x_um", "y_um", "z_um"], MICRO)? }))
        },
    },
    Entry {
        name: "station_drift",
        keys: &[or_zero("rate_x_um_h"), or_zero("rate_y_um_h"), or_zero("rate_z_um_h")],
        example: "station_drift rate_x_um_h=2 rate_y_um_h=1 rate_z_um_h=-1",
        make: |v| {
            let rate_m_s = numbers(v, ["rate_x_um_h", "rate_y_um_h", "rate_z_um_h"], MICRO / 3600.0)?;
            Ok(Arc::new(StationDrift { rate_m_s }))
        },
    },
    Entry {
        name: "table_load",
        keys: &[given("um_per_kg")],
        example: "table_load um_per_kg=0.3",
        make: |v| Ok(Arc::new(TableLoad { compliance_m_kg: v.number("um_per_kg")? * MICRO })),
    },
    Entry {
        name: "undescribed",
        keys: &[
            given("seed"),
            given("of"),
            given("of_from"),
            given("of_to"),
            given("and"),
            given("and_from"),
            given("and_to"),
            given("along"),
            given("size_um"),
        ],
        example: "undescribed seed=1 of=temp_air_c of_from=19.5 of_to=21 and=y_mm and_from=0 and_to=600 along=z size_um=2",
        make: |v| {
            let first = (v.text("of")?, [v.number("of_from")?, v.number("of_to")?]);
            let second = (v.text("and")?, [v.number("and_from")?, v.number("and_to")?]);
            let size_m = v.number("size_um")? * MICRO;
            Ok(Arc::new(Undescribed::new(v.count("seed")?, [first, second], v.axis("along")?, size_m)?))
        },
    },
    Entry {
        name: "warm_up",
        keys: &[or_zero("final_x_um"), or_zero("final_y_um"), or_zero("final_z_um"), given("time_constant_s")],
        example: "warm_up final_y_um=1 final_z_um=-4 time_constant_s=3000",
        make: |v| {
            let final_m = numbers(v, ["final_x_um", "final_y_um", "final_z_um"], MICRO)?;
            Ok(Arc::new(WarmUp { final_m, time_constant_s: v.number("time_constant_s")? }))
        },
    },
    Entry {
        name: "wear",
        keys: &[given("axis"), given("across"), given("size_um"), given("at_mm"), given("width_mm")],
        example: "wear axis=x across=z size_um=2 at_mm=300 width_mm=30",
        make: |v| {
            let (size_m, at_m) = (v.number("size_um")? * MICRO, v.number("at_mm")? * MILLI);
            let (axis, across, width_m) = (v.axis("axis")?, v.axis("across")?, v.number("width_mm")? * MILLI);
            Ok(Arc::new(Wear { axis, across, size_m, at_m, width_m }))
        },
    },
    Entry {
        name: "zero_jump",
        keys: &[given("station"), given("after_s"), given("shift_um")],
        example: "zero_jump station=1 after_s=300 shift_um=5",
        make: |v| {
            let (station, after_s) = (v.count("station")?, v.number("after_s")?);
            Ok(Arc::new(ZeroJump { station, after_s, shift_m: v.number("shift_um")? * MICRO }))
        },
    },
];

/// The effect that a text such as `backlash axis=x size_um=2 from_s=600` describes, checked.
///
/// # Errors
/// Names the effect and key that is unknown, missing or makes no sense, with those that are known.
pub fn from_text(text: &str) -> Result<Arc<dyn Effect>, SimulationError> {
    let mut parts = text.split_whitespace();
    let name = parts.next().unwrap_or_default();
    let Some(entry) = ENTRIES.iter().find(|entry| entry.name == name) else {
        let known = ENTRIES.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ");
        return Err(SimulationError::new(
            "effect",
            format!("no effect is called {name:?}"),
            format!("known are {known}"),
        ));
    };
    made(entry, parts).map_err(|e| e.under(&format!("effect.{name}")))
}

/// One text for each effect that [`from_text`] knows, with sensible sizes.
pub fn examples() -> impl Iterator<Item = &'static str> {
    ENTRIES.iter().map(|entry| entry.example)
}

fn made<'a>(entry: &Entry, parts: impl Iterator<Item = &'a str>) -> Made {
    let keys: Vec<Key> = entry.keys.iter().copied().chain([or_zero(FROM)]).collect();
    let values = Values::new(parts, &keys)?;
    let effect = (entry.make)(&values)?;
    effect.check()?;
    if values.has(FROM) {
        return Ok(Arc::new(Onset { effect, from_s: values.number(FROM)? }));
    }
    Ok(effect)
}

/// Three numbers of one unit.
fn numbers(values: &Values, keys: [&str; 3], unit: f64) -> Result<[f64; 3], SimulationError> {
    let mut out = [0.0; 3];
    for (number, key) in out.iter_mut().zip(keys) {
        *number = values.number(key)? * unit;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn refused(text: &str) -> SimulationError {
        from_text(text).unwrap_err()
    }

    #[test]
    fn every_effect_can_be_named_and_its_example_uses_its_own_keys() {
        let names: BTreeSet<_> = ENTRIES.iter().map(|entry| entry.name).collect();
        assert_eq!(names.len(), ENTRIES.len(), "names are unique");
        for entry in ENTRIES {
            let effect = from_text(entry.example).unwrap();
            assert_eq!(effect.name(), entry.name);
            let written: Vec<_> = entry.example.split_whitespace().skip(1).collect();
            for key in entry.keys.iter().filter(|key| !key.or_zero) {
                // Leaving out a key that must be given is refused under that key.
                let starts = format!("{}=", key.name);
                let rest: Vec<_> = written.iter().filter(|part| !part.starts_with(&starts)).copied().collect();
                let problem = refused(&format!("{} {}", entry.name, rest.join(" ")));
                assert_eq!(problem.key, format!("effect.{}.{}", entry.name, key.name));
            }
        }
    }

    /// The files of this folder that hold an effect are those that the list can make.
    #[test]
    fn no_effect_is_left_out_of_the_list() {
        let exported = include_str!("mod.rs").lines().filter(|line| line.starts_with("pub use ")).count();
        // `Onset` wraps another effect and is made by its key; `registry` exports functions.
        assert_eq!(exported, ENTRIES.len() + 2);
    }

    #[test]
    fn units_of_the_keys_become_si() {
        let text = |effect: Arc<dyn Effect>| format!("{effect:?}");
        let made = from_text("backlash axis=Y size_um=2 growth_um=1").unwrap();
        let wanted = Backlash { axis: crate::Axis::Y, size_m: 2e-6, growth_m: 1e-6 };
        assert_eq!(text(made), format!("{wanted:?}"));
        let made = from_text("station_drift rate_z_um_h=-3.6").unwrap();
        assert_eq!(text(made), format!("{:?}", StationDrift { rate_m_s: [0.0, 0.0, -3.6 * (MICRO / 3600.0)] }));
    }

    #[test]
    fn what_is_not_known_is_refused_with_what_is() {
        let problem = refused("backlsh axis=x");
        assert!(problem.remedy.contains("backlash") && problem.remedy.contains("warm_up"), "{problem}");
        let problem = refused("backlash axis=x size_mm=2");
        assert_eq!(problem.key, "effect.backlash.size_mm");
        assert!(problem.remedy.contains("size_um") && problem.remedy.contains("from_s"), "{problem}");
        assert_eq!(refused("").key, "effect");
    }

    #[test]
    fn values_that_make_no_sense_are_refused_by_their_key() {
        for (text, key) in [
            ("backlash axis=w size_um=2", "axis"),
            ("backlash axis=x size_um=two", "size_um"),
            ("backlash axis=x size_um=NaN", "size_um"),
            ("backlash axis=x size_um", "size_um"),
            ("backlash axis=x axis=y", "axis"),
            ("backlash axis=x size_um=1 from_s=soon", "from_s"),
            ("outlying_run line=-1 shift_um=5", "line"),
            ("periodic_scale axis=x size_um=1 pitch_mm=0", "pitch_m"),
        ] {
            assert_eq!(refused(text).key, format!("effect.{}.{key}", text.split(' ').next().unwrap()), "{text}");
        }
    }
}
