//! Who measured what, when and with which instrument: one block at the same place of every report.
//!
//! In: what the user stated and what the data say. Out: the lines that are known, in one order; what is not known has none.

use serde::{Deserialize, Serialize};

/// Who, when, which. Dates are text as the source wrote them (ISO 8601).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Number of the certificate.
    pub certificate: Option<String>,
    /// Who measured.
    pub operator: Option<String>,
    /// Name of the machine.
    pub machine: Option<String>,
    /// Its maker and type.
    pub machine_type: Option<String>,
    /// Its serial number.
    pub machine_serial: Option<String>,
    /// Name of the instrument or artefact.
    pub instrument: Option<String>,
    /// Its serial number.
    pub instrument_serial: Option<String>,
    /// Date of its calibration.
    pub instrument_calibrated: Option<String>,
    /// Its certificate.
    pub instrument_certificate: Option<String>,
    /// Day of the measurement, or first and last.
    pub measured: Option<String>,
    /// Lowest and highest temperature, °C.
    pub temperature_c: Option<[f64; 2]>,
    /// Where it was measured.
    pub place: Option<String>,
    /// Who measured for it: name and place of the laboratory.
    #[serde(default)]
    pub laboratory: Option<String>,
    /// Name and place of the customer.
    #[serde(default)]
    pub customer: Option<String>,
}

impl Identity {
    /// The lines that are known: label and text.
    pub fn lines(&self) -> Vec<(&'static str, String)> {
        let joined = |parts: &[(&str, &Option<String>)]| {
            let known = parts.iter().filter_map(|(before, part)| Some(format!("{before}{}", part.as_deref()?)));
            let text = known.collect::<Vec<_>>().join(", ");
            (!text.is_empty()).then_some(text)
        };
        let temperature = self.temperature_c.map(|[low, high]| match high - low < 0.05 {
            true => format!("{low:.1} °C"),
            false => format!("{low:.1} to {high:.1} °C"),
        });
        let lines = [
            ("Certificate", self.certificate.clone()),
            ("Measured", self.measured.as_ref().map(|days| days.replace('/', " to "))),
            ("Operator", self.operator.clone()),
            ("Place", self.place.clone()),
            ("Laboratory", self.laboratory.clone()),
            ("Customer", self.customer.clone()),
            (
                "Machine",
                joined(&[("", &self.machine), ("", &self.machine_type), ("serial number ", &self.machine_serial)]),
            ),
            (
                "Instrument",
                joined(&[
                    ("", &self.instrument),
                    ("serial number ", &self.instrument_serial),
                    ("calibrated ", &self.instrument_calibrated),
                    ("certificate ", &self.instrument_certificate),
                ]),
            ),
            ("Temperature", temperature),
        ];
        lines.into_iter().filter_map(|(label, text)| Some((label, text?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_known_has_no_line() {
        assert!(Identity::default().lines().is_empty());
        let some = |text: &str| Some(text.to_owned());
        let known = Identity {
            machine: some("m1"),
            machine_serial: some("4711"),
            instrument_calibrated: some("2026-01-05"),
            temperature_c: Some([19.82, 20.31]),
            ..Identity::default()
        };
        let lines = known.lines();
        let told: Vec<_> = lines.iter().map(|(label, text)| (*label, text.as_str())).collect();
        let machine = ("Machine", "m1, serial number 4711");
        assert_eq!(told, [machine, ("Instrument", "calibrated 2026-01-05"), ("Temperature", "19.8 to 20.3 °C")]);
    }
}
