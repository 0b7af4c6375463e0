//! What is known of the machine: its active coordinate system and where the tip stands in its tool.
//!
//! Place in the flow: asked for by [`super::survey`], used by [`super::Relay`] for every point. A reported point is
//! p = T(s + o) with the scales s, the offset o of the tip and the transformation T of the active system; what is corrected is
//! s with o, and what leaves is T of the corrected point.

use super::report::{Converted, Refused};
use super::{Correct, Purpose};
use crate::csy::{Csy, Transformation};
use crate::item::Item;
use std::collections::BTreeMap;

/// How often a target is turned back at most, and how near it has to come (mm): a tenth of a nanometre.
const MOST_TURNS: usize = 30;
const NEAR_MM: f64 = 1e-7;

/// What a server calls the tool after a change that failed.
const UNKNOWN_TOOL: &str = "UnDefTool";
/// What it calls an empty holder.
const NO_TOOL: &str = "NoTool";

/// Where the tip of a tool stands from the ram reference point (m, ram frame): as whoever runs the relay says, or as the server
/// says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Offsets {
    /// By name of the tool.
    pub by_tool_m: BTreeMap<String, [f64; 3]>,
    /// Of every other tool.
    pub of_any_m: Option<[f64; 3]>,
    /// Whether the server is asked for those of tools without a name here (`Tool.AvrOffsets`).
    pub from_server: bool,
}

impl Offsets {
    /// The offset of a tool as far as it stands here.
    pub fn of(&self, tool: Option<&str>) -> Option<[f64; 3]> {
        tool.and_then(|tool| self.by_tool_m.get(tool)).copied().or(self.of_any_m)
    }

    /// Why no offset holds for a tool whatever is known of offsets, not even one for all tools; `None` where one may.
    pub fn refused(&self, tool: Option<&str>, is_turned: bool) -> Option<String> {
        let words = match tool {
            Some(UNKNOWN_TOOL) => {
                "the server does not know which tool is in the machine; tell it with ChangeTool or SetTool".to_owned()
            }
            Some(NO_TOOL) if !self.by_tool_m.contains_key(NO_TOOL) => {
                "no tool is in the machine, so that no tip has a position".to_owned()
            }
            _ if is_turned && self.of(tool).is_some() => format!(
                "tool {} was turned, and its offset is known for one direction only; let the server tell offsets",
                tool.unwrap_or("without a name")
            ),
            _ => return None,
        };
        Some(words)
    }
}

/// Whether setting these properties may move the tip in its tool; parameters of its movements do not.
pub fn moves_tip(properties: &[Item]) -> bool {
    let mut names = properties.iter().filter_map(|item| Some(item.call()?.0));
    names.any(|name| !name.contains("Par.") && name.contains("Tool"))
}

/// Where points are told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Place {
    pub(super) csy: Csy,
    pub(super) from_machine: Transformation,
    pub(super) offset_m: [f64; 3],
}

impl Place {
    /// The corrected point for a reported one, both in the active system (mm).
    pub(super) fn corrected_mm(
        &self,
        reported_mm: [f64; 3],
        correct: &mut dyn Correct,
        purpose: Purpose,
    ) -> Result<[f64; 3], Refused> {
        let is_moved = self.csy != Csy::Machine && !self.from_machine.is_identity();
        let indicated_mm = if is_moved { self.from_machine.to_machine(reported_mm) } else { reported_mm };
        let corrected_m = correct.corrected_m(indicated_mm.map(|mm| mm / 1e3), self.offset_m, purpose)?;
        let corrected_mm = corrected_m.map(|metres| metres * 1e3);
        Ok(if is_moved { self.from_machine.from_machine(corrected_mm) } else { corrected_mm })
    }

    /// As [`Place::corrected_mm`], for a report.
    pub(super) fn convert(&self, reported_mm: [f64; 3], correct: &mut dyn Correct) -> Converted {
        self.corrected_mm(reported_mm, correct, Purpose::Report).map(Some)
    }

    /// The target that the machine has to be given so that the tip goes where `wanted_mm` says, in the active system (mm).
    pub(super) fn target_mm(&self, wanted_mm: [f64; 3], correct: &mut dyn Correct) -> Result<[f64; 3], Refused> {
        let mut target_mm = wanted_mm;
        for _ in 0..MOST_TURNS {
            let reached_mm = self.corrected_mm(target_mm, correct, Purpose::Target)?;
            let missed_mm: [f64; 3] = std::array::from_fn(|d| wanted_mm[d] - reached_mm[d]);
            if missed_mm.iter().all(|mm| mm.abs() < NEAR_MM) {
                return Ok(target_mm);
            }
            target_mm = std::array::from_fn(|d| target_mm[d] + missed_mm[d]);
        }
        Err("no target was found from which the tip comes there".to_owned())
    }
}
