//! Maximum permissible error of length measurement, A + L/K, and how people write it.
//!
//! Place in the flow: from a data sheet or an option of a command to the limit at a length. ISO 10360-1 knows three
//! forms: A + L/K, a constant B, and the smaller of both. As text A and B are in µm and L in mm, as on data sheets:
//! `0.5+L/400`, `1.9 + 3L/1000`, `0.5`, `min(0.5+L/400, 2)`.

use crate::error::ConformityError;
use crate::quantity::PermissibleError;
use std::fmt;

/// Above this a limit is taken for a slip of units (m).
const LARGEST_CONSTANT_M: f64 = 1e-3;
/// A limit that grows faster than this with length is taken for a slip of units (m/m).
const LARGEST_PER_METRE: f64 = 1e-3;
const FORMS: &str = "write A+L/K with A in micrometres and L in millimetres, such as 0.5+L/400 or 1.9+3L/1000; \
                     a constant such as 2.5; or min(0.5+L/400, 2)";

/// Maximum permissible error of length measurement: A + L/K, or the smaller of that and a constant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaximumPermissibleError {
    constant_m: f64,
    per_metre: f64,
    cap_m: Option<f64>,
}

impl MaximumPermissibleError {
    /// A (m) and 1/K (m/m).
    ///
    /// # Errors
    /// Figures that are negative, not finite, both zero, or larger than any machine's.
    pub fn new(constant_m: f64, per_metre: f64) -> Result<MaximumPermissibleError, ConformityError> {
        let limit = MaximumPermissibleError { constant_m, per_metre, cap_m: None };
        limit.check().map_err(|problem| ConformityError::new("maximum permissible error", problem, FORMS))?;
        Ok(limit)
    }

    /// Reads A+L/K (µm, L in mm), a constant (µm), or `min(A+L/K, B)`.
    ///
    /// # Errors
    /// Text of another form, and what [`MaximumPermissibleError::new`] refuses; both quote the text.
    pub fn from_text(text: &str) -> Result<MaximumPermissibleError, ConformityError> {
        let wrong = |problem: String| ConformityError::new(format!("limit {text:?}"), problem, FORMS);
        let limit = parse(text).map_err(wrong)?;
        limit.check().map_err(wrong)?;
        Ok(limit)
    }

    /// The limit at a length (m).
    pub fn at(&self, length_m: f64) -> PermissibleError {
        let straight = self.constant_m + self.per_metre * length_m.abs();
        PermissibleError::from_metres(self.cap_m.map_or(straight, |cap| straight.min(cap)))
    }

    /// A (m).
    pub fn constant_m(&self) -> f64 {
        self.constant_m
    }

    /// 1/K (m/m).
    pub fn per_metre(&self) -> f64 {
        self.per_metre
    }

    /// Largest value at any length (m), where one is stated.
    pub fn cap_m(&self) -> Option<f64> {
        self.cap_m
    }

    fn check(&self) -> Result<(), String> {
        let figures = [self.constant_m, self.per_metre, self.cap_m.unwrap_or(0.0)];
        if figures.iter().any(|v| !v.is_finite() || *v < 0.0) {
            return Err("a figure is negative or not finite".to_owned());
        }
        if (self.constant_m == 0.0 && self.per_metre == 0.0) || self.cap_m == Some(0.0) {
            return Err("a limit of zero permits nothing".to_owned());
        }
        let constant_m = self.constant_m.max(self.cap_m.unwrap_or(0.0));
        if constant_m > LARGEST_CONSTANT_M {
            return Err(format!("the constant is {:.3} mm, more than any machine is specified with", constant_m * 1e3));
        }
        if self.per_metre > LARGEST_PER_METRE {
            return Err(format!("it grows by {:.3} mm a metre of length", self.per_metre * 1e3));
        }
        Ok(())
    }
}

fn parse(text: &str) -> Result<MaximumPermissibleError, String> {
    let squeezed: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let bare = ["µm", "μm", "um"].iter().find_map(|unit| squeezed.strip_suffix(unit)).unwrap_or(&squeezed);
    if let Some(inside) = bare.strip_prefix("min(").and_then(|rest| rest.strip_suffix(')')) {
        let (straight, cap) = inside.split_once([',', ';']).ok_or("min( ) needs two limits")?;
        return Ok(MaximumPermissibleError { cap_m: Some(number(cap)? / 1e6), ..straight_line(straight)? });
    }
    straight_line(bare)
}

fn straight_line(text: &str) -> Result<MaximumPermissibleError, String> {
    if text.is_empty() {
        return Err("it is empty".to_owned());
    }
    let (constant, slope) = match text.split_once('+') {
        Some((constant, slope)) => (number(constant)?, per_metre(slope)?),
        None if text.contains(['L', 'l']) => (0.0, per_metre(text)?),
        None => (number(text)?, 0.0),
    };
    Ok(MaximumPermissibleError { constant_m: constant / 1e6, per_metre: slope, cap_m: None })
}

