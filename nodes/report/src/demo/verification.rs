//! Chapter "Error before and after": main plot, table by component, map by region of the volume.

use super::build::heading;
use super::{DemoReport, VerificationPoint};
use crate::scale::extent;
use crate::sections::{
    Axis, Callout, Cell, CellMap, CellPanel, Column, Comparison, ComparisonGroup, Section, State as Shown,
    TableSection, Tone, Vector, Vectors,
};
use crate::stats::{max_abs, quantile_sorted, rms, sorted};

/// Regions along each axis.
const REGIONS: usize = 3;

/// Share of the rms below which a mean is rounding of the arithmetic.
const ROUNDING: f64 = 1e-6;

/// Length of a vector.
fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Which state of the verification points.
type State = fn(&VerificationPoint) -> Option<[f64; 3]>;
/// As indicated.
const BEFORE: State = |p| Some(p.before_um);
/// As corrected with the model of the campaign.
const AFTER: State = |p| p.after_um;
/// As corrected with what a diagnosis added to it.
const AFTER_LOOP: State = |p| p.after_loop_um;

impl DemoReport {
    /// The states that the points were seen in, with their names: before first, after last.
    fn states(&self) -> Vec<(&'static str, State)> {
        match self.verification.iter().any(|point| point.after_loop_um.is_some()) {
            true => vec![("as indicated", BEFORE), ("after geometry", AFTER), ("after the loop", AFTER_LOOP)],
            false => vec![("as indicated", BEFORE), ("corrected", AFTER)],
        }
    }

    /// Names of the states and 3-D errors in each, µm: before first, after last.
    pub fn errors_by_state_um(&self) -> Vec<(&'static str, Vec<f64>)> {
        self.states().into_iter().map(|(name, state)| (name, self.lengths(state))).collect()
    }

    fn lengths(&self, state: State) -> Vec<f64> {
        self.verification.iter().filter_map(state).map(length).collect()
    }

    fn component(&self, axis: usize, state: State) -> Vec<f64> {
        self.verification.iter().filter_map(state).map(|e| e[axis]).collect()
    }

    /// Adds the chapter; returns the index of the main plot, if there are verification points.
    pub(super) fn add_verification(&self, sections: &mut Vec<Section>) -> Option<usize> {
        let intro = "Error = actual − indicated position at points that took no part in the fit.";
        sections.push(heading("Error before and after", Some(intro)));
        if self.verification.is_empty() {
            sections.push(Section::Callout(Callout {
                tone: Tone::Neutral,
                title: String::new(),
                text: "There are no verification points: the figures of the fit alone do not show what the \
                       correction is worth."
                    .to_owned(),
            }));
            return None;
        }
        let index = sections.len();
        sections.push(Section::Comparison(self.comparison()));
        sections.push(Section::Table(self.error_table()));
        sections.extend(self.vectors().map(Section::Vectors));
        sections.extend(self.region_map().map(Section::CellMap));
        Some(index)
    }

    fn comparison(&self) -> Comparison {
        let magnitudes = |values: Vec<f64>| values.into_iter().map(f64::abs).collect();
        let states = self.states();
        let of_axis = |axis| states.iter().map(|(_, state)| magnitudes(self.component(axis, *state))).collect();
        let mut groups: Vec<_> = ["x", "y", "z"]
            .into_iter()
            .enumerate()
            .map(|(axis, label)| ComparisonGroup { label: label.to_owned(), states: of_axis(axis) })
            .collect();
        let lengths = states.iter().map(|(_, state)| self.lengths(*state)).collect();
        groups.push(ComparisonGroup { label: "3-D".to_owned(), states: lengths });
        Comparison {
            title: "Volumetric error before and after correction".to_owned(),
            note: self.verification_note.clone(),
            label: "error magnitude".to_owned(),
            unit: "µm".to_owned(),
            states: states.iter().map(|(name, _)| (*name).to_owned()).collect(),
            groups,
        }
    }

    /// Errors as vectors, before and after everything.
    fn vectors(&self) -> Option<Vectors> {
        let states = self.states();
        let ((first_name, first), (last_name, last)) = (states.first()?, states.last()?);
        let edges: Vec<Vec<f64>> = (0..3).map(|axis| self.edges(axis)).collect::<Option<_>>()?;
        let corner = |of: fn(&Vec<f64>) -> Option<&f64>| -> Option<[f64; 3]> {
            Some([*of(&edges[0])?, *of(&edges[1])?, *of(&edges[2])?])
        };
        let point = |p: &VerificationPoint| Vector { at: p.position_mm, states: [first(p), last(p)] };
        Some(Vectors {
            title: "Error vectors in the volume".to_owned(),
            note: Some("Each line runs from a verification point along its error vector.".to_owned()),
            position_unit: "mm".to_owned(),
            vector_unit: "µm".to_owned(),
            vector_in_position: 1e-3,
            volume_min: corner(|edges| edges.first())?,
            volume_max: corner(|edges| edges.last())?,
            states: vec![((*first_name).to_owned(), Shown::Before), ((*last_name).to_owned(), Shown::After)],
            points: self.verification.iter().map(point).collect(),
        })
    }

