//! Liang 2025, section 4.4: acceptance test after ISO 10360, from the deviations of Table 2.
//!
//! Place in the flow: called by [`super::figures`]. Observed errors come from [`published`] through `abbe_conformity`; the
//! claims MPE_E = 0.5 + L/400 µm and MPE_P = 0.35 µm are limits. The test itself, before and after correction, is run on
//! simulated machines of the paper's size, since the paper's raw data are not published.

mod published;

use crate::figure::{Figure, PaperError, Settings, Verdict};
use abbe_conformity::length::{
    LengthErrors, LengthMeasurement, LengthPlan, LengthSet, LengthTest, MeasuringVolume, Probing, e0_lines, evaluate,
};
use abbe_conformity::{ConformityError, DecisionRule, MaximumPermissibleError, ObservedError, TestUncertainty};
use abbe_geometry::correct::correct;
use abbe_geometry::effects::{NoCovariates, State};
use abbe_geometry::error_function::FunctionKind;
use abbe_geometry::machine::{Joint, Machine, Side, Squareness};
use abbe_geometry::rotation::RotationForm;
use abbe_geometry::{Axis, ErrorId, Vector3};
use abbe_identify::{IdentifyOptions, identify};
use abbe_virtual_machine::environment::EnvironmentConfig;
use abbe_virtual_machine::instrument::InstrumentConfig;
use abbe_virtual_machine::length_test::{MachineAtTouch, length_test};
use abbe_virtual_machine::machine::Roughness;
use abbe_virtual_machine::plan::presets::{CASE_OFFSETS_M, case_like};
use abbe_virtual_machine::{SimulationConfig, SimulationError, TruthRecipe, simulate_campaign};
use published::{GAUGES_MM, LINES, SPHERE};
use std::collections::BTreeMap;

const PAPER: &str = "Liang 2025";
const TABLE: &str = "Table 2";
/// Claimed limit of the length error, L in mm, µm.
const CLAIM: &str = "0.5+L/400";
/// Claimed limit of the probing error (µm).
const PROBING_CLAIM_UM: f64 = 0.35;
/// Uncertainty of the gauge blocks, 0.07 µm + L/4000, and of the sphere (µm), as stated; its coverage factor is not.
const GAUGE_UNCERTAINTY: (f64, f64) = (0.07e-6, 0.25e-6);
const SPHERE_UNCERTAINTY_UM: f64 = 0.03;
/// Raw volumetric error (rms, m) of the first simulated machine of a seed; the machine tested has the same errors, larger.
const VOLUMETRIC_RMS_M: f64 = 20e-6;
/// Raw length error (m) that the paper reports as exceeded.
const RAW_M: f64 = 50e-6;
/// Raw length error (m) that each simulated machine is scaled to: beyond what is reported by a tenth, so that repeatability
/// leaves no doubt.
const SCALED_TO_M: f64 = 1.1 * RAW_M;

/// The figures of the acceptance test.
pub(super) fn figures(settings: &Settings) -> Result<Vec<Figure>, PaperError> {
    let errors = measured().map_err(failed)?;
    let mut figures = lengths(&errors).map_err(failed)?;
    figures.push(requirement(&errors));
    figures.extend(sphere());
    figures.extend(before_and_after(settings)?.map(|figure| settings.of_runs(figure)));
    Ok(figures)
}

/// The published deviations as a length test.
fn measured() -> Result<LengthErrors, ConformityError> {
    let mut measurements = Vec::new();
    for (line, _, deviations_um) in &LINES {
        for (gauge_mm, repeats) in GAUGES_MM.iter().zip(deviations_um) {
            for (repeat, deviation_um) in (1..).zip(repeats) {
                measurements.push(LengthMeasurement {
                    line: (*line).to_owned(),
                    calibrated_m: gauge_mm / 1e3,
                    repeat,
                    error: ObservedError::from_metres(deviation_um / 1e6),
                });
            }
        }
    }
    let travel_m = LINES.iter().map(|(line, travel_mm, _)| ((*line).to_owned(), travel_mm / 1e3)).collect();
    evaluate(LengthTest { tool_offset_m: 0.0, probing: Probing::Bidirectional, travel_m }, &measurements)
}

