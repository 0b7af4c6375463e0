//! Which known name a misspelt one was meant to be.
//!
//! Place in the flow: the readers of machine, campaign and point files put it into their messages.

/// The known name nearest to `name`, if it is near enough to be a slip of the pen: one letter in short names, two
/// in longer ones, case aside.
pub(crate) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = name.to_lowercase();
    known
        .into_iter()
        .map(|candidate| (strsim::damerau_levenshtein(&lower, &candidate.to_lowercase()), candidate))
        .filter(|(distance, candidate)| *distance <= if candidate.len() < 6 { 1 } else { 2 })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}
