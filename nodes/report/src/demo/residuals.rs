//! Chapter "Residuals of the fit": maps by position, histograms, over time, by station.

use super::build::heading;
use super::{DemoReport, Residual};
use crate::sections::{
    Axis, BoxGroup, BoxPlot, Curve, CurveStyle, Histogram, HistogramPanel, LinePanel, LinePlot, MapPanel, MapPoint,
    ResidualMap, Section,
};
use crate::stats::{BoxStats, rms};

/// Bins of the histograms (odd: one is centred on zero).
const BINS: usize = 61;
/// The three views of the maps: horizontal and vertical axis.
const VIEWS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
const AXES: [&str; 3] = ["x", "y", "z"];

impl DemoReport {
    /// Adds the chapter.
    pub(super) fn add_residuals(&self, sections: &mut Vec<Section>) {
        if self.residuals.is_empty() {
            return;
        }
        let intro = "Residual = measured − modelled range of the readings used. Structure in position, time or \
                     station is what the model does not describe.";
        sections.push(heading("Residuals of the fit", Some(intro)));
        sections.push(Section::ResidualMap(self.residual_map()));
        sections.push(Section::Histogram(self.histograms()));
        sections.push(Section::LinePlot(self.over_time()));
        sections.push(Section::BoxPlot(self.by_station()));
    }

    fn residual_map(&self) -> ResidualMap {
        let panel = |(h, v): (usize, usize)| MapPanel {
            title: format!("{}{}", AXES[h], AXES[v]),
            x: Axis::new(AXES[h], "mm"),
            y: Axis::new(AXES[v], "mm"),
            points: self
                .residuals
                .iter()
                .map(|r| MapPoint {
                    x: r.position_mm[h],
                    y: r.position_mm[v],
                    value: r.residual_um,
                })
                .collect(),
        };
        ResidualMap {
            title: "Residual by position".to_owned(),
            note: Some("All readings seen along z, y and x; large residuals are drawn on top.".to_owned()),
            value: Axis::new("residual", "µm"),
            limit: self.fit.declared_sigma_um.filter(|&s| s > 0.0).map(|s| 3.0 * s),
            panels: VIEWS.map(panel).to_vec(),
        }
    }

    fn histograms(&self) -> Histogram {
        let values: Vec<f64> = self.residuals.iter().map(|r| r.residual_um).collect();
        let declared: Vec<f64> = self.residuals.iter().filter_map(|r| r.declared_sigma_um).collect();
        let sigma = rms(&declared).filter(|&s| s > 0.0);
        let normalised: Vec<f64> = self.residuals.iter().filter_map(normalised).collect();
        let mut panels = vec![HistogramPanel::from_values(
            "Residual",
            Axis::new("residual", "µm"),
            &values,
            BINS,
            sigma,
        )];
        if !normalised.is_empty() {
            panels.push(HistogramPanel::from_values(
                "Residual over its declared σ",
                Axis::new("normalised residual", "1"),
                &normalised,
                BINS,
                Some(1.0),
            ));
        }
        Histogram {
            title: "Distribution of the residuals".to_owned(),
            note: None,
            normal_name: Some("normal curve of the declared σ (left: its rms over the readings)".to_owned()),
            columns: 2,
            panels,
        }
    }

    fn over_time(&self) -> LinePlot {
        let curves = self
            .station_names()
            .into_iter()
            .enumerate()
            .map(|(index, name)| {
                let of: Vec<&Residual> = self.residuals.iter().filter(|r| r.station == name).collect();
                Curve {
                    name: format!("station {name}"),
                    style: CurveStyle::Points((index % 6 + 1) as u8),
                    x: of.iter().map(|r| r.time_s / 60.0).collect(),
                    y: of.iter().map(|r| Some(r.residual_um)).collect(),
                    half_width: None,
                }
            })
            .collect();
        LinePlot {
            title: "Residual against time".to_owned(),
            note: None,
            columns: 1,
            band_name: None,
            panels: vec![LinePanel {
                title: String::new(),
                x: Axis::new("time since the campaign began", "min"),
                y: Axis::new("residual", "µm"),
                curves,
            }],
        }
    }

    fn by_station(&self) -> BoxPlot {
        let group = |name: String| {
            let of = self.residuals.iter().filter(|r| r.station == name);
            let values: Vec<f64> = of.map(|r| r.residual_um.abs()).collect();
            BoxGroup {
                label: name,
                boxes: vec![BoxStats::of(&values)],
            }
        };
        BoxPlot {
            title: "Residual magnitude by station".to_owned(),
            note: None,
            groups_label: "station".to_owned(),
            value: Axis::new("residual magnitude", "µm"),
            series: vec!["residual".to_owned()],
            groups: self.station_names().into_iter().map(group).collect(),
        }
    }

    /// Stations in the order of the list of stations, then any others in the order of the readings.
    fn station_names(&self) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        let listed = self.stations.iter().map(|s| &s.name);
        for name in listed.chain(self.residuals.iter().map(|r| &r.station)) {
            if !names.contains(name) {
                names.push(name.clone());
            }
        }
        names
    }
}

/// Residual over declared standard uncertainty, where that is declared and positive.
fn normalised(residual: &Residual) -> Option<f64> {
    residual.declared_sigma_um.filter(|&s| s > 0.0).map(|s| residual.residual_um / s)
}
