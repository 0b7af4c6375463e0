//! `abbe sphere`: points probed or scanned on a sphere in; centre, radius, form and their uncertainty out.
//!
//! Place in the flow: on its own; the centres of several poses make the file that `abbe probe-pose` takes.

use crate::calibration::{finish, lead_on, sphere};
use crate::next::Next;
use crate::verdict::{Accept, shown};
use abbe_measurement::sphere::SphereRadius;
use std::path::PathBuf;

/// Arguments of `sphere`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Points (CSV): x_mm, y_mm, z_mm
    #[arg(long)]
    points: PathBuf,
    /// Calibrated radius, which is then held instead of fitted
    #[arg(long)]
    radius_mm: Option<f64>,
    /// Standard uncertainty of that radius (k = 1)
    #[arg(long, requires = "radius_mm", default_value_t = 0.0)]
    u_radius_um: f64,
    /// Standard uncertainty of a point along the radius (k = 1); the scatter of the points where it is left out
    #[arg(long)]
    u_um: Option<f64>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let radius = match arguments.radius_mm {
        None => SphereRadius::Free,
        Some(mm) => SphereRadius::Known { radius_m: mm / 1e3, u_m: arguments.u_radius_um / 1e6 },
    };
    let product = sphere::product(&arguments.points, radius, arguments.u_um.map(|um| um / 1e6), arguments.accept);
    let mut product = shown(product, arguments.json)?;
    let what_for = "to calibrate a laser probe by the centres found in several of its poses";
    lead_on(&mut product, &Next::new(what_for, "probe-pose --centres CENTRES.csv --out pose"));
    finish(&product, None, &arguments.points, arguments.json)
}
