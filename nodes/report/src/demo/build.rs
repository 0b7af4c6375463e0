//! From the data of a corrected campaign to its report: header, key figures, remarks, then the chapters.

use super::{DemoReport, LiveFigures};
use crate::diagnosis::ErrorFigures;
use crate::error::ReportError;
use crate::finite::check_finite;
use crate::report::{MetaItem, Report, to_json};
use crate::sections::{
    Axis, Bar, Bars, Callout, Cell, Column, Heading, KeyFigure, KeyFigures, Quantity, Section, TableSection, Tone,
};
use crate::stats::{max_abs, rms};
use serde::Serialize;

/// χ²/ν within this range is consistent with the declared noise for the many readings of a campaign.
const CHI2_RANGE: std::ops::RangeInclusive<f64> = 0.8..=1.25;

/// 3-D error at the verification points in one state.
#[derive(Serialize)]
struct Summary {
    state: &'static str,
    rms_um: Option<f64>,
    max_um: Option<f64>,
}

/// The file: the figures, then what they were made of.
#[derive(Serialize)]
struct Written<'a> {
    verification_summary: Vec<Summary>,
    #[serde(flatten)]
    data: &'a DemoReport,
}

impl DemoReport {
    /// The report: page sections in reading order; the PNG shows error before and after.
    pub fn report(&self) -> Report {
        let mut sections = vec![Section::KeyFigures(self.key_figures())];
        sections.extend(self.remarks.iter().cloned().map(Section::Callout));
        if !self.fit.converged {
            sections.push(not_converged());
        }
        let main_plot = if self.is_fit_alone { None } else { self.add_verification(&mut sections) };
        self.add_closing(&mut sections);
        self.add_residuals(&mut sections);
        self.add_errors(&mut sections);
        self.add_stations(&mut sections);
        self.add_fit(&mut sections);
        self.add_live(&mut sections);
        Report {
            title: self.header.title.clone(),
            lead: Some(self.header.what.clone()),
            identity: self.header.identity.clone(),
            next: self.header.next.clone(),
            meta: self.meta(),
            main_plot,
            footer: Some(self.footer()),
            sections,
        }
    }

    /// The page.
    ///
    /// # Errors
    /// [`ReportError`] naming the section and the place in it.
    pub fn html(&self) -> Result<String, ReportError> {
        self.checked()?.html()
    }

    /// The main plot: error before and after, 1600 x 900 px.
    ///
    /// # Errors
    /// [`ReportError`]; [`ReportError::MainPlot`] where there are no verification points.
    pub fn png(&self) -> Result<Vec<u8>, ReportError> {
        self.checked()?.png()
    }

    /// The data as JSON, complete, with unit suffixes in the keys, and first the figures that terminal and page lead with.
    ///
    /// # Errors
    /// [`ReportError::NotFinite`] naming the field.
    pub fn json(&self) -> Result<String, ReportError> {
        check_finite("report data", self)?;
        let summary = |(state, errors_um): (&'static str, Vec<f64>)| Summary {
            state,
            rms_um: rms(&errors_um),
            max_um: max_abs(&errors_um),
        };
        let verification_summary = self.errors_by_state_um().into_iter().map(summary).collect();
        to_json("report data", &Written { verification_summary, data: self })
    }

    /// The report, after a check of the data itself: an error then names the field, not a figure made from it.
    fn checked(&self) -> Result<Report, ReportError> {
        check_finite("report data", self)?;
        Ok(self.report())
    }

    fn meta(&self) -> Vec<MetaItem> {
        let header = &self.header;
        let mut hashes = [("campaign", &header.data_hash), ("model", &header.model_hash)];
        let mut meta: Vec<MetaItem> = header.about.iter().map(|line| MetaItem::new(&line.role, &line.name)).collect();
        for file in &header.files {
            let own = hashes.iter_mut().find(|(role, _)| *role == file.role);
            let hash = own.and_then(|(_, hash)| std::mem::replace(hash, &None).as_deref());
            meta.push(MetaItem::file(&file.role, &file.name, hash));
        }
        // A hash whose file is not named.
        let alone = hashes.iter().filter_map(|(role, hash)| Some((role, hash.as_ref()?)));
        meta.extend(alone.map(|(role, hash)| MetaItem::new(*role, format!("SHA-256 {hash}"))));
        meta.push(MetaItem::software(&header.software_version));
        meta
    }

