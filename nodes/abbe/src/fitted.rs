//! What an identification found, in the form that the report crate draws: the pages of `abbe demo` and `abbe identify` show the same.
//!
//! Place in the flow: after the fit; millimetres, micrometres and microradians.

use crate::pipeline::{Identification, LoadedCampaign};
use abbe_files::ModelFile;
use abbe_geometry::ErrorId;
use abbe_geometry::error_function::FunctionKind;
use abbe_report::{
    Correlation, DemoReport, ErrorCurve, ErrorCurveSet, ErrorKind, FitSummary, Identifiability, MeasuredLine,
    MeasuringVolume, OrderChoice, RejectedReading, Residual, SquarenessError, StationEntry,
};

/// Points of an error curve.
const CURVE_POINTS: usize = 81;
/// Factor of a 95 % band of a normal distribution.
const BAND_95: f64 = 1.96;

/// A campaign, and the model that came of it.
#[derive(Clone, Copy)]
pub(crate) struct Fitted<'a> {
    pub(crate) loaded: &'a LoadedCampaign,
    pub(crate) model: &'a ModelFile,
    pub(crate) found: &'a Identification,
}

impl Fitted<'_> {
    /// All of it; what is no matter of the fit is empty.
    pub(crate) fn report(&self) -> DemoReport {
        DemoReport {
            fit: self.fit(),
            residuals: self.residuals(),
            errors: ErrorCurveSet { curves: self.curves(), squareness: self.squareness() },
            stations: self.stations(),
            volume: Some(self.volume()),
            lines: self.lines(),
            order: self.order(),
            identifiability: self.identifiability(),
            rejected: self.rejected(),
            ..DemoReport::default()
        }
    }

    /// How the fit went.
    fn fit(&self) -> FitSummary {
        let quality = &self.model.model.parts().quality;
        let declared = self.found.u_m.iter().map(|u| u * u).sum::<f64>() / self.found.u_m.len().max(1) as f64;
        FitSummary {
            residual_sigma_um: Some(self.found.evidence.robust_scale * declared.sqrt() * 1e6),
            declared_sigma_um: Some(declared.sqrt() * 1e6),
            chi2_per_dof: Some(quality.chi2_per_dof),
            degrees_of_freedom: Some(quality.readings as f64 - self.found.evidence.effective_unknowns),
            readings_used: quality.readings,
            readings_rejected: quality.rejected,
            converged: true,
        }
    }

    /// Residuals of the readings used.
    fn residuals(&self) -> Vec<Residual> {
        let campaign = &self.loaded.campaign;
        let rejected: std::collections::BTreeSet<usize> =
            self.found.evidence.rejected.iter().map(|r| r.reading - 1).collect();
        let list = campaign.readings.iter().zip(&self.found.residuals_m).zip(&self.found.u_m).enumerate();
        list.filter(|(index, _)| !rejected.contains(index))
            .map(|(_, ((reading, residual_m), u_m))| Residual {
                station: campaign.stations[reading.station as usize].clone(),
                line: campaign.lines[reading.line as usize].clone(),
                time_s: reading.time_s,
                position_mm: reading.reading_m.map(|v| v * 1e3),
                residual_um: residual_m * 1e6,
                declared_sigma_um: Some(u_m * 1e6),
            })
            .collect()
    }

    /// The errors along the identified range, with their 95 % bands.
    fn curves(&self) -> Vec<ErrorCurve> {
        let model = &self.model.model;
        let identified = &model.parts().identified.reading_m;
        let curve = |id: ErrorId| {
            let (lower_m, upper_m) = identified[id.axis().index()];
            let positions =
                (0..CURVE_POINTS).map(|k| lower_m + (upper_m - lower_m) * k as f64 / (CURVE_POINTS - 1) as f64);
            let positions: Vec<f64> = positions.collect();
            let (value, half): (Vec<_>, Vec<_>) = positions
                .iter()
                .map(|position_m| model.error(id, *position_m))
                .map(|(value, u)| (Some(value * 1e6), Some(BAND_95 * u * 1e6)))
                .unzip();
            ErrorCurve {
                name: id.name(),
                axis: id.axis().letter().to_lowercase().to_string(),
                kind: if id.is_angular() { ErrorKind::Angular } else { ErrorKind::Linear },
                position_mm: positions.iter().map(|p| p * 1e3).collect(),
                value,
                half_width_95: Some(half),
                truth: None,
            }
        };
        ErrorId::all().filter(|id| model.layout().basis(*id).is_some()).map(curve).collect()
    }

    /// Squareness, and the turn of the ram.
    fn squareness(&self) -> Vec<SquarenessError> {
        let model = &self.model.model;
        let entry = |(name, (value, u)): (String, (f64, f64))| SquarenessError {
            name,
            value_urad: Some(value * 1e6),
            expanded_95_urad: Some(BAND_95 * u * 1e6),
            truth_urad: None,
        };
        let between_axes = model.parts().machine.squareness.iter().enumerate();
        let between_axes = between_axes.map(|(k, entry)| (entry.name.clone(), model.squareness(k)));
        let of_ram = ["turn of the ram, A", "turn of the ram, B", "turn of the ram, C"].map(str::to_owned);
        between_axes.chain(of_ram.into_iter().zip(model.ram_turn())).map(entry).collect()
    }

    /// The stations.
    fn stations(&self) -> Vec<StationEntry> {
        let list = self.model.model.parts().stations.iter().zip(&self.found.evidence.stations);
        list.map(|(station, evidence)| StationEntry {
            name: station.name.clone(),
            position_mm: (station.position_m * 1e3).into(),
            uncertainty_um: Some(std::array::from_fn(|d| evidence.u_m[d] * 1e6)),
            dead_path_mm: Some(station.dead_path_m * 1e3),
            readings: evidence.readings,
            residual_rms_um: Some(evidence.residual_rms_m * 1e6),
        })
        .collect()
    }

    /// The identified volume.
    fn volume(&self) -> MeasuringVolume {
        let identified = &self.model.model.parts().identified.reading_m;
        MeasuringVolume {
            min_mm: identified.map(|(lower, _)| lower * 1e3),
            max_mm: identified.map(|(_, upper)| upper * 1e3),
        }
    }

    /// The measured lines.
    fn lines(&self) -> Vec<MeasuredLine> {
        let campaign = &self.loaded.campaign;
        let runs = campaign.readings.chunk_by(|a, b| a.line == b.line && a.station == b.station);
        runs.filter_map(|run| Some((run.first()?, run.last()?)))
            .map(|(first, last)| MeasuredLine {
                name: campaign.lines[first.line as usize].clone(),
                station: campaign.stations[first.station as usize].clone(),
                from_mm: first.reading_m.map(|v| v * 1e3),
                to_mm: last.reading_m.map(|v| v * 1e3),
            })
            .collect()
    }

    /// What each error is made of.
    fn order(&self) -> Vec<OrderChoice> {
        let machine = &self.model.model.parts().machine;
        let form = |name: &str| match ErrorId::from_name(name).and_then(|id| machine.kinds[id.index()]) {
            Some(FunctionKind::BSpline { intervals }) => format!("cubic spline, {intervals} intervals, penalised"),
            Some(FunctionKind::Polynomial { degree }) => format!("polynomial, up to degree {degree}"),
            Some(FunctionKind::Nodes { count }) => format!("piecewise linear, {count} nodes"),
            None => "held at zero".to_owned(),
        };
        let choice = |e: &abbe_identify::ErrorEvidence| OrderChoice {
            error: e.name.clone(),
            form: form(&e.name),
            effective_dof: Some(e.effective),
            evidence_gain: None,
        };
        self.found.evidence.errors.iter().map(choice).collect()
    }

    /// What the campaign can tell.
    fn identifiability(&self) -> Identifiability {
        let evidence = &self.found.evidence;
        let correlations = evidence.correlated.iter().map(|c| Correlation {
            first: c.first.clone(),
            second: c.second.clone(),
            coefficient: c.correlation,
        });
        Identifiability {
            unknowns: evidence.low_order_unknowns,
            rank: Some(evidence.rank),
            condition: Some(evidence.condition),
            cramer_rao_ratio: None,
            correlations: correlations.collect(),
        }
    }

    /// The rejected readings.
    fn rejected(&self) -> Vec<RejectedReading> {
        let entry = |r: &abbe_identify::RejectedReading| {
            let reading = &self.loaded.campaign.readings[r.reading - 1];
            RejectedReading {
                row: r.reading,
                station: r.station.clone(),
                line: r.line.clone(),
                time_s: Some(reading.time_s),
                position_mm: reading.reading_m.map(|v| v * 1e3),
                residual_um: Some(r.residual_m * 1e6),
                normalised: Some(r.residual_m / self.found.u_m[r.reading - 1]),
                reason: format!("{:.1} robust standard deviations from the fit", r.standardised.abs()),
            }
        };
        self.found.evidence.rejected.iter().map(entry).collect()
    }
}
