//! Candidates of a study of residual vectors: effects of the machine, names of a plane, smooth forms, steps in time.
//!
//! Place in the flow: called once when a study is made of its vectors; each candidate goes in beside the part that makes its columns.

use super::super::angle::Angle;
use super::super::drift::Drift;
use super::super::linear::{Named, unseen};
use super::super::plate::calibration_words;
use super::super::quantities::{POSITION, TIME, leads};
use super::super::registered::registered;
use super::super::shape::{Bent, Quantity, Shape};
use super::super::wave::Wave;
use super::{IN_PAIRS, PLAUSIBLE_M, Part, Vectors};
use crate::error::DiagnoseError;
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes};
use crate::study::outcome::Untestable;
use abbe_geometry::effects::ParameterSpec;
use abbe_geometry::{Axis, ErrorId};

/// What poses that lie alike leave open.
const UNTURNED: &str = "the plate's own form: its poses are not turned against each other, so that plate and machine cannot be told apart; turn it \
                        by 90 degrees between two poses, or give the uncertainty of its calibration in u_plate_um";

impl Vectors<'_> {
    pub(super) fn add_registered(&mut self) -> Result<(), DiagnoseError> {
        let Some(machine) = self.machine else {
            self.untestable.push(Untestable {
                name: "every registered effect of a machine".to_owned(),
                needs: "the machine file of the chain behind the positions".to_owned(),
            });
            return Ok(());
        };
        // Positions are no covariates; they come first among the quantities.
        let logged = |quantity: &&Quantity| !POSITION.contains(&quantity.name.as_str());
        let varying: Vec<String> = self.quantities.iter().filter(logged).map(|q| q.name.clone()).collect();
        let time_s = self.quantities.iter().find(|quantity| quantity.name == TIME).map_or((0.0, 0.0), |q| q.range);
        let (effects, untestable) = registered((self.vectors, &self.nominal), machine, &varying, time_s)?;
        for effect in effects {
            self.candidates.push(effect.candidate.clone());
            self.parts.push(Part::Registered(effect));
        }
        self.untestable.extend(untestable);
        Ok(())
    }

    /// Waves of linear axes. Where joints are logged and no machine is named, positions are no readings of any: on a robot several waves along a
    /// coordinate fit, turn their sign from one stretch of time to the next, and bring the error down by hundredths of a micrometre.
    pub(super) fn add_waves(&mut self) -> Result<(), DiagnoseError> {
        if !self.has_names() {
            return Ok(());
        }
        for wave in Wave::all(self.vectors, self.measured, self.machine)? {
            self.candidates.push(wave.candidate());
            self.parts.push(Part::Wave(wave));
        }
        Ok(())
    }

    /// Angular errors of the axes of a machine.
    pub(super) fn add_angles(&mut self) {
        for angle in Angle::all(&self.quantities, &self.nominal, self.measured) {
            self.candidates.push(angle.candidate());
            self.parts.push(Part::Angle(angle));
        }
    }

    /// Scales and squareness of the axes that positions span.
    pub(super) fn add_named(&mut self, is_scale_unknown: bool) {
        if !self.has_names() {
            return;
        }
        let axes = self.poses.axes();
        let is_moved = |named: &Named| {
            let moved = |k: usize| named.motion_m(&self.poses.arm_m(self.vectors, k));
            (0..self.vectors.len()).any(|k| (0..3).any(|d| self.measured[d] && moved(k)[d] != 0.0))
        };
        for named in Named::all(&axes, self.machine, is_scale_unknown) {
            if is_moved(&named) {
                self.candidates.push(named.candidate());
                self.parts.push(Part::Named(named));
            }
        }
        // None in a volume.
        let unseen = unseen(&axes, self.machine).into_iter();
        self.untestable.extend(unseen.map(|(name, needs)| Untestable { name, needs }));
    }

    /// The same candidates where the plate's own scale is one of the unknowns.
    pub(in crate::study::vectors) fn with_unknown_scale(&mut self) {
        // A contrast mixes the times of two poses.
        self.retain(|part| !matches!(part, Part::Named(_) | Part::Step(..)));
        let names: Vec<String> = unseen(&self.poses.axes(), self.machine).into_iter().map(|(name, _)| name).collect();
        self.untestable.retain(|own| !names.contains(&own.name));
        self.add_named(true);
        for axis in self.poses.axes() {
            let name = format!("scale of {0} (E{0}{0}, straight part), by itself", axis.letter());
            let needs = "a calibrated length: the plate's own scale is one of the unknowns. Without the column point the \
                         plate is taken as it was calibrated";
            self.untestable.push(Untestable { name, needs: needs.to_owned() });
        }
    }

    /// Axis whose position nobody gave.
    pub(super) fn lacking_axis(&self) -> Option<Axis> {
        Axis::ALL.into_iter().find(|axis| self.vectors[0].position_lacks[axis.index()])
    }

    pub(super) fn add_plate_notes(&mut self) {
        if !self.poses.is_plate() {
            return;
        }
        let needs = "a plate whose place on the machine is known: its shift and turn are fitted";
        self.untestable.push(Untestable { name: "a shift or turn of the whole".to_owned(), needs: needs.to_owned() });
        if let Some(axis) = self.lacking_axis() {
            self.notes.push(format!("Positions have no {}: they were taken to lie in one plane.", axis.lower()));
        }
    }

    pub(super) fn add_smooth(&mut self) {
        let leads = |k: usize| leads(&self.quantities[k].name);
        let is_pair = |first: usize, second: usize| second < IN_PAIRS || leads(first) || leads(second);
        for shape in Shape::all(&self.quantities, is_pair) {
            let bent = shape.bent(&self.quantities, |k| self.is_spanned(k));
            if bent.kept.is_empty() {
                continue;
            }
            for axis in Axis::ALL.into_iter().filter(|axis| self.measured[axis.index()]) {
                self.candidates.push(self.smooth_candidate(&bent, axis));
                self.parts.push(Part::Smooth(axis, bent.clone()));
            }
        }
    }

    pub(super) fn add_steps(&mut self) {
        for step in self.steps.all() {
            for axis in Axis::ALL.into_iter().filter(|axis| self.measured[axis.index()]) {
                self.candidates.push(self.steps.candidate(&step, axis, &self.rows_of_file));
                self.parts.push(Part::Step(axis, step.clone()));
            }
        }
    }

    /// What no machine does, and its instrument or a plate does: turns and scales of the whole in time.
    pub(super) fn add_drifts(&mut self) {
        let Some((_, time_s)) = self.time() else { return };
        let drifts = Drift::all(time_s).into_iter();
        let is_moved = |drift: &Drift| {
            let moved = |k: usize| drift.motion.of(&self.poses.arm_m(self.vectors, k));
            (0..self.vectors.len()).any(|k| (0..3).any(|d| self.measured[d] && moved(k)[d] != 0.0))
        };
        let drifts: Vec<Drift> = drifts.filter(is_moved).collect();
        for drift in drifts {
            self.candidates.push(drift.candidate(self.poses.is_plate(), TIME));
            self.parts.push(Part::Drift(drift));
        }
    }

    /// Without what no machine does: the instrument was checked.
    pub(in crate::study::vectors) fn without_drifts(&mut self) {
        self.retain(|part| !matches!(part, Part::Drift(_)));
    }

    /// Keeps candidates of these parts only.
    fn retain(&mut self, is_kept: impl Fn(&Part) -> bool) {
        let is_kept: Vec<bool> = self.parts.iter().map(is_kept).collect();
        let mut kept = is_kept.iter();
        self.candidates.retain(|_| kept.next().is_some_and(|is_kept| *is_kept));
        let mut kept = is_kept.iter();
        self.parts.retain(|_| kept.next().is_some_and(|is_kept| *is_kept));
    }

    /// Whether what is straight in a position has a name: on a plate, and in the volume of a machine with linear axes. A robot, whose
    /// joints are logged, has neither scales nor squareness.
    fn has_names(&self) -> bool {
        let is_joint = |quantity: &Quantity| quantity.name.ends_with("_deg");
        self.poses.is_plate() || self.machine.is_some() || !self.quantities.iter().any(is_joint)
    }

    /// Whether the straight line in a quantity has a name: scale, squareness or a turn of the pose.
    fn is_spanned(&self, quantity: usize) -> bool {
        let is_own = |axis: &Axis| POSITION[axis.index()] == self.quantities[quantity].name;
        self.has_names() && self.poses.axes().iter().any(is_own)
    }

    fn smooth_candidate(&self, bent: &Bent, axis: Axis) -> Candidate {
        let shape = bent.shape;
        let (words, formula) = shape.words(&self.quantities);
        let all = shape.parameters();
        let names: Vec<String> = shape.quantities().iter().map(|k| self.quantities[*k].name.clone()).collect();
        let beyond = if bent.is_less() { " beyond the straight line" } else { "" };
        let (name, kind, goes) = match self.linear_error(shape, axis) {
            Some(error) => (format!("{error}{beyond}"), Explanation::Attributed, Goes::BeforeDescriptions),
            None => {
                let name = format!("{words}{beyond}, component {}", axis.lower());
                (name, Explanation::Empirical, Goes::ByEvidence)
            }
        };
        Candidate {
            name,
            formula: formula.to_owned(),
            kind,
            family: format!("{}, component {}", names.join(" and "), axis.lower()),
            decided_by: match names.as_slice() {
                [one] => format!("vary {one} independently of all else"),
                _ => format!("vary {} independently of each other and of all else", names.join(" and ")),
            },
            covariates: names,
            parameters: bent.kept.iter().map(|k| ParameterSpec::new(all[*k].clone(), "m", PLAUSIBLE_M)).collect(),
            essential: Vec::new(),
            stands_apart: matches!(shape, Shape::Turn { .. }),
            goes,
        }
    }

    /// What a smooth form of one position is called on a machine with linear axes, by its definition in ISO 230-1.
    fn linear_error(&self, shape: Shape, along: Axis) -> Option<String> {
        let (Some(_), Shape::One { quantity, degree: degree @ 2.. }) = (self.machine, shape) else { return None };
        let is_own = |axis: &Axis| POSITION[axis.index()] == self.quantities[quantity].name;
        let axis = Axis::ALL.into_iter().find(is_own)?;
        let name = ErrorId::linear(along, axis).name();
        Some(match axis == along {
            true => format!("positioning error {name} of {}, degree {degree}", axis.letter()),
            false => format!("straightness {name} of {} along {}, degree {degree}", axis.letter(), along.letter()),
        })
    }

    /// The component that a smooth form moves; `None` of any other candidate.
    pub(in crate::study::vectors) fn smooth_on(&self, candidate: usize) -> Option<Axis> {
        let Part::Smooth(axis, _) = &self.parts[candidate] else { return None };
        Some(*axis)
    }

    /// Positions along an axis, where they vary.
    pub(in crate::study::vectors) fn position(&self, axis: Axis) -> Option<&Quantity> {
        self.quantities.iter().find(|quantity| quantity.name == POSITION[axis.index()])
    }

    /// What a reader must know.
    pub(super) fn told(&self) -> Vec<String> {
        let mut notes = vec![
            format!("Left out to judge: one {} at a time, {} in all.", self.block_word, self.blocks.len()),
            self.poses.words(self.machine.is_some()).to_owned(),
        ];
        if self.poses.is_plate() {
            let is_calibrated = self.vectors.iter().all(|vector| vector.u_plate_m.is_some());
            notes.push(calibration_words(is_calibrated, !self.hidden.is_empty()).to_owned());
        }
        notes.extend(self.notes.iter().cloned());
        if self.quantities.len() > IN_PAIRS {
            let names: Vec<&str> = self.quantities[IN_PAIRS..].iter().map(|quantity| quantity.name.as_str()).collect();
            notes.push(format!(
                "Tried alone and with positions and the time, not with each other: {}.",
                names.join(", ")
            ));
        }
        notes
    }

    /// Says that poses which are not turned against each other hold the plate's own form alike, where their points are named.
    pub(in crate::study::vectors) fn note_unturned(&mut self) {
        let is_calibrated = self.vectors.iter().all(|vector| vector.u_plate_m.is_some());
        if self.poses.list.len() > 1 && self.vectors.iter().all(|vector| vector.point.is_some()) && !is_calibrated {
            self.hidden.push(UNTURNED.to_owned());
        }
    }
}
