//! Tables of a diagnosis: effects, parameters, rivals, what cannot be told, detection, search.

use super::names::{in_words, shape};
use super::record::{Effect, NotIdentifiable, Parameter, Placebo, Record, Structure};
use super::shaped::{entries, for_readers, shaped};
use super::words::alias_words;
use super::{HELD_ALREADY, is_held_already, readable, share_text};
use crate::digits;
use crate::sections::{Callout, Cell, Column, Section, TableSection, Tone};
use crate::text::significant;

/// Candidates on the page; all of them are in the JSON.
const MOST_CANDIDATES: usize = 20;

fn table(title: &str, note: Option<&str>, columns: Vec<Column>, rows: Vec<Vec<Option<Cell>>>) -> Section {
    let note = note.map(str::to_owned);
    Section::Table(TableSection { title: title.to_owned(), note, columns, rows, total_rows: None })
}

/// A table, or where it would be empty what that means.
fn table_or(title: &str, note: &str, columns: Vec<Column>, rows: Vec<Vec<Option<Cell>>>, empty: &str) -> Section {
    if rows.is_empty() {
        return Section::Callout(Callout { tone: Tone::Neutral, title: title.to_owned(), text: empty.to_owned() });
    }
    table(title, Some(note), columns, rows)
}

/// A probability as text: most are far too small for decimals.
pub(super) fn probability(p: Option<f64>) -> Option<Cell> {
    Cell::text(digits::chance(p?))
}

/// An effect as the page names it.
pub(super) fn label(effect: &Effect) -> String {
    in_words(&effect.label())
}

/// A share of a signature.
fn share(share: Option<f64>) -> Option<Cell> {
    share.and_then(|share| Cell::text(share_text(share)))
}

/// Numbers of one kind with the same decimals: three digits of the largest.
fn even(values: impl IntoIterator<Item = Option<f64>>) -> impl Fn(Option<f64>) -> Option<Cell> {
    let decimals = digits::of_group(values.into_iter().flatten());
    move |value| Cell::maybe(value, decimals)
}

fn interval_cell(interval: Option<(f64, f64)>) -> Option<Cell> {
    interval.and_then(|(low, high)| Cell::text(format!("{} … {}", significant(low, 3), significant(high, 3))))
}

fn words(list: &[String]) -> Option<Cell> {
    if list.is_empty() { None } else { Cell::text(list.join(", ")) }
}

impl Record {
    /// What was found and how surely.
    pub(super) fn effects_table(&self) -> Section {
        let columns = vec![
            Column::text("effect"),
            Column::text("probability by chance, corrected"),
            Column::number("size in the readings, rms", "µm"),
            Column::number("gain on data left out", "µm"),
            Column::text("share absorbed"),
            Column::text("which means"),
        ];
        let row = |e: &Effect| {
            vec![
                Cell::text(label(e)),
                probability(e.p_value),
                Cell::result(e.size_um),
                Cell::result(e.held_out_gain_um),
                share(e.alias_share),
                Cell::text(alias_words(e.alias_share)),
            ]
        };
        let note =
            "Share absorbed: how much of what the effect does to the readings the model without it could imitate.";
        table("Effects found", Some(note), columns, self.effects.iter().map(row).collect())
    }

    /// What the effects are.
    pub(super) fn formulas_table(&self) -> Section {
        let columns = ["effect", "kind", "depends on", "shape", "formula"].map(Column::text).to_vec();
        let row = |e: &Effect| {
            vec![
                Cell::text(label(e)),
                Cell::text(kind_words(&e.kind)),
                words(&e.covariates).map(|_| Cell::Text(in_words(&e.covariates.join(", ")))),
                if e.shape.is_empty() { None } else { Cell::text(entries(&shape(&e.shape))) },
                Cell::text(&e.formula),
            ]
        };
        let note = "Attributed: a known effect explains it. Empirical: the data depend on the named quantities in this \
                    shape; nothing known explains why.";
        table("What they are", Some(note), columns, self.effects.iter().map(row).collect())
    }

    /// Parameters of all effects, in units that people read.
    pub(super) fn parameters_table(&self) -> Section {
        let columns = vec![
            Column::text("effect"),
            Column::text("parameter"),
            Column::text("value ± standard uncertainty (k = 1)"),
            Column::text("plausible up to"),
            Column::text("inside"),
        ];
        let rows = self.effects.iter().flat_map(|e| e.parameters.iter().map(|p| parameter_row(&label(e), p)));
        let note = "Plausible is what such a parameter can be on a sound machine; a value outside points to another \
                    cause.";
        table("Parameters", Some(note), columns, rows.collect())
    }

