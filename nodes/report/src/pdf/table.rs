//! A table on pages: columns as wide as they need, text broken where they do not fit, the head again on each page.

use super::pages::{MARGIN, Pages, WIDTH, letters, lines, title};
use crate::error::ReportError;
use crate::sections::{Cell, TableSection, shown};
use crate::svg::Anchor;
use crate::text::{MISSING, fixed, integer};

/// Size of the letters, height of a line, and space between columns, px.
const SIZE: f64 = 16.0;
const LINE: f64 = 21.0;
const GAP: f64 = 18.0;
/// Letters that a column of text keeps at least.
const LEAST: f64 = 9.0;

fn text_of(cell: Option<&Cell>, column: usize) -> String {
    match cell {
        None => MISSING.to_owned(),
        Some(Cell::Text(text)) => shown(text, column),
        Some(Cell::Integer(value)) => integer(*value),
        Some(Cell::Number(q)) => fixed(q.value, q.decimals),
    }
}

/// A column as it is set.
struct Column {
    head: String,
    unit: Option<String>,
    cells: Vec<String>,
    width: f64,
}

impl Column {
    /// Letters of the longest line, where words may be broken from each other or not.
    fn longest(&self, whole: bool) -> usize {
        let of = |text: &str| match whole {
            true => text.chars().count(),
            false => text.split_whitespace().map(|word| word.chars().count()).max().unwrap_or(0),
        };
        let head = self.head.split_whitespace().map(|word| word.chars().count()).max().unwrap_or(0);
        let unit = self.unit.as_deref().map_or(0, of);
        self.cells.iter().map(|cell| of(cell)).max().unwrap_or(0).max(head).max(unit)
    }
}

/// Adds a table.
pub(super) fn add(pages: &mut Pages, table: &TableSection) -> Result<(), ReportError> {
    pages.need(150.0)?;
    title(pages, &table.title, table.note.as_deref())?;
    let mut columns: Vec<Column> = Vec::new();
    for (k, column) in table.columns.iter().enumerate() {
        // As on the page: a column of nothing but dashes tells nothing.
        if table.rows.iter().all(|row| row[k].is_none()) {
            continue;
        }
        let cells = table.rows.iter().map(|row| text_of(row[k].as_ref(), k)).collect();
        columns.push(Column { head: column.name.clone(), unit: column.unit.clone(), cells, width: 0.0 });
    }
    if columns.is_empty() {
        return pages.text("mutedb", SIZE, "None.");
    }
    set_widths(&mut columns);
    head(pages, &columns)?;
    for row in 0..table.rows.len() {
        let cells: Vec<Vec<String>> =
            columns.iter().map(|column| lines(&column.cells[row], letters(column.width, SIZE))).collect();
        let height = LINE * cells.iter().map(Vec::len).max().unwrap_or(1) as f64 + 6.0;
        let before = pages.y;
        pages.need(height)?;
        if pages.y < before {
            head(pages, &columns)?;
        }
        let top = pages.y;
        let mut left = MARGIN;
        for (column, cell) in columns.iter().zip(&cells) {
            for (index, line) in cell.iter().enumerate() {
                put(pages, "cell", column, (left, top + LINE * (index + 1) as f64 - 4.0), line);
            }
            left += column.width + GAP;
        }
        pages.y = top + height;
        let y = pages.y - 2.0;
        pages.svg().line("gr", (MARGIN, y), (left - GAP, y));
    }
    if let Some(total) = table.total_rows.filter(|&total| total > table.rows.len()) {
        pages.text("mutedb", SIZE, &format!("The first {} of {total} rows.", table.rows.len()))?;
    }
    Ok(())
}

/// As wide as the longest cell; where that is too much, columns of text give way in proportion.
fn set_widths(columns: &mut [Column]) {
    let letter = 0.58 * SIZE;
    for column in columns.iter_mut() {
        column.width = letter * column.longest(true) as f64;
    }
    let room = WIDTH - GAP * (columns.len().saturating_sub(1)) as f64;
    let total: f64 = columns.iter().map(|column| column.width).sum();
    if total <= room {
        return;
    }
    let least = |column: &Column| match column.unit {
        Some(_) => column.width,
        None => (letter * column.longest(false) as f64).max(letter * LEAST).min(column.width).min(room / 3.0),
    };
    let kept: f64 = columns.iter().map(least).sum();
    let share = ((room - kept) / (total - kept)).clamp(0.0, 1.0);
    let narrowed: Vec<f64> =
        columns.iter().map(|column| least(column) + share * (column.width - least(column))).collect();
    // Where even that is too wide, all give way: text is broken, never cut.
    let factor = (room / narrowed.iter().sum::<f64>()).min(1.0);
    for (column, width) in columns.iter_mut().zip(narrowed) {
        column.width = width * factor;
    }
}

fn head(pages: &mut Pages, columns: &[Column]) -> Result<(), ReportError> {
    let heads: Vec<Vec<String>> =
        columns.iter().map(|column| lines(&column.head, letters(column.width, SIZE))).collect();
    let count = heads.iter().map(Vec::len).max().unwrap_or(1);
    // A count has none to be shown.
    let shown = |column: &Column| column.unit.clone().filter(|unit| unit != "1");
    let has_units = columns.iter().any(|column| shown(column).is_some());
    let height = LINE * (count + usize::from(has_units)) as f64 + 8.0;
    pages.need(height + 2.0 * LINE)?;
    let top = pages.y;
    let mut left = MARGIN;
    for (column, found) in columns.iter().zip(&heads) {
        for (index, line) in found.iter().enumerate() {
            let row = index + count - found.len();
            put(pages, "cellb", column, (left, top + LINE * (row + 1) as f64 - 4.0), line);
        }
        if let Some(unit) = shown(column) {
            put(pages, "mutedb", column, (left, top + LINE * (count + 1) as f64 - 4.0), &unit);
        }
        left += column.width + GAP;
    }
    pages.y = top + height;
    let y = pages.y - 3.0;
    pages.svg().line("vol", (MARGIN, y), (left - GAP, y));
    Ok(())
}

/// Numbers end at the right of their column.
fn put(pages: &mut Pages, class: &str, column: &Column, (left, y): (f64, f64), text: &str) {
    match column.unit {
        Some(_) => pages.svg().text(class, (left + column.width, y), Anchor::End, text),
        None => pages.svg().text(class, (left, y), Anchor::Start, text),
    }
}
