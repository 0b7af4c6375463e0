//! Chapter "The 21 errors": 18 curves with 95 % bands, squareness and turn of the ram as a table.

use super::build::heading;
use super::{DemoReport, ErrorCurve, ErrorCurveSet};
use crate::digits;
use crate::sections::{Axis, Cell, Column, Curve, CurveStyle, LinePanel, LinePlot, Section, TableSection};

impl DemoReport {
    /// Adds the chapter.
    pub(super) fn add_errors(&self, sections: &mut Vec<Section>) {
        let errors = &self.errors;
        if errors.curves.is_empty() && errors.squareness.is_empty() {
            return;
        }
        let intro = "Identified errors by ISO 230-1 name: the letter after E is the direction or the rotation, the last one the axis \
                     of motion. Sign: actual − indicated.";
        sections.push(heading("The 21 errors", Some(intro)));
        if !errors.curves.is_empty() {
            sections.push(Section::LinePlot(errors.plot()));
        }
        if !errors.squareness.is_empty() {
            sections.push(Section::Table(errors.squareness_table()));
        }
    }
}

impl ErrorCurveSet {
    /// The curves as small multiples, three a row.
    pub fn plot(&self) -> LinePlot {
        LinePlot {
            title: "Position-dependent errors with 95 % bands".to_owned(),
            note: Some("Every panel has a vertical scale of its own.".to_owned()),
            columns: 3,
            band_name: Some("95 % band".to_owned()),
            panels: self.curves.iter().map(ErrorCurve::panel).collect(),
        }
    }

    /// The squareness errors and the turn of the ram as a table.
    pub fn squareness_table(&self) -> TableSection {
        let with_truth = self.squareness.iter().any(|s| s.truth_urad.is_some());
        let mut columns =
            vec![Column::text("angle"), Column::number("value", "µrad"), Column::number("± U (95 %)", "µrad")];
        if with_truth {
            columns.push(Column::number("true", "µrad"));
        }
        let rows = self
            .squareness
            .iter()
            .map(|s| {
                let digits = digits::of(s.value_urad.unwrap_or(0.0), s.expanded_95_urad);
                let mut row = vec![
                    Cell::text(&s.name),
                    Cell::maybe(s.value_urad, digits),
                    Cell::maybe(s.expanded_95_urad, digits),
                ];
                if with_truth {
                    row.push(Cell::maybe(s.truth_urad, digits));
                }
                row
            })
            .collect();
        TableSection {
            title: "Squareness errors and turn of the ram".to_owned(),
            note: None,
            columns,
            rows,
            total_rows: None,
        }
    }
}

impl ErrorCurve {
    fn panel(&self) -> LinePanel {
        let mut curves = vec![Curve {
            name: "identified".to_owned(),
            style: CurveStyle::Line(1),
            x: self.position_mm.clone(),
            y: self.value.clone(),
            also: None,
            half_width: self.half_width_95.clone(),
        }];
        if let Some(truth) = &self.truth {
            curves.push(Curve {
                name: "true (simulated machine)".to_owned(),
                style: CurveStyle::Reference,
                x: self.position_mm.clone(),
                y: truth.clone(),
                also: None,
                half_width: None,
            });
        }
        LinePanel {
            title: self.name.clone(),
            x: Axis::new(format!("position {}", self.axis), "mm"),
            y: Axis::new(&self.name, self.kind.unit()),
            curves,
        }
    }
}
