//! Length errors after ISO 10360-2: figures, limits, words, JSON and tables.
//!
//! Place in the flow: `abbe conformity --lengths`, and before and after a correction in [`super::simulated`].

use super::{
    Figure, Limits, Product, data_words, departure_callout, departure_json, departure_words, expanded_um, pictures,
    tone, um, verdict_in_words, verdict_word, worst,
};
use crate::pipeline::software;
use crate::provenance::made_from;
use abbe_conformity::length::{LengthErrors, LengthTest, LengthVerdict, Probing, REPEATABILITY_RULE, evaluate};
use abbe_conformity::{DecisionRule, Frontier, MaximumPermissibleError, SupportedLimit, Verdict};
use abbe_files::{hex, read_lengths_file};
use abbe_report::{
    Callout, Cell, Column, Identity, KeyFigure, KeyFigures, Quantity, Report, Section, TableSection, Tone, digits,
};
use anyhow::Context;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;

pub(crate) const STANDARD: &str = "ISO 10360-2";
/// Limits that differ by less are the same (m): above rounding, far below what anybody states.
const SAME_M: f64 = 1e-13;

/// What the user said of the test.
pub(crate) struct Stated {
    pub(crate) probing: Probing,
    pub(crate) tool_offset_m: f64,
}

/// Figures of a file of measured lengths.
pub(crate) fn run(path: &Path, stated: &Stated, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<Product> {
    let file = read_lengths_file(path)?;
    let test =
        LengthTest { tool_offset_m: stated.tool_offset_m, probing: stated.probing, travel_m: file.travel_m.clone() };
    let errors = evaluate(test, &file.measurements).with_context(|| path.display().to_string())?;
    let mut words = words(&errors, limits, rule)?;
    words.push_str(&data_words(path));
    let mut json = figures(&errors, limits, rule)?;
    json["data_sha256"] = json!(hex(&file.sha256));
    json["software"] = json!(software());
    let sections = sections(&errors, limits, rule)?;
    let report = Report {
        title: format!("Length measurement error {}", errors.test.symbol()),
        lead: Some(lead(&errors)),
        identity: Identity::default(),
        next: None,
        meta: made_from(path, &file.sha256),
        main_plot: None,
        footer: Some(software()),
        sections,
    };
    Ok(Product {
        words,
        json,
        report,
        verdict: verdict(&errors, limits, rule),
        outside: None,
        figures: certified(&errors, limits, rule),
        method: (STANDARD, errors.departures.iter().map(ToString::to_string).collect()),
    })
}

/// The figures of a certificate: the largest error of each line, and the repeatability range.
fn certified(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> Vec<Figure> {
    let expanded_m = |length_m: f64| expanded_um(rule, length_m).map(|u_um| u_um * 1e-6);
    let symbol = errors.test.symbol();
    let verdict = limits.length.as_ref().map(|limit| errors.verdict(limit, limits.repeatability, rule));
    let of_line = |line: &abbe_conformity::length::LineSummary| {
        let (largest, at_m) = line.largest;
        Figure {
            name: format!("{symbol}, largest error on line {}, at a length of {:.4} mm", line.line, at_m * 1e3),
            value_m: largest.metres(),
            expanded_m: expanded_m(at_m),
            limit_m: limits.length.map(|limit| limit.at(at_m).metres()),
            // The verdict is on the whole test, not on a line.
            verdict: None,
        }
    };
    let mut figures: Vec<Figure> = errors.lines.iter().map(of_line).collect();
    let (largest, line, at_m) = errors.largest();
    figures.push(Figure {
        name: format!("{symbol}, largest error of all lines, on {line} at a length of {:.4} mm", at_m * 1e3),
        value_m: largest.metres(),
        expanded_m: expanded_m(at_m),
        limit_m: limits.length.map(|limit| limit.at(at_m).metres()),
        verdict: verdict.as_ref().map(|verdict| (verdict.errors, *rule)),
    });
    figures.extend(errors.repeatability().map(|range| Figure {
        name: "R0, largest repeatability range".to_owned(),
        value_m: range.metres(),
        expanded_m: None,
        limit_m: limits.repeatability.map(|limit| limit.metres()),
        verdict: verdict.as_ref().and_then(|verdict| Some((verdict.repeatability?, REPEATABILITY_RULE))),
    }));
    figures
}

/// The verdict on the limits, where there are some.
pub(crate) fn verdict(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> Option<Verdict> {
    let limit = limits.length.as_ref()?;
    let LengthVerdict { errors, repeatability, .. } = errors.verdict(limit, limits.repeatability, rule);
    worst([Some(errors), repeatability])
}

fn lead(errors: &LengthErrors) -> String {
    format!(
        "{} measurements of {} lengths on {} lines, {} probing; error = measured − calibrated.",
        errors.errors().count(),
        errors.sets.len(),
        errors.lines.len(),
        errors.test.probing.word()
    )
}

/// A limit that certainly holds, rounded outwards: A up at the third digit, K down to whole numbers.
pub(crate) fn supported_text(limit: &SupportedLimit) -> String {
    let constant = rounded_up(limit.constant_m * 1e6);
    match limit.per_metre {
        0.0 => format!("{constant} µm"),
        slope => format!("{constant} + L/{:.0} µm", (1e-3 / slope + 1e-6).floor()),
    }
}

/// A constant that holds what the exact one does, with three digits.
fn rounded_up(constant_um: f64) -> String {
    digits::rounded_up(constant_um, digits::of_result(constant_um))
}

/// Words for the terminal.
pub(crate) fn words(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<String> {
    let mut text = answer_words(errors, limits, rule)?;
    text.push_str(&departure_words(STANDARD, &errors.departures));
    // Writing to a string cannot fail.
    let _ = writeln!(text, "  {}: {}", errors.test.symbol(), digits::taken(&lead(errors)));
    let _ = writeln!(
        text,
        "  {:<14} {:>7} {:>12} {:>9} {:>12} {:>10} {:>9}",
        "line", "lengths", "longest_mm", "travel_%", "largest_um", "at_mm", "range_um"
    );
    for line in &errors.lines {
        let share = line.travel_m.map_or_else(|| "-".to_owned(), |t| format!("{:.1}", 100.0 * line.longest_m / t));
        let range = line.range.map_or_else(|| "-".to_owned(), |r| digits::result(um(r.metres())));
        let (largest, at_m) = line.largest;
        let _ = writeln!(
            text,
            "  {:<14} {:>7} {:>12.4} {share:>9} {:>12} {:>10.4} {range:>9}",
            line.line,
            line.lengths,
            line.longest_m * 1e3,
            digits::result(um(largest.metres())),
            at_m * 1e3
        );
    }
    Ok(text)
}

/// What was asked first: the limit and whether it is kept, the largest error, the limits that would do.
fn answer_words(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<String> {
    let mut text = limit_words(errors, limits, rule)?;
    let (largest, line, length_m) = errors.largest();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "  largest error  {} µm at {:.4} mm on {line}",
        digits::result(um(largest.metres())),
        length_m * 1e3
    );
    if let Some(range) = errors.repeatability() {
        let _ = writeln!(text, "  R0             {} µm", digits::result(um(range.metres())));
    }
    let frontier = errors.frontier()?;
    let _ = writeln!(
        text,
        "  tightest limit {} (smallest area up to the longest length{})",
        supported_text(&frontier.smallest_area()),
        if *rule == DecisionRule::SimpleAcceptance { "" } else { "; the uncertainty of the test left out" }
    );
    let corners: Vec<String> = frontier.corners().iter().map(supported_text).collect();
    let _ = writeln!(text, "  as tight       {}", corners.join("; "));
    Ok(text)
}

fn limit_words(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<String> {
    let Some(limit) = &limits.length else { return Ok(String::new()) };
    let verdict = errors.verdict(limit, limits.repeatability, rule);
    let symbol = errors.test.symbol();
    let mut text = format!("  {symbol},MPE         {limit}: {}\n", verdict_text(errors, &verdict));
    let (used, line, length_m) = most_used(errors, limit);
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "                 largest share of it {:.1} %, at {:.4} mm on {line}",
        100.0 * used,
        length_m * 1e3
    );
    let enough = match enough(errors, limit, rule)? {
        Enough::Limit(SupportedLimit { constant_m, per_metre }) => format!(
            "with its K, A = {} µm would do; with its A, {}",
            rounded_up(um(constant_m)),
            match per_metre {
                0.0 => "no L/K is needed".to_owned(),
                slope => format!("K = {:.0} would do", (1e-3 / slope).floor()),
            }
        ),
        Enough::LargestValue(needed_m) => {
            format!("its largest value would have to be {} µm, whatever A and K", rounded_up(um(needed_m)))
        }
    };
    let _ = writeln!(text, "                 {enough}");
    let _ = writeln!(text, "                 {}", rule.words());
    if let (Some(verdict), Some(limit)) = (verdict.repeatability, limits.repeatability) {
        let _ = writeln!(text, "  R0,MPL         {:.3} µm: {}", um(limit.metres()), verdict_in_words(verdict));
        let _ = writeln!(text, "                 {}", repeatability_rule());
    }
    Ok(text)
}

/// What a limit would need so that every error conforms by the rule.
enum Enough {
    /// The smallest A with its K, and the smallest 1/K with its A.
    Limit(SupportedLimit),
    /// A limit min(A + L/K, B) whose B (m) is below what an error needs.
    LargestValue(f64),
}

fn enough(errors: &LengthErrors, limit: &MaximumPermissibleError, rule: &DecisionRule) -> anyhow::Result<Enough> {
    let frontier = errors.frontier_to_conform(rule)?;
    let needed_m = frontier.smallest_constant_m(0.0);
    let short_m = limit.cap_m().map_or(0.0, |cap_m| needed_m - cap_m);
    if short_m > SAME_M {
        return Ok(Enough::LargestValue(needed_m));
    }
    let constant_m = frontier.smallest_constant_m(limit.per_metre());
    Ok(Enough::Limit(SupportedLimit { constant_m, per_metre: frontier.smallest_per_metre(limit.constant_m()) }))
}

/// How R0 was decided, and why not as the errors were.
fn repeatability_rule() -> String {
    format!("{}; in a range of measurements of one gauge it takes no part", REPEATABILITY_RULE.words())
}

/// The rules of the verdicts that were asked for, R0 by a rule of its own.
pub(crate) fn rules(limits: &Limits, rule: &DecisionRule) -> String {
    match limits.repeatability {
        Some(_) if *rule != REPEATABILITY_RULE => format!("{}; for R0 {}", rule.words(), repeatability_rule()),
        _ => rule.words().to_owned(),
    }
}

fn verdict_text(errors: &LengthErrors, verdict: &LengthVerdict) -> String {
    let total = errors.sets.len();
    match verdict.errors {
        Verdict::Conforms => "every error conforms".to_owned(),
        Verdict::Undecided => "neither conformity nor nonconformity is proved".to_owned(),
        Verdict::DoesNotConform => format!(
            "does not conform: {} of {total} sets have one error beyond, {} more than one (repeating a measurement is for the \
             standard to allow, not for this program)",
            verdict.sets_with_one_beyond, verdict.sets_with_more_beyond
        ),
    }
}

/// Largest share of a limit that an error uses, with its line and length (m).
pub(crate) fn most_used<'a>(errors: &'a LengthErrors, limit: &MaximumPermissibleError) -> (f64, &'a str, f64) {
    let mut most = (0.0, "", 0.0);
    for set in &errors.sets {
        let share = set.largest().magnitude_m() / limit.at(set.calibrated_m).metres();
        if most.1.is_empty() || share > most.0 {
            most = (share, &set.line, set.calibrated_m);
        }
    }
    most
}

/// All figures as JSON.
pub(crate) fn figures(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<Value> {
    let supported = |l: &SupportedLimit| json!({ "constant_um": um(l.constant_m), "um_per_mm": l.per_metre * 1e3 });
    let frontier = errors.frontier()?;
    let (largest, line, length_m) = errors.largest();
    let lines: Vec<Value> = errors
        .lines
        .iter()
        .map(|l| {
            json!({
                "line": l.line, "lengths": l.lengths, "longest_mm": l.longest_m * 1e3,
                "travel_mm": l.travel_m.map(|t| t * 1e3),
                "largest_error_um": um(l.largest.0.metres()), "at_mm": l.largest.1 * 1e3,
                "largest_range_um": l.range.map(|r| um(r.metres())),
            })
        })
        .collect();
    let sets: Vec<Value> = errors
        .sets
        .iter()
        .map(|s| {
            let errors_um: Vec<f64> = s.errors.iter().map(|e| um(e.metres())).collect();
            json!({ "line": s.line, "calibrated_mm": s.calibrated_m * 1e3, "errors_um": errors_um })
        })
        .collect();
    let against = |limit: MaximumPermissibleError| -> anyhow::Result<Value> {
        let enough = match enough(errors, &limit, rule)? {
            Enough::Limit(enough) => Some(enough),
            Enough::LargestValue(_) => None,
        };
        let verdict = errors.verdict(&limit, limits.repeatability, rule);
        Ok(json!({
            "mpe": limit.to_string(), "decision_rule": rule.words(),
            "errors": verdict_word(verdict.errors),
            "repeatability": verdict.repeatability.map(verdict_word),
            "repeatability_decision_rule": verdict.repeatability.map(|_| repeatability_rule()),
            "sets_with_one_beyond": verdict.sets_with_one_beyond,
            "sets_with_more_beyond": verdict.sets_with_more_beyond,
            "verified": verdict.is_whole_test && verdict.overall() == Verdict::Conforms,
            "largest_share": most_used(errors, &limit).0,
            "smallest_constant_for_its_k_um": enough.map(|enough| um(enough.constant_m)),
            "smallest_um_per_mm_for_its_a": enough.map(|enough| enough.per_metre * 1e3),
        }))
    };
    let against = limits.length.map(against).transpose()?;
    Ok(json!({
        "test": errors.test.symbol(), "standard": STANDARD, "probing": errors.test.probing.word(),
        "tool_offset_mm": errors.test.tool_offset_m * 1e3,
        "error": "measured - calibrated",
        "largest_error_um": um(largest.metres()), "largest_error_line": line, "largest_error_at_mm": length_m * 1e3,
        "repeatability_range_um": errors.repeatability().map(|r| um(r.metres())),
        "tightest_by_smallest_area": supported(&frontier.smallest_area()),
        "tightest": frontier.corners().iter().map(supported).collect::<Vec<_>>(),
        "lines": lines, "sets": sets,
        "against_limits": against,
        "departures": departure_json(&errors.departures),
    }))
}

/// Verdict, key figures, what the test lacks, limits, picture and table.
fn sections(errors: &LengthErrors, limits: &Limits, rule: &DecisionRule) -> anyhow::Result<Vec<Section>> {
    chapter(errors, limits, rule, Some(lacking(errors)))
}

/// What the test lacks of a whole one.
pub(super) fn lacking(errors: &LengthErrors) -> Section {
    departure_callout(STANDARD, &errors.departures)
}

/// The same for a page of several tests, which says once what they lack.
pub(super) fn chapter(
    errors: &LengthErrors,
    limits: &Limits,
    rule: &DecisionRule,
    lacking: Option<Section>,
) -> anyhow::Result<Vec<Section>> {
    let frontier = errors.frontier()?;
    let answers = limits.length.iter().flat_map(|limit| answers(errors, limit, limits, rule));
    let mut sections: Vec<Section> = answers.map(Section::Callout).collect();
    sections.push(key_figures(errors, &frontier, limits, rule));
    sections.extend(lacking);
    sections.push(pictures::errors_against_length(
        "Errors against length",
        errors,
        limits.length.as_ref(),
        &frontier.smallest_area(),
    ));
    sections.push(table(errors, rule));
    Ok(sections)
}

/// The verdict on each limit, how much of it was used, and the rule; once where it is the same for all.
fn answers(
    errors: &LengthErrors,
    limit: &MaximumPermissibleError,
    limits: &Limits,
    rule: &DecisionRule,
) -> Vec<Callout> {
    let verdict = errors.verdict(limit, limits.repeatability, rule);
    let graded = |own: Verdict| match verdict.is_whole_test || own == Verdict::DoesNotConform {
        true => tone(own),
        false => Tone::Neutral,
    };
    let (used, line, length_m) = most_used(errors, limit);
    let mut list = vec![Callout {
        tone: graded(verdict.errors),
        title: format!("Against {limit}"),
        text: format!(
            "{}; the largest share of the limit that an error uses is {:.0} %, {}.",
            verdict_text(errors, &verdict),
            100.0 * used,
            at(line, length_m)
        ),
    }];
    let range = errors.repeatability().zip(limits.repeatability).zip(verdict.repeatability);
    if *rule != REPEATABILITY_RULE || range.is_none() {
        list.iter_mut().for_each(|own| own.text.push_str(&format!(" Decision rule: {}.", rule.words())));
    }
    list.extend(range.map(|((range, limit), own)| Callout {
        tone: graded(own),
        title: format!("Repeatability range against {} µm", um(limit.metres())),
        text: format!(
            "{}; it uses {:.0} % of the limit. Decision rule: {}.",
            verdict_in_words(own),
            100.0 * range.metres() / limit.metres(),
            if *rule == REPEATABILITY_RULE { rule.words().to_owned() } else { repeatability_rule() }
        ),
    }));
    list
}

/// A place on a line.
fn at(line: &str, length_m: f64) -> String {
    format!("on {line} at {:.1} mm", length_m * 1e3)
}

fn key_figures(errors: &LengthErrors, frontier: &Frontier, limits: &Limits, rule: &DecisionRule) -> Section {
    let figure = |label: &str, value: Option<Quantity>, unit: &str, detail: String| KeyFigure {
        label: label.to_owned(),
        value,
        unit: unit.to_owned(),
        detail: Some(detail),
        ..KeyFigure::default()
    };
    let (largest, line, length_m) = errors.largest();
    let u_um = expanded_um(rule, length_m);
    let stated = u_um.map_or_else(String::new, |u| format!("± {} µm (k = 2), ", digits::uncertainty(u)));
    let largest = Quantity::with(um(largest.metres()), u_um);
    let mut figures =
        vec![figure("largest error, observed", Some(largest), "µm", format!("{stated}{}", at(line, length_m)))];
    if let Some(limit) = &limits.length {
        let (used, line, length_m) = most_used(errors, limit);
        let verdict = errors.verdict(limit, limits.repeatability, rule).errors;
        let share = figure("largest share of the limit", Some(Quantity::new(100.0 * used, 0)), "%", at(line, length_m));
        figures.push(KeyFigure { tone: tone(verdict), ..share });
    }
    let range = errors.repeatability().map(|range| Quantity::result(um(range.metres())));
    let verdict = limits.length.and_then(|limit| errors.verdict(&limit, limits.repeatability, rule).repeatability);
    let used = errors.repeatability().zip(limits.repeatability);
    let used = used.map(|(range, limit)| format!("; {:.0} % of the limit", 100.0 * range.metres() / limit.metres()));
    figures.extend(range.map(|range| {
        let detail = format!("largest of all sets{}", used.unwrap_or_default());
        let range = figure("repeatability range, observed", Some(range), "µm", detail);
        KeyFigure { tone: verdict.map_or_else(Tone::default, tone), ..range }
    }));
    let constant_um = um(frontier.smallest_area().constant_m);
    let decimals = digits::of_result(constant_um);
    figures.push(figure(
        "tightest limit, A of A + L/K",
        Some(Quantity::new(digits::up(constant_um, decimals), decimals)),
        "µm",
        supported_text(&frontier.smallest_area()),
    ));
    Section::KeyFigures(KeyFigures { title: "Observed".to_owned(), figures })
}

fn table(errors: &LengthErrors, rule: &DecisionRule) -> Section {
    let row = |line: &abbe_conformity::length::LineSummary| {
        let u_um = expanded_um(rule, line.largest.1);
        vec![
            Cell::text(&line.line),
            Cell::with(Some(um(line.largest.0.metres())), u_um),
            Cell::uncertainty(u_um),
            Cell::number(line.largest.1 * 1e3, 1),
            Cell::result(line.range.map(|r| um(r.metres()))),
            Cell::count(line.lengths),
            Cell::number(line.longest_m * 1e3, 1),
            Cell::maybe(line.travel_m.map(|t| 100.0 * line.longest_m / t), 0),
        ]
    };
    Section::Table(TableSection {
        title: "Measuring lines".to_owned(),
        note: Some("Largest error by magnitude; the range is that of repeated measurements of one length.".to_owned()),
        columns: vec![
            Column::text("line"),
            Column::number("largest error", "µm"),
            Column::number("± U (k = 2)", "µm"),
            Column::number("at", "mm"),
            Column::number("largest range", "µm"),
            Column::number("lengths", "1"),
            Column::number("longest", "mm"),
            Column::number("share of travel", "%"),
        ],
        rows: errors.lines.iter().map(row).collect(),
        total_rows: None,
    })
}
