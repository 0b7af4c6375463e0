//! `abbe guideway`: targets on a table at several positions in; the six errors of the axis with uncertainty out.
//!
//! Place in the flow: on its own. Tracker readings or points of any instrument; CSV, JSON and report in a folder.

use crate::calibration::{check_folder, finish, guideway, lead_on};
use crate::identity::IdentityOptions;
use crate::next::Next;
use crate::verdict::{Accept, shown};
use abbe_measurement::guideway::{GuidewayAxis, GuidewayFrame, GuidewayOptions, GuidewayRotation};
use abbe_measurement::tracker::TrackerUncertainty;
use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use std::path::PathBuf;

/// The axis that moves.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum AxisText {
    /// Along x
    #[value(alias = "X")]
    X,
    /// Along y
    #[value(alias = "Y")]
    Y,
    /// Along z
    #[value(alias = "Z")]
    Z,
}

/// Frame of the points.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrameText {
    /// The machine's: slopes of straightness stay in
    Given,
    /// The instrument's own, turned so that the mean motion is along the axis
    AlongMotion,
}

/// How rotations enter.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum RotationText {
    /// The rotation vector
    Exact,
    /// δ + ε × p, as published
    SmallAngle,
}

/// Arguments of `guideway`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Targets by position (CSV): position_mm, target and range_mm, azimuth_deg, elevation_deg, or x_mm, y_mm, z_mm
    #[arg(long)]
    points: PathBuf,
    /// The axis that moves
    #[arg(long)]
    axis: AxisText,
    /// Frame of the points
    #[arg(long, default_value = "given")]
    frame: FrameText,
    /// How rotations enter
    #[arg(long, default_value = "exact")]
    rotation: RotationText,
    /// Point whose displacement is reported, at the lowest position, X,Y,Z in the frame of the points; else the targets' centroid
    #[arg(long, allow_hyphen_values = true)]
    reference_mm: Option<String>,
    /// Standard uncertainty (k = 1) of the tracker along the beam, "CONSTANT_um,PER_METRE_um" such as 0.5,0.5
    #[arg(long, requires = "u_across")]
    u_range: Option<String>,
    /// Standard uncertainty (k = 1) of the tracker across the beam, "CONSTANT_um,PER_METRE_um" such as 5,2
    #[arg(long, requires = "u_range")]
    u_across: Option<String>,
    /// Folder for report.html, errors.csv and guideway.json
    #[arg(long)]
    out: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    accept: Accept,
    #[command(flatten)]
    identity: IdentityOptions,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if let Some(folder) = &arguments.out {
        check_folder(folder)?;
    }
    let options = GuidewayOptions {
        axis: match arguments.axis {
            AxisText::X => GuidewayAxis::X,
            AxisText::Y => GuidewayAxis::Y,
            AxisText::Z => GuidewayAxis::Z,
        },
        frame: match arguments.frame {
            FrameText::Given => GuidewayFrame::Given,
            FrameText::AlongMotion => GuidewayFrame::AlongMotion,
        },
        rotation: match arguments.rotation {
            RotationText::Exact => GuidewayRotation::Exact,
            RotationText::SmallAngle => GuidewayRotation::SmallAngle,
        },
        reference_m: match &arguments.reference_mm {
            None => None,
            Some(text) => Some(numbers::<3>("--reference-mm", text)?.map(|mm| mm / 1e3).into()),
        },
    };
    let product = guideway::product(&arguments.points, options, tracker(arguments)?, arguments.accept);
    let mut product = shown(product, arguments.json)?;
    product.identify(&arguments.identity, &arguments.points)?;
    let plan = "plan --machine MACHINE.toml --request REQUEST.toml --out plan";
    lead_on(&mut product, &Next::new("to measure all errors of the machine together", plan));
    finish(&product, arguments.out.as_deref(), &arguments.points, arguments.json)
}

fn tracker(arguments: &Arguments) -> anyhow::Result<Option<TrackerUncertainty>> {
    let (along, across) = match (&arguments.u_range, &arguments.u_across) {
        (None, None) => return Ok(None),
        (Some(along), Some(across)) => (along, across),
        _ => bail!("--u-range and --u-across belong together; give both"),
    };
    let [range_constant_m, range_per_metre] = numbers::<2>("--u-range", along)?.map(|um| um / 1e6);
    let [transverse_constant_m, transverse_per_metre] = numbers::<2>("--u-across", across)?.map(|um| um / 1e6);
    let tracker = TrackerUncertainty { range_constant_m, range_per_metre, transverse_constant_m, transverse_per_metre };
    tracker.check().context("--u-range, --u-across")?;
    Ok(Some(tracker))
}

/// So many numbers between commas.
fn numbers<const N: usize>(option: &str, text: &str) -> anyhow::Result<[f64; N]> {
    let values: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>())
        .collect::<Result<_, _>>()
        .with_context(|| format!("{option} {text:?}: write {N} numbers with commas between"))?;
    ensure!(values.iter().all(|v| v.is_finite()), "{option} {text:?}: write finite numbers");
    values.try_into().map_err(|_| anyhow::anyhow!("{option} {text:?}: write {N} numbers with commas between"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_between_commas_are_counted() {
        assert_eq!(numbers::<3>("--o", "1, -2.5,3e1").unwrap(), [1.0, -2.5, 30.0]);
        for text in ["1,2", "1,2,3,4", "1,x,3", "1,NaN,3", ""] {
            assert!(numbers::<3>("--o", text).unwrap_err().to_string().starts_with("--o"), "{text}");
        }
    }
}