fn lengths(errors: &LengthErrors) -> Result<Vec<Figure>, ConformityError> {
    let limit = MaximumPermissibleError::from_text(CLAIM)?;
    let um = |m: f64| m * 1e6;
    let (largest, line, length_m) = errors.largest();
    let by_line = errors
        .lines
        .iter()
        .map(|l| format!("{} {:+.2} at {:.0} mm", l.line, um(l.largest.0.metres()), l.largest.1 * 1e3));
    let shares = errors.sets.iter().map(|s| s.largest().magnitude_m() / limit.at(s.calibrated_m).metres());
    let most = shares.fold(0.0, f64::max);
    let simple = errors.verdict(&limit, None, &DecisionRule::SimpleAcceptance).overall();
    let (constant_m, per_metre) = GAUGE_UNCERTAINTY;
    let guard = DecisionRule::GuardBand(TestUncertainty::expanded(constant_m, per_metre)?);
    let guarded = errors.verdict(&limit, None, &guard).overall();
    let conforms = simple == abbe_conformity::Verdict::Conforms && guarded == abbe_conformity::Verdict::Conforms;
    let frontier = errors.frontier()?;
    let tightest = frontier.smallest_area();
    let how = "deviations of Table 2 as shipped in launch-config/data/liang2025_lengths.csv, abbe_conformity::length"
        .to_owned();
    let row = |what: &str, published: Option<&str>, reproduced: String, verdict, reason: &str| Figure {
        place: TABLE,
        what: what.to_owned(),
        published: published.map(str::to_owned),
        reproduced,
        how: how.clone(),
        verdict,
        reason: reason.to_owned(),
    };
    Ok(vec![
        row(
            "length errors against their limit",
            Some("MPE_E 0.5 + L/400 µm met"),
            format!(
                "all {} within; {:.0} % of the limit used at most; the same with U = 0.07 µm + L/4000 taken off (ISO 14253-1)",
                errors.errors().count(),
                100.0 * most
            ),
            if conforms { Verdict::Reproduced } else { Verdict::DoesNotFollow },
            "the claim holds of these data with room, whether or not the stated uncertainty of the gauges is counted; what their \
             coverage factor is the paper does not say",
        ),
        row(
            "largest length error",
            Some("a row of Table 2, not named"),
            format!(
                "{:.2} µm at {:.0} mm on {line}; R0 {:.2} µm",
                um(largest.metres()),
                length_m * 1e3,
                errors.repeatability().map_or(f64::NAN, |r| um(r.metres()))
            ),
            Verdict::Reproduced,
            "an observed error; the paper defines its MPE_E as the largest one, which mixes up observation and limit",
        ),
        row(
            "largest length error by line",
            Some("rows of Table 2, not named"),
            by_line.collect::<Vec<_>>().join("; "),
            Verdict::Reproduced,
            "labels are out of order in the text at hand: X, Y and Z are labelled, the other four blocks of gauge lengths are the \
             diagonals, and which of 1 to 4 each is cannot be told",
        ),
        row(
            "tightest limit A + L/K that holds all errors",
            Some("0.5 + L/400 µm"),
            format!(
                "{:.3} + L/{:.0} µm (smallest area up to 420 mm); with K = 400, A = {:.2} µm; with A = 0.5 µm, K = {:.0}; constant {:.2} µm",
                (um(tightest.constant_m) * 1e3 - 1e-6).ceil() / 1e3,
                (1e-3 / tightest.per_metre + 1e-6).floor(),
                (um(frontier.smallest_constant_m(limit.per_metre())) * 1e2 - 1e-6).ceil() / 1e2,
                (1e-3 / frontier.smallest_per_metre(limit.constant_m())).floor(),
                um(largest.magnitude_m())
            ),
            Verdict::Better,
            "the data support a tighter limit than the one claimed, up to the 420 mm that were measured and no further",
        ),
        row(
            "lengths a line",
            Some("5"),
            format!("{}", errors.lines.iter().map(|l| l.lengths).max().unwrap_or(0)),
            Verdict::DoesNotFollow,
            "the text says five lengths, the table has six; both satisfy the standard",
        ),
    ])
}

