//! Who measured, when, with which machine and instrument: gathered once, for the head of every report.
//!
//! Place in the flow: what the data say, what the machine file or `--identity` says, and what the options say come together here. What
//! none of them says is left out. Where two of them differ nothing is chosen: that is an error.

use abbe_files::{Contact, Days, MachineFile, TableFacts, is_temperature, read_identity};
use abbe_measurement::campaign::Campaign;
use abbe_report::Identity;
use anyhow::{Context, ensure};
use std::path::{Path, PathBuf};

/// Options that every command with a report has.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct IdentityOptions {
    /// Who measured with which machine and instrument, for the report: a file with a table identity, such as the machine file
    #[arg(long, value_name = "FILE")]
    identity: Option<PathBuf>,
    /// Who measured, for the report
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// Day of the measurement, for the report, where the data do not say it: 2026-03-05 or 2026-03-05/2026-03-07
    #[arg(long, value_name = "DAY")]
    measured: Option<Days>,
}

/// What the data and the other files of a command say.
#[derive(Debug, Clone, Copy, Default)]
pub struct Said<'a> {
    /// The machine file of the command.
    pub machine: Option<&'a MachineFile>,
    /// Name of the machine, where a model or the machine file says it.
    pub machine_name: Option<&'a str>,
    /// Measured tables, which may say their day and hold temperatures.
    pub tables: &'a [&'a Path],
    /// Days by the stamps of a recording.
    pub days: Option<Days>,
    /// Lowest and highest temperature that was logged.
    pub temperature_c: Option<[f64; 2]>,
}

impl Said<'_> {
    /// Lowest and highest temperature that was logged; else that of the tables.
    fn temperatures(&self) -> anyhow::Result<Option<[f64; 2]>> {
        let mut range = self.temperature_c;
        if range.is_some() {
            return Ok(range);
        }
        for table in self.tables {
            let Some(own) = TableFacts::temperature_c(table)? else { continue };
            range = Some(range.map_or(own, |[low, high]: [f64; 2]| [low.min(own[0]), high.max(own[1])]));
        }
        Ok(range)
    }
}

/// Who, when and which.
#[derive(Debug, Clone, Default)]
pub struct Who {
    /// As reports show it.
    pub shown: Identity,
    /// As it was stated, with laboratory and customer.
    pub stated: abbe_files::Identity,
}

impl IdentityOptions {
    /// Brings together what is known.
    ///
    /// # Errors
    /// A file that cannot be read, a file of another machine, and days that differ.
    pub fn gather(&self, said: &Said) -> anyhow::Result<Who> {
        let machine_name = said.machine_name.or(said.machine.map(|file| file.machine.name.as_str()));
        let stated = match &self.identity {
            Some(path) => {
                let (named, stated) = read_identity(path)?;
                if let (Some(named), Some(own)) = (named.as_deref(), machine_name) {
                    let shown = path.display();
                    ensure!(
                        named == own,
                        "--identity {shown}: this is machine {named}, and the data are of {own}; name its file"
                    );
                }
                stated
            }
            None => said.machine.and_then(|file| file.identity.clone()).unwrap_or_default(),
        };
        let instrument = stated.instrument.clone().unwrap_or_default();
        let machine_type = [&stated.maker, &stated.model].into_iter().flatten().cloned().collect::<Vec<_>>().join(" ");
        let shown = Identity {
            certificate: stated.certificate.clone(),
            operator: self.operator.clone().or_else(|| stated.operator.clone()),
            machine: machine_name.map(str::to_owned),
            machine_type: Some(machine_type).filter(|text| !text.is_empty()),
            machine_serial: stated.serial_number.clone(),
            instrument: instrument.name,
            instrument_serial: instrument.serial_number,
            instrument_calibrated: instrument.calibrated,
            instrument_certificate: instrument.certificate,
            measured: self.days(said, &stated)?.map(|days| days.to_string()),
            temperature_c: said.temperatures()?.or(stated.temperature_c),
            place: stated.place.clone(),
            laboratory: stated.laboratory.as_ref().map(contact),
            customer: stated.customer.as_ref().map(contact),
        };
        Ok(Who { shown, stated })
    }

