//! What a plan says: words for a terminal, JSON, and the page.
//!
//! Place in the flow: the last step of `abbe plan`; millimetres, micrometres, microradians, hours; uncertainties k = 1.

mod page;
mod tables;

use crate::next::Next;
use abbe_files::MachineFile;
use abbe_geometry::effects::{Shape, ShapeValue, Wish};
use abbe_plan::{Plan, Promise, Request};
use abbe_report::diagnosis::{parameter_name, readable_unit, shape_words as words_of_shape};
use abbe_report::{Identity, MetaItem, digits};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

pub(crate) use page::report;

/// What the plan was made from.
pub(crate) struct Sources<'a> {
    pub(crate) machine: &'a MachineFile,
    pub(crate) request: &'a Request,
    pub(crate) campaign: Option<&'a Path>,
    pub(crate) who: &'a Identity,
    /// Files with their hashes.
    pub(crate) files: Vec<MetaItem>,
}

/// What will come of a wish.
enum Outcome {
    Told(String),
    Not(String),
}

/// A shape in short words.
fn shape_words(shape: &Shape) -> String {
    let word = |(key, value): (&String, &ShapeValue)| match value {
        ShapeValue::Text(text) => Some(format!("{key} {text}")),
        ShapeValue::Number(number) if key != "start_s" => Some(format!("{key} {}", figure(*number))),
        _ => None,
    };
    shape.0.iter().filter_map(word).collect::<Vec<_>>().join(", ")
}

/// A shape as a page says it: lengths in mm, times in minutes. When it begins is the campaign's own.
fn shape_in_words(shape: &Shape) -> String {
    let mut own = crate::diagnosis::shape(shape);
    own.retain(|key, value| key != "start_s" && !value.is_array());
    words_of_shape(&own)
}

/// A number of a shape: a count has no decimals.
fn figure(number: f64) -> String {
    if number.fract() == 0.0 { format!("{number:.0}") } else { format!("{number:.4}") }
}

/// An uncertainty of a parameter, or what it is found from, in the unit of readers.
fn size_words(value: f64, unit: &str) -> String {
    match unit {
        "m" => format!("{} µm", digits::uncertainty(value * 1e6)),
        "rad" => format!("{} µrad", digits::uncertainty(value * 1e6)),
        "m/s" => format!("{} µm/h", digits::uncertainty(value * 1e6 * 3600.0)),
        other => {
            let (factor, unit) = readable_unit(other);
            format!("{} {unit}", digits::uncertainty(value * factor))
        }
    }
}

/// Positions of a plan that differ by less are one (m).
const SAME_M: f64 = 1e-6;

/// An uncertainty in µm or µrad.
fn um(u: f64) -> String {
    digits::uncertainty(u * 1e6)
}

/// Why nothing is said of effects.
fn unsaid_words(problem: &str) -> String {
    format!("what this plan tells of effects cannot be said: {problem}")
}

fn outcome(promise: &Promise, wish: &Wish) -> Outcome {
    let fits = |shape: &Shape| wish.shape.0.iter().all(|(key, value)| shape.0.get(key) == Some(value));
    let effects = match &promise.effects {
        Ok(effects) => effects,
        Err(problem) => return Outcome::Not(unsaid_words(problem)),
    };
    if let Some(told) = effects.told.iter().find(|told| told.name == wish.name && fits(&told.shape)) {
        let best = told.parameters.iter().min_by(|a, b| a.found_from.total_cmp(&b.found_from));
        let size = best.map_or_else(String::new, |p| {
            format!(
                ", {} known to {}, found from {}",
                parameter_name(&p.name),
                size_words(p.u, p.unit),
                size_words(p.found_from, p.unit)
            )
        });
        return Outcome::Told(format!("{:.0} % absorbed{size}", told.alias_share * 1e2));
    }
    if let Some(hidden) = effects.not_identifiable.iter().find(|hidden| hidden.name == wish.name) {
        let with = hidden.aliased_with.join(", ");
        return Outcome::Not(format!("{:.1} % absorbed by {with}; {}", hidden.alias_share * 1e2, hidden.decided_by));
    }
    let needs = effects.untestable.iter().find(|u| u.name == wish.name).map(|u| &u.needs);
    Outcome::Not(needs.map_or_else(|| "not told by this plan".to_owned(), |needs| format!("needs {needs}")))
}