    /// Gain beside placebos; nothing where none were drawn.
    pub(super) fn placebo_table(&self) -> Option<Section> {
        if self.effects.iter().any(|e| e.placebo.draws == 0) && !self.effects.is_empty() {
            return None;
        }
        let columns = vec![
            Column::text("effect"),
            Column::number("gain", "1"),
            Column::number("placebos, median", "1"),
            Column::number("placebos, 95 %", "1"),
            Column::text("share of placebos as good"),
            Column::number("placebos", "1"),
        ];
        let row = |e: &Effect| {
            let Placebo { gain, unit: _, draws, median, quantile_95, share_as_good } = &e.placebo;
            let cell = even([*gain, *median, *quantile_95]);
            vec![
                Cell::text(label(e)),
                cell(*gain),
                cell(*median),
                cell(*quantile_95),
                share_as_good.and_then(|as_good| Cell::text(digits::plain(as_good, 2))),
                Cell::count(*draws),
            ]
        };
        let unit = self.effects.first().map_or("", |e| e.placebo.unit.as_str());
        let note = format!(
            "A placebo has the effect's own columns, cut loose from the readings they belong to: as flexible, but without meaning. An \
             effect that gains no more than its placebos is flexibility, not physics. Gain: {unit}."
        );
        Some(table("Real gain and placebo gain", Some(&note), columns, self.effects.iter().map(row).collect()))
    }

    /// Effects that would do as well; nothing where there are none.
    pub(super) fn rivals_table(&self) -> Option<Section> {
        let columns = vec![
            Column::text("effect found"),
            Column::text("cannot be told from"),
            Column::number("evidence behind", "1"),
        ];
        let of = |e: &Effect| {
            let label = label(e);
            let row = move |r: &super::Rival| {
                vec![Cell::text(&label), Cell::text(r.label()), Cell::maybe(r.evidence_behind, 1)]
            };
            e.cannot_be_told_from.iter().map(row).collect::<Vec<_>>()
        };
        let rows: Vec<_> = self.effects.iter().flat_map(of).collect();
        let note = "Evidence is twice the log likelihood after the price of parameters and trials; below 10 the data \
                    do not decide.";
        (!rows.is_empty()).then(|| table("Rivals", Some(note), columns, rows))
    }

    /// What corrected coordinates are the mean of; nothing where no explanation competes.
    pub(super) fn averaged_table(&self) -> Option<Section> {
        let columns = vec![Column::text("effect found"), Column::text("in its place"), Column::number("share", "%")];
        let of = |e: &Effect| {
            let label = label(e);
            let row = move |a: &super::Averaged| {
                let share = Cell::maybe(a.share.map(|share| 100.0 * share), 0);
                vec![Cell::text(&label), Cell::text(a.named()), share]
            };
            e.averaged_with.iter().map(row).collect::<Vec<_>>()
        };
        let rows: Vec<_> = self.effects.iter().flat_map(of).collect();
        let note = "Corrected coordinates are the mean of these explanations and of what was found, each by its likelihood. Where \
                    they disagree, the stated uncertainty is wider.";
        (!rows.is_empty()).then(|| table("Competing explanations", Some(note), columns, rows))
    }

    /// How effects predict what they were not fitted to; nothing where that was not judged.
    pub(super) fn predicts_table(&self) -> Option<Section> {
        let columns = vec![
            Column::text("effect"),
            Column::text("left out"),
            Column::number("blocks", "1"),
            Column::number("without it", "1"),
            Column::number("with it", "1"),
            Column::number("gain in standard deviations", "1"),
        ];
        let of = |e: &Effect| {
            let label = label(e);
            let row = |l: &super::LeftOut| {
                vec![
                    Cell::text(&label),
                    Cell::text(&l.by),
                    Cell::count(l.blocks),
                    Cell::result(l.without),
                    Cell::result(l.with),
                    Cell::maybe(l.deviations, 1),
                ]
            };
            let missing = |words: &String| vec![Cell::text(&label), Cell::text(words), None, None, None, None];
            e.predicts.left_out.iter().map(row).chain(e.predicts.not_judged.iter().map(missing)).collect::<Vec<_>>()
        };
        let rows: Vec<_> = self.effects.iter().flat_map(of).collect();
        let note = "Rms over the declared noise of blocks left out of both fits, over the same readings. An effect that \
                    loses beyond chance in any kind of block, or does not gain on lines, stays out of the model.";
        (!rows.is_empty()).then(|| table("Predicted elsewhere", Some(note), columns, rows))
    }

