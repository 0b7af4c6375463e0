//! Probing errors after ISO 10360-5: 25 points on a calibrated sphere with one stylus.
//!
//! Place in the flow: probed points (m, any Cartesian frame, tip radius already taken off) and the calibrated diameter
//! in; form and size error (m) out. Names: `PFTU` and `PSTU` in the edition of 2010, `PForm.Sph.1x25:SS:Tact` and
//! `PSize.Sph.1x25:SS:Tact` in that of 2020. Form = largest − smallest distance from the centre of the least-squares
//! sphere; size = diameter of that sphere − calibrated diameter.

use crate::decision::{DecisionRule, Verdict};
use crate::departure::Departure;
use crate::error::ConformityError;
use crate::quantity::{ObservedError, PermissibleError};
use abbe_measurement::sphere::{SphereFit, SphereRadius};
use nalgebra::Vector3;

/// Points of the test.
pub const POINTS: usize = 25;
/// Diameters of test spheres (m): the standard asks for 10 mm to 50 mm.
pub const DIAMETER_M: (f64, f64) = (0.010, 0.050);
/// Name of the form error, editions of 2020 and 2010.
pub const FORM_NAMES: [&str; 2] = ["PForm.Sph.1x25:SS:Tact", "PFTU"];
/// Name of the size error, editions of 2020 and 2010.
pub const SIZE_NAMES: [&str; 2] = ["PSize.Sph.1x25:SS:Tact", "PSTU"];
/// A size or form error beyond this is a slip: another sphere, tip radius left in, wrong unit (m).
const PLAUSIBLE_M: f64 = 1e-3;
/// Diameters of spheres that anybody probes (m).
const PLAUSIBLE_DIAMETER_M: std::ops::Range<f64> = 1e-3..1.0;
/// Four points lie on a sphere of any form; one more leaves something to judge.
const LEAST_POINTS: usize = 5;
/// Points that reach less far from the middle of their cap show no diameter (degrees).
const LEAST_REACH_DEG: f64 = 45.0;
/// A hemisphere, less what aligning its equator by hand costs (degrees).
const HEMISPHERE_DEG: f64 = 84.0;

/// Farthest that a place of the hemisphere may be from the nearest point (degrees). The recommended points leave 30, other even patterns
/// of 25 points 23 to 31 and, where they are probed by hand to 8 degrees, up to 40; a ring of 24 at the equator with the pole leaves 45.
const LARGEST_GAP_DEG: f64 = 40.0;
/// Places of the hemisphere that are looked at: 2.3 degrees apart.
const PLACES: u32 = 4000;

/// Observed figures of a probing test.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbingErrors {
    /// Least-squares sphere.
    pub sphere: SphereFit,
    /// Calibrated diameter (m), where it is known.
    pub calibrated_diameter_m: Option<f64>,
    /// Form error.
    pub form: ObservedError,
    /// Size error; missing without a calibrated diameter.
    pub size: Option<ObservedError>,
    /// What a whole test after the standard has and these data lack.
    pub departures: Vec<Departure>,
}

impl ProbingErrors {
    /// Length at which the uncertainty of the test counts (m): the diameter.
    pub fn length_m(&self) -> f64 {
        self.calibrated_diameter_m.unwrap_or(2.0 * self.sphere.radius_m)
    }

    /// Holds form and size against their limits; `None` for what has no limit or no figure.
    pub fn verdicts(
        &self,
        form_limit: Option<PermissibleError>,
        size_limit: Option<PermissibleError>,
        rule: &DecisionRule,
    ) -> (Option<Verdict>, Option<Verdict>) {
        let length_m = self.length_m();
        let form = form_limit.map(|limit| rule.decide(self.form, limit, length_m));
        let size = size_limit.zip(self.size).map(|(limit, size)| rule.decide(size, limit, length_m));
        (form, size)
    }
}