/// The summary for a terminal.
pub(crate) fn words(sources: &Sources, plan: &Plan, out: &Path) -> String {
    let promise = &plan.promise;
    let [x, y, z] = promise.u_axis_m.map(um);
    let mut text = format!(
        "corrected points within {} µm (k = 1, in space, rms over the volume); X {x}, Y {y}, Z {z} µm\n",
        um(promise.u_m)
    );
    let mut line = |name: &str, value: String| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:<20}{value}");
    };
    let new = if sources.campaign.is_some() { "new " } else { "" };
    line(
        "plan",
        format!("{} {new}stations, {} {new}lines, {}", plan.stations.len(), plan.lines.len(), readings_words(plan)),
    );
    line("time", time_words(sources, plan));
    if let Some(before) = &plan.before {
        line("measured before", format!("{} µm (k = 1)", um(before.u_m)));
    }
    line("of the model alone", format!("{} µm, without the repeatability of one approach", um(promise.u_model_m)));
    let (largest_m, at_m) = promise.largest_m;
    let [x, y, z] = at_m.map(|v| v * 1e3);
    line("largest", format!("{} µm at X {x:.0}, Y {y:.0}, Z {z:.0} mm", um(largest_m)));
    let [half, twice] = plan.if_bent_m.map(um);
    line("if errors bend", format!("half as much {half} µm, twice as much {twice} µm"));
    line("written", out.display().to_string());
    for wish in &sources.request.tell {
        let shape = shape_in_words(&wish.shape);
        let shape = if shape.is_empty() { shape } else { format!(" ({shape})") };
        let name = format!("{}{shape}", crate::diagnosis::title(&wish.name));
        match outcome(promise, wish) {
            Outcome::Told(words) => line("can be told", format!("{name}: {words}")),
            Outcome::Not(words) => line("cannot be told", format!("{name}: {words}")),
        }
    }
    stations_table(plan, &mut text);
    errors_table(promise, &mut text);
    let effects = match &promise.effects {
        Ok(effects) => effects,
        Err(problem) => {
            let _ = writeln!(text, "  {}", unsaid_words(problem));
            return text;
        }
    };
    let mut hidden: Vec<String> =
        effects.not_identifiable.iter().map(|hidden| crate::diagnosis::title(hidden.name).to_string()).collect();
    // An effect of several axes stands once.
    hidden.dedup();
    if !hidden.is_empty() {
        let _ = writeln!(
            text,
            "  cannot be told with this plan: {}; report.html has why and what would tell",
            hidden.join(", ")
        );
    }
    text
}

/// How many readings there are, and how many of them a machine that stands still takes once.
fn readings_words(plan: &Plan) -> String {
    let readings = plan.nominal.readings.len();
    match joints(plan) {
        0 => format!("{readings} readings"),
        joints => {
            format!("{readings} readings, {joints} of them where the line before ended: abbe capture takes these once")
        }
    }
}

/// Lines that begin where the one before them ended, with the same station and reflector.
fn joints(plan: &Plan) -> usize {
    let is_same = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < SAME_M);
    let meet = |pair: &&[abbe_measurement::planned::Line]| {
        let [before, after] = pair else { return false };
        let (end, start) = (before.points_m.last(), after.points_m.first());
        before.station == after.station
            && is_same(&before.offset_m, &after.offset_m)
            && end.zip(start).is_some_and(|(end, start)| is_same(end, start))
    };
    plan.lines.windows(2).filter(meet).count()
}

/// Time with the speeds that it is reckoned from.
fn time_words(sources: &Sources, plan: &Plan) -> String {
    let motion = &sources.request.motion;
    let feeds: Vec<String> = motion.feeds_m_s.iter().map(|feed| format!("{:.0}", feed * 1e3)).collect();
    format!(
        "{:.2} h at {} mm/s, {:.0} mm/s2, {} s a point, {:.0} s a station, {:.0} s a holder",
        plan.time_s / 3600.0,
        feeds.join(" and "),
        motion.acceleration_m_s2 * 1e3,
        motion.dwell_s,
        motion.station_change_s,
        motion.holder_change_s
    )
}

fn stations_table(plan: &Plan, text: &mut String) {
    let _ = writeln!(
        text,
        "\n  {:<12}{:>10}{:>10}{:>10}{:>8}{:>10}",
        "station", "x_mm", "y_mm", "z_mm", "lines", "readings"
    );
    for (k, station) in plan.stations.iter().enumerate() {
        let own = plan.lines.iter().filter(|line| line.station == k);
        let (lines, readings) = own.fold((0, 0), |(lines, readings), line| (lines + 1, readings + line.points_m.len()));
        let [x, y, z] = station.position_m.map(|v| v * 1e3);
        let _ = writeln!(text, "  {:<12}{x:>10.1}{y:>10.1}{z:>10.1}{lines:>8}{readings:>10}", station.name);
    }
}

