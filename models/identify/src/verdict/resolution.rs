//! To how many digits a column was written.
//!
//! Place in the flow: a cause of misfit. Values (m) in, the coarsest decimal step of a millimetre that all of them are
//! multiples of out.

use std::collections::BTreeSet;

/// Steps looked for (mm), coarsest first.
const STEPS_MM: [f64; 9] = [100.0, 10.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];
/// Distance from a multiple, in steps, that rounding of binary numbers leaves: values are below 10⁵ mm.
const ROUNDING_MM: f64 = 1e-10;
/// Values that must differ before a step means anything.
const FEWEST: usize = 20;

/// The coarsest step (m) of which all values (m) are multiples; `None` for few values or none that fits.
///
/// Scales do not come to rest on whole millimetres: where every value is a multiple of a step, it was rounded to it, or the
/// commanded position stands in place of the read one.
pub fn coarsest_step(values_m: &[f64]) -> Option<f64> {
    let mut different = BTreeSet::new();
    // A long column is not read to its end for this.
    if !values_m.iter().any(|value| different.insert((value + 0.0).to_bits()) && different.len() >= FEWEST) {
        return None;
    }
    let is_multiple = |value_mm: f64, step_mm: f64| {
        let steps = value_mm / step_mm;
        ((steps - steps.round()) * step_mm).abs() <= ROUNDING_MM
    };
    let fits = |step_mm: &&f64| values_m.iter().all(|value| is_multiple(value * 1e3, **step_mm));
    STEPS_MM.iter().find(fits).map(|step_mm| step_mm * 1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coarsest_step_of_a_column_is_found_in_spite_of_binary_rounding() {
        let column = |step_mm: f64| -> Vec<f64> { (0..50).map(|k| f64::from(37 * k) * step_mm * 1e-3).collect() };
        for step_mm in [1.0, 0.1, 0.01, 1e-3, 1e-5] {
            let found_mm = coarsest_step(&column(step_mm)).unwrap() * 1e3;
            assert!((found_mm / step_mm - 1.0).abs() < 1e-9, "{step_mm}: {found_mm}");
        }
        let scattered: Vec<f64> = (0..50).map(|k| f64::from(k).sin()).collect();
        assert_eq!(coarsest_step(&scattered), None);
        assert_eq!(coarsest_step(&column(1.0)[..10]), None);
    }
}