    fn error_table(&self) -> TableSection {
        let mut columns = vec![Column::text("component"), Column::text("state"), Column::number("points", "1")];
        columns.extend(["mean", "rms", "95 %", "largest"].map(|name| Column::number(name, "µm")));
        columns.push(Column::number("rms smaller by a factor of", "1"));
        let mut rows = Vec::new();
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            rows.extend(self.error_rows(name, true, |state| self.component(axis, state)));
        }
        rows.extend(self.error_rows("3-D", false, |state| self.lengths(state)));
        TableSection {
            title: "Error by component".to_owned(),
            note: Some("A mean is signed; 95 % and largest refer to magnitudes.".to_owned()),
            columns,
            rows,
            total_rows: None,
        }
    }

    /// The rows of a component, one a state; the mean only where the component has a sign.
    fn error_rows(&self, name: &str, signed: bool, sample_of: impl Fn(State) -> Vec<f64>) -> Vec<Vec<Option<Cell>>> {
        let before = rms(&sample_of(BEFORE));
        let row = |(state_name, state): (&str, State)| {
            let sample = sample_of(state);
            let mean = (signed && !sample.is_empty()).then(|| sample.iter().sum::<f64>() / sample.len() as f64);
            // The alignment takes the mean out: what is left of it is rounding.
            let mean = mean.zip(rms(&sample)).filter(|(mean, rms)| mean.abs() > ROUNDING * rms).map(|(mean, _)| mean);
            let magnitudes = sorted(&sample.iter().map(|v| v.abs()).collect::<Vec<_>>());
            let ratio = before.zip(rms(&sample)).filter(|(_, this)| *this > 0.0).map(|(b, this)| b / this);
            vec![
                Cell::text(name),
                Cell::text(state_name),
                Cell::count(sample.len()),
                Cell::result(mean),
                Cell::result(rms(&sample)),
                Cell::result(quantile_sorted(&magnitudes, 0.95)),
                Cell::result(max_abs(&sample)),
                Cell::result(ratio),
            ]
        };
        self.states().into_iter().map(row).collect()
    }

    /// rms 3-D error in 3 x 3 x 3 regions: one panel a layer of z, one row a state.
    fn region_map(&self) -> Option<CellMap> {
        let edges: Vec<Vec<f64>> = (0..3).map(|axis| self.edges(axis)).collect::<Option<_>>()?;
        let mut panels = Vec::new();
        let states = self.states();
        for (k, (name, state)) in states.iter().enumerate() {
            let shown = Shown::of(k, states.len());
            panels.extend((0..REGIONS).map(|layer| self.region_panel((name, *state, shown), layer, &edges)));
        }
        Some(CellMap {
            title: "Error by region of the volume".to_owned(),
            note: Some(
                "Root mean square of the 3-D error in each region, µm; one column a layer of z. Each row has a colour \
                 scale of its own, from zero to its largest value."
                    .to_owned(),
            ),
            value: Axis::new("3-D error, rms", "µm"),
            is_uncertainty: false,
            columns: REGIONS,
            panels,
        })
    }

    /// Edges of the regions along an axis: those of the volume, widened to hold every point. None if all points lie
    /// in one plane.
    fn edges(&self, axis: usize) -> Option<Vec<f64>> {
        let limits = self.volume.map(|v| [v.min_mm[axis], v.max_mm[axis]]);
        let points = self.verification.iter().map(|p| p.position_mm[axis]);
        let (low, high) = extent(points.chain(limits.into_iter().flatten()))?;
        let step = (high - low) / REGIONS as f64;
        (step > 0.0).then(|| (0..=REGIONS).map(|i| low + i as f64 * step).collect())
    }

    fn region_panel(&self, (name, state, shown): (&str, State, Shown), layer: usize, edges: &[Vec<f64>]) -> CellPanel {
        let mut cells = vec![Vec::new(); REGIONS * REGIONS];
        for point in &self.verification {
            let [i, j, k] = std::array::from_fn(|axis| region(point.position_mm[axis], &edges[axis]));
            if let (true, Some(error)) = (k == layer, state(point)) {
                cells[j * REGIONS + i].push(length(error));
            }
        }
        CellPanel {
            title: format!("{name}, z {:.0} … {:.0} mm", edges[2][layer], edges[2][layer + 1]),
            x: Axis::new("x", "mm"),
            y: Axis::new("y", "mm"),
            x_edges: edges[0].clone(),
            y_edges: edges[1].clone(),
            values: cells.iter().map(|cell| rms(cell)).collect(),
            state: Some(shown),
        }
    }
}

/// Index of the region that holds a coordinate; the last edge belongs to the last region.
fn region(value: f64, edges: &[f64]) -> usize {
    let below = edges.iter().skip(1).take_while(|&&edge| value >= edge).count();
    below.min(REGIONS - 1)
}
