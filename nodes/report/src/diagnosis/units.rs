//! Parameters as metrologists read them: µm, µrad, µm/(m·K), with as many decimals as the uncertainty allows.

use super::record::Parameter;

/// A length parameter that can be larger than this (m) is shown in millimetres.
const LARGE_M: f64 = 5e-3;
const PER_HOUR: f64 = 3600.0;

/// A factor from SI and the unit it leads to.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Readable {
    pub(super) factor: f64,
    pub(super) unit: String,
}

/// Unit for readers of a parameter.
pub(super) fn readable(parameter: &Parameter) -> Readable {
    let large = parameter.plausible.is_some_and(|plausible| plausible > LARGE_M);
    from_si(&parameter.unit, large)
}

pub(super) fn from_si(si: &str, large: bool) -> Readable {
    let of = |factor: f64, unit: String| Readable { factor, unit };
    let (numerator, denominator) = match si.split_once('/') {
        Some((numerator, denominator)) => (numerator, Some(product(denominator))),
        None => (si, None),
    };
    match (numerator, denominator) {
        ("m", None) if large => of(1e3, "mm".to_owned()),
        ("m", None) => of(1e6, "µm".to_owned()),
        ("m", Some(per)) if per == "s" => of(1e6 * PER_HOUR, "µm/h".to_owned()),
        ("m", Some(per)) => of(1e6, format!("µm/{}", grouped(&per))),
        ("rad", None) => of(1e6, "µrad".to_owned()),
        ("rad", Some(per)) if per == "s" => of(1e6 * PER_HOUR, "µrad/h".to_owned()),
        ("rad", Some(per)) => of(1e6, format!("µrad/{}", grouped(&per))),
        // A change of length per length, or of direction per length.
        ("1", Some(per)) if per.starts_with("m·") || per == "m" => of(1e6, format!("µrad/{}", grouped(&per))),
        ("1", Some(per)) => of(1e6, format!("µm/(m·{per})")),
        ("1" | "", None) => of(1e6, "µm/m".to_owned()),
        ("s", None) => of(1e3, "ms".to_owned()),
        _ => of(1.0, si.to_owned()),
    }
}

/// `(m K)` as `m·K`, `(m/s2)` as `m/s²`.
fn product(denominator: &str) -> String {
    denominator.trim_start_matches('(').trim_end_matches(')').replace(' ', "·").replace("s2", "s²")
}

fn grouped(denominator: &str) -> String {
    if denominator.contains(['·', '/']) { format!("({denominator})") } else { denominator.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn reads(si: &str, factor: f64, unit: &str) {
        assert_eq!(from_si(si, false), Readable { factor, unit: unit.to_owned() }, "{si}");
    }

    #[test]
    fn units_read_as_metrologists_write_them() {
        reads("m", 1e6, "µm");
        reads("rad", 1e6, "µrad");
        reads("1/K", 1e6, "µm/(m·K)");
        reads("1/hPa", 1e6, "µm/(m·hPa)");
        reads("m/K", 1e6, "µm/K");
        reads("m/s", 3.6e9, "µm/h");
        reads("m/kg", 1e6, "µm/kg");
        reads("rad/(m/s2)", 1e6, "µrad/(m/s²)");
        reads("1/(m K)", 1e6, "µrad/(m·K)");
        reads("s", 1e3, "ms");
        reads("lx", 1.0, "lx");
    }

    #[test]
    fn a_dead_path_is_shown_in_millimetres() {
        assert_eq!(from_si("m", true), Readable { factor: 1e3, unit: "mm".to_owned() });
    }
}
