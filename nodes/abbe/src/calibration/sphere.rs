//! A sphere through measured points, in words and JSON.
//!
//! Place in the flow: points file → `abbe_measurement::sphere` → [`Product`].

use super::{COVERAGE, Product, claim_json, claim_words};
use crate::verdict::{self, Accept, Objection};
use abbe_files::{PointRow, PointsReader};
use abbe_geometry::Vector3;
use abbe_identify::verdict::{Counted, Grade, Verdict};
use abbe_measurement::sphere::{SphereFit, SphereRadius, ToldRadius};
use abbe_report::digits;
use anyhow::{Context, ensure};
use serde_json::json;
use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;

/// Condition from which the terminal says that a small cap was measured: half angles below about 0.2 rad.
const SMALL_CAP: f64 = 30.0;
/// Radii of spheres that somebody measures (m): beyond, metres or micrometres were written for millimetres.
const PLAUSIBLE_RADIUS_M: std::ops::RangeInclusive<f64> = 1e-4..=1.0;

/// Points (m) and their lines; columns beside x_mm, y_mm and z_mm play no part.
fn read(path: &Path) -> anyhow::Result<(Vec<Vector3<f64>>, Vec<u64>)> {
    let name = path.display().to_string();
    let input = File::open(path).with_context(|| format!("{name}: cannot be opened"))?;
    let mut reader = PointsReader::new(input, &name, Some([0.0; 3]))?;
    let (mut row, mut points_m, mut lines) = (PointRow::default(), Vec::new(), Vec::new());
    while reader.read(&mut row)? {
        points_m.push(Vector3::from(row.reading_m));
        lines.push(row.line());
    }
    Ok((points_m, lines))
}

/// Fits and describes.
pub(crate) fn product(
    path: &Path,
    radius: SphereRadius,
    u_point_m: Option<f64>,
    accept: Accept,
) -> anyhow::Result<Product> {
    let (points_m, lines) = read(path)?;
    let name = path.display().to_string();
    let (held, strays) = SphereFit::without_strays(&points_m, radius, u_point_m).with_context(|| name.clone())?;
    ensure!(
        PLAUSIBLE_RADIUS_M.contains(&held.radius_m),
        "{name}: the sphere has a radius of {:.6} mm, as no sphere that is measured; check the unit: x_mm, y_mm, z_mm{} are millimetres",
        held.radius_m * 1e3,
        if matches!(radius, SphereRadius::Known { .. }) { " and --radius-mm" } else { "" }
    );
    let told = SphereFit::contradicting(&points_m, radius, u_point_m);
    let objection = told.as_ref().map(|told| objection(told, &held));
    if let Some(objection) = &objection {
        objection.check(
            accept,
            &name,
            || json!({ "radius_mm": held.radius_m * 1e3, "scatter_um": held.scatter_m.map(|s| s * 1e6) }),
        )?;
    }
    // Of the free fit where it contradicts the given radius: what that one leaves says nothing of the points.
    let judged = told.as_ref().map_or(&held, |told| &told.free);
    let chi2_per_dof =
        u_point_m.zip(judged.scatter_m).map(|(u_m, scatter_m)| ((scatter_m / u_m).powi(2), judged.degrees_of_freedom));
    let counted = Counted { what: "points", rejected: strays.len(), all: points_m.len() };
    let verdict = verdict::of_fit(chi2_per_dof, Some(counted));
    let fit = match (&told, radius) {
        (Some(told), SphereRadius::Known { radius_m, u_m }) => {
            let u_m = u_m.hypot(told.difference_m);
            let wide = SphereFit::without_strays(&points_m, SphereRadius::Known { radius_m, u_m }, u_point_m);
            wide.with_context(|| name.clone())?.0
        }
        _ => held,
    };
    let rejected = strays.iter().map(|stray| (lines[stray.point], stray.off_m * 1e3)).collect();
    let answer = Answer { points: points_m.len(), fit, told, objection, rejected, verdict };
    verdict::check(
        &answer.verdict,
        accept,
        &name,
        || json!({ "form_um": answer.fit.form_m() * 1e6, "radius_mm": answer.fit.radius_m * 1e3, "rejected": answer.rejected_in_json() }),
    )?;
    let is_known = matches!(radius, SphereRadius::Known { .. });
    Ok(Product {
        words: answer.words(),
        json: answer.json(is_known),
        report: None,
        files: Vec::new(),
        withheld: Vec::new(),
    })
}

/// A sphere, and what is said of it.
struct Answer {
    points: usize,
    fit: SphereFit,
    /// What the points tell of the radius, where they contradict the given one.
    told: Option<ToldRadius>,
    objection: Option<Objection>,
    /// Lines of rejected points, and how far they lie off the sphere of the others (mm).
    rejected: Vec<(u64, f64)>,
    verdict: Verdict,
}

