//! What the paper prints: tables 2, 3 and 4 and eq. 14, in mm and degrees.
//!
//! Place in the flow: data of the rows of this folder.

use abbe_measurement::probe_pose::SphereCentre;

/// Table 2: A, C (degrees), d, x, y, z (mm) of the ten fitted centres.
pub(super) const TABLE_2: [[f64; 6]; 10] = [
    [0.0, 0.0, 90.0, -387.4694, -374.6453, -322.5901],
    [0.0, 0.0, 100.0, -387.4791, -374.8232, -312.5628],
    [60.0, 45.0, 90.0, -46.9930, -678.1894, -623.5403],
    [60.0, 45.0, 100.0, -40.8204, -684.3993, -618.6532],
    [60.0, -45.0, 90.0, -735.3694, -693.3078, -623.0718],
    [60.0, -45.0, 100.0, -741.5375, -699.4576, -618.2132],
    [-60.0, 45.0, 90.0, -710.8020, -12.4336, -562.9768],
    [-60.0, 45.0, 100.0, -716.8236, -6.3912, -557.8140],
    [-60.0, -45.0, 90.0, -71.2422, -27.8549, -563.4818],
    [-60.0, -45.0, 100.0, -65.2267, -21.8239, -558.3104],
];
/// Half of the last digit of table 2 (mm).
pub(super) const HALF_DIGIT_MM: f64 = 0.5e-4;

/// Eq. 14: S0 (mm), R_p (1), T_p (mm).
pub(super) const EQ_14: [f64; 9] =
    [-398.677734, -340.665187, -864.734844, 0.000907, 0.017933, -0.999839, -10.927967, 32.981423, -452.704314];

/// Table 3: compensation of each pose along x, y, z (mm), poses in the order of table 2.
pub(super) const TABLE_3: [[f64; 3]; 5] = [
    [-0.3617, -0.7204, 0.5306],
    [0.6218, 0.5689, 0.1683],
    [-0.2845, 0.3247, -0.2860],
    [-0.2514, -0.5337, -0.4568],
    [0.2758, -0.4393, 0.0439],
];

/// Table 4: distance of the centre from S0 before and after compensation, and diameter (mm).
pub(super) const TABLE_4: [[f64; 3]; 5] = [
    [0.7460, 0.1055, 19.9813],
    [0.8637, 0.1152, 20.0214],
    [0.9052, 0.1341, 19.9560],
    [0.5207, 0.0961, 20.0309],
    [0.5497, 0.1087, 20.0298],
];
/// Nominal diameter of the sphere (mm).
pub(super) const DIAMETER_MM: f64 = 20.0;
/// Poses as the tables name them (degrees).
pub(super) const POSES: [&str; 5] = ["(0, 0)", "(60, 45)", "(60, -45)", "(-60, 45)", "(-60, -45)"];

/// Rows of table 2 in metres and radians.
pub(super) fn centres(rows: &[[f64; 6]]) -> Vec<SphereCentre> {
    let centre = |[a, c, d, x, y, z]: &[f64; 6]| SphereCentre {
        a_rad: a.to_radians(),
        c_rad: c.to_radians(),
        distance_m: d / 1e3,
        centre_m: [x / 1e3, y / 1e3, z / 1e3],
        u_m: None,
    };
    rows.iter().map(centre).collect()
}
