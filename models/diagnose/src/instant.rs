//! Whether a jump that was found is one instant, or a part of something that takes its time.
//!
//! Place in the flow: the end of [`crate::diagnose()`], for what happens once: the zero of a tracer jumps, or its stand. An arm that creeps for minutes
//! after its carriage moved leaves whole lines off, and a step through the best of the pauses between them explains a part of that. What
//! jumps leaves nothing behind. So a jump is the cause only where the lines are noise beside it, where nothing that takes its time explains
//! as much, and where no other jump or drift beside it is a description. Else it describes: it corrects no less, and stands in U.

use crate::context::follows_time;
use crate::diagnosis::{Found, Rival};
use crate::explanation::Explanation;
use crate::noise::Detection;
use abbe_geometry::effects::{Effect, construct};
use abbe_geometry::machine::Machine;

/// Leaves jumps that are not shown to be one instant as descriptions. `effects` are those found, in their order, `left` is what the residual
/// says beside all of them, at this significance.
pub(crate) fn hold<'e>(
    found: &mut [Found],
    effects: impl Iterator<Item = &'e dyn Effect>,
    (left, significance): (&Detection, f64),
    machine: &Machine,
) {
    let is_off = left.between_lines.p_value < significance;
    let moves: Vec<(bool, bool)> = effects.map(|effect| (effect.happens_once(), effect.moves_stand())).collect();
    let describes =
        |(found, (once, stand)): (&Found, &(bool, bool))| (*once || *stand) && found.kind == Explanation::Empirical;
    let is_one_of_several = found.iter().zip(&moves).any(describes);
    for (found, _) in found.iter_mut().zip(&moves).filter(|(_, (once, _))| *once) {
        if is_off || is_one_of_several || found.rivals.iter().any(|rival| takes_its_time(rival, machine)) {
            found.kind = Explanation::Empirical;
        }
    }
}

/// Whether it is a course in time. What cannot be made for this machine is no rival.
fn takes_its_time(rival: &Rival, machine: &Machine) -> bool {
    construct(rival.name, &rival.shape, machine)
        .is_ok_and(|effect| follows_time(effect.as_ref(), &rival.shape) && !effect.happens_once())
}