/// The 25 points that the standard recommends, as unit vectors from the centre: one at the pole of `axis`, 4 at 22.5°
/// from it, 8 at 45°, 4 at 67.5° and 8 at 90°, each ring turned by 22.5° against the one before.
///
/// # Errors
/// An axis of no length.
pub fn recommended_points(axis: &Vector3<f64>) -> Result<Vec<Vector3<f64>>, ConformityError> {
    let Some(pole) = axis.try_normalize(0.0).filter(|p| p.iter().all(|v| v.is_finite())) else {
        return Err(ConformityError::new("axis of the sphere", "it has no direction", "give a vector of some length"));
    };
    let (across, other) = equator(&pole);
    let mut points = vec![pole];
    for (ring, count) in [(1, 4), (2, 8), (3, 4), (4, 8)] {
        let (polar_rad, turned_rad) = ((22.5 * f64::from(ring)).to_radians(), (22.5 * f64::from(ring)).to_radians());
        for k in 0..count {
            let angle_rad = turned_rad + std::f64::consts::TAU * f64::from(k) / f64::from(count);
            let around = across * angle_rad.cos() + other * angle_rad.sin();
            points.push(pole * polar_rad.cos() + around * polar_rad.sin());
        }
    }
    Ok(points)
}

/// Two directions across a pole and each other.
fn equator(pole: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = if pole.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let across = pole.cross(&helper).normalize();
    (across, pole.cross(&across))
}

/// Figures of a probing test.
///
/// # Errors
/// Too few, double, collinear, coplanar or one-sided points, points that are no numbers, and sizes that only a slip of
/// units explains.
pub fn evaluate(
    points_m: &[Vector3<f64>],
    calibrated_diameter_m: Option<f64>,
) -> Result<ProbingErrors, ConformityError> {
    if let Some(diameter_m) = calibrated_diameter_m {
        check_diameter("calibrated diameter", diameter_m, "give it in the unit asked for")?;
    }
    if points_m.len() < LEAST_POINTS {
        let problem = format!("{} points do not show the form of a sphere", points_m.len());
        return Err(ConformityError::new("test sphere", problem, "probe 25 points over a hemisphere"));
    }
    let fit = SphereFit::new(points_m, SphereRadius::Free, None);
    let sphere =
        fit.map_err(|e| ConformityError::new("test sphere", e.to_string(), "probe 25 points over a hemisphere"))?;
    check_diameter("test sphere", 2.0 * sphere.radius_m, "give the points in the unit asked for")?;
    if let Some(reach) = reach_deg(points_m, &sphere).filter(|reach| *reach < LEAST_REACH_DEG) {
        let problem = format!("the points reach only {reach:.0} degrees from the middle of their cap");
        return Err(ConformityError::new("test sphere", problem, "probe 25 points over a hemisphere"));
    }
    let form = ObservedError::from_metres(sphere.form_m());
    let size = calibrated_diameter_m.map(|d| ObservedError::from_metres(2.0 * sphere.radius_m - d));
    for (name, error) in [("form", Some(form)), ("size", size)] {
        if let Some(error) = error.filter(|e| e.magnitude_m() > PLAUSIBLE_M) {
            let problem = format!("a {name} error of {:.3} mm is none of a probe", error.metres() * 1e3);
            let remedy = "check units, calibrated diameter, and that the tip radius was taken off";
            return Err(ConformityError::new("test sphere", problem, remedy));
        }
    }
    let departures = departures(points_m, &sphere, calibrated_diameter_m);
    Ok(ProbingErrors { sphere, calibrated_diameter_m, form, size, departures })
}

fn check_diameter(place: &str, diameter_m: f64, remedy: &str) -> Result<(), ConformityError> {
    if diameter_m.is_finite() && PLAUSIBLE_DIAMETER_M.contains(&diameter_m) {
        return Ok(());
    }
    let problem = format!("a diameter of {:.6} mm is that of no test sphere", diameter_m * 1e3);
    Err(ConformityError::new(place, problem, remedy))
}