    /// What stays out; nothing where nothing does.
    pub(super) fn set_aside_table(&self) -> Option<Section> {
        let columns = vec![Column::text("candidate"), Column::text("stays out because")];
        let row = |s: &super::SetAside| vec![Cell::text(s.label()), Cell::text(&s.because)];
        let rows: Vec<_> = self.set_aside.iter().map(row).collect();
        let note =
            "These explain the readings better than chance when they are alone, but something else may be the cause.";
        (!rows.is_empty()).then(|| table("Set aside", Some(note), columns, rows))
    }

    /// What aliases with the model.
    pub(super) fn not_identifiable_table(&self) -> Section {
        let columns = vec![
            Column::text("effect"),
            Column::text("share absorbed"),
            Column::text("looks like"),
            Column::text("why"),
            Column::text("decided by"),
        ];
        let row = |n: &NotIdentifiable| {
            vec![
                Cell::text(shaped(for_readers(&n.name, &n.title), &n.shape)),
                share(n.alias_share),
                words(&n.aliased_with),
                n.because.as_ref().and_then(Cell::text),
                Cell::text(&n.decided_by),
            ]
        };
        let note = "These effects may be there: with this plan the model's own parameters would take them up. Where \
                    they belong to position alone, correction at the campaign's conditions does not suffer.";
        let empty = "No candidate was seen that the model imitates so well that these data could not judge it.";
        table_or("Cannot be identified", note, columns, self.not_identifiable.iter().map(row).collect(), empty)
    }

    /// What needs a sensor.
    pub(super) fn untestable_table(&self) -> Section {
        let columns = vec![Column::text("effect"), Column::text("needs")];
        let row = |u: &super::Untestable| vec![Cell::text(&u.name), Cell::text(&u.needs)];
        let note = "Not logged, or logged and constant. Nothing is claimed of these effects.";
        let empty = "No candidate was left out for want of a sensor, a column or a move.";
        table_or("Untestable", note, columns, self.untestable.iter().map(row).collect(), empty)
    }

    /// A numbered list; where it would be empty, what that means.
    pub(super) fn list_or(title: &str, note: Option<&str>, heading: &str, lines: &[String], empty: &str) -> Section {
        if lines.is_empty() {
            return Section::Callout(Callout { tone: Tone::Neutral, title: title.to_owned(), text: empty.to_owned() });
        }
        Record::list(title, note, heading, lines)
    }

    /// A numbered list.
    pub(super) fn list(title: &str, note: Option<&str>, heading: &str, lines: &[String]) -> Section {
        let rows = lines.iter().enumerate().map(|(k, text)| vec![Cell::count(k + 1), Cell::text(text)]);
        table(title, note, vec![Column::number("no.", "1"), Column::text(heading)], rows.collect())
    }

    /// What was looked at and what was found, in a few sentences.
    pub(super) fn detection_words(&self) -> String {
        let (b, a) = (&self.detection.before, &self.detection.after);
        let looked = match b.rejected {
            0 => format!("Looked at: what the model leaves of {} observations.", b.used),
            rejected => format!(
                "Looked at: what the model leaves of {} observations; {rejected} more were rejected as gross errors.",
                b.used
            ),
        };
        let is_same = self.is_one_state();
        let said = match is_same || b.words == a.words {
            true => b.words.clone(),
            false => format!("Before: {} After: {}", b.words, a.words),
        };
        let found = match (is_same, self.consistent_with_noise) {
            (true, true) => "Found: nothing that noise does not have.",
            (true, false) if self.only_correlated => "Found: nothing that correlated noise does not have.",
            (true, false) => "Found: something that noise does not have, and no candidate that explains it.",
            (false, _) => "Found: something that noise does not have; the answer at the top says what it is.",
        };
        let tests = "These data give no figure that tells a residual from noise by itself: declared uncertainties and \
                     repeats are missing or too few.";
        let tests = if self.detection_rows().is_empty() { tests } else { "" };
        [looked.as_str(), &said, found, tests].into_iter().filter(|said| !said.is_empty()).collect::<Vec<_>>().join(" ")
    }

    /// Nothing was added: what was measured has one state, and before and after are the same figures.
    pub(super) fn is_one_state(&self) -> bool {
        self.effects.is_empty() && !self.enriched
    }