impl Answer {
    /// Expanded uncertainties of centre and radius (µm, k = 2).
    fn expanded_um(&self) -> Option<[f64; 4]> {
        self.fit.u_m().map(|u| u.map(|u| COVERAGE * u * 1e6))
    }

    fn words(&self) -> String {
        let fit = &self.fit;
        let expanded_um = self.expanded_um();
        let shown = |k: usize| expanded_um.map_or_else(|| "unknown".to_owned(), |u| digits::uncertainty(u[k]));
        let mut words = format!("{} points\n", self.points);
        for (k, axis) in ["x", "y", "z"].iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = writeln!(words, "  centre {axis}  {:14.5} mm  ± {} µm (k = 2)", fit.centre_m[k] * 1e3, shown(k));
        }
        let _ = writeln!(words, "  radius    {:14.5} mm  ± {} µm (k = 2)", fit.radius_m * 1e3, shown(3));
        let _ = writeln!(
            words,
            "  form      {:>14} µm  (largest less smallest distance from the centre)",
            digits::result(fit.form_m() * 1e6)
        );
        let scatter = fit.scatter_m.map_or_else(
            || "unknown: no more points than unknowns".to_owned(),
            |s| format!("{} µm", digits::result(s * 1e6)),
        );
        let _ = writeln!(words, "  scatter   {scatter}");
        let note = if fit.condition > SMALL_CAP { ": a small cap; mind the uncertainty" } else { "" };
        let _ = writeln!(words, "  condition {:.1}{note}", fit.condition);
        words.extend(self.objection.iter().map(Objection::words));
        words.push_str(&verdict::words(&self.verdict.findings));
        words.push_str(&claim_words(fit.claim.as_ref()));
        for (line, off_mm) in &self.rejected {
            let _ = writeln!(words, "  rejected  line {line}: {off_mm:.4} mm off the sphere of the other points");
        }
        words
    }

    fn json(&self, radius_is_known: bool) -> serde_json::Value {
        let fit = &self.fit;
        json!({
            "findings": verdict::with_objection(self.objection.as_ref(), &self.verdict.findings),
            "points": self.points,
            "rejected": self.rejected_in_json(),
            "centre_mm": (fit.centre_m * 1e3).as_slice(),
            "radius_mm": fit.radius_m * 1e3,
            "fitted_radius_mm": self.told.as_ref().map(|told| told.free.radius_m * 1e3),
            "radius_is_known": radius_is_known,
            "expanded_uncertainty_um": self.expanded_um().map(|u| json!({ "x": u[0], "y": u[1], "z": u[2], "radius": u[3], "k": COVERAGE })),
            "uncertainty_from": claim_json(fit.claim.as_ref()),
            "form_um": fit.form_m() * 1e6,
            "scatter_um": fit.scatter_m.map(|s| s * 1e6),
            "degrees_of_freedom": fit.degrees_of_freedom,
            "condition": fit.condition,
            "residuals_um": fit.residuals_m.iter().map(|r| r * 1e6).collect::<Vec<_>>(),
            "software": crate::pipeline::software(),
        })
    }

    fn rejected_in_json(&self) -> Vec<serde_json::Value> {
        self.rejected.iter().map(|(line, off_mm)| json!({ "line": line, "off_mm": off_mm })).collect()
    }
}

/// What the points say against the given radius, and what that does to the centre.
fn objection(told: &ToldRadius, held: &SphereFit) -> Objection {
    let fitted_mm = told.free.radius_m * 1e3;
    let fitted = match told.free.u_m() {
        Some(u_m) => digits::with_uncertainty(fitted_mm, COVERAGE * u_m[3] * 1e3).join(" ± "),
        None => format!("{fitted_mm:.5}"),
    };
    let moved_um = (held.centre_m - told.free.centre_m).norm() * 1e6;
    let grade = if told.is_certain { Grade::Refusal } else { Grade::Warning };
    let finding = format!(
        "the points tell a radius of {fitted} mm (k = 2), not the {} mm of --radius-mm; held to that, the centre moves by {} µm",
        held.radius_m * 1e3,
        digits::result(moved_um)
    );
    let causes = [
        "correct --radius-mm (the tip belongs to it where the points are centres of the tip), or leave it out, so that it is fitted",
        "give its uncertainty by --u-radius-um where that is not 0",
        "where it is right, the form of the sphere, the probe or the scale is wrong",
    ];
    Objection { grade, finding, causes: causes.map(str::to_owned).to_vec() }
}
