//! Two straightness errors that no reading tells apart, and the one that stands for both.

use crate::canvas::{BLUE, Canvas, GREEN, MUTED, ORANGE, Plot};
use crate::hold;

const STROKE_M: f64 = 0.8;
/// Zero and slope of the frame in which the second is given (µm, µm/m).
const FRAME: (f64, f64) = (1.5, -6.0);

/// A straightness error (µm).
fn straightness_um(x_m: f64) -> f64 {
    let t = x_m / STROKE_M;
    3.0 * (std::f64::consts::PI * t).sin() + 1.2 * (7.0 * t).sin() + 2.0 * t + 0.6
}

/// The same in the frame.
fn in_frame_um(x_m: f64) -> f64 {
    straightness_um(x_m) + FRAME.0 + FRAME.1 * x_m
}

/// Without the line through its ends, and the slope of that line (µm/m).
fn in_gauge(error_um: impl Fn(f64) -> f64) -> (impl Fn(f64) -> f64, f64) {
    let (first, last) = (error_um(0.0), error_um(STROKE_M));
    let slope = (last - first) / STROKE_M;
    (move |x_m: f64| error_um(x_m) - first - slope * x_m, slope)
}

fn curve(error_um: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    (0..=80).map(|k| STROKE_M * f64::from(k) / 80.0).map(|x_m| (x_m, error_um(x_m))).collect()
}

#[test]
fn one_error_in_two_frames_is_one_in_the_gauge() {
    let ((first, slope), (second, other)) = (in_gauge(straightness_um), in_gauge(in_frame_um));
    for (x_m, error_um) in curve(&first) {
        assert!((error_um - second(x_m)).abs() < 1e-12);
    }
    assert!((other - slope - FRAME.1).abs() < 1e-12 && first(STROKE_M).abs() < 1e-12);
    let mut canvas = Canvas::new(720.0, 250.0);
    let plot = |left: f64| Plot { left, top: 30.0, width: 270.0, height: 160.0, x: (0.0, STROKE_M), y: (-2.0, 6.0) };
    let words = ("x in m", "EYX in µm");
    let marks: (&[f64], &[f64]) = (&[0.0, 0.4, 0.8], &[-2.0, 0.0, 2.0, 4.0, 6.0]);
    let before = plot(50.0);
    before.frame(&mut canvas, marks, words);
    for (values, colour) in [(curve(straightness_um), BLUE), (curve(in_frame_um), ORANGE)] {
        let ends = [values[0], values[values.len() - 1]];
        canvas.path(&before.curve(&ends), colour, 1.0, "4 3");
        canvas.path(&before.curve(&values), colour, 2.0, "");
    }
    let after = plot(410.0);
    after.frame(&mut canvas, marks, words);
    canvas.path(&after.curve(&curve(first)), GREEN, 2.0, "");
    canvas.text((185.0, 243.0), "middle", MUTED, "one rail, seen from two frames");
    let words = format!("both in the gauge; squareness {slope:.1} and {other:.1} µrad").replace('-', "−");
    canvas.text((545.0, 243.0), "middle", MUTED, &words);
    hold("gauge", &canvas.finished("One straightness error in two frames, and in the gauge: zero at both ends"));
}
