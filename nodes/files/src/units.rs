//! Millimetres and micrometres of files against the metres of everything else.
//!
//! Place in the flow: readers divide (`mm / 1e3`, correctly rounded), writers call these, so that what was read
//! is written back as it stood.

/// The shortest number of millimetres that reads back as exactly `value_m`, or the nearest there is.
pub(crate) fn millimetres_from_m(value_m: f64) -> f64 {
    shortest(value_m, 1e3)
}

/// The shortest number of micrometres that reads back as exactly `value_m`, or the nearest there is.
pub(crate) fn micrometres_from_m(value_m: f64) -> f64 {
    shortest(value_m, 1e6)
}

/// Tries one digit after the other, because the product alone would write 0.05 as 0.049999999999999996. Some
/// values have no such number at all: multiples of a thousandth lie further apart than the values they stand for.
fn shortest(value: f64, factor: f64) -> f64 {
    let product = value * factor;
    let rounded = (0..17).filter_map(|digits| format!("{product:.digits$e}").parse().ok());
    let mut candidates = rounded.chain([product, product.next_up(), product.next_down()]);
    candidates.find(|candidate| candidate / factor == value).unwrap_or(product)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What a file says in mm or µm is written back so that it reads the same.
        #[test]
        fn lengths_read_from_a_file_are_written_back_the_same(value in -1e7f64..1e7) {
            prop_assert_eq!(millimetres_from_m(value / 1e3) / 1e3, value / 1e3);
            prop_assert_eq!(micrometres_from_m(value / 1e6) / 1e6, value / 1e6);
        }

        #[test]
        fn short_numbers_stay_short(tenths in -100_000i64..100_000) {
            let mm = tenths as f64 / 10.0;
            prop_assert_eq!(format!("{}", millimetres_from_m(mm / 1e3)), format!("{mm}"));
        }
    }
}
