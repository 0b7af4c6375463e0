//! Millimetres and micrometres of files against the metres of everything else.
//!
//! Place in the flow: readers divide (`mm / 1e3`, correctly rounded), writers call these, so that what was read
//! is written back as it stood.

/// The shortest number of millimetres that reads back as exactly `value_m`, or the nearest there is.
pub(crate) fn millimetres_from_m(value_m: f64) -> f64 {
    scaled(value_m, 3, 1e3)
}

/// The shortest number of micrometres that reads back as exactly `value_m`, or the nearest there is.
pub(crate) fn micrometres_from_m(value_m: f64) -> f64 {
    scaled(value_m, 6, 1e6)
}

/// Shifts the decimal point of the shortest text of `value` first, because the product alone would turn 0.05 into
/// 0.049999999999999996; takes a neighbour where that reads back differently.
fn scaled(value: f64, places: i32, factor: f64) -> f64 {
    let shifted = format!("{value:e}").split_once('e').and_then(|(mantissa, exponent)| {
        let exponent: i32 = exponent.parse().ok()?;
        format!("{mantissa}e{}", exponent + places).parse().ok()
    });
    let product = value * factor;
    let candidates = [shifted.unwrap_or(product), product, product.next_up(), product.next_down()];
    candidates.into_iter().find(|candidate| candidate / factor == value).unwrap_or(candidates[0])
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
