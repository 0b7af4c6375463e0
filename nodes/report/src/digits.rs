//! How many digits a number is shown with, on pages and on terminals alike.
//!
//! A number beside its uncertainty has the decimals that show the uncertainty with two digits (GUM, 7.2.6); a result whose
//! uncertainty is not stated has three digits. All digits are in JSON and CSV files. In: values in the unit that is shown;
//! out: decimals, or text for a terminal. There a number is one that programs read, with an ASCII minus sign and `e`, so that
//! it can be taken from the screen; units and other signs are those of pages.

use crate::text;

/// Digits of a result whose uncertainty is not stated.
const RESULT_DIGITS: i32 = 3;
/// Digits of an uncertainty.
const UNCERTAINTY_DIGITS: i32 = 2;
/// A result below this, in any unit that is shown, is rounding of the arithmetic.
const NOTHING: f64 = 1e-9;
/// Share of the last digit that is rounding of the arithmetic.
const ROUNDING: f64 = 1e-6;
/// Probabilities below this are told by the power of ten that they are below.
const RARE: f64 = 1e-3;
/// Probabilities below this are beyond what the distributions are computed to.
const SMALLEST_P: f64 = 1e-300;

/// Decimals of a result whose uncertainty is not stated; none of what is nothing but rounding.
pub fn of_result(value: f64) -> u8 {
    if value.abs() < NOTHING { 0 } else { text::decimals(value, RESULT_DIGITS) }
}

/// Decimals of an uncertainty itself.
pub fn of_uncertainty(u: f64) -> u8 {
    text::decimals(u, UNCERTAINTY_DIGITS)
}

/// Decimals of a value and of its uncertainty, any coverage; those of a result where no uncertainty is known.
pub fn of(value: f64, uncertainty: Option<f64>) -> u8 {
    match uncertainty {
        Some(u) if u > 0.0 && u.is_finite() => of_uncertainty(u),
        _ => of_result(value),
    }
}

/// Decimals of several numbers that are read side by side, as in a table's column: those of the largest.
pub fn of_group(values: impl IntoIterator<Item = f64>) -> u8 {
    values.into_iter().map(f64::abs).filter(|v| v.is_finite()).reduce(f64::max).map_or(0, of_result)
}

/// A result whose uncertainty is not stated, for a terminal.
pub fn result(value: f64) -> String {
    plain(value, of_result(value))
}

/// An uncertainty, for a terminal.
pub fn uncertainty(u: f64) -> String {
    plain(u, of_uncertainty(u))
}

/// A value and its uncertainty with the same decimals, for a terminal.
pub fn with_uncertainty(value: f64, u: f64) -> [String; 2] {
    let decimals = of(value, Some(u));
    [plain(value, decimals), plain(u, decimals)]
}

/// A limit that holds whatever the exact one does: rounded up at the last decimal.
pub fn up(limit: f64, decimals: u8) -> f64 {
    let unit = 10f64.powi(i32::from(decimals));
    (limit * unit - ROUNDING).ceil() / unit
}

/// The same in ASCII.
pub fn rounded_up(limit: f64, decimals: u8) -> String {
    plain(up(limit, decimals), decimals)
}

/// A probability by chance, for a terminal: two digits, or the power of ten that it is below.
pub fn chance(p: f64) -> String {
    if p >= RARE {
        return plain(p, text::decimals(p, UNCERTAINTY_DIGITS));
    }
    let power = p.max(SMALLEST_P).log10().floor() + 1.0;
    format!("below 1e{}", if p < SMALLEST_P { -300.0 } else { power })
}

/// A sentence of a page on a terminal: its numbers are such that programs read them.
pub fn taken(sentence: &str) -> String {
    sentence.replace('−', "-")
}

/// A number with as many decimals, in ASCII and without a negative zero.
pub fn plain(value: f64, decimals: u8) -> String {
    let text = format!("{value:.*}", usize::from(decimals));
    match text.strip_prefix('-') {
        Some(rest) if rest.bytes().all(|b| matches!(b, b'0' | b'.')) => rest.to_owned(),
        _ => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_has_three_digits_and_an_uncertainty_two() {
        assert_eq!([40.1234, 4.01234, 0.401234, 1234.5].map(result), ["40.1", "4.01", "0.401", "1234"]);
        // 9.996 with three digits is 10.0, 0.0996 with two is 0.10.
        assert_eq!(
            (result(9.996), uncertainty(0.0996), uncertainty(12.3)),
            ("10.0".into(), "0.10".into(), "12".into())
        );
        assert_eq!([0.0, -0.0, -3e-13].map(result), ["0", "0", "0"]);
    }

    #[test]
    fn a_value_has_the_decimals_of_its_uncertainty() {
        assert_eq!(with_uncertainty(-31.812, 2.83), ["-31.8", "2.8"]);
        assert_eq!(with_uncertainty(-0.004, 0.13), ["0.00", "0.13"]);
        assert_eq!((of(40.1234, None), of(40.1234, Some(0.0)), of(40.1234, Some(f64::NAN))), (1, 1, 1));
    }

    /// 4.99×10⁻³³ has digits that no distribution has.
    #[test]
    fn regress_a_rare_chance_is_told_by_its_power() {
        let told = [0.948, 0.0034, 4.99e-33, 0.0].map(chance);
        assert_eq!(told, ["0.95", "0.0034", "below 1e-32", "below 1e-300"]);
    }

    #[test]
    fn a_limit_is_rounded_up() {
        assert_eq!([rounded_up(48.612, 1), rounded_up(48.6, 1), rounded_up(0.0, 2)], ["48.7", "48.6", "0.00"]);
    }

    #[test]
    fn numbers_side_by_side_have_the_decimals_of_the_largest() {
        assert_eq!(of_group([0.0123, -39.2, f64::NAN]), 1);
        assert_eq!(of_group([]), 0);
    }
}