/// Does the published test meet the standard's own requirement?
fn requirement(errors: &LengthErrors) -> Figure {
    let share = |line: &abbe_conformity::length::LineSummary| {
        line.travel_m.map_or_else(|| "?".to_owned(), |t| format!("{} {:.1} %", line.line, 100.0 * line.longest_m / t))
    };
    Figure {
        place: "section 4.4",
        what: "longest length as a share of the travel, 66 % asked for".to_owned(),
        published: Some("tested after ISO 10360".to_owned()),
        reproduced: errors.lines.iter().map(share).collect::<Vec<_>>().join("; "),
        how: "420 mm against 800 x 600 x 600 mm; body diagonals assumed for the four diagonals".to_owned(),
        verdict: Verdict::DoesNotFollow,
        reason: "ISO 10360-2 asks for a longest length of at least 66 % of the travel along its line: Y and Z have it, X and the \
                 diagonals do not, so this is not a whole test after the standard and nothing is verified beyond 420 mm"
            .to_owned(),
    }
}

fn sphere() -> Vec<Figure> {
    let all = || SPHERE.iter().flat_map(|(_, deviations)| deviations.iter().copied());
    let largest_um = all().fold(0.0, |most: f64, d| most.max(d.abs()));
    let nominal_um = || SPHERE.iter().map(|(diameter_mm, _)| diameter_mm * 1e3);
    let spread_um = nominal_um().fold(f64::MIN, f64::max) - nominal_um().fold(f64::MAX, f64::min);
    let how = "the four rows of the reference sphere, shipped in launch-config/data/liang2025_sphere.csv".to_owned();
    vec![
        Figure {
            place: TABLE,
            what: "probing error".to_owned(),
            published: Some(format!("MPE_P {PROBING_CLAIM_UM} µm")),
            reproduced: format!("largest of {} deviations {largest_um:.2} µm", all().count()),
            how: how.clone(),
            verdict: Verdict::Reproduced,
            reason: format!(
                "the limit claimed is the largest error observed: there is no margin, and with the sphere's stated uncertainty of \
                 {SPHERE_UNCERTAINTY_UM} µm ISO 14253-1 proves neither conformity nor nonconformity; the 25 points are not published, so \
                 neither form (PFTU) nor size (PSTU) can be computed"
            ),
        },
        Figure {
            place: TABLE,
            what: "calibrated diameter of the sphere".to_owned(),
            published: Some("29.97 mm, four different nominal values".to_owned()),
            reproduced: format!("the four differ by up to {spread_um:.2} µm"),
            how,
            verdict: Verdict::DoesNotFollow,
            reason: "one sphere has one calibrated diameter, so these are measured diameters (or several spheres), and a size error needs \
                     the calibrated one to a hundredth of a micrometre, which is not given"
                .to_owned(),
        },
    ]
}

