//! Sides of approach that follow over some travel: what an axis remembers of the way that it came.
//!
//! Place in the flow: effects read such a quantity like any other covariate, by its name; [`Travel`] makes its values from the
//! sequence of readings of a campaign, of a table of points and of a live stream alike. `dir_x_over_12000um` is the side of X
//! that follows over 12 mm: −1 to 1, and nearly all of it after three times that travel in one direction.
//! Formula: λ dz/ds = sign(dx) − z, s the travel without its sign (Dahl's friction). Nobody read what was before the first reading:
//! z begins at 0, and has forgotten it after 3 λ of travel. Where the logged side of a reading is not that of its step, the axis went
//! further and came back, how far nobody read either: z begins anew at that side. Readings in m; names in µm.
//! Source: Dahl, "A solid friction model", Aerospace Corporation TOR-158(3107-18)-1, 1968.

use crate::axis::Axis;

/// What stands between the side and its travel.
const MARK: &str = "_over_";
/// Motion below which a standing axis only trembles (m): it adds up until it is more.
const TREMBLE_M: f64 = 1e-6;
/// A step against its logged side that is no longer than this (m) is an axis that settles where it was sent.
const SETTLES_M: f64 = 50e-6;
/// Multiples of the travel after which 5 % of a wrong beginning are left.
const SETTLED: f64 = 3.0;

/// Name of the logged side of an axis: the sign of its last approach.
pub const fn logged_side(axis: Axis) -> &'static str {
    ["dir_x", "dir_y", "dir_z"][axis.index()]
}

/// The name of the side of an axis over a travel (µm).
pub fn travelled_name(axis: Axis, travel_um: u32) -> String {
    format!("{}{MARK}{travel_um}um", logged_side(axis))
}

/// The axis and the travel (µm, above zero) of such a name; `None` for any other.
pub fn of_travelled(name: &str) -> Option<(Axis, u32)> {
    let (side, travel) = name.split_once(MARK)?;
    let axis = Axis::ALL.into_iter().find(|axis| side == logged_side(*axis))?;
    let travel_um = travel.strip_suffix("um")?.parse().ok().filter(|travel_um| *travel_um > 0)?;
    // "+7um" and "007um" parse as well, and would be other names of the same.
    (travelled_name(axis, travel_um) == name).then_some((axis, travel_um))
}

/// The side of one axis that follows over some travel.
#[derive(Debug, Clone)]
pub struct Travel {
    axis: Axis,
    travel_m: f64,
    last_m: Option<f64>,
    side: f64,
    gone_m: f64,
}

/// The side at one reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travelled {
    /// From −1 to 1.
    pub side: f64,
    /// Whether the axis has travelled far enough to have forgotten how it began.
    pub is_settled: bool,
}

impl Travel {
    /// What a name asks for, of an axis that was never read; `None` for a name that is none of these.
    pub fn of(name: &str) -> Option<Travel> {
        let (axis, travel_um) = of_travelled(name)?;
        Some(Travel { axis, travel_m: f64::from(travel_um) * 1e-6, last_m: None, side: 0.0, gone_m: 0.0 })
    }

    /// Begins anew: nobody read how the axis moved before the next reading.
    pub fn forget(&mut self) {
        (self.last_m, self.side, self.gone_m) = (None, 0.0, 0.0);
    }