    fn footer(&self) -> String {
        let short = |hash: &Option<String>| hash.as_deref().map(|h| h.chars().take(16).collect::<String>());
        let mut parts = vec![self.header.software_version.clone()];
        parts.extend(short(&self.header.data_hash).map(|h| format!("data {h}")));
        parts.extend(short(&self.header.model_hash).map(|h| format!("model {h}")));
        parts.join("  ·  ")
    }

    fn key_figures(&self) -> KeyFigures {
        let mut figures = Vec::new();
        if !self.is_fit_alone {
            figures.extend(self.verification_figures());
        }
        figures.extend(self.fit_figures());
        figures.extend(self.live.iter().map(latency_figure));
        if !self.steps.is_empty() {
            figures.push(self.duration_figure());
        }
        KeyFigures { title: "Key figures".to_owned(), figures }
    }

    fn verification_figures(&self) -> [KeyFigure; 2] {
        let states = self.errors_by_state_um();
        let count = states.first().map_or(0, |(_, errors)| errors.len());
        let quantity = |v: Option<f64>| v.map(Quantity::result);
        let figure = |label: &str, of: fn(&[f64]) -> Option<f64>| {
            let values: Vec<Option<f64>> = states.iter().map(|(_, errors)| of(errors)).collect();
            let (before, after) = (values.first().copied().flatten(), values.last().copied().flatten());
            let between = states.iter().zip(&values).skip(1).take(states.len().saturating_sub(2));
            let between = between
                .filter_map(|((name, _), value)| Some(format!("{name} {}; ", Quantity::result((*value)?).text())));
            KeyFigure {
                label: label.to_owned(),
                before: quantity(before),
                value: quantity(after),
                unit: "µm".to_owned(),
                detail: Some(format!("{}3-D, {count} verification points", between.collect::<String>())),
                tone: match (before, after) {
                    (Some(b), Some(a)) if a < b => Tone::Good,
                    (Some(_), Some(_)) => Tone::Bad,
                    _ => Tone::Neutral,
                },
            }
        };
        [figure("Verification error, rms", rms), figure("Verification error, largest", max_abs)]
    }

    fn fit_figures(&self) -> [KeyFigure; 3] {
        let fit = &self.fit;
        let total = fit.readings_used + fit.readings_rejected;
        let [residual, chi2] = self.fit_before_and_after();
        [
            residual,
            KeyFigure {
                tone: match chi2.value.map(|chi2| chi2.value) {
                    Some(v) if CHI2_RANGE.contains(&v) => Tone::Good,
                    Some(_) => Tone::Warning,
                    None => Tone::Neutral,
                },
                ..chi2
            },
            KeyFigure {
                label: "Readings used".to_owned(),
                value: Some(Quantity::new(fit.readings_used as f64, 0)),
                detail: Some(format!("of {total}; {} rejected", fit.readings_rejected)),
                ..KeyFigure::default()
            },
        ]
    }

    /// Residual and χ² of the fit; where another model took over, of the readings that it was found from, with both.
    fn fit_before_and_after(&self) -> [KeyFigure; 2] {
        let closing = self.closing.as_ref().filter(|closing| closing.in_use.is_some());
        let figure = |label: &str, [before, value]: [Option<f64>; 2], unit: &str, detail: Option<String>| KeyFigure {
            label: label.to_owned(),
            before: before.map(Quantity::result),
            value: value.map(Quantity::result),
            unit: unit.to_owned(),
            detail,
            ..KeyFigure::default()
        };
        if let Some(errors) = closing.and_then(|closing| closing.errors.as_ref()) {
            let of = |of: fn(&ErrorFigures) -> Option<f64>| [of(&errors.before), of(&errors.after)];
            let kept = || Some("of the readings that the monitor kept".to_owned());
            return [
                figure("Range residual, rms", of(|e| e.residual_rms_um), "µm", kept()),
                figure("χ² per degree of freedom", of(|e| e.chi2_per_dof), "", kept()),
            ];
        }
        let fit = &self.fit;
        let declared = |s: f64| format!("by the median of its sizes; declared {} µm", Quantity::result(s).text());
        let degrees = |v: f64| format!("{v:.0} degrees of freedom");
        [
            figure("Residual σ", [None, fit.residual_sigma_um], "µm", fit.declared_sigma_um.map(declared)),
            figure("χ² per degree of freedom", [None, fit.chi2_per_dof], "", fit.degrees_of_freedom.map(degrees)),
        ]
    }