fn errors_table(promise: &Promise, text: &mut String) {
    let _ = writeln!(text, "\n  {:<8}{:>10}{:>10}", "error", "u rms", "u largest");
    for error in &promise.errors {
        let unit = if error.is_angle { "µrad" } else { "µm" };
        let _ = writeln!(text, "  {:<8}{:>10}{:>10} {unit}", error.name, um(error.u_rms), um(error.u_largest));
    }
    for (name, u_rad) in &promise.squareness {
        let _ = writeln!(text, "  {name:<8}{:>10}{:>10} µrad", um(*u_rad), "");
    }
    text.push('\n');
}

/// The figures for other programs.
pub(crate) fn json(sources: &Sources, plan: &Plan) -> Value {
    let promise = &plan.promise;
    let stations: Vec<Value> =
        plan.stations.iter().map(|s| json!({ "name": s.name, "position_mm": s.position_m.map(|v| v * 1e3) })).collect();
    let lines: Vec<Value> = plan
        .lines
        .iter()
        .map(|line| {
            json!({
                "name": line.name, "station": plan.stations[line.station].name, "offset_mm": line.offset_m.map(|v| v * 1e3),
                "from_mm": line.points_m.first().map(|p| p.map(|v| v * 1e3)),
                "to_mm": line.points_m.last().map(|p| p.map(|v| v * 1e3)),
                "points": line.points_m.len(), "feed_mm_s": line.feed_m_s * 1e3,
                "via_mm": line.via_m.iter().map(|p| p.map(|v| v * 1e3)).collect::<Vec<_>>(),
            })
        })
        .collect();
    let motion = &sources.request.motion;
    json!({
        "machine": sources.machine.machine.name,
        "seed": sources.request.seed,
        "extends": sources.campaign.map(|path| path.display().to_string()),
        "stopped": plan.stopped,
        "time_h": plan.time_s / 3600.0,
        "motion": {
            "feeds_mm_s": motion.feeds_m_s.iter().map(|feed| feed * 1e3).collect::<Vec<_>>(),
            "acceleration_mm_s2": motion.acceleration_m_s2 * 1e3, "dwell_s": motion.dwell_s,
            "station_change_s": motion.station_change_s, "holder_change_s": motion.holder_change_s,
        },
        "stations": stations,
        "lines": lines,
        "readings": plan.nominal.readings.len(),
        "readings_where_the_line_before_ended": joints(plan),
        "u_um": promise.u_m * 1e6,
        "u_model_um": promise.u_model_m * 1e6,
        "u_axis_um": promise.u_axis_m.map(|u| u * 1e6),
        "u_largest_um": promise.largest_m.0 * 1e6,
        "u_largest_at_mm": promise.largest_m.1.map(|v| v * 1e3),
        "u_um_before": plan.before.as_ref().map(|before| before.u_m * 1e6),
        "u_um_if_errors_bend_half_and_twice_as_much": plan.if_bent_m.map(|u| u * 1e6),
        "errors": promise.errors.iter().map(|e| json!({
            "name": e.name, "unit": if e.is_angle { "urad" } else { "um" }, "u_rms": e.u_rms * 1e6, "u_largest": e.u_largest * 1e6,
        })).collect::<Vec<_>>(),
        "squareness": promise.squareness.iter().map(|(name, u)| json!({ "name": name, "u_urad": u * 1e6 })).collect::<Vec<_>>(),
        "ram_turn_u_urad": promise.ram_turn.map(|u| u * 1e6),
        "unknowns": promise.unknowns,
        "condition": promise.condition,
        "effects": effects_json(promise),
        "software": crate::pipeline::software(),
    })
}

/// What follows from a plan.
pub(crate) fn next() -> Next {
    Next::new(
        "to take its readings, once a file says where scales and tracer are read",
        "capture CAPTURE.toml --out captured",
    )
}

fn effects_json(promise: &Promise) -> Value {
    let effects = match &promise.effects {
        Ok(effects) => effects,
        Err(problem) => return json!({ "problem": unsaid_words(problem) }),
    };
    json!({
        "told": effects.told.iter().map(|told| json!({
            "name": told.name, "shape": shape_words(&told.shape), "alias_share": told.alias_share,
            "parameters": told.parameters.iter().map(|p| json!({
                "name": p.name, "unit": p.unit, "u": p.u, "found_from": p.found_from,
            })).collect::<Vec<_>>(),
        })).collect::<Vec<_>>(),
        "not_identifiable": effects.not_identifiable.iter().map(|hidden| json!({
            "name": hidden.name, "shape": shape_words(&hidden.shape), "alias_share": hidden.alias_share,
            "aliased_with": hidden.aliased_with, "decided_by": hidden.decided_by,
        })).collect::<Vec<_>>(),
        "untestable": effects.untestable.iter().map(|u| json!({ "name": u.name, "needs": u.needs })).collect::<Vec<_>>(),
    })
}