fn departures(points_m: &[Vector3<f64>], sphere: &SphereFit, calibrated_diameter_m: Option<f64>) -> Vec<Departure> {
    let mut found = Vec::new();
    if points_m.len() != POINTS {
        let text = format!("{POINTS} points are asked for, there are {}", points_m.len());
        found.push(Departure::new("test sphere", text));
    }
    if calibrated_diameter_m.is_none() {
        found.push(Departure::new(
            "test sphere",
            "the calibrated diameter is not given, so that there is no size error",
        ));
    }
    let (least_m, most_m) = DIAMETER_M;
    let diameter_m = calibrated_diameter_m.unwrap_or(2.0 * sphere.radius_m);
    if !(least_m..=most_m).contains(&diameter_m) {
        let text = format!("a diameter of {:.3} mm; 10 mm to 50 mm are asked for", diameter_m * 1e3);
        found.push(Departure::new("test sphere", text));
    }
    if let Some(reach) = reach_deg(points_m, sphere).filter(|reach| *reach < HEMISPHERE_DEG) {
        let text =
            format!("the points reach {reach:.0} degrees from the middle of their cap; a hemisphere is asked for");
        found.push(Departure::new("test sphere", text));
    }
    if let Some(gap) = gap_deg(points_m, sphere).filter(|gap| *gap > LARGEST_GAP_DEG) {
        let text = format!(
            "a place of the hemisphere is {gap:.0} degrees from the nearest point; spread them evenly, so that none is farther than \
             {LARGEST_GAP_DEG:.0}"
        );
        found.push(Departure::new("test sphere", text));
    }
    found
}

/// Largest angle between a place of the hemisphere around the points' middle and the point nearest to it (degrees); over the
/// whole sphere for points all around. `None` where no point has a direction.
fn gap_deg(points_m: &[Vector3<f64>], sphere: &SphereFit) -> Option<f64> {
    let directions = directions(points_m, sphere);
    let middle = directions.iter().sum::<Vector3<f64>>().try_normalize(1e-9);
    let lowest = if middle.is_some() { HEMISPHERE_DEG.to_radians().cos() } else { -1.0 };
    let pole = middle.unwrap_or_else(Vector3::z);
    let (across, other) = equator(&pole);
    // A spiral in steps of the golden angle: every place stands for the same area.
    let golden_rad = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let nearest = |k: u32| {
        let height = 1.0 - (1.0 - lowest) * (f64::from(k) + 0.5) / f64::from(PLACES);
        let (out, turned_rad) = ((1.0 - height * height).max(0.0).sqrt(), golden_rad * f64::from(k));
        let place = pole * height + (across * turned_rad.cos() + other * turned_rad.sin()) * out;
        directions.iter().map(|d| d.dot(&place)).fold(-1.0, f64::max)
    };
    let farthest = (0..PLACES).map(nearest).reduce(f64::min).filter(|_| !directions.is_empty())?;
    Some(farthest.clamp(-1.0, 1.0).acos().to_degrees())
}

/// Directions of the points from the centre.
fn directions(points_m: &[Vector3<f64>], sphere: &SphereFit) -> Vec<Vector3<f64>> {
    points_m.iter().filter_map(|p| (p - sphere.centre_m).try_normalize(0.0)).collect()
}

/// Angle between the middle of the points' cap and the farthest of them (degrees); `None` for points all around, which have
/// no middle.
fn reach_deg(points_m: &[Vector3<f64>], sphere: &SphereFit) -> Option<f64> {
    let directions = directions(points_m, sphere);
    let axis = directions.iter().sum::<Vector3<f64>>().try_normalize(1e-9)?;
    let lowest = directions.iter().map(|d| d.dot(&axis)).fold(1.0, f64::min);
    Some(lowest.clamp(-1.0, 1.0).acos().to_degrees())
}

#[cfg(test)]
mod tests;
