//! What the pictures of residual vectors show: the residuals in space, and over each quantity that they were found to depend on.
//!
//! Place in the flow: the rows of the file and the study's answer in, sections of the report out (mm, µm, the unit in a name).
//! The quantities show what was measured; vectors and boxes what is left of it as well, where anything was found.

use abbe_diagnose::study::vectors::ResidualVector;
use abbe_diagnose::study::{LeftOver, StudyDiagnosis};
use abbe_report::{
    Axis, BoxGroup, BoxPlot, BoxStats, Curve, CurveStyle, LinePanel, LinePlot, Section, State, Vector, Vectors,
};

const MEASURED: &str = "Each line runs from a point along its residual, as measured: actual less predicted.";
const LEFT: &str = "What is left of each residual: before, by a rigid motion of the frame (of each pose, where there are poses); after, with \
                    everything that was found as well.";
/// Quantities shown at most.
const QUANTITIES: usize = 6;
const COMPONENTS: [&str; 3] = ["x", "y", "z"];
/// Series of the components: none has a colour of before or after.
pub(super) const SERIES: [u8; 3] = [3, 6, 8];

/// The pictures; none of a component or a position that nobody measured.
pub(super) fn sections(rows: &[ResidualVector], diagnosis: &StudyDiagnosis) -> Vec<Section> {
    let left = (!diagnosis.effects.is_empty()).then(|| both(rows.len(), &diagnosis.left)).flatten();
    let by_component = left.as_ref().map(by_component);
    space(rows, left.as_ref()).into_iter().chain(by_component).chain(over_quantities(rows, diagnosis)).collect()
}

/// What is left of each row before and after what was found (µm), component by component; `None` of what counts for nothing.
struct Both {
    before: Vec<[Option<f64>; 3]>,
    after: Vec<[Option<f64>; 3]>,
}

/// Nothing where the study is one of differences between vectors.
fn both(rows: usize, left: &[LeftOver]) -> Option<Both> {
    let mut both = Both { before: vec![[None; 3]; rows], after: vec![[None; 3]; rows] };
    for own in left {
        both.before[own.row][own.component] = Some(own.before_m * 1e6);
        both.after[own.row][own.component] = Some(own.after_m * 1e6);
    }
    (!left.is_empty()).then_some(both)
}

/// All components of a row.
fn whole([x, y, z]: [Option<f64>; 3]) -> Option<[f64; 3]> {
    Some([x?, y?, z?])
}

/// Magnitudes of each component, of the rows that count.
fn by_component(both: &Both) -> Section {
    let of = |rows: &[[Option<f64>; 3]], component: usize| {
        BoxStats::of(&rows.iter().filter_map(|row| Some(row[component]?.abs())).collect::<Vec<_>>())
    };
    let one = |component: usize| BoxGroup {
        label: COMPONENTS[component].to_owned(),
        boxes: vec![of(&both.before, component), of(&both.after, component)],
    };
    Section::BoxPlot(BoxPlot {
        title: "Residual by component, before and after what was found".to_owned(),
        note: Some(LEFT.to_owned()),
        groups_label: "component".to_owned(),
        value: Axis::new("residual, magnitude", "µm"),
        series: vec!["before".to_owned(), "after".to_owned()],
        states: vec![State::Before, State::After],
        groups: (0..3).map(one).filter(|group| group.boxes.iter().any(Option::is_some)).collect(),
    })
}