    /// The day: of the data, else of the option, else of the file. What the data say is not overruled.
    fn days(&self, said: &Said, stated: &abbe_files::Identity) -> anyhow::Result<Option<Days>> {
        let mut of_data = said.days;
        for table in said.tables {
            let Some(days) = Days::of_table(table)? else { continue };
            let both = of_data
                .map_or(days, |other| Days { first: other.first.min(days.first), last: other.last.max(days.last) });
            of_data = Some(both);
        }
        let named = match (self.measured, &stated.measured) {
            (Some(days), _) => Some((days, "--measured")),
            (None, Some(text)) => Some((Days::parse(text).context("identity.measured")?, "identity.measured")),
            (None, None) => None,
        };
        if let (Some(own), Some((named, source))) = (of_data, named) {
            ensure!(own == named, "{source} {named}: the data say {own}; leave it out, or correct what is wrong");
        }
        Ok(of_data.or(named.map(|(days, _)| days)))
    }
}

/// A name and where it is, in a line.
fn contact(of: &Contact) -> String {
    let known = [Some(&of.name), of.city.as_ref(), of.country.as_ref()];
    known.into_iter().flatten().map(String::as_str).collect::<Vec<_>>().join(", ")
}

/// Lowest and highest of all temperatures that were logged in a campaign.
pub fn temperature_c(campaign: &Campaign) -> Option<[f64; 2]> {
    let logged = campaign.covariates.iter().filter(|c| is_temperature(&c.name));
    let values = || logged.clone().flat_map(|covariate| covariate.values.iter().flatten().copied());
    Some([values().reduce(f64::min)?, values().reduce(f64::max)?])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test

    use super::*;

    fn options(identity: Option<&Path>, measured: Option<&str>) -> IdentityOptions {
        IdentityOptions {
            identity: identity.map(Path::to_owned),
            operator: Some("B. Other".to_owned()),
            measured: measured.map(|text| text.parse().unwrap()),
        }
    }

    #[test]
    fn the_option_goes_before_the_file_and_the_data_are_not_overruled() {
        let folder = tempfile::tempdir().unwrap();
        let (file, table) = (folder.path().join("i.toml"), folder.path().join("t.csv"));
        std::fs::write(&file, "[identity]\noperator = \"A. Person\"\nserial_number = \"4711\"\nmodel = \"M 7\"\n")
            .unwrap();
        std::fs::write(&table, "# measured=2026-03-05\nx_mm,temp_air_c\n1,19.9\n2,20.4\n").unwrap();
        let tables = [table.as_path()];
        let said = Said { machine_name: Some("m"), tables: &tables, ..Said::default() };
        let who = options(Some(&file), None).gather(&said).unwrap();
        assert_eq!(
            (who.shown.operator.as_deref(), who.stated.operator.as_deref()),
            (Some("B. Other"), Some("A. Person"))
        );
        assert_eq!(
            (who.shown.measured.as_deref(), who.shown.machine_serial.as_deref()),
            (Some("2026-03-05"), Some("4711"))
        );
        assert_eq!(who.shown.machine_type.as_deref(), Some("M 7"));
        assert_eq!(who.shown.temperature_c, Some([19.9, 20.4]), "of the table");
        let logged = Said { temperature_c: Some([21.0, 22.0]), ..said };
        assert_eq!(options(None, None).gather(&logged).unwrap().shown.temperature_c, Some([21.0, 22.0]));
        let error = options(None, Some("2026-03-06")).gather(&said).unwrap_err().to_string();
        assert!(error.contains("--measured 2026-03-06") && error.contains("the data say 2026-03-05"), "{error}");
        assert_eq!(
            options(None, Some("2026-03-05")).gather(&said).unwrap().shown.operator.as_deref(),
            Some("B. Other")
        );
    }

    #[test]
    fn a_file_of_another_machine_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("m.toml");
        let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch-config/machines/fyxz.toml");
        let text = std::fs::read_to_string(shipped).unwrap() + "\n[identity]\nserial_number = \"4711\"\n";
        std::fs::write(&file, text).unwrap();
        let error = options(Some(&file), None).gather(&Said { machine_name: Some("other"), ..Said::default() });
        assert!(error.unwrap_err().to_string().contains("this is machine fyxz"));
    }
}