/// `L/400` or `3L/1000` or `3*L/1000`: micrometres a millimetre, as m/m.
fn per_metre(text: &str) -> Result<f64, String> {
    let (numerator, denominator) =
        text.split_once('/').ok_or_else(|| format!("{text:?} has no division such as L/400"))?;
    let factor = numerator
        .strip_suffix(['L', 'l'])
        .ok_or_else(|| format!("{numerator:?} does not end in L, the length in millimetres"))?;
    let factor = factor.strip_suffix(['*', '·']).unwrap_or(factor);
    let factor = if factor.is_empty() { 1.0 } else { number(factor)? };
    let denominator = number(denominator)?;
    if denominator <= 0.0 {
        return Err(format!("K = {denominator} is not above zero"));
    }
    Ok(factor / denominator * 1e-3)
}

fn number(text: &str) -> Result<f64, String> {
    if text.contains(',') {
        return Err(format!("{text:?} has a decimal comma; write a decimal point"));
    }
    let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
    value.ok_or_else(|| format!("{text:?} is not a number"))
}

impl fmt::Display for MaximumPermissibleError {
    /// As on a data sheet: µm, L in mm.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let constant = self.constant_m * 1e6;
        let straight = match self.per_metre {
            0.0 => format!("{}", rounded(constant)),
            slope => format!("{} + {}", rounded(constant), slope_in_words(slope)),
        };
        match self.cap_m {
            Some(cap) => write!(f, "min({straight}, {}) µm", rounded(cap * 1e6)),
            None => write!(f, "{straight} µm"),
        }
    }
}

/// `L/400`; where that K has no end, as the one of 3L/1000, in thousandths of the length.
fn slope_in_words(per_metre: f64) -> String {
    let tenths = 1e-2 / per_metre;
    match (tenths - tenths.round()).abs() < 1e-6 * tenths {
        true => format!("L/{}", tenths.round() / 10.0),
        false => format!("{}L/1000", rounded(per_metre * 1e6)),
    }
}

/// Free of the noise of unit conversion.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_read_as_on_data_sheets() {
        // 0.5 µm + 420/400 µm = 1.55 µm; 1.9 + 3·500/1000 = 3.4 µm; the cap holds from 600 mm on.
        let cases = [
            ("0.5+L/400", 0.42, 1.55e-6),
            ("0.5 + L / 400 µm", 0.42, 1.55e-6),
            ("1.9+3L/1000", 0.5, 3.4e-6),
            ("1.9+3*L/1000 um", 0.5, 3.4e-6),
            ("2.5", 9.0, 2.5e-6),
            ("L/400", 0.4, 1e-6),
            ("min(0.5+L/400, 2)", 0.6, 2e-6),
            ("min(0.5+L/400;2)", 0.2, 1e-6),
            ("min(0.5+L/400;2)", 5.0, 2e-6),
        ];
        for (text, length_m, limit_m) in cases {
            let limit = MaximumPermissibleError::from_text(text).unwrap();
            assert!((limit.at(length_m).metres() - limit_m).abs() < 1e-18, "{text}");
            assert_eq!(MaximumPermissibleError::from_text(&limit.to_string()).unwrap().to_string(), limit.to_string());
        }
        assert_eq!(MaximumPermissibleError::from_text("0.5+L/400").unwrap().to_string(), "0.5 + L/400 µm");
        // Was 1.9 + L/333.333333333.
        assert_eq!(MaximumPermissibleError::from_text("1.9+3L/1000").unwrap().to_string(), "1.9 + 3L/1000 µm");
        assert_eq!(MaximumPermissibleError::from_text("1+L/333.4").unwrap().to_string(), "1 + L/333.4 µm");
    }

    #[test]
    fn what_is_no_limit_is_refused_with_the_forms_that_are() {
        let cases = [
            ("", "empty"),
            ("0,5+L/400", "decimal comma"),
            ("0.5+L/0", "not above zero"),
            ("0.5+L/-400", "not above zero"),
            ("0.5+L*400", "no division"),
            ("0.5+400", "no division"),
            ("0.5+x/400", "does not end in L"),
            ("-0.5+L/400", "negative"),
            ("nan", "not a number"),
            ("inf+L/400", "not a number"),
            ("0", "permits nothing"),
            ("500000", "more than any machine"),
            ("0.5+L/0.5", "a metre of length"),
            ("0.5+L/400+1", "not a number"),
            ("min(0.5+L/400)", "two limits"),
        ];
        for (text, says) in cases {
            let told = MaximumPermissibleError::from_text(text).unwrap_err().to_string();
            assert!(told.contains(says) && told.contains("such as 0.5+L/400"), "{text}: {told}");
        }
    }
}