/// The vectors in the volume; none where their points lie in a plane or a part of them is not known.
fn space(rows: &[ResidualVector], both: Option<&Both>) -> Option<Section> {
    if rows.iter().any(|row| row.position_lacks.contains(&true) || row.residual_lacks.contains(&true)) {
        return None;
    }
    let end = |pick: fn(f64, f64) -> f64, axis: usize| rows.iter().map(|row| row.position_m[axis] * 1e3).reduce(pick);
    let corner = |pick: fn(f64, f64) -> f64| Some([end(pick, 0)?, end(pick, 1)?, end(pick, 2)?]);
    let (volume_min, volume_max) = (corner(f64::min)?, corner(f64::max)?);
    let states = |k: usize| match both {
        Some(both) => [whole(both.before[k]), whole(both.after[k])],
        None => [Some(rows[k].residual_m.map(|v| v * 1e6)), None],
    };
    let point = |(k, row): (usize, &ResidualVector)| Vector { at: row.position_m.map(|v| v * 1e3), states: states(k) };
    let (note, names) = match both {
        Some(_) => (LEFT, vec![("before".to_owned(), State::Before), ("after".to_owned(), State::After)]),
        None => (MEASURED, vec![("residual as measured".to_owned(), State::Before)]),
    };
    (0..3).all(|axis| volume_min[axis] < volume_max[axis]).then(|| {
        Section::Vectors(Vectors {
            title: "Residual vectors in space".to_owned(),
            note: Some(note.to_owned()),
            position_unit: "mm".to_owned(),
            vector_unit: "µm".to_owned(),
            vector_in_position: 1e-3,
            volume_min,
            volume_max,
            states: names,
            points: rows.iter().enumerate().map(point).collect(),
        })
    })
}

/// Each component over the quantities of the effects found, those of the strongest first; over the position where none was found.
fn over_quantities(rows: &[ResidualVector], diagnosis: &StudyDiagnosis) -> Option<Section> {
    let mut names: Vec<&str> = Vec::new();
    for name in diagnosis.effects.iter().flat_map(|effect| &effect.covariates) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let is_found = !names.is_empty();
    if !is_found {
        names = vec!["x_m", "y_m", "z_m"];
    }
    let panels: Vec<LinePanel> = names.into_iter().filter_map(|name| panel(rows, name)).take(QUANTITIES).collect();
    let title = if is_found { "Residual over what it depends on" } else { "Residual over the position" };
    (!panels.is_empty()).then(|| {
        Section::LinePlot(LinePlot {
            title: title.to_owned(),
            note: Some("Every component as measured, before anything was added.".to_owned()),
            columns: panels.len().min(2),
            band_name: None,
            panels,
        })
    })
}

/// The components over a quantity; none where a row lacks it, or all have the same.
fn panel(rows: &[ResidualVector], name: &str) -> Option<LinePanel> {
    let values: Vec<f64> = rows.iter().map(|row| value(row, name)).collect::<Option<_>>()?;
    let low = values.iter().copied().reduce(f64::min)?;
    values.iter().any(|value| *value > low).then_some(())?;
    let curve = |component: usize| Curve {
        name: COMPONENTS[component].to_owned(),
        style: CurveStyle::Points(SERIES[component]),
        x: values.clone(),
        y: rows
            .iter()
            .map(|row| {
                let is_known = !row.residual_lacks[component];
                is_known.then(|| row.residual_m[component] * 1e6)
            })
            .collect(),
        also: None,
        half_width: None,
    };
    let curves = (0..3).map(curve).filter(|curve| curve.y.iter().any(Option::is_some)).collect();
    Some(LinePanel { title: String::new(), x: label(name), y: Axis::new("residual", "µm"), curves })
}

/// A quantity of a row in the unit of its label.
fn value(row: &ResidualVector, name: &str) -> Option<f64> {
    let position = |axis: usize| {
        let is_known = !row.position_lacks[axis];
        is_known.then(|| row.position_m[axis] * 1e3)
    };
    match name {
        "x_m" => position(0),
        "y_m" => position(1),
        "z_m" => position(2),
        "time_s" => row.time_s,
        name => row.covariates.get(name).copied(),
    }
}

fn label(name: &str) -> Axis {
    match name {
        "x_m" | "y_m" | "z_m" => Axis::new(name.trim_end_matches("_m"), "mm"),
        "time_s" => Axis::new("time", "s"),
        name => super::pictures::logged(name),
    }
}