    /// Name of the logged side of the same axis.
    pub fn logged_side(&self) -> &'static str {
        logged_side(self.axis)
    }

    /// Takes the next reading and its logged side (−1 or 1, anything else says nothing); `None`, and everything as it was, where the reading
    /// is no number.
    pub fn push(&mut self, reading_m: [f64; 3], logged: Option<f64>) -> Option<Travelled> {
        let at_m = Some(reading_m[self.axis.index()]).filter(|at_m| at_m.is_finite())?;
        let step_m = at_m - *self.last_m.get_or_insert(at_m);
        if step_m.abs() >= TREMBLE_M {
            let end = step_m.signum();
            match logged.filter(|side| *side == -end && step_m.abs() > SETTLES_M) {
                Some(side) => (self.side, self.gone_m) = (side, 0.0),
                None => {
                    self.side = end + (self.side - end) * (-step_m.abs() / self.travel_m).exp();
                    self.gone_m += step_m.abs();
                }
            }
            self.last_m = Some(at_m);
        }
        Some(Travelled { side: self.side, is_settled: self.gone_m >= SETTLED * self.travel_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn travel() -> Travel {
        Travel::of("dir_y_over_10000um").unwrap()
    }

    #[test]
    fn a_side_follows_over_its_travel_and_turns_as_far_after_a_reversal_whatever_the_steps() {
        for steps in [1_u32, 7, 500] {
            let mut travel = travel();
            let mut go = |from_m: f64, to_m: f64| {
                let at = |k: u32| from_m + (to_m - from_m) * f64::from(k) / f64::from(steps);
                let all: Vec<Travelled> = (0..=steps).map(|k| travel.push([9.0, at(k), -9.0], None).unwrap()).collect();
                all[steps as usize]
            };
            let there = go(0.0, 0.5);
            assert!(there.is_settled && (there.side - 1.0).abs() < 1e-12, "{there:?}");
            // 5 mm back of 10 mm: from +1 towards −1.
            let back = go(0.5, 0.495);
            assert!((back.side - (2.0 * (-0.5_f64).exp() - 1.0)).abs() < 1e-12, "{back:?}");
        }
    }

    #[test]
    fn what_trembles_forgets_nothing_and_what_creeps_counts() {
        let mut travel = travel();
        travel.push([0.0; 3], None);
        let there = travel.push([0.0, 0.4, 0.0], None).unwrap();
        for k in 0..200_000 {
            let at_m = 0.4 + 0.4e-6 * f64::from(k % 2);
            assert_eq!(travel.push([0.0, at_m, 0.0], None), Some(there));
        }
        let creep = |k: u32| travel.push([0.0, 0.4 - 0.25e-6 * f64::from(k), 0.0], None).unwrap().side;
        let crept: Vec<f64> = (1..=40_000).map(creep).collect();
        assert!((crept[39_999] - (2.0 * (-1.0_f64).exp() - 1.0)).abs() < 1e-3, "{}", crept[39_999]);
        assert_eq!(travel.push([0.0, f64::NAN, 0.0], None), None);
    }

    #[test]
    fn regress_a_way_that_nobody_read_leaves_the_side_open() {
        let mut travel = travel();
        travel.push([0.0; 3], None);
        assert!(travel.push([0.0, 0.4, 0.0], None).unwrap().is_settled);
        travel.forget();
        assert!(!travel.push([0.0, 0.2, 0.0], None).unwrap().is_settled);
        let there = travel.push([0.0, 0.1, 0.0], None).unwrap();
        assert!(there.is_settled && there.side < -0.99, "{there:?}");
    }

    /// Tables that are sorted, or whose points were approached by overshooting, were answered by the order of their rows.
    #[test]
    fn regress_a_logged_side_that_is_not_that_of_the_step_leaves_the_way_open() {
        let mut travel = travel();
        travel.push([0.0; 3], Some(1.0));
        assert!(travel.push([0.0, 0.4, 0.0], Some(1.0)).unwrap().is_settled);
        // It went beyond 0.5 and came back, how far nobody read.
        let back = travel.push([0.0, 0.5, 0.0], Some(-1.0)).unwrap();
        assert_eq!(back, Travelled { side: -1.0, is_settled: false });
        let there = travel.push([0.0, 0.4, 0.0], Some(-1.0)).unwrap();
        assert!(there.is_settled && there.side < -0.999, "{there:?}");
        // A side that says nothing changes nothing.
        for says_nothing in [None, Some(0.0), Some(f64::NAN)] {
            assert!(travel.clone().push([0.0, 0.5, 0.0], says_nothing).unwrap().is_settled);
        }
    }

    #[test]
    fn it_is_settled_after_three_times_its_travel_and_names_read_back() {
        let mut travel = travel();
        let settled = [0.0, 0.01, 0.0, 0.01].map(|at_m| travel.push([0.0, at_m, 0.0], None).unwrap().is_settled);
        assert_eq!(settled, [false, false, false, true]);
        for axis in Axis::ALL {
            assert_eq!(of_travelled(&travelled_name(axis, 750)), Some((axis, 750)));
        }
        for name in ["dir_x", "dir_x_over_0um", "dir_x_over_+5um", "dir_x_over_05um", "dir_w_over_5um", "x_over_5um"] {
            assert_eq!(of_travelled(name), None, "{name}");
            assert!(Travel::of(name).is_none());
        }
    }
}
