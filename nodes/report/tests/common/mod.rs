//! A realistic synthetic campaign, shared by the example and the tests. Not a simulator: plausible shapes and noise.
//!
//! Out: a full [`DemoReport`] in mm, µm and µrad; the same seed gives the same data.

use abbe_report::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const STROKE_MM: [f64; 3] = [800.0, 600.0, 600.0];
const AXES: [&str; 3] = ["x", "y", "z"];
const STATIONS: [(&str, [f64; 3]); 5] = [
    ("A", [-210.4471, -180.2213, 120.0934]),
    ("B", [1010.9921, -150.7743, 140.5512]),
    ("C", [-190.0182, 760.3345, 80.7719]),
    ("D", [980.4410, 790.1129, 650.3307]),
    ("E", [400.2150, 300.8821, -260.4416]),
];

/// A source of plausible numbers.
struct Source(ChaCha8Rng);

impl Source {
    fn normal(&mut self, sigma: f64) -> f64 {
        sigma * self.0.sample::<f64, _>(StandardNormal)
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    fn point_mm(&mut self) -> [f64; 3] {
        STROKE_MM.map(|s| self.uniform(0.0, s))
    }
}

/// The whole report.
pub(crate) fn demo_report(seed: u64) -> DemoReport {
    let mut source = Source(ChaCha8Rng::seed_from_u64(seed));
    let errors = errors(&mut source);
    let verification = verification(&mut source, 400);
    let residuals = residuals(&mut source, 2790);
    let stations = stations(&residuals);
    DemoReport {
        header: header(),
        verification,
        verification_note: Some(
            "400 random points of another day, aligned rigidly to the reference frame; uncertainty of the reference \
             0.05 µm."
                .into(),
        ),
        fit: FitSummary {
            residual_sigma_um: Some(0.321),
            declared_sigma_um: Some(0.302),
            chi2_per_dof: Some(1.11),
            degrees_of_freedom: Some(2571.4),
            readings_used: 2790,
            readings_rejected: 27,
            converged: true,
        },
        steps: steps(),
        residuals,
        errors,
        stations,
        volume: Some(MeasuringVolume { min_mm: [0.0; 3], max_mm: STROKE_MM }),
        lines: lines(),
        order: order(&mut source),
        identifiability: identifiability(),
        rejected: rejected(&mut source, 27),
        live: Some(LiveFigures {
            samples_sent: Some(60000),
            samples_received: Some(60000),
            samples_lost: Some(0),
            latency_p50_us: Some(41.3),
            latency_p99_us: Some(118.9),
            latency_p999_us: Some(402.0),
            transport: Some("shared memory".into()),
        }),
        closing: None,
        is_fit_alone: false,
        remarks: vec![Callout {
            tone: Tone::Warning,
            title: String::new(),
            text:
                "Two pairs of parameters correlate above 0.9: their values are not to be read one by one, their sum is \
                   well determined."
                    .into(),
        }],
    }
}

fn header() -> RunHeader {
    let file = |role: &str, name: &str| FileEntry { role: role.into(), name: name.into() };
    RunHeader {
        title: "Volumetric correction of a bridge machine".into(),
        what: "A recorded tracer campaign identified the machine's 21 errors; the nodes then corrected its \
               coordinates live."
            .into(),
        identity: Identity {
            operator: Some("A. Person".into()),
            machine: Some("bridge_xyz, 800 x 600 x 600 mm".into()),
            machine_serial: Some("4711".into()),
            measured: Some("2026-01-15".into()),
            ..Identity::default()
        },
        next: None,
        about: vec![file("Instrument", "tracer"), file("Temperatures", "19.8 to 20.3 °C")],
        files: vec![file("campaign", "example-campaign.mcap"), file("verification", "example-verify.csv")],
        data_hash: Some("3f1d9c0a7be2415588e0c2f4a96d7b1350fe8c21aa09d4e7".into()),
        model_hash: Some("b80c55e1f2a94d03977a61e0d2c8345f1b6e7d90c4a2f318".into()),
        software_version: "abbe 0.1.0".into(),
    }
}

/// Error before: smooth volume error of some 20 µm; after: noise with a weak rest.
fn verification(source: &mut Source, count: usize) -> Vec<VerificationPoint> {
    (0..count)
        .map(|_| {
            let p = source.point_mm();
            let [u, v, w] = std::array::from_fn(|i| p[i] / STROKE_MM[i]);
            let before = [
                14.0 * u + 4.0 * (4.0 * u).sin() - 9.0 * w * v,
                -8.0 * v + 6.0 * u * u + 5.0 * w,
                11.0 * w - 7.0 * u * (1.0 - u) - 3.0 * v,
            ];
            VerificationPoint {
                position_mm: p,
                before_um: before.map(|b| b + source.normal(0.25)),
                after_um: Some([0.2 * u - 0.1, 0.1, 0.3 * w - 0.15].map(|a| a + source.normal(0.16))),
                after_loop_um: None,
            }
        })
        .collect()
}

fn residuals(source: &mut Source, count: usize) -> Vec<Residual> {
    (0..count)
        .map(|i| {
            let station = STATIONS[i * STATIONS.len() / count];
            let p: [f64; 3] = std::array::from_fn(|a| (source.uniform(0.0, 9.0).floor()) / 8.0 * STROKE_MM[a]);
            let distance = (0..3).map(|a| (p[a] - station.1[a]).powi(2)).sum::<f64>().sqrt();
            let sigma = 0.25 + 0.00008 * distance;
            let drift = 0.1 * (i as f64 / 300.0).sin() + 0.15 * (p[0] / 800.0 - 0.5);
            Residual {
                station: station.0.into(),
                // Three lines a station, one after the other.
                line: format!("{}-{}", station.0, 3 * (i * STATIONS.len() % count) / count),
                time_s: i as f64 * 4.2 + 600.0 * (i * STATIONS.len() / count) as f64,
                position_mm: p,
                residual_um: drift + source.normal(sigma),
                declared_sigma_um: Some(sigma),
            }
        })
        .collect()
}

fn errors(source: &mut Source) -> ErrorCurveSet {
    let mut curves = Vec::new();
    for (axis, name) in AXES.into_iter().enumerate() {
        for (kind, letter) in [(ErrorKind::Linear, 'E'), (ErrorKind::Angular, 'R')] {
            for direction in 0..3 {
                curves.push(curve(source, axis, name, kind, letter, direction));
            }
        }
    }
    let squareness = ["A0Z", "B0Z", "C0Y"]
        .map(|name| {
            let truth = source.normal(12.0);
            SquarenessError {
                name: name.into(),
                value_urad: Some(truth + source.normal(0.2)),
                expanded_95_urad: Some(source.uniform(0.3, 0.6)),
                truth_urad: Some(truth),
            }
        })
        .to_vec();
    ErrorCurveSet { curves, squareness }
}

fn curve(source: &mut Source, axis: usize, name: &str, kind: ErrorKind, letter: char, dir: usize) -> ErrorCurve {
    let moved = ["X", "Y", "Z"][axis];
    let names = if letter == 'E' { ["EX", "EY", "EZ"] } else { ["EA", "EB", "EC"] };
    let (a, b, c) = (source.normal(5.0), source.normal(3.0), source.uniform(2.0, 7.0));
    let width = if kind == ErrorKind::Linear { 0.35 } else { 0.8 };
    let share = |i: usize| i as f64 / 60.0;
    let truth = |t: f64| a * t * (1.0 - 0.6 * t) + b * (c * t).sin();
    ErrorCurve {
        name: format!("{}{moved}", names[dir]),
        axis: name.into(),
        kind,
        position_mm: (0..=60).map(|i| share(i) * STROKE_MM[axis]).collect(),
        value: (0..=60).map(|i| Some(truth(share(i)) + 0.4 * width * (9.0 * share(i) + c).sin())).collect(),
        half_width_95: Some((0..=60).map(|i| Some(width * (0.6 + 1.6 * (share(i) - 0.5).powi(2)))).collect()),
        truth: Some((0..=60).map(|i| Some(truth(share(i)))).collect()),
    }
}

fn stations(residuals: &[Residual]) -> Vec<StationEntry> {
    let entry = |(index, (name, position)): (usize, (&str, [f64; 3]))| {
        let own: Vec<f64> = residuals.iter().filter(|r| r.station == name).map(|r| r.residual_um).collect();
        StationEntry {
            name: name.into(),
            position_mm: position,
            uncertainty_um: (index != 4).then_some([0.21, 0.18, 0.34]),
            dead_path_mm: Some(212.3051 + 31.77 * index as f64),
            readings: own.len(),
            residual_rms_um: rms(&own),
        }
    };
    STATIONS.into_iter().enumerate().map(entry).collect()
}

fn lines() -> Vec<MeasuredLine> {
    let mut lines = Vec::new();
    for (station, _) in STATIONS {
        for j in 0..3 {
            for k in 0..3 {
                let (y, z) = (300.0 * f64::from(j), 300.0 * f64::from(k));
                let name = format!("{station}-{}", 3 * j + k);
                lines.push(MeasuredLine { name, station: station.into(), from_mm: [0.0, y, z], to_mm: [800.0, y, z] });
            }
        }
    }
    lines
}

fn order(source: &mut Source) -> Vec<OrderChoice> {
    let names = ["EX", "EY", "EZ", "EA", "EB", "EC"];
    ["X", "Y", "Z"]
        .iter()
        .flat_map(|axis| names.map(|name| format!("{name}{axis}")))
        .map(|error| OrderChoice {
            error,
            form: "penalised cubic B-spline, 8 knots".into(),
            effective_dof: Some(source.uniform(2.0, 9.0)),
            evidence_gain: Some(source.uniform(3.0, 180.0)),
        })
        .collect()
}

fn identifiability() -> Identifiability {
    let pair = |first: &str, second: &str, coefficient| Correlation {
        first: first.into(),
        second: second.into(),
        coefficient,
    };
    Identifiability {
        unknowns: 219,
        rank: Some(219),
        condition: Some(4821.0),
        cramer_rao_ratio: Some(1.043),
        correlations: vec![pair("dead path C", "z of station C", -0.943), pair("EBX knot 7", "EBX knot 8", 0.911)],
    }
}

fn steps() -> Vec<StepDuration> {
    [
        ("read campaign", 0.08),
        ("identify", 0.17),
        ("choose order", 1.42),
        ("start nodes", 0.35),
        ("play recording", 21.6),
        ("report", 0.4),
    ]
    .map(|(name, duration)| StepDuration { name: name.into(), duration_s: Some(duration) })
    .to_vec()
}

fn rejected(source: &mut Source, count: usize) -> Vec<RejectedReading> {
    (0..count)
        .map(|i| RejectedReading {
            row: 37 + 101 * i,
            station: STATIONS[i % 5].0.into(),
            line: format!("{}-1", STATIONS[i % 5].0),
            time_s: (i != 3).then_some(155.4 + 424.2 * i as f64),
            position_mm: source.point_mm(),
            residual_um: Some(source.normal(4.0)),
            normalised: Some(source.uniform(5.0, 14.0)),
            reason: "beam interrupted".into(),
        })
        .collect()
}
