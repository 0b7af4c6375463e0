//! Long pieces of work side by side, with one observer for all.
//!
//! Place in the flow: [`crate::judge`] repeats the search without each fold of lines, [`crate::competing`] fits without each effect and with
//! each rival; these know nothing of each other. The observer
//! belongs to the caller's thread, so the pieces tell theirs what they would tell it. Results come in the order of the pieces and do not
//! depend on how many threads there are.

use crate::error::DiagnoseError;
use crate::options::Progress;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Mutex, PoisonError};

/// Works on the pieces 0 … count − 1 on as many threads as the machine has. Once the observer wants to stop, every piece is told so, and no
/// other begins.
///
/// # Errors
/// [`DiagnoseError::Stopped`] where the observer wanted that, whenever it said so: a piece may have asked for the last time.
pub(crate) fn side_by_side<R: Send>(
    count: usize,
    work: impl Fn(usize, &mut dyn FnMut(Progress) -> bool) -> R + Sync,
    observe: &mut dyn FnMut(Progress) -> bool,
) -> Result<Vec<R>, DiagnoseError> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get()).min(count);
    let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    let done: Mutex<Vec<(usize, R)>> = Mutex::new(Vec::new());
    let (tell, heard) = channel();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (tell, work, next, stopped, done) = (tell.clone(), &work, &next, &stopped, &done);
            scope.spawn(move || {
                let mut observe = |progress| tell.send(progress).is_ok() && !stopped.load(Ordering::Relaxed);
                loop {
                    let piece = next.fetch_add(1, Ordering::Relaxed);
                    if piece >= count || stopped.load(Ordering::Relaxed) {
                        break;
                    }
                    let result = work(piece, &mut observe);
                    done.lock().unwrap_or_else(PoisonError::into_inner).push((piece, result));
                }
            });
        }
        drop(tell);
        for progress in heard {
            if !stopped.load(Ordering::Relaxed) && !observe(progress) {
                stopped.store(true, Ordering::Relaxed);
            }
        }
    });
    if stopped.into_inner() {
        return Err(DiagnoseError::Stopped);
    }
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(piece, _)| *piece);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judging(fold: usize) -> Progress {
        Progress::Judging { fold, folds: 9 }
    }

    #[test]
    fn results_come_in_order_and_all_is_told_here() {
        let here = std::thread::current().id();
        let mut told = Vec::new();
        let work = |piece: usize, observe: &mut dyn FnMut(Progress) -> bool| {
            assert!(observe(judging(piece)));
            piece * piece
        };
        let results = side_by_side(9, work, &mut |progress| {
            assert_eq!(std::thread::current().id(), here);
            told.push(progress);
            true
        });
        assert_eq!(results.unwrap(), [0, 1, 4, 9, 16, 25, 36, 49, 64]);
        assert_eq!(told.len(), 9);
        assert_eq!(side_by_side(0, work, &mut |_| true).unwrap(), [0_usize; 0]);
    }

    #[test]
    fn every_piece_hears_that_it_is_to_stop() {
        let work = |piece: usize, observe: &mut dyn FnMut(Progress) -> bool| {
            // The word needs a moment; a piece that never heard of it would go on for ever.
            while observe(judging(piece)) {
                std::thread::yield_now();
            }
            piece
        };
        assert!(matches!(side_by_side(3, work, &mut |_| false), Err(DiagnoseError::Stopped)));
    }

    /// The word came when the last piece had asked for the last time: nobody heard of it.
    #[test]
    fn regress_a_stop_in_the_last_moment_is_a_stop() {
        let work = |piece: usize, observe: &mut dyn FnMut(Progress) -> bool| observe(judging(piece));
        assert!(matches!(side_by_side(1, work, &mut |_| false), Err(DiagnoseError::Stopped)));
    }
}