/// The largest length errors of simulated machines as poor as the paper's, before and after correction.
fn before_and_after(settings: &Settings) -> Result<[Figure; 2], PaperError> {
    let limit = MaximumPermissibleError::from_text(CLAIM).map_err(failed)?;
    let runs = settings.runs(20, 2);
    let (mut before_um, mut after_um, mut shares, mut met) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for seed in (settings.seed..).take(runs) {
        let (machine, config) = poor_bridge(seed)?;
        let [before, after] = tested(&machine, &config, seed)?;
        before_um.push(before.largest().0.magnitude_m() * 1e6);
        after_um.push(after.largest().0.magnitude_m() * 1e6);
        let share = |set: &LengthSet| set.largest().magnitude_m() / limit.at(set.calibrated_m).metres();
        shares.push(100.0 * after.sets.iter().map(share).fold(0.0, f64::max));
        let verdict = after.verdict(&limit, None, &DecisionRule::SimpleAcceptance).overall();
        met += usize::from(verdict == abbe_conformity::Verdict::Conforms);
    }
    let ends = |values: &[f64]| values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    let range = |values: &[f64]| format!("{:.2} to {:.2}", ends(values).0, ends(values).1);
    let how = format!(
        "{runs} simulated machines of 800 x 600 x 600 mm, errors scaled until the raw length error is {:.0} µm; geometry \
         identified from a tracer campaign of five stations, no network; the whole test after ISO 10360-2, lengths up to 90 % of \
         the travel, the same touches before and after",
        SCALED_TO_M * 1e6
    );
    Ok([
        Figure {
            place: "section 4.4, Fig. 10",
            what: "largest length error without compensation (µm)".to_owned(),
            published: Some("over 50".to_owned()),
            reproduced: range(&before_um),
            how: how.clone(),
            verdict: Verdict::NotPublished,
            reason: "readings of Fig. 10 are not published; machines of that size and error were made to test the claim below".to_owned(),
        },
        Figure {
            place: "section 4.4, Fig. 10",
            what: "largest length error after compensation (µm)".to_owned(),
            published: Some("within 0.5 + L/400 from over 50".to_owned()),
            reproduced: format!(
                "{}; {met} of {runs} machines within 0.5 + L/400, which is used up to {:.0} to {:.0} %",
                range(&after_um),
                ends(&shares).0,
                ends(&shares).1
            ),
            how,
            verdict: if met == runs { Verdict::Reproduced } else { Verdict::NotPublished },
            reason: if met == runs {
                "a rigid-body model from one campaign reaches the limit alone; the simulated machines have no error beyond geometry, \
                 which the paper's network is for"
            } else {
                "the readings are not published; geometry alone does not bring every machine as poor as this within the limit, and \
                 the paper's one machine has its network as well"
            }
            .to_owned(),
        },
    ])
}

/// A bridge machine whose raw length error is [`SCALED_TO_M`]: that of its seed with larger errors.
fn poor_bridge(seed: u64) -> Result<(Machine, SimulationConfig), PaperError> {
    let mut rms_m = VOLUMETRIC_RMS_M;
    let (machine, config) = simulated_bridge(seed, rms_m).map_err(failed)?;
    // Errors are small, so that lengths grow with them but for the repeatability.
    rms_m *= SCALED_TO_M / raw(&machine, &config, seed)?.largest().0.magnitude_m();
    simulated_bridge(seed, rms_m).map_err(failed)
}

/// A bridge machine of the paper's size and of that raw volumetric error (rms, m), and its measurement by a tracer on five
/// stations.
fn simulated_bridge(seed: u64, volumetric_rms_m: f64) -> Result<(Machine, SimulationConfig), SimulationError> {
    let recipe = TruthRecipe { seed, roughness: Roughness::TYPICAL, volumetric_rms_m };
    let truth = recipe.bridge_xyz()?;
    let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
    let joint = |axis| Joint { axis, side: Side::Tool };
    let machine = Machine {
        name: "bridge".to_owned(),
        frame_id: "machine".to_owned(),
        joints: [joint(Axis::X), joint(Axis::Y), joint(Axis::Z)],
        stroke_m: truth.stroke_m.map(|[lower, upper]| (lower, upper)),
        squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
        rotation: RotationForm::Exact,
        kinds: [Some(FunctionKind::BSpline { intervals: 9 }); ErrorId::COUNT],
        repeatability_m: InstrumentConfig::LASER_TRACER.repeatability_m,
        u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
        default_offset_m: None,
    };
    let config = SimulationConfig {
        seed,
        plan: case_like(truth.stroke_m, seed).build()?,
        machine: truth,
        instrument: InstrumentConfig::LASER_TRACER,
        environment: EnvironmentConfig::constant(),
        effects: Vec::new(),
    };
    Ok((machine, config))
}

/// Whole tests of one machine before and after correction by the model that its campaign gives.
fn tested(machine: &Machine, config: &SimulationConfig, seed: u64) -> Result<[LengthErrors; 2], PaperError> {
    let campaign = simulate_campaign(config).map_err(failed)?.campaign;
    let found = identify(machine, config.instrument.range, &campaign, &IdentifyOptions::default(), &mut |_| true);
    let model = found.map_err(failed)?.model;
    let corrected_m = |at: &MachineAtTouch| -> [f64; 3] {
        let state = State { reading_m: at.reading_m, offset_m: at.offset_m, covariates: &NoCovariates };
        correct(&model, &state).position_m.into()
    };
    Ok([raw(machine, config, seed)?, whole_test(machine, config, seed, &corrected_m)?])
}

