//! Units of covariates: what a sensor says against the unit in which effects read it.
//!
//! Place in the flow: drivers that take sensors name a covariate with the unit that the sensor gives; here it becomes the unit of
//! the name that effects and campaigns use. A unit that is not known is refused: a temperature in degrees Fahrenheit under
//! another name would be a wrong correction that nobody is told of.

/// Unit at the end of a name, the unit it becomes, and value = (value − zero)·factor.
const UNITS: [(&str, &str, f64, f64); 27] = [
    ("_c", "_c", 0.0, 1.0),
    ("_k", "_c", 273.15, 1.0),
    ("_f", "_c", 32.0, 5.0 / 9.0),
    ("_hpa", "_hpa", 0.0, 1.0),
    ("_mbar", "_hpa", 0.0, 1.0),
    ("_pa", "_hpa", 0.0, 0.01),
    ("_kpa", "_hpa", 0.0, 10.0),
    ("_bar", "_hpa", 0.0, 1000.0),
    ("_pct", "_pct", 0.0, 1.0),
    ("_kg", "_kg", 0.0, 1.0),
    ("_g", "_kg", 0.0, 1e-3),
    ("_mm_s", "_mm_s", 0.0, 1.0),
    ("_m_s", "_mm_s", 0.0, 1e3),
    ("_mm_min", "_mm_s", 0.0, 1.0 / 60.0),
    ("_m_min", "_mm_s", 0.0, 1e3 / 60.0),
    ("_mm_s2", "_mm_s2", 0.0, 1.0),
    ("_m_s2", "_mm_s2", 0.0, 1e3),
    ("_s", "_s", 0.0, 1.0),
    ("_ms", "_s", 0.0, 1e-3),
    ("_min", "_s", 0.0, 60.0),
    ("_h", "_s", 0.0, 3600.0),
    ("_n", "_n", 0.0, 1.0),
    ("_mm", "_mm", 0.0, 1.0),
    ("_deg", "_deg", 0.0, 1.0),
    ("_a", "_a", 0.0, 1.0),
    ("_v", "_v", 0.0, 1.0),
    ("_1", "_1", 0.0, 1.0),
];
/// Names without a unit: the side an axis comes from.
const PLAIN: [&str; 3] = ["dir_x", "dir_y", "dir_z"];

/// A covariate as a sensor gives it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Unit {
    /// Name with the unit in which effects read it.
    pub(crate) name: String,
    zero: f64,
    factor: f64,
}

impl Unit {
    /// The covariate of a name that ends with the sensor's unit, or what is wrong with the name.
    pub(crate) fn of(name: &str) -> Result<Unit, String> {
        if PLAIN.contains(&name) {
            return Ok(Unit { name: name.to_owned(), zero: 0.0, factor: 1.0 });
        }
        let longest = UNITS.iter().filter(|(unit, ..)| name.len() > unit.len() && name.ends_with(unit));
        match longest.max_by_key(|(unit, ..)| unit.len()) {
            Some((unit, becomes, zero, factor)) => {
                let stem = &name[..name.len() - unit.len()];
                Ok(Unit { name: format!("{stem}{becomes}"), zero: *zero, factor: *factor })
            }
            None => {
                let known: Vec<&str> = UNITS.iter().map(|(unit, ..)| *unit).collect();
                Err(format!("{name:?} ends with no unit that is known ({}); name its unit", known.join(" ")))
            }
        }
    }

    /// Whether this unit at the end of a name means the same.
    #[cfg(feature = "opcua")]
    pub(crate) fn is_as(&self, suffix: &str) -> bool {
        let of = |unit: &str| UNITS.iter().find(|(known, ..)| *known == unit);
        let is_same = |(_, becomes, zero, factor): &(&str, &str, f64, f64)| {
            self.name.ends_with(becomes) && (self.zero, self.factor) == (*zero, *factor)
        };
        of(suffix).is_some_and(is_same)
    }

    /// A value in the unit that effects read.
    pub(crate) fn convert(&self, value: f64) -> f64 {
        (value - self.zero) * self.factor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_become_those_that_effects_read() {
        for (name, value, becomes, converted) in [
            ("temp_air_c", 20.5, "temp_air_c", 20.5),
            ("temp_air_k", 293.15, "temp_air_c", 20.0),
            ("temp_air_f", 68.0, "temp_air_c", 20.0),
            ("pressure_pa", 101_325.0, "pressure_hpa", 1013.25),
            ("speed_m_min", 6.0, "speed_mm_s", 100.0),
            ("acc_x_m_s2", 0.5, "acc_x_mm_s2", 500.0),
            ("dir_x", -1.0, "dir_x", -1.0),
        ] {
            let unit = Unit::of(name).unwrap();
            assert_eq!(unit.name, becomes);
            assert!((unit.convert(value) - converted).abs() < 1e-9, "{name}");
        }
    }

    #[test]
    fn a_unit_that_is_not_known_is_refused() {
        for name in ["temperature", "_c", "", "temp_x", "load_lbs", "dir"] {
            assert!(Unit::of(name).is_err(), "{name}");
        }
    }
}
