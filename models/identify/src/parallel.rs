//! Work on parts side by side, with results in the order of the parts.
//!
//! Place in the flow: sums over large campaigns here, the look without candidates in diagnosis. A result never depends on
//! the number of threads, since the parts do not.

use std::num::NonZero;
use std::sync::OnceLock;

/// Maps parts on as many threads as the machine has, keeping their order.
pub fn in_parallel<P: Sync, R: Send>(parts: &[P], work: impl Fn(&P) -> R + Sync) -> Vec<R> {
    let threads = if parts.len() < 2 { 1 } else { cores().min(parts.len()) };
    if threads < 2 {
        return parts.iter().map(work).collect();
    }
    let mut results: Vec<Option<R>> = parts.iter().map(|_| None).collect();
    let share = parts.len().div_ceil(threads);
    let mut shares = parts.chunks(share).zip(results.chunks_mut(share));
    let one = |(parts, results): (&[P], &mut [Option<R>])| {
        parts.iter().zip(results).for_each(|(part, result)| *result = Some(work(part)));
    };
    std::thread::scope(|scope| {
        // The first share is this thread's own: it would wait.
        let own = shares.next();
        for share in shares {
            scope.spawn(move || one(share));
        }
        own.into_iter().for_each(one);
    });
    results.into_iter().flatten().collect()
}

/// Cores that this process may use. Asked once: the system opens files for the answer.
fn cores() -> usize {
    static CORES: OnceLock<usize> = OnceLock::new();
    *CORES.get_or_init(|| std::thread::available_parallelism().map_or(1, NonZero::get))
}