    /// Detection, before beside after, or once where they are one; nothing where the data give no figure.
    pub(super) fn detection_table(&self) -> Option<Section> {
        let rows = self.detection_rows();
        let mut columns = vec![Column::text("figure"), Column::text("noise has")];
        columns.extend(match self.is_one_state() {
            true => vec![Column::number("these data", "1"), Column::text("probability by chance")],
            false => vec![
                Column::number("before", "1"),
                Column::text("probability before"),
                Column::number("after", "1"),
                Column::text("probability after"),
            ],
        });
        // A column of nothing but dashes is not shown.
        let has_dash = |column: usize| {
            let missing = rows.iter().filter(|row| row[column].is_none()).count();
            missing > 0 && missing < rows.len()
        };
        let is_whole = !(0..columns.len()).any(has_dash);
        let note = (!is_whole).then_some("A dash is a figure that these data do not give.");
        (!rows.is_empty()).then(|| table("Is it noise?", note, columns, rows))
    }

    fn detection_rows(&self) -> Vec<Vec<Option<Cell>>> {
        let (b, a) = (&self.detection.before, &self.detection.after);
        let plain = |value: Option<f64>, p_value: Option<f64>| Some(Structure { value, p_value });
        let rows = [
            (
                "χ² per degree of freedom, declared uncertainties",
                "1",
                plain(b.chi2_per_dof, b.p_declared),
                plain(a.chi2_per_dof, a.p_declared),
            ),
            (
                "estimated over declared standard deviation",
                "1",
                plain(b.estimated_over_declared, None),
                plain(a.estimated_over_declared, None),
            ),
            ("correlation of neighbours on a line", "0", b.along_lines, a.along_lines),
            ("scatter of the lines' means over that of noise", "1", b.between_lines, a.between_lines),
            ("misfit over the scatter of replicates", "1", b.lack_of_fit, a.lack_of_fit),
        ];
        let row = |(name, noise, before, after): (&str, &str, Option<Structure>, Option<Structure>)| {
            let cells = |s: Option<Structure>| {
                let value = s.and_then(|s| s.value);
                let chance = probability(s.and_then(|s| s.p_value));
                [Cell::result(value), chance.or_else(|| value.and_then(|_| Cell::text("not tested")))]
            };
            let states = if self.is_one_state() { vec![before] } else { vec![before, after] };
            let cells = states.into_iter().flat_map(cells);
            [Cell::text(name), Cell::text(noise)].into_iter().chain(cells).collect()
        };
        let is_known = |s: &Option<Structure>| s.is_some_and(|s| s.value.is_some() || s.p_value.is_some());
        let rows = rows.into_iter().filter(|(_, _, before, after)| is_known(before) || is_known(after));
        rows.map(row).collect()
    }

    /// Residual by station, offset, direction.
    pub(super) fn groups_table(&self) -> Option<Section> {
        let (before, after) = (&self.detection.before.groups, &self.detection.after.groups);
        if before.is_empty() {
            return None;
        }
        let later = |g: &super::Group| after.iter().find(|other| other.name == g.name).cloned();
        let both = |of: fn(&super::Group) -> Option<f64>| even(before.iter().chain(after).map(of));
        let (mean, square) = (both(|g| g.mean_um), both(|g| g.mean_square));
        let mut columns = vec![Column::text("observations"), Column::number("count", "1")];
        columns.extend(match self.is_one_state() {
            true => vec![Column::number("mean", "µm"), Column::number("mean square over declared", "1")],
            false => vec![
                Column::number("mean before", "µm"),
                Column::number("mean after", "µm"),
                Column::number("mean square over declared, before", "1"),
                Column::number("after", "1"),
            ],
        });
        let row = |g: &super::Group| {
            let states = if self.is_one_state() { vec![Some(g.clone())] } else { vec![Some(g.clone()), later(g)] };
            let cells = |of: &dyn Fn(&super::Group) -> Option<Cell>| -> Vec<Option<Cell>> {
                states.iter().map(|state| state.as_ref().and_then(of)).collect()
            };
            let [means, squares] = [cells(&|g| mean(g.mean_um)), cells(&|g| square(g.mean_square))];
            [vec![Cell::text(&g.name), Cell::count(g.count)], means, squares].concat()
        };
        let title = "By station, offset and direction";
        Some(table(title, None, columns, before.iter().map(row).collect()))
    }

    /// Error of blocks left out of the final fit.
    pub(super) fn blocked_table(&self) -> Option<Section> {
        let is_one = self.is_one_state();
        let mut columns = vec![Column::text("left out")];
        columns.extend(match is_one {
            true => vec![Column::number("these data", "1")],
            false => vec![Column::number("before", "1"), Column::number("after", "1")],
        });
        let row = |b: &super::Blocked| {
            let after = (!is_one).then(|| Cell::result(b.after));
            [Cell::text(&b.by), Cell::result(b.before)].into_iter().chain(after).collect()
        };
        let note = "Rms over the declared noise, predicted by the final structure fitted to the rest.";
        let rows: Vec<_> = self.held_out.blocked.iter().map(row).collect();
        (!rows.is_empty()).then(|| table("Blocks left out of the final fit", Some(note), columns, rows))
    }

