//! Whether a jump that was found is one instant, or a part of something that takes its time.
//!
//! Place in the flow: the end of [`crate::kind`], for what happens once: the zero of a tracer jumps, or its stand. An arm that creeps for minutes
//! after its carriage moved leaves whole lines off, and a step through the best of the pauses between them explains a part of that. What
//! jumps leaves nothing behind. So a jump is the cause only where the lines are noise beside it, where nothing that takes its time explains
//! as much, and where no other jump or drift beside it is a description. Else it describes: it corrects no less, and stands in U.

use crate::candidates::Candidate;
use crate::context::takes_its_time;
use crate::explanation::Explanation;
use abbe_geometry::effects::Effect;

/// What was found, and what explains nearly as much.
pub(crate) struct Moves<'a> {
    pub(crate) effect: &'a dyn Effect,
    pub(crate) rivals: &'a [Candidate],
}

/// Leaves jumps that are not shown to be one instant as descriptions; `is_off` where lines are more than noise beside all that was found.
pub(crate) fn hold(found: &mut [(&mut Explanation, Moves)], is_off: bool) {
    let moves = |own: &Moves| own.effect.happens_once() || own.effect.moves_stand();
    let is_one_of_several = found.iter().any(|(kind, own)| moves(own) && **kind == Explanation::Empirical);
    for (kind, own) in found.iter_mut().filter(|(_, own)| own.effect.happens_once()) {
        if is_off || is_one_of_several || own.rivals.iter().any(|rival| takes_its_time(&rival.term)) {
            **kind = Explanation::Empirical;
        }
    }
}
