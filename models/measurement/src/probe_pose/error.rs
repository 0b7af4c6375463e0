//! Why no pose of the probe is given, and what to do.
//!
//! Place in the flow: returned by [`super::ProbePose::fit`]. Centres are counted from 1.

use super::undetermined::Undetermined;
use thiserror::Error;

/// Centres that give no pose.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ProbePoseError {
    /// A figure is not finite.
    #[error("centre {0} holds a figure that is not finite; remove or correct it")]
    NotFinite(usize),
    /// An uncertainty that cannot be.
    #[error("centre {0} has an uncertainty that is not above zero; correct it")]
    Uncertainty(usize),
    /// A row given twice.
    #[error("centres {first} and {second} are the same to the last digit; remove the copy")]
    Duplicate {
        /// The earlier one.
        first: usize,
        /// The later one.
        second: usize,
    },
    /// The poses do not determine all unknowns.
    #[error(transparent)]
    Undetermined(#[from] Undetermined),
    /// Centres that fit far better when columns are read in another way.
    #[error(
        "the centres fit {ratio:.0} times better {}; angles are right-handed about the machine's axes, A about X, C about Z",
        .mistakes.join("; or ")
    )]
    Misread {
        /// What may be mixed up, and the remedy; likeliest first.
        mistakes: Vec<&'static str>,
        /// Ratio of the root mean squares, of the likeliest.
        ratio: f64,
    },
    /// Centres that no head leaves.
    #[error(
        "the fit leaves {rms_mm:.3} mm rms at a lever of {lever_mm:.0} mm; no head is that bad: check the order and units of the \
         columns, and that the centres are of one sphere that did not move"
    )]
    NoHead {
        /// Root mean square of the residuals (mm).
        rms_mm: f64,
        /// Length from the A axis to the beam's end (mm).
        lever_mm: f64,
    },
    /// A head of a size that none has.
    #[error(
        "the beam's end is {lever_mm:.6} mm from the A axis, as at no head; check the unit: d_mm, x_mm, y_mm and z_mm are millimetres"
    )]
    Size {
        /// Length from the A axis to the beam's end (mm).
        lever_mm: f64,
    },
    /// A beam whose length is not near one.
    #[error(
        "the probe's reading moves the point by {length:.4} of what it reads; it must be near 1: check the unit and sign of the \
         distance and the angles"
    )]
    Beam {
        /// Length of R_p.
        length: f64,
    },
    /// The constraint on the beam's length did not settle.
    #[error("the fit with a beam of length one did not settle in {0} passes; check angles and distances")]
    NotSettled(usize),
    /// No pose has enough others to judge it.
    #[error("no pose can be left out: the others do not determine the unknowns; measure at further angles")]
    NothingLeftOut,
}