    fn duration_figure(&self) -> KeyFigure {
        let known: Option<Vec<f64>> = self.steps.iter().map(|s| s.duration_s).collect();
        let total = known.filter(|d| !d.is_empty()).map(|d| d.iter().sum::<f64>());
        KeyFigure {
            label: "Duration, all steps".to_owned(),
            value: total.map(|t| Quantity::new(t, 1)),
            unit: "s".to_owned(),
            detail: Some(format!("{} steps", self.steps.len())),
            ..KeyFigure::default()
        }
    }

    /// Live figures and duration of the steps.
    fn add_live(&self, sections: &mut Vec<Section>) {
        if self.live.is_none() && self.steps.is_empty() {
            return;
        }
        sections.push(heading("The run", None));
        if let Some(live) = &self.live {
            sections.push(Section::Table(live.table()));
        }
        if !self.steps.is_empty() {
            sections.push(Section::Bars(Bars {
                title: "Duration of the steps".to_owned(),
                note: None,
                value: Axis::new("duration", "s"),
                decimals: 2,
                bars: self.steps.iter().map(|step| Bar { name: step.name.clone(), value: step.duration_s }).collect(),
            }));
        }
    }
}

impl LiveFigures {
    /// Latencies as they are read: in milliseconds where one of them reaches that.
    fn latency_unit(&self) -> (f64, &'static str, u8) {
        let all = [self.latency_p50_us, self.latency_p99_us, self.latency_p999_us];
        if all.into_iter().flatten().any(|us| us >= 1e3) { (1e-3, "ms", 2) } else { (1.0, "µs", 0) }
    }

    fn table(&self) -> TableSection {
        let (factor, unit, decimals) = self.latency_unit();
        let latency = |us: Option<f64>| Cell::maybe(us.map(|us| us * factor), decimals);
        let count = |v: Option<u64>| v.map(|v| Cell::Integer(i64::try_from(v).unwrap_or(i64::MAX)));
        TableSection {
            title: "Live correction".to_owned(),
            note: Some("Latency from the scale sample to the corrected sample.".to_owned()),
            columns: vec![
                Column::text("transport"),
                Column::number("sent", "samples"),
                Column::number("received", "samples"),
                Column::number("lost", "samples"),
                Column::number("latency p50", unit),
                Column::number("latency p99", unit),
                Column::number("latency p99.9", unit),
            ],
            rows: vec![vec![
                self.transport.clone().map(Cell::Text),
                count(self.samples_sent),
                count(self.samples_received),
                count(self.samples_lost),
                latency(self.latency_p50_us),
                latency(self.latency_p99_us),
                latency(self.latency_p999_us),
            ]],
            total_rows: None,
        }
    }
}

fn latency_figure(live: &LiveFigures) -> KeyFigure {
    let (factor, unit, decimals) = live.latency_unit();
    let lost = live.samples_lost.map(|n| format!("{n} samples lost"));
    let sent = live.samples_sent.map(|n| format!("of {n}"));
    KeyFigure {
        label: "Live latency, p99".to_owned(),
        value: live.latency_p99_us.map(|v| Quantity::new(v * factor, decimals)),
        unit: unit.to_owned(),
        detail: Some([lost, sent].into_iter().flatten().collect::<Vec<_>>().join(" ")),
        tone: match live.samples_lost {
            Some(0) => Tone::Good,
            Some(_) => Tone::Warning,
            None => Tone::Neutral,
        },
        ..KeyFigure::default()
    }
}

/// A chapter heading.
pub(super) fn heading(title: &str, intro: Option<&str>) -> Section {
    Section::Heading(Heading { title: title.to_owned(), intro: intro.map(str::to_owned) })
}

fn not_converged() -> Section {
    Section::Callout(Callout {
        tone: Tone::Bad,
        title: "fit".to_owned(),
        text: "The fit did not converge; its figures below are those of the last step and not to be relied on."
            .to_owned(),
    })
}
