//! Numbers as the protocol writes them.
//!
//! Place in the flow: read by [`crate::item`], written by [`crate::relay`]. At most 16 digits, no unit, a point for decimals.

/// Digits of a number at most.
const MOST_DIGITS: usize = 16;

/// A number of the protocol: sign, digits with at most one point among or beside them, exponent of at most three digits. Its
/// length in bytes and its value; `None` where there is none, or none that is finite.
pub(crate) fn leading(bytes: &[u8]) -> Option<(usize, f64)> {
    let digits_from = |at: usize| bytes[at.min(bytes.len())..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let is = |at: usize, signs: &[u8]| bytes.get(at).is_some_and(|byte| signs.contains(byte));
    let mut at = usize::from(is(0, b"+-"));
    let whole = digits_from(at);
    at += whole;
    let mut fraction = 0;
    if is(at, b".") {
        fraction = digits_from(at + 1);
        at += 1 + fraction;
    }
    if whole + fraction == 0 {
        return None;
    }
    if is(at, b"Ee") {
        let first = at + 1 + usize::from(is(at + 1, b"+-"));
        let exponent = digits_from(first);
        if !(1..=3).contains(&exponent) {
            return None;
        }
        at = first + exponent;
    }
    let value: f64 = std::str::from_utf8(&bytes[..at]).ok()?.parse().ok()?;
    value.is_finite().then_some((at, value))
}

/// Decimals that a number was written with; an exponent says nothing of them.
pub fn decimals(text: &[u8]) -> usize {
    let after = text.iter().position(|byte| *byte == b'.').map_or(text.len(), |at| at + 1);
    text[after..].iter().take_while(|byte| byte.is_ascii_digit()).count()
}

/// A number with so many decimals, or as many as 16 digits leave room for; `None` for what is no number, or is too large.
pub fn written(value: f64, decimals: usize) -> Option<String> {
    if !value.is_finite() {
        return None;
    }
    let whole = format!("{:.0}", value.trunc().abs()).len();
    let text = format!("{value:.*}", decimals.min(MOST_DIGITS.checked_sub(whole)?));
    // A zero has no sign.
    let is_zero = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    Some(if is_zero { text.trim_start_matches('-').to_owned() } else { text })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_of_the_specification_are_read_and_others_are_not() {
        for (text, value) in
            [("100", 100.0), ("-.77", -0.77), ("7.", 7.0), ("+.1947", 0.1947), ("-2.6E01", -26.0), ("1e-3", 1e-3)]
        {
            assert_eq!(leading(text.as_bytes()), Some((text.len(), value)), "{text}");
        }
        for text in ["", "+", ".", "-.E1", "E5", "1e", "1e+", "1e1234", "1e999", "inf", "nan", "x"] {
            assert_eq!(leading(text.as_bytes()), None, "{text}");
        }
        assert_eq!((decimals(b"1.2500"), decimals(b"7."), decimals(b"-3"), decimals(b"1.5E3")), (4, 0, 0, 1));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_within_its_last_digit(value in -1e9..1e9_f64, decimals in 0_usize..20) {
            let text = written(value, decimals).unwrap();
            prop_assert!(text.bytes().filter(u8::is_ascii_digit).count() <= 16);
            let (length, back) = leading(text.as_bytes()).unwrap();
            prop_assert_eq!(length, text.len());
            let step = 0.1_f64.powi(i32::try_from(super::decimals(text.as_bytes())).unwrap());
            prop_assert!((back - value).abs() <= 0.5 * step + value.abs() * 1e-15, "{} {}", value, text);
        }

        #[test]
        fn no_bytes_end_the_program(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            if let Some((length, value)) = leading(&bytes) {
                prop_assert!(length <= bytes.len() && value.is_finite());
            }
            prop_assert!(decimals(&bytes) <= bytes.len());
        }
    }

    #[test]
    fn a_zero_has_no_sign_and_what_is_too_large_is_not_written() {
        assert_eq!(written(-1e-9, 4).unwrap(), "0.0000");
        assert_eq!(written(-0.5, 0).unwrap(), "0");
        assert_eq!(written(1e20, 4), None);
        assert_eq!(written(f64::NAN, 4), None);
    }
}
