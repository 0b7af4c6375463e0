//! What the values of a server mean: the unit that a name says, held against the one that the server says.
//!
//! Place in the flow: when a session begins, before any value is taken. A name with a unit (`x_mm`, `temp_air_c`) goes by it, and
//! must not contradict the server; a name without one goes by the server's `EngineeringUnits`. A unit that nobody says, or that
//! is not known, is refused: of an axis no reading is given, of a sensor the covariate is missing.

use super::config::OpcuaConfig;
use crate::units::Unit;
use abbe_opcua::client::Found;
use abbe_opcua::join::AXES;
use abbe_opcua::units::{ServerUnit, length_of, metres_in};

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    /// Its name in the launch file.
    pub(super) name: String,
    /// One of its unit (m).
    pub(super) metres: f64,
}

/// What the nodes of a session mean.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Meanings {
    /// Axes in order.
    pub(super) axes: Vec<Axis>,
    /// Covariates by the name in the launch file, with their unit; `None` of one that cannot be taken.
    pub(super) covariates: Vec<(String, Option<Unit>)>,
    /// Why those cannot.
    pub(super) problems: Vec<String>,
}

impl Meanings {
    /// Of the nodes of this launch file as they were found.
    ///
    /// # Errors
    /// Why no reading can be given, in words.
    pub(super) fn of(config: &OpcuaConfig, found: &[Found]) -> Result<Meanings, String> {
        let names = config.axis_names();
        if found.len() != names.len() + config.covariates.len() {
            return Err("the server told of other nodes than were asked for".to_owned());
        }
        let mut axes = Vec::with_capacity(AXES);
        for (name, found) in names.iter().zip(found) {
            let metres = sound(found).and_then(|()| metres_of(name, found.unit.as_ref()));
            let metres = metres.map_err(|problem| format!("axis {name}: {problem}"))?;
            axes.push(Axis { name: (*name).to_owned(), metres });
        }
        let (mut covariates, mut problems) = (Vec::new(), Vec::new());
        for (name, found) in config.covariates.keys().zip(&found[names.len()..]) {
            let unit = sound(found).and_then(|()| unit_of(name, found.unit.as_ref()));
            if let Err(problem) = &unit {
                problems.push(format!("covariate {name} is missing: {problem}"));
            }
            covariates.push((name.clone(), unit.ok()));
        }
        if axes.is_empty() && covariates.iter().all(|(_, unit)| unit.is_none()) {
            return Err(problems.join("; "));
        }
        Ok(Meanings { axes, covariates, problems })
    }
}

fn sound(found: &Found) -> Result<(), String> {
    found.problem.clone().map_or(Ok(()), Err)
}

/// One of an axis' unit (m).
fn metres_of(name: &str, server: Option<&ServerUnit>) -> Result<f64, String> {
    let named = length_of(name).1;
    let told = server.map(|unit| unit.suffix().filter(|suffix| metres_in(suffix).is_some()).ok_or(unit)).transpose();
    let told = told.map_err(|unit| format!("the server's unit {} is no length that is known", unit.words()))?;
    let suffix = match (named, told) {
        (Some(named), Some(told)) if named != told => {
            return Err(format!(
                "the server says {}, and the launch file {}; name the right one",
                &told[1..],
                &named[1..]
            ));
        }
        (named, told) => named.or(told),
    };
    let suffix = suffix.ok_or_else(|| format!("the server names no unit; name it here, as {name}_mm"))?;
    metres_in(suffix).ok_or_else(|| format!("{suffix} is no unit of length"))
}

