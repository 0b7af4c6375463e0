//! Tables to be spoilt, and commands that must refuse them.
//!
//! Place in the flow: tests of bad input spoil a good table in one way each, and hold the refusal against what it must say.

use super::assert_says;
use super::files::{Bench, listing};
use super::program::run;

/// A table as lines of cells, to be spoilt.
pub(crate) struct Table(pub(crate) Vec<Vec<String>>);

/// What spoils it.
pub(crate) type Spoil = fn(&mut Table);

impl Table {
    pub(crate) fn of(text: &str) -> Table {
        Table(text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect())
    }

    pub(crate) fn column(&self, name: &str) -> usize {
        self.0[0].iter().position(|column| column == name).unwrap()
    }

    /// Line numbers as in the file: the header is line 1.
    pub(crate) fn cell(&mut self, line: usize, column: &str) -> &mut String {
        let column = self.column(column);
        &mut self.0[line - 1][column]
    }

    pub(crate) fn without(&mut self, column: &str) {
        let column = self.column(column);
        self.0.iter_mut().for_each(|row| drop(row.remove(column)));
    }

    pub(crate) fn rename(&mut self, column: &str, name: &str) {
        let column = self.column(column);
        self.0[0][column] = name.to_owned();
    }

    pub(crate) fn keep(&mut self, mut row: impl FnMut(usize, &[String]) -> bool) {
        let mut number = 0;
        self.0.retain(|cells| {
            number += 1;
            number == 1 || row(number, cells)
        });
    }

    pub(crate) fn text(&self) -> String {
        self.0.iter().map(|row| row.join(",") + "\n").collect()
    }
}

/// Runs a command that must refuse its input, and asserts that it changed nothing in the folder.
#[track_caller]
pub(crate) fn refused(bench: &Bench, arguments: &[&str], says: &[&str]) {
    let before = listing(&bench.path(""));
    let said = run(arguments).refused();
    assert_says(&said, says);
    let verdict = said.lines().last().unwrap();
    assert!(verdict.matches("os error").count() <= 1, "the cause is said twice: {verdict}");
    assert_eq!(listing(&bench.path("")), before, "something was left behind by {arguments:?}");
}

/// The same of `identify`.
#[track_caller]
pub(crate) fn identify_refused(bench: &Bench, machine: &str, campaign: &str, says: &[&str]) {
    let arguments = ["identify", "--machine", machine, "--campaign", campaign, "--out", &bench.text("refused.json")];
    refused(bench, &arguments, says);
}
