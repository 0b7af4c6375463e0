//! What is assumed of a field's parameters before any point is measured.
//!
//! Place in the flow: added to the likelihood where few points leave parameters open: [`super::averaged`]. Logarithms in scaled
//! units, normally distributed: a length scale is of the order of the volume's extent, much more alike along the axes
//! than known, the signal of the order of the deviation of the errors, and what the declared uncertainties leave out is
//! most often small. Wide enough that some dozen points outweigh it.

/// Mean of the logarithm of a length scale in extents: a third of the volume.
const LENGTH: f64 = -1.1;
/// Deviation of the mean of their logarithms.
const LENGTH_COMMON: f64 = 0.8;
/// Deviation of each from that mean.
const LENGTH_OWN: f64 = 0.5;
/// Mean and deviation of the logarithm of the signal, in deviations of the errors.
const SIGNAL: (f64, f64) = (0.0, 0.7);
/// The same of the fitted noise.
const NOISE: (f64, f64) = (-4.0, 2.0);

/// −2 ln of the density of logarithms of parameters (signal, a length for each of `size` inputs, noise), without its constant, and its
/// gradient.
pub(crate) fn minus_two_log(logarithms: &[f64], size: usize) -> (f64, Vec<f64>) {
    let mut gradient = vec![0.0; logarithms.len()];
    let mut value = 0.0;
    for (k, (mean, deviation)) in [(0, SIGNAL), (size + 1, NOISE)] {
        let (Some(at), Some(slope)) = (logarithms.get(k), gradient.get_mut(k)) else { continue };
        let off = (at - mean) / deviation;
        value += off * off;
        *slope = 2.0 * off / deviation;
    }
    if let (Some(lengths), Some(slopes)) = (logarithms.get(1..=size), gradient.get_mut(1..=size)) {
        let mean = lengths.iter().sum::<f64>() / size as f64;
        let common = (mean - LENGTH) / LENGTH_COMMON;
        value += common * common;
        for (length, slope) in lengths.iter().zip(slopes) {
            let own = (length - mean) / LENGTH_OWN;
            value += own * own;
            *slope = 2.0 * own / LENGTH_OWN + 2.0 * common / LENGTH_COMMON / size as f64;
        }
    }
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_of_the_prior_is_its_slope() {
        let at = [0.4, -0.2, 0.9, -1.3, -2.0];
        let (_, gradient) = minus_two_log(&at, 3);
        for k in 0..5 {
            let moved = |by: f64| {
                let mut there = at;
                there[k] += by;
                minus_two_log(&there, 3).0
            };
            let slope = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((slope - gradient[k]).abs() < 1e-6, "{k} {slope} {}", gradient[k]);
        }
    }
}
