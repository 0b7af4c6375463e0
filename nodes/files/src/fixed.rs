//! Numbers with a fixed count of decimals, for tables of many rows.
//!
//! Place in the flow: below [`crate::points_csv`], which writes six of them a row. The text is that of `{:.N}`, to the last digit; digits
//! of whole numbers take a small part of the time that the exact expansion of a float does.

use std::fmt::Write as _;

/// Digits of the largest whole number below, with room for a point and a sign.
const ROOM: usize = 24;
/// From here on not every half is a float.
const MOST: f64 = (1_u64 << 52) as f64;
/// Powers of ten up to here are floats, and their digits have room.
const MOST_DECIMALS: usize = 16;

/// Appends a number with so many decimals.
pub(crate) fn push_fixed(text: &mut String, value: f64, decimals: usize) {
    match in_last_decimals(value, decimals) {
        Some(whole) => push_digits(text, value.is_sign_negative(), whole, decimals),
        // Writing to a string cannot fail.
        None => drop(write!(text, "{value:.decimals$}")),
    }
}

/// Size of a number in units of its last decimal; `None` where the rounding of the product may decide, or where it is too large.
fn in_last_decimals(value: f64, decimals: usize) -> Option<u64> {
    let power: f64 = (0..decimals).map(|_| 10.0).product();
    let scaled = value.abs() * power;
    let from_half = (scaled - scaled.floor() - 0.5).abs();
    let is_clear = decimals <= MOST_DECIMALS && scaled < MOST && from_half > scaled * f64::EPSILON;
    is_clear.then(|| scaled.round() as u64)
}

fn push_digits(text: &mut String, is_negative: bool, mut whole: u64, decimals: usize) {
    let mut digits = [0_u8; ROOM];
    let mut first = ROOM;
    let mut put = |digit: u8| {
        first -= 1;
        digits[first] = digit;
    };
    for place in 0.. {
        if place > decimals && whole == 0 {
            break;
        }
        if place == decimals && decimals > 0 {
            put(b'.');
        }
        put(b'0' + (whole % 10) as u8);
        whole /= 10;
    }
    if is_negative {
        put(b'-');
    }
    digits[first..].iter().for_each(|digit| text.push(char::from(*digit)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_same(value: f64, decimals: usize) {
        let mut text = String::from("x");
        push_fixed(&mut text, value, decimals);
        assert_eq!(text, format!("x{value:.decimals$}"), "{value:e}");
    }

    #[test]
    fn halves_zeros_and_what_is_no_number_are_written_as_floats_are() {
        let edges = [
            0.0,
            -0.0,
            0.5,
            1.5,
            2.5,
            -0.25,
            0.125,
            0.05,
            1e-9,
            -1e-9,
            9.999_999_95,
            9.999_999_949,
            99_999_999.999_999_99,
        ];
        let odd = [f64::NAN, f64::INFINITY, -1e300, 4.5e15, 450_359_962.737_049_6, 1e22, f64::MIN_POSITIVE];
        for value in edges.into_iter().chain(odd) {
            (0..10).for_each(|decimals| is_same(value, decimals));
        }
    }

    proptest! {
        #[test]
        fn any_number_is_written_as_floats_are(value in proptest::num::f64::ANY, decimals in 0_usize..24) {
            is_same(value, decimals);
        }

        #[test]
        fn coordinates_are_written_as_floats_are(value in -2000.0..2000.0_f64, half in -1_000_000_i32..1_000_000) {
            is_same(value, 7);
            is_same(value, 4);
            // One unit and a half of the last decimal, as near as a float comes.
            is_same((f64::from(half) + 0.5) / 1e4, 4);
        }
    }
}