    /// From the base model to all effects.
    pub(super) fn ladder_table(&self) -> Option<Section> {
        let columns = vec![
            Column::text("added"),
            Column::number("error on blocks left out", "µm"),
            Column::text("95 % interval / µm"),
            Column::number("residual rms of the fit", "µm"),
            Column::text("probability by chance, corrected"),
            Column::text("share absorbed below"),
        ];
        let row = |r: &super::Rung| {
            vec![
                Cell::text(r.added.as_deref().unwrap_or("(the model as it was)")),
                Cell::result(r.held_out_rms_um),
                interval_cell(r.held_out_interval_um),
                Cell::result(r.residual_rms_um),
                probability(r.p_value),
                share(r.alias_share),
            ]
        };
        let rows: Vec<_> = self.ladder.iter().map(row).collect();
        (!rows.is_empty()).then(|| table("Ladder: one effect more on each rung", None, columns, rows))
    }

    /// Other sets of effects.
    pub(super) fn alternatives_table(&self) -> Option<Section> {
        let columns = vec![
            Column::text("effects"),
            Column::number("error on blocks left out", "µm"),
            Column::text("95 % interval / µm"),
            Column::text("probability by chance"),
            Column::number("evidence", "1"),
        ];
        let row = |a: &super::Alternative| {
            vec![
                Cell::text(if a.effects.is_empty() { "(none)".to_owned() } else { a.effects.join(" + ") }),
                Cell::result(a.held_out_rms_um),
                interval_cell(a.held_out_interval_um),
                probability(a.p_value),
                Cell::maybe(a.evidence, 1),
            ]
        };
        let note = "Best prediction first; probabilities are not corrected for the number of sets.";
        let rows: Vec<_> = self.alternatives.iter().map(row).collect();
        (!rows.is_empty()).then(|| table("Other sets of effects", Some(note), columns, rows))
    }

    /// All candidates against the base model.
    pub(super) fn considered_table(&self) -> Option<Section> {
        let columns = vec![
            Column::text("candidate"),
            Column::text("kind"),
            Column::number("parameters", "1"),
            Column::text("probability by chance"),
            Column::text("corrected"),
            Column::number("evidence", "1"),
            Column::text("share absorbed"),
        ];
        let row = |c: &super::Considered| {
            vec![
                Cell::text(&c.name),
                Cell::text(kind_words(&c.kind)),
                Cell::count(c.tested),
                probability(c.p_value),
                probability(c.p_holm),
                Cell::maybe(c.evidence, 1),
                share(c.alias_share),
            ]
        };
        let mut best: Vec<_> = self.considered.iter().collect();
        let evidence = |c: &super::Considered| c.evidence.unwrap_or(f64::NEG_INFINITY);
        best.sort_by(|a, b| evidence(b).total_cmp(&evidence(a)));
        let rows: Vec<_> = best.into_iter().take(MOST_CANDIDATES).map(row).collect();
        (!rows.is_empty()).then(|| {
            Section::Table(TableSection {
                title: "Candidates against the model as it was".to_owned(),
                note: Some("Those with most evidence first.".to_owned()),
                columns,
                rows,
                total_rows: Some(self.considered.len()),
            })
        })
    }
}

fn parameter_row(effect: &str, parameter: &Parameter) -> Vec<Option<Cell>> {
    let (value, u, plausible, unit, decimals) = readable(parameter);
    let shown = |v: f64| crate::text::fixed(v, decimals);
    let value = value.map(|v| match u {
        _ if is_held_already(parameter) => HELD_ALREADY.to_owned(),
        Some(u) => format!("{} ± {} {unit}", shown(v), shown(u)),
        None => format!("{} {unit}", significant(v, 3)),
    });
    vec![
        Cell::text(effect),
        Cell::text(&parameter.name),
        value.and_then(Cell::text),
        plausible.and_then(|p| Cell::text(format!("{} {unit}", significant(p, 2)))),
        Cell::text(if parameter.is_plausible { "yes" } else { "NO" }),
    ]
}

fn kind_words(kind: &str) -> String {
    if kind == "empirical" { "empirical (described, not explained)".to_owned() } else { kind.to_owned() }
}