/// A covariate's unit.
fn unit_of(name: &str, server: Option<&ServerUnit>) -> Result<Unit, String> {
    let named = OpcuaConfig::unit_named(name);
    let told = server.map(|unit| unit.suffix().ok_or(unit)).transpose();
    let told = told.map_err(|unit| format!("the server's unit {} is not known", unit.words()))?;
    match (named, told) {
        (Some(named), None) => Ok(named),
        (Some(named), Some(told)) if named.is_as(told) => Ok(named),
        (Some(_), Some(told)) => Err(format!("the server says {}; name the right unit", &told[1..])),
        (None, Some(told)) => Unit::of(&format!("{name}{told}")),
        (None, None) => Err("neither the server nor the name says its unit; name it, as in temp_air_c".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_opcua::units::UNECE;

    const MILLIMETRE: i32 = 5_066_068;
    const MICROMETRE: i32 = 13_384;
    const KELVIN: i32 = 4_932_940;
    const CELSIUS: i32 = 4_408_652;

    fn unit(id: i32) -> Option<ServerUnit> {
        Some(ServerUnit { namespace: UNECE.to_owned(), id, shown: String::new() })
    }

    fn config(keys: &str) -> OpcuaConfig {
        toml::from_str(&format!("server = \"opc.tcp://h:1\"\n{keys}")).unwrap()
    }

    fn found(units: &[Option<ServerUnit>]) -> Vec<Found> {
        units.iter().map(|unit| Found { unit: unit.clone(), problem: None }).collect()
    }

    #[test]
    fn units_of_axes_are_the_names_or_the_servers_and_never_a_guess() {
        let all = config("axes = { x = \"i=1\", y_mm = \"i=2\", z_um = \"i=3\" }");
        let meanings = Meanings::of(&all, &found(&[unit(MILLIMETRE), unit(MILLIMETRE), None])).unwrap();
        let metres: Vec<f64> = meanings.axes.iter().map(|axis| axis.metres).collect();
        assert_eq!(metres, [1e-3, 1e-3, 1e-6]);
        for (units, words) in [
            ([unit(MILLIMETRE), unit(MICROMETRE), None], "axis y_mm: the server says um"),
            ([None, None, None], "axis x: the server names no unit"),
            ([unit(CELSIUS), None, None], "no length that is known"),
            ([unit(1), None, None], "no length that is known"),
        ] {
            let problem = Meanings::of(&all, &found(&units)).unwrap_err();
            assert!(problem.contains(words), "{problem}");
        }
    }

    #[test]
    fn a_covariate_of_a_wrong_unit_is_missing_and_the_reading_stays() {
        let keys = "axes = { x_mm = \"i=1\", y_mm = \"i=2\", z_mm = \"i=3\" }\n\
                    covariates = { a_c = \"i=4\", b = \"i=5\", c_c = \"i=6\", d = \"i=7\", e_hpa = \"i=8\" }";
        let units = [None, None, None, unit(CELSIUS), unit(KELVIN), unit(KELVIN), None, unit(5_063_250)];
        let meanings = Meanings::of(&config(keys), &found(&units)).unwrap();
        let names: Vec<Option<&str>> =
            meanings.covariates.iter().map(|(_, unit)| unit.as_ref().map(|unit| unit.name.as_str())).collect();
        assert_eq!(names, [Some("a_c"), Some("b_c"), None, None, Some("e_hpa")], "a millibar is a hectopascal");
        assert_eq!(meanings.problems.len(), 2, "{:?}", meanings.problems);
        let kelvin = meanings.covariates[1].1.as_ref().unwrap();
        assert!((kelvin.convert(293.15) - 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_node_that_is_not_there_stops_an_axis_and_not_the_others() {
        let keys = "covariates = { a_c = \"i=4\", b_c = \"i=5\" }";
        let missing = Found { unit: None, problem: Some("node i=4: BadNodeIdUnknown".to_owned()) };
        let one = Meanings::of(&config(keys), &[missing.clone(), Found::default()]).unwrap();
        assert_eq!(one.problems, ["covariate a_c is missing: node i=4: BadNodeIdUnknown"]);
        assert!(Meanings::of(&config(keys), &[missing.clone(), missing.clone()]).is_err());
        let axes = config("axes = { x_mm = \"i=1\", y_mm = \"i=2\", z_mm = \"i=3\" }");
        assert!(Meanings::of(&axes, &[Found::default(), missing, Found::default()]).is_err());
    }
}
