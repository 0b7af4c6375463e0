//! Of which tips the points of a campaign are.
//!
//! Place in the flow: solved points in; the offsets that were measured, and the points of one of them, out. Reflector holders differ in
//! where they put the reflector (offset in m, ram frame), and axes that turn move each by its own lever: a field of the position is that
//! of one tip.

use abbe_files::offset_words;
use abbe_geometry::Vector3;
use abbe_measurement::multilateration::{MultiStation, Target};
use anyhow::{bail, ensure};
use serde_json::{Value, json};

/// Offsets that the terminal shows one by one.
const MOST_SHOWN: usize = 6;

/// Offsets of a campaign, in the order of its points, each with the number of its solved points.
pub(super) struct Tips {
    offsets: Vec<(Vector3<f64>, usize)>,
    same_m: f64,
    /// That of which the points are, where one was asked for.
    taken: Option<Vector3<f64>>,
}

impl Tips {
    /// Of a solved campaign, whose offsets are one where they differ by no more than this (m). Of one that is asked for (m), only the points
    /// are left.
    pub(super) fn of(solved: &mut MultiStation, same_m: f64, asked_m: Option<[f64; 3]>) -> anyhow::Result<Tips> {
        let mut tips = Tips { offsets: Vec::new(), same_m, taken: None };
        for target in &solved.targets {
            if tips.place(target).is_none() {
                tips.offsets.push((target.offset_m, 0));
            }
        }
        for point in &solved.points {
            if let Some(place) = tips.place(&solved.targets[point.target]) {
                tips.offsets[place].1 += 1;
            }
        }
        let Some(asked_m) = asked_m.map(Vector3::from) else { return Ok(tips) };
        let Some((found_m, _)) = tips.offsets.iter().find(|(offset_m, _)| (offset_m - asked_m).norm() <= same_m) else {
            bail!(
                "--offset-mm: no point was measured with the offset {}; take one of those that were: {}",
                offset_words(asked_m.into()),
                tips.shown()
            )
        };
        let found_m = *found_m;
        tips.taken = Some(found_m);
        let targets = &solved.targets;
        let is_its = |target: usize| (targets[target].offset_m - found_m).norm() <= same_m;
        solved.points.retain(|point| is_its(point.target));
        solved.unsolved.retain(|missing| is_its(missing.target));
        Ok(tips)
    }

    fn place(&self, target: &Target) -> Option<usize> {
        self.offsets.iter().position(|(offset_m, _)| (offset_m - target.offset_m).norm() <= self.same_m)
    }

    /// Whether the campaign has more than one, so that vectors must say of which they are.
    pub(super) fn are_several(&self) -> bool {
        self.offsets.len() > 1
    }

    /// Whether the vectors are of more than one tip.
    pub(super) fn are_mixed(&self) -> bool {
        self.taken.is_none() && self.are_several()
    }

    fn shown(&self) -> String {
        let shown = self.offsets.iter().take(MOST_SHOWN);
        let shown = shown.map(|(offset_m, points)| format!("{} ({points} points)", offset_words((*offset_m).into())));
        let more = if self.offsets.len() > MOST_SHOWN { ", …" } else { "" };
        format!("{}{more}", shown.collect::<Vec<_>>().join(", "))
    }

    /// Lines above the vectors, where there are several tips.
    pub(super) fn notes(&self) -> Vec<String> {
        let positions = "x_mm y_mm z_mm are scale readings, not where the tip is";
        match self.taken {
            None if self.are_mixed() => {
                vec![format!("errors of {} tips, each at its own offset (ram frame); {positions}", self.offsets.len())]
            }
            Some(offset_m) if self.are_several() => {
                vec![format!("errors of the tip at offset {} (ram frame); {positions}", offset_words(offset_m.into()))]
            }
            None | Some(_) => Vec::new(),
        }
    }

    /// For the terminal, in the form of the lines around it.
    pub(super) fn print(&self) {
        match self.taken {
            Some(offset_m) if self.are_several() => println!(
                "  offset            {}: the points of this tip alone, {} offsets were measured",
                offset_words(offset_m.into()),
                self.offsets.len()
            ),
            None if self.are_mixed() => println!("  offsets           {}: {}", self.offsets.len(), self.shown()),
            None | Some(_) => {}
        }
    }

    /// What several tips in one file mean.
    pub(super) fn warn(&self, out: &str) {
        if self.are_mixed() {
            eprintln!(
                "abbe: warning: {out}: vectors of {} tips, which have errors of their own; a field of the position is of one of them: abbe \
                 interpolate, train, compare and diagnose want a file of one tip each, which --offset-mm X,Y,Z writes",
                self.offsets.len()
            );
        }
    }

    /// One that has points, as the option takes it: for the command that follows.
    pub(super) fn option(&self) -> String {
        let most = self.offsets.iter().rev().max_by_key(|(_, points)| *points);
        most.map_or_else(String::new, |(offset_m, _)| {
            let words = offset_words((*offset_m).into());
            format!("--offset-mm={}", words.trim_end_matches(" mm").replace(' ', ","))
        })
    }

    /// The same for programs; `None` of a campaign with one offset.
    pub(super) fn json(&self) -> Option<Value> {
        let tip = |(offset_m, points): &(Vector3<f64>, usize)| json!({ "offset_mm": (offset_m * 1e3).as_slice(), "points": points });
        self.are_several().then(|| self.offsets.iter().map(tip).collect())
    }
}

/// The offset asked for (m).
pub(super) fn asked_m(offset_mm: Option<&[f64]>) -> anyhow::Result<Option<[f64; 3]>> {
    let offset_m = match offset_mm {
        None => return Ok(None),
        Some([x, y, z]) => [x / 1e3, y / 1e3, z / 1e3],
        Some(other) => bail!("--offset-mm has {} numbers; write three, x,y,z", other.len()),
    };
    ensure!(offset_m.iter().all(|v| v.is_finite()), "--offset-mm: give three numbers in millimetres");
    Ok(Some(offset_m))
}
