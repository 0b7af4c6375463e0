//! Chapter "Residuals of the fit": maps by position, histograms, over time, by station.

use std::collections::{BTreeMap, BTreeSet};

use super::build::heading;
use super::{DemoReport, Residual};
use crate::scale::extent;
use crate::sections::{
    Axis, BoxGroup, BoxPlot, Curve, CurveStyle, Histogram, HistogramPanel, LinePanel, LinePlot, MapPanel, MapPoint,
    ResidualMap, Section,
};
use crate::stats::{BoxStats, rms};

/// Bins of the histograms (odd: one is centred on zero).
const BINS: usize = 61;
/// Cells of the maps along the longest side.
const MAP_CELLS: f64 = 40.0;
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
        let of = match self.closing.as_ref().and_then(|closing| closing.in_use.as_ref()) {
            Some(_) => "Residuals of the fit, before the loop",
            None => "Residuals of the fit",
        };
        sections.push(heading(of, Some(intro)));
        sections.push(Section::ResidualMap(self.residual_map()));
        sections.push(Section::Histogram(self.histograms()));
        sections.push(Section::LinePlot(self.over_time()));
        sections.push(Section::BoxPlot(self.by_station()));
    }

    fn residual_map(&self) -> ResidualMap {
        let cell_mm = self.map_cell_mm();
        let panel = |(h, v): (usize, usize)| {
            let (points, of) = self.cell_means(h, v, cell_mm).into_iter().unzip();
            MapPanel {
                title: format!("{}{}", AXES[h], AXES[v]),
                x: Axis::new(AXES[h], "mm"),
                y: Axis::new(AXES[v], "mm"),
                points,
                of,
            }
        };
        let limit = self.fit.declared_sigma_um.filter(|&s| s > 0.0);
        let scale = if limit.is_some() { " The colour scale ends at the declared σ of a single reading." } else { "" };
        ResidualMap {
            title: "Mean residual by position".to_owned(),
            note: Some(format!(
                "Seen along z, y and x; every dot is the mean over the readings within {cell_mm:.0} mm, so that noise \
                 averages out and structure stays.{scale}"
            )),
            value: Axis::new("mean residual", "µm"),
            limit,
            panels: VIEWS.map(panel).to_vec(),
        }
    }

    /// Width of the cells over which residuals are averaged: a share of the longest side, a whole number of mm.
    fn map_cell_mm(&self) -> f64 {
        let side =
            |axis: usize| extent(self.residuals.iter().map(|r| r.position_mm[axis])).map(|(low, high)| high - low);
        let longest = (0..3).filter_map(side).fold(0.0, f64::max);
        (longest / MAP_CELLS).ceil().max(1.0)
    }

    /// Means of position and residual over the cells of a view, in the order of the cells, and the stations and lines read there.
    fn cell_means(&self, h: usize, v: usize, cell_mm: f64) -> Vec<(MapPoint, Vec<String>)> {
        type Cell<'r> = (f64, [f64; 3], BTreeSet<&'r str>, BTreeSet<&'r str>);
        let mut cells: BTreeMap<(i64, i64), Cell> = BTreeMap::new();
        for residual in &self.residuals {
            let (x, y) = (residual.position_mm[h], residual.position_mm[v]);
            let key = ((x / cell_mm).round() as i64, (y / cell_mm).round() as i64);
            let (count, sums, stations, lines) = cells.entry(key).or_default();
            *count += 1.0;
            stations.insert(&residual.station);
            lines.insert(&residual.line);
            for (sum, value) in sums.iter_mut().zip([x, y, residual.residual_um]) {
                *sum += value;
            }
        }
        let mean = |(count, [x, y, value], stations, lines): Cell| {
            let of = stations.into_iter().chain(lines).map(str::to_owned).collect();
            (MapPoint { x: x / count, y: y / count, value: value / count }, of)
        };
        cells.into_values().map(mean).collect()
    }

    fn histograms(&self) -> Histogram {
        let values: Vec<f64> = self.residuals.iter().map(|r| r.residual_um).collect();
        let declared: Vec<f64> = self.residuals.iter().filter_map(|r| r.declared_sigma_um).collect();
        let sigma = rms(&declared).filter(|&s| s > 0.0);
        let normalised: Vec<f64> = self.residuals.iter().filter_map(normalised).collect();
        let mut panels =
            vec![HistogramPanel::from_values("Residual", Axis::new("residual", "µm"), &values, BINS, sigma)];
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
        let curve = |index: usize, of: &[&Residual]| Curve {
            // As in every other figure and table: the page picks stations and lines out by their names.
            name: of[0].station.clone(),
            also: Some(of[0].line.clone()),
            style: CurveStyle::Points((index % 8 + 1) as u8),
            x: of.iter().map(|r| r.time_s / 60.0).collect(),
            y: of.iter().map(|r| Some(r.residual_um)).collect(),
            half_width: None,
        };
        let curves = self.station_names().into_iter().enumerate().flat_map(|(index, name)| {
            let of: Vec<&Residual> = self.residuals.iter().filter(|r| r.station == name).collect();
            of.chunk_by(|a, b| a.line == b.line).map(|line| curve(index, line)).collect::<Vec<_>>()
        });
        let curves = curves.collect();
        LinePlot {
            title: "Residual against time, by station".to_owned(),
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
            BoxGroup { label: name, boxes: vec![BoxStats::of(&values)] }
        };
        BoxPlot {
            title: "Residual magnitude by station".to_owned(),
            note: None,
            states: Vec::new(),
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
