//! How many seeds a statistical test tries: some of them each time, all of them with `ABBE_SEEDS=all` (`just seeds`).

#![allow(dead_code)] // each test uses its part

/// Of so many seeds those to try, as a count from the first.
pub(crate) fn seeds(all: u64) -> u64 {
    if std::env::var("ABBE_SEEDS").is_ok_and(|how| how == "all") { all } else { all.div_ceil(5) }
}

/// Of these cases those to try, from the first.
pub(crate) fn some_of<T>(cases: &[T]) -> &[T] {
    let count = usize::try_from(seeds(cases.len() as u64)).unwrap_or(usize::MAX);
    &cases[..count.min(cases.len())]
}

/// Most of so many cases that a test at one in twenty may lose; one where they are few.
pub(crate) fn one_in_twenty(cases: u64) -> usize {
    usize::try_from(cases / 20).unwrap_or(usize::MAX).max(1)
}