/// The whole test of the machine as it is.
fn raw(machine: &Machine, config: &SimulationConfig, seed: u64) -> Result<LengthErrors, PaperError> {
    whole_test(machine, config, seed, &|at| at.indicated_m())
}

/// Seven lines, five lengths, three repeats, with the stylus where the plan hangs the reflector.
fn whole_test(
    machine: &Machine,
    config: &SimulationConfig,
    seed: u64,
    believed_m: &dyn Fn(&MachineAtTouch) -> [f64; 3],
) -> Result<LengthErrors, PaperError> {
    let volume = MeasuringVolume::new(machine.stroke_m).map_err(failed)?;
    let stylus_m = Vector3::from(CASE_OFFSETS_M[0]);
    let lines: Vec<_> = e0_lines(&volume).into_iter().map(|line| line.with_stylus(stylus_m)).collect();
    let travel_m: BTreeMap<String, f64> = lines.iter().map(|line| (line.name.clone(), line.travel_m())).collect();
    let measured = length_test(config, &lines, &LengthPlan::default(), seed, believed_m).map_err(failed)?;
    evaluate(LengthTest { tool_offset_m: 0.0, probing: Probing::Bidirectional, travel_m }, &measured).map_err(failed)
}

fn failed(problem: impl ToString) -> PaperError {
    PaperError { paper: PAPER, place: TABLE, problem: problem.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Figure> {
        figures(&Settings { seed: 1, effort: 0.1 }).unwrap()
    }

    #[test]
    fn val_liang_2025_table_2_gives_the_figures_worked_out_from_it() {
        let errors = measured().unwrap();
        let (largest, line, length_m) = errors.largest();
        assert_eq!((largest.metres(), line, length_m), (-0.58e-6, "diagonal_d", 0.42));
        // 260.0388 mm on the same line: -0.35, -0.19, -0.49.
        assert!((errors.repeatability().unwrap().metres() - 0.30e-6).abs() < 1e-15);
        // The hull edge over half of 420 mm goes through 0.45 um at 179.9895 mm and 0.57 um at 340.0179 mm, worked out by hand:
        // slope 0.12/160.0284 um/mm, A = 0.45 - 179.9895 slope.
        let slope = 0.12 / 160.0284;
        let tightest = errors.frontier().unwrap().smallest_area();
        assert!((tightest.per_metre * 1e3 - slope).abs() < 1e-9, "{tightest:?}");
        assert!((tightest.constant_m * 1e6 - (0.45 - 179.9895 * slope)).abs() < 1e-9, "{tightest:?}");
    }

    #[test]
    fn what_the_published_test_lacks_is_said() {
        let errors = measured().unwrap();
        let lacking: Vec<&str> = errors.departures.iter().map(|d| d.place.as_str()).collect();
        assert_eq!(lacking, ["line X", "line diagonal_a", "line diagonal_b", "line diagonal_c", "line diagonal_d"]);
        assert!(errors.departures[0].text.contains("52.5 %") && errors.departures[1].text.contains("36.0 %"));
    }

    #[test]
    fn claims_are_judged_and_observed_errors_are_no_limits() {
        let rows = rows();
        let verdict = |what: &str| rows.iter().find(|row| row.what == what).unwrap().verdict;
        assert_eq!(verdict("length errors against their limit"), Verdict::Reproduced);
        assert_eq!(verdict("lengths a line"), Verdict::DoesNotFollow);
        assert_eq!(verdict("calibrated diameter of the sphere"), Verdict::DoesNotFollow);
        assert!(rows.iter().any(|row| row.reproduced.contains("largest of 12 deviations 0.35 µm")));
    }

    #[test]
    fn a_raw_length_error_beyond_50_um_becomes_at_least_ten_times_smaller() {
        let (machine, config) = poor_bridge(3).unwrap();
        let [before, after] = tested(&machine, &config, 3).unwrap();
        assert!(before.largest().0.magnitude_m() > RAW_M);
        assert!(before.departures.is_empty() && after.departures.is_empty());
        assert!(before.largest().0.magnitude_m() > 10.0 * after.largest().0.magnitude_m());
    }
}
