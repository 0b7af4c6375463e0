//! Points from the distances of an absolute instrument whose zero is off: U holds them, and says where nothing tells the zero.
//!
//! Place in the flow: [`abbe_measurement::multilateration`] as `abbe points` calls it. Simulated, SI.

use abbe_measurement::alignment::aligned_residuals_m;
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::instrument::{RangeUncertainty, U_ABSOLUTE_ZERO_M};
use abbe_measurement::multilateration::{MultiStation, MultilaterationOptions, solve};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Stations about a machine of 1 × 0.8 × 0.6 m.
const STATIONS_M: [[f64; 3]; 5] =
    [[-0.4, -0.5, 0.1], [1.4, -0.3, 0.5], [1.3, 1.2, -0.1], [-0.3, 1.1, 0.7], [0.5, -0.6, 1.2]];
/// Constants of instrument and reflector (m): none, those of a good one, and a reflector that was mistaken for another.
const CONSTANTS_M: [f64; 3] = [0.0, 20e-6, 0.3e-3];
const U_M: f64 = 1e-6;

const OPTIONS: MultilaterationOptions = MultilaterationOptions {
    instrument: RangeUncertainty { constant_m: U_M, per_metre: 0.0, common_per_metre: 0.0 },
    repeatability_m: [0.0; 3],
    pair_limit_m: None,
    same_point_m: 1e-4,
    absolute_range: true,
};

/// So many points along each axis.
fn lattice(counts: [usize; 3]) -> Vec<Vector3<f64>> {
    let [x, y, z] = counts;
    let place = |k: usize, count: usize, length_m: f64| length_m * k as f64 / (count - 1) as f64;
    let at = |k: usize| Vector3::new(place(k % x, x, 1.0), place(k / x % y, y, 0.8), place(k / x / y, z, 0.6));
    (0..x * y * z).map(at).collect()
}

/// Where a machine with a bow and a squareness really is.
fn actual(p: &Vector3<f64>) -> Vector3<f64> {
    p + Vector3::new(20e-6 * p.y, 30e-6 * p.x * (1.0 - p.x), -15e-6 * p.x * p.z)
}

/// What stations with these constants read at these points.
fn campaign(constants_m: &[f64], points: &[Vector3<f64>], random: &mut ChaCha8Rng) -> Campaign {
    let mut campaign = Campaign::default();
    for (station, (place, constant_m)) in STATIONS_M.iter().zip(constants_m).enumerate() {
        campaign.stations.push(format!("S{station}"));
        campaign.lines.push(format!("S{station}"));
        for point in points {
            let noise_m = U_M * random.sample::<f64, _>(StandardNormal);
            campaign.readings.push(RangeReading {
                station: station as u32,
                line: station as u32,
                time_s: campaign.readings.len() as f64,
                reading_m: (*point).into(),
                offset_m: [0.0; 3],
                length_m: (actual(point) - Vector3::from(*place)).norm() + constant_m + noise_m,
            });
        }
    }
    campaign
}

/// What many campaigns made of their points.
#[derive(Debug, Default)]
struct Found {
    /// Share of components within ±1.96 u.
    inside: f64,
    /// Error of a component, rms, and its u (m).
    error_m: f64,
    u_m: f64,
    /// The least u of a dead path (m).
    u_dead_path_m: f64,
    chi2_per_dof: f64,
}

fn run(campaign: &Campaign) -> MultiStation {
    solve(campaign, &OPTIONS, &mut |_| true).unwrap()
}

fn found(stations: usize, points: &[Vector3<f64>], mut constant_m: impl FnMut() -> f64, campaigns: usize) -> Found {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let truth: Vec<Vector3<f64>> = points.iter().map(actual).collect();
    // Ranges know no frame: that of the points that fit the indicated ones best.
    let left_m = aligned_residuals_m(&truth, points).unwrap();
    let mut all = Found { u_dead_path_m: f64::INFINITY, ..Found::default() };
    let share = 1.0 / (campaigns * points.len() * 3) as f64;
    for _ in 0..campaigns {
        let constants_m: Vec<f64> = (0..stations).map(|_| constant_m()).collect();
        let solved = run(&campaign(&constants_m, points, &mut random));
        assert_eq!(solved.points.len(), points.len());
        for (point, left_m) in solved.points.iter().zip(&left_m) {
            // Residual = indicated less actual, aligned.
            let off_m = point.error_m + left_m;
            for d in 0..3 {
                let variance = point.covariance_m2[(d, d)];
                all.inside += share * f64::from(off_m[d].abs() < 1.96 * variance.sqrt());
                all.error_m += share * off_m[d].powi(2);
                all.u_m += share * variance;
            }
        }
        let of = |station: &abbe_measurement::network::Station| station.covariance_m2[(3, 3)].sqrt();
        all.u_dead_path_m = solved.stations.iter().map(of).fold(all.u_dead_path_m, f64::min);
        all.chi2_per_dof += solved.chi2_per_dof / campaigns as f64;
    }
    (all.error_m, all.u_m) = (all.error_m.sqrt(), all.u_m.sqrt());
    println!("{stations} stations, {} points: {all:?}", points.len());
    all
}

/// With the zero held, 20 µm and 0.3 mm made errors of 1.5 and 17 µm (rms of a component) at a χ² per degree of 2.7 and 388: 1.1 µm now.
#[test]
fn u_holds_points_whatever_the_constant_of_instrument_and_reflector() {
    let points = lattice([4, 3, 3]);
    for constant_m in CONSTANTS_M {
        let found = found(5, &points, || constant_m, 60);
        // Points share their stations: 60 campaigns are some 60 × 9 independent numbers.
        assert!((0.92..0.98).contains(&found.inside), "{constant_m}: {found:?}");
        assert!((found.error_m / found.u_m - 1.0).abs() < 0.15, "{constant_m}: {found:?}");
        assert!((found.chi2_per_dof - 1.0).abs() < 0.1, "{constant_m}: {found:?}");
        // The readings tell the zero.
        assert!(found.u_dead_path_m < 0.1 * U_ABSOLUTE_ZERO_M, "{found:?}");
    }
}

/// Eight points from four stations leave two checks beside the places: far fewer than dead paths.
#[test]
fn u_widens_where_few_readings_tell_no_zero() {
    let points = lattice([2, 2, 2]);
    for constant_m in CONSTANTS_M {
        let found = found(4, &points, || constant_m, 60);
        assert!(found.inside > 0.93, "{constant_m}: {found:?}");
        assert!(found.u_m > 10.0 * U_M, "{constant_m}: {found:?}");
    }
}

/// Zeros that are as uncertain as is said, each station with its own: then U of such points is no wider than it should be either.
#[test]
fn u_is_as_wide_as_the_zero_is_uncertain() {
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let zero_m = || U_ABSOLUTE_ZERO_M * random.sample::<f64, _>(StandardNormal);
    let found = found(4, &lattice([2, 2, 2]), zero_m, 400);
    // Four zeros a campaign make 1600 numbers.
    assert!((0.93..0.97).contains(&found.inside), "{found:?}");
    assert!((found.error_m / found.u_m - 1.0).abs() < 0.1, "{found:?}");
}
