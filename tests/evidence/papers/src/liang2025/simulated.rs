//! The paper's measurement, simulated: a bridge machine along edges and inner lines, positions by a tracer.
//!
//! Place in the flow: the figures of [`super::identification`] and [`super::table`]; the truth stays with the simulator. SI,
//! machine frame. The paper's data are not published; strokes and instrument are its own (800 × 600 × 600 mm, U = 0.05 µm +
//! 0.3 µm/m), a position from several stations is taken to be known to 0.3 µm in each coordinate.

use crate::figure::PaperError;
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, Vector3};
use abbe_identify::points::MeasuredPoint;
use abbe_virtual_machine::machine::{Roughness, Term};
use abbe_virtual_machine::{TruthRecipe, VirtualMachine};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Strokes of the paper's machine (m).
pub(super) const STROKE_M: [(f64, f64); 3] = [(0.0, 0.8), (0.0, 0.6), (0.0, 0.6)];
/// Standard uncertainty of each measured coordinate (m, k = 1).
pub(super) const NOISE_M: f64 = 0.3e-6;
/// Points on each line.
const POINTS: usize = 7;
/// Reflector on the edges, and on the two offset bars of the inner lines (m, ram frame).
const OFFSETS_M: [[f64; 3]; 3] = [[0.0, 0.0, -0.06], [0.12, 0.0, -0.06], [0.0, 0.14, -0.09]];

/// A simulated measurement.
pub(super) struct Measurement {
    /// What the maker would write down of the machine.
    pub(super) machine: Machine,
    /// Positions as measured.
    pub(super) points: Vec<MeasuredPoint>,
    /// The truth.
    pub(super) truth: VirtualMachine,
}

/// Gross errors: some lines are shifted as a whole.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shifted {
    /// Share of the lines.
    pub(super) share: f64,
    /// Length of each line's shift (m); its direction is drawn.
    pub(super) by_m: f64,
    /// One direction for all, as when an instrument was bumped into; otherwise each line has its own, as when an
    /// interferometer lost counts.
    pub(super) together: bool,
}

impl Measurement {
    /// A machine whose errors are polynomials of this degree, measured with this noise and these gross errors.
    pub(super) fn new(seed: u64, degree: usize, shifted: Option<Shifted>) -> Result<Measurement, PaperError> {
        let recipe = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m: 20e-6 };
        let mut truth = recipe.bridge_xyz().map_err(failed)?;
        for terms in truth.errors.values_mut() {
            terms.retain(|term| matches!(term, Term::Chebyshev { order, .. } if *order as usize <= degree));
        }
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        let joint = |axis| Joint { axis, side: Side::Tool };
        let machine = Machine {
            name: "bridge XYZ".to_owned(),
            frame_id: "machine".to_owned(),
            joints: [joint(Axis::X), joint(Axis::Y), joint(Axis::Z)],
            stroke_m: STROKE_M,
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            // Eq. 2-4.
            rotation: RotationForm::SmallAngle,
            kinds: [Some(FunctionKind::Polynomial { degree }); 18],
            repeatability_m: [0.0; 3],
            u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        };
        let truth = VirtualMachine::new(truth).map_err(failed)?;
        let points = measure(&truth, seed, shifted);
        Ok(Measurement { machine, points, truth })
    }
}

fn measure(truth: &VirtualMachine, seed: u64, shifted: Option<Shifted>) -> Vec<MeasuredPoint> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let paths = paths();
    let shifts = shifts_m(&mut generator, paths.len(), shifted);
    let mut points = Vec::new();
    for (line, (from_m, to_m, offset_m)) in paths.into_iter().enumerate() {
        for k in 0..POINTS {
            let share = k as f64 / (POINTS - 1) as f64;
            let reading_m: [f64; 3] = std::array::from_fn(|d| from_m[d] + share * (to_m[d] - from_m[d]));
            let mut noise = || NOISE_M * generator.sample::<f64, _>(StandardNormal);
            let noise = Vector3::new(noise(), noise(), noise());
            let actual_m = Vector3::from(truth.actual_point_m(reading_m, offset_m)) + noise + shifts[line];
            points.push(MeasuredPoint { reading_m, offset_m, actual_m, u_m: NOISE_M });
        }
    }
    points
}

/// The shift of each line (m), zero for most.
fn shifts_m(generator: &mut ChaCha8Rng, lines: usize, shifted: Option<Shifted>) -> Vec<Vector3<f64>> {
    let mut shifts = vec![Vector3::zeros(); lines];
    let Some(Shifted { share, by_m, together }) = shifted else { return shifts };
    let mut order: Vec<usize> = (0..lines).collect();
    order.shuffle(generator);
    let mut direction = |_: &usize| {
        let mut normal = || generator.sample::<f64, _>(StandardNormal);
        Vector3::new(normal(), normal(), normal()).normalize() * by_m
    };
    let common = direction(&0);
    for line in &order[..(share * lines as f64).round() as usize] {
        shifts[*line] = if together { common } else { direction(line) };
    }
    shifts
}

/// A straight path: first and last reading, and the offset (m).
type Path = ([f64; 3], [f64; 3], [f64; 3]);

/// Twelve edges without offset bar, and three inner lines an axis with each of two bars.
fn paths() -> Vec<Path> {
    let mut paths = Vec::new();
    for axis in 0..3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut line = |at_a: f64, at_b: f64, offset_m| {
            let mut from_m = [0.0; 3];
            from_m[a] = STROKE_M[a].1 * at_a;
            from_m[b] = STROKE_M[b].1 * at_b;
            let mut to_m = from_m;
            to_m[axis] = STROKE_M[axis].1;
            paths.push((from_m, to_m, offset_m));
        };
        for (at_a, at_b) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            line(at_a, at_b, OFFSETS_M[0]);
        }
        for offset_m in [OFFSETS_M[1], OFFSETS_M[2]] {
            for (at_a, at_b) in [(0.25, 0.25), (0.75, 0.5), (0.5, 0.75)] {
                line(at_a, at_b, offset_m);
            }
        }
    }
    paths
}

/// A failure of the simulation or of a fit.
pub(super) fn failed(problem: impl ToString) -> PaperError {
    PaperError { paper: "Liang 2025", place: "simulated measurement", problem: problem.to_string() }
}
