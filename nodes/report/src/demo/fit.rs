//! Chapters "Stations" and "Model and evidence": tables, sketch, order choice, identifiability, rejected readings.

use super::build::heading;
use super::{DemoReport, MeasuredLine, MeasuringVolume};
use crate::digits;
use crate::sections::{Cell, Column, IsoLine, IsoPoint, Isometric, Section, TableSection};

/// Rows of the longest lists on the page; the rest is in the JSON.
const MAX_ROWS: usize = 20;

/// Decimals of a coordinate in mm whose uncertainty is not known.
const WITHOUT_U: u8 = 4;

impl DemoReport {
    /// Adds the chapter on the stations.
    pub(super) fn add_stations(&self, sections: &mut Vec<Section>) {
        if self.stations.is_empty() {
            return;
        }
        sections.push(heading("Stations", None));
        sections.push(Section::Table(self.station_table()));
        sections.extend(self.volume.map(|volume| Section::Isometric(self.sketch(volume))));
    }

    fn station_table(&self) -> TableSection {
        let mut columns = vec![Column::text("station")];
        columns.extend(["x", "y", "z"].map(|axis| Column::number(axis, "mm")));
        columns.extend(["u(x)", "u(y)", "u(z)"].map(|u| Column::number(u, "µm")));
        columns.push(Column::number("dead path", "mm"));
        columns.push(Column::number("readings", "1"));
        columns.push(Column::number("residual rms", "µm"));
        // One count of decimals a column: that of its largest uncertainty.
        let largest_um = |i: usize| self.stations.iter().filter_map(|s| Some(s.uncertainty_um?[i])).reduce(f64::max);
        let decimals: [u8; 3] =
            std::array::from_fn(|i| largest_um(i).map_or(WITHOUT_U, |u_um| digits::of_uncertainty(u_um * 1e-3)));
        let rows = self
            .stations
            .iter()
            .map(|station| {
                let mut row = vec![Cell::text(&station.name)];
                row.extend((0..3).map(|i| Cell::number(station.position_mm[i], decimals[i])));
                row.extend((0..3).map(|i| Cell::uncertainty(station.uncertainty_um.map(|u| u[i]))));
                row.push(Cell::maybe(station.dead_path_mm, decimals.into_iter().min().unwrap_or_default()));
                row.push(Cell::count(station.readings));
                row.push(Cell::result(station.residual_rms_um));
                row
            })
            .collect();
        TableSection {
            title: "Identified stations and dead paths".to_owned(),
            note: Some("Machine frame; u is the standard uncertainty (k = 1).".to_owned()),
            columns,
            rows,
            total_rows: None,
        }
    }

    fn sketch(&self, volume: MeasuringVolume) -> Isometric {
        let index_of = |name: &str| self.stations.iter().position(|s| s.name == name);
        let names = |line: &MeasuredLine| vec![line.station.clone(), line.name.clone()];
        let measured = self.lines.iter().map(|line| IsoLine {
            names: names(line),
            point: None,
            from: line.from_mm,
            to: line.to_mm,
        });
        // A line of sight to the middle of each measured line: where the beams of a station went.
        let sights = self.lines.iter().filter_map(|line| {
            let station = index_of(&line.station)?;
            Some(IsoLine {
                names: names(line),
                point: Some(station),
                from: self.stations[station].position_mm,
                to: std::array::from_fn(|i| line.from_mm[i] / 2.0 + line.to_mm[i] / 2.0),
            })
        });
        Isometric {
            title: "Volume, stations and measured lines".to_owned(),
            note: Some(
                "Isometric view. Grey: measured lines; coloured: lines of sight from each station to their middles; \
                 dashed drops end on the floor of the volume."
                    .to_owned(),
            ),
            unit: "mm".to_owned(),
            volume_min: volume.min_mm,
            volume_max: volume.max_mm,
            points: self.stations.iter().map(|s| IsoPoint { name: s.name.clone(), at: s.position_mm }).collect(),
            lines: measured.chain(sights).collect(),
        }
    }

    /// Adds the chapter on model order, identifiability and rejected readings.
    pub(super) fn add_fit(&self, sections: &mut Vec<Section>) {
        sections.push(heading("Model and evidence", None));
        sections.push(Section::Table(self.order_table()));
        sections.push(Section::Table(self.identifiability_table()));
        sections.push(Section::Table(self.correlation_table()));
        sections.push(Section::Table(self.rejected_table()));
    }

    fn order_table(&self) -> TableSection {
        TableSection {
            title: "Choice of model order".to_owned(),
            note: self
                .order
                .iter()
                .any(|o| o.evidence_gain.is_some())
                .then(|| "Gain of log evidence over the next simpler form.".to_owned()),
            columns: vec![
                Column::text("error"),
                Column::text("form"),
                Column::number("effective degrees of freedom", "1"),
                Column::number("evidence gain", "nat"),
            ],
            rows: self
                .order
                .iter()
                .map(|o| {
                    vec![
                        Cell::text(&o.error),
                        Cell::text(&o.form),
                        Cell::maybe(o.effective_dof, 1),
                        Cell::maybe(o.evidence_gain, 1),
                    ]
                })
                .collect(),
            total_rows: None,
        }
    }

    fn identifiability_table(&self) -> TableSection {
        let of = &self.identifiability;
        TableSection {
            title: "Rank and condition".to_owned(),
            note: Some(
                "Whether the plan sees the stations and errors of low order; the fit itself has more unknowns."
                    .to_owned(),
            ),
            columns: vec![
                Column::number("unknowns", "1"),
                Column::number("rank", "1"),
                Column::number("condition", "1"),
                Column::number("uncertainty over Cramér-Rao bound", "1"),
            ],
            rows: vec![vec![
                Cell::count(of.unknowns),
                of.rank.and_then(Cell::count),
                Cell::maybe(of.condition, 0),
                Cell::result(of.cramer_rao_ratio),
            ]],
            total_rows: None,
        }
    }

    fn correlation_table(&self) -> TableSection {
        let all = &self.identifiability.correlations;
        TableSection {
            title: "Correlations above 0.9".to_owned(),
            note: None,
            columns: vec![Column::text("parameter"), Column::text("with"), Column::number("correlation", "1")],
            rows: all
                .iter()
                .take(MAX_ROWS)
                .map(|c| vec![Cell::text(&c.first), Cell::text(&c.second), Cell::number(c.coefficient, 3)])
                .collect(),
            total_rows: Some(all.len()),
        }
    }

    fn rejected_table(&self) -> TableSection {
        let mut columns = vec![
            Column::number("row", "1"),
            Column::text("station"),
            Column::text("line"),
            Column::number("time", "s"),
        ];
        columns.extend(["x", "y", "z"].map(|axis| Column::number(axis, "mm")));
        columns.push(Column::number("residual", "µm"));
        columns.push(Column::number("residual / σ", "1"));
        columns.push(Column::text("reason"));
        TableSection {
            title: "Rejected readings".to_owned(),
            note: None,
            columns,
            rows: self.rejected.iter().take(MAX_ROWS).map(super::RejectedReading::row).collect(),
            total_rows: Some(self.rejected.len()),
        }
    }
}

impl super::RejectedReading {
    fn row(&self) -> Vec<Option<Cell>> {
        let mut row =
            vec![Cell::count(self.row), Cell::text(&self.station), Cell::text(&self.line), Cell::maybe(self.time_s, 1)];
        row.extend(self.position_mm.map(|v| Cell::number(v, 2)));
        row.push(Cell::result(self.residual_um));
        row.push(Cell::maybe(self.normalised, 1));
        row.push(Cell::text(&self.reason));
        row
    }
}
