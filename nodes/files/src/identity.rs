//! Who measured, with which machine and which instrument: the `[identity]` of a machine file, or of a file of its own.
//!
//! Place in the flow: `[identity]` → here → head of every report, certificate and DCC. Every key may be missing; what is there is
//! checked. No number of a fit comes from here.

use crate::day::Days;
use crate::error::{FileError, Place};
use crate::toml_place::line_of;
use serde::{Deserialize, Serialize};

/// Temperatures that a measuring room has (°C).
pub(crate) const PLAUSIBLE_C: std::ops::RangeInclusive<f64> = -20.0..=60.0;

/// Who, when, which.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Number of the certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<String>,
    /// Who measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub operator: Option<String>,
    /// Where.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place: Option<String>,
    /// Whose place that is, for a digital certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub performed_at: Option<PerformedAt>,
    /// Day of the measurement, or first and last.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<String>,
    /// Lowest and highest temperature, where the data hold none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<[f64; 2]>,
    /// Maker of the machine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub maker: Option<String>,
    /// Its type.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Its serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial_number: Option<String>,
    /// Tracer, interferometer, gauge or sphere.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<InstrumentIdentity>,
    /// Who answers for the certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub laboratory: Option<Contact>,
    /// Whom it is for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub customer: Option<Contact>,
}

/// Whose place a measurement was made at, as digital certificates tell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerformedAt {
    /// The laboratory's own.
    Laboratory,
    /// A branch of the laboratory.
    LaboratoryBranch,
    /// The customer's.
    Customer,
    /// A branch of the customer.
    CustomerBranch,
    /// Somewhere else.
    Other,
}

/// The instrument that was measured with.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstrumentIdentity {
    /// Maker and type.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial_number: Option<String>,
    /// Day of its calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<String>,
    /// Number of its certificate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<String>,
}

/// A laboratory or a customer.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Name.
    pub name: String,
    /// Address for mail.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub email: Option<String>,
    /// Street and number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub street: Option<String>,
    /// Postal code.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub post_code: Option<String>,
    /// Town.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub city: Option<String>,
    /// Two letters of ISO 3166-1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub country: Option<String>,
}

impl Identity {
    /// Refuses what cannot be so, with its line; `text` is that of the file.
    pub(crate) fn check(&self, text: &str, file: &str) -> Result<(), FileError> {
        let wrong = |path: &[&str], problem: String, remedy: &str| {
            let path: Vec<&str> = ["identity"].iter().chain(path).copied().collect();
            let mut place = Place::file(file).key(&path.join("."));
            place.line = line_of(text, &path);
            Err(FileError::content(place, problem, remedy))
        };
        let calibrated = self.instrument.as_ref().and_then(|instrument| instrument.calibrated.as_ref());
        for (path, days) in [(&["measured"][..], &self.measured.as_ref()), (&["instrument", "calibrated"], &calibrated)]
        {
            let is_one = |days: &&&String| path.len() == 1 || !days.contains('/');
            if let Some(text) = days.filter(|text| Days::parse(text).filter(|_| is_one(&text)).is_none()) {
                let remedy = "write a day as 2026-03-05";
                return wrong(path, format!("{text:?} is no day"), remedy);
            }
        }
        if let Some([low, high]) = self.temperature_c
            && !(PLAUSIBLE_C.contains(&low) && PLAUSIBLE_C.contains(&high) && low <= high)
        {
            let remedy = "write lowest and highest in degrees Celsius";
            return wrong(&["temperature_c"], format!("[{low}, {high}] is no range of a measuring room"), remedy);
        }
        for (key, contact) in [("laboratory", &self.laboratory), ("customer", &self.customer)] {
            let country = contact.as_ref().and_then(|contact| contact.country.as_ref());
            if let Some(country) = country.filter(|c| c.len() != 2 || !c.bytes().all(|b| b.is_ascii_uppercase())) {
                let remedy = "write the two capital letters of ISO 3166-1, such as DE";
                return wrong(&[key, "country"], format!("{country:?} is no country code"), remedy);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;
    use crate::identity_file::read_identity;
    use crate::machine::parse_machine;

    fn read(text: &str) -> Result<(Option<String>, Identity), String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("identity.toml");
        std::fs::write(&path, text).unwrap();
        read_identity(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_file_of_its_own_holds_who_measured() {
        let text = "[identity]\noperator = \"A. Person\"\nmeasured = \"2026-03-05\"\n[identity.instrument]\nserial_number = \"T7\"\n";
        let (machine, identity) = read(text).unwrap();
        assert_eq!((machine, identity.operator.as_deref()), (None, Some("A. Person")));
        assert_eq!(identity.instrument.unwrap().serial_number.as_deref(), Some("T7"));
    }

    #[test]
    fn a_machine_file_does_it_too_and_survives_being_written() {
        let text =
            std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch-config/machines/fyxz.toml"))
                .unwrap();
        assert!(read(&text).unwrap_err().contains("no [identity]"));
        let text = text + "\n[identity]\nserial_number = \"4711\"\n[identity.customer]\nname = \"C\"\n";
        let (name, identity) = read(&text).unwrap();
        assert_eq!((name.as_deref(), identity.serial_number.as_deref()), (Some("fyxz"), Some("4711")));
        let machine = parse_machine(&text, "m").unwrap();
        assert_eq!(parse_machine(&crate::machine_text(&machine).unwrap(), "again").unwrap(), machine);
    }

    #[test]
    fn what_cannot_be_is_refused_with_its_line() {
        for (wrong, words) in [
            ("measured = \"yesterday\"", "no day"),
            ("temperature_c = [21.0, 19.0]", "measuring room"),
            ("serial = \"x\"", "unknown field"),
            ("instrument = { calibrated = \"2026-01-01/2026-01-02\" }", "no day"),
            ("laboratory = { name = \"L\", country = \"Germany\" }", "country code"),
        ] {
            let error = read(&format!("[identity]\n{wrong}\n")).unwrap_err();
            assert!(error.contains(words) && error.contains("line 2"), "{error}");
        }
    }
}
