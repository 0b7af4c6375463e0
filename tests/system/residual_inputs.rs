//! Residual models on named inputs from end to end: temperatures beside the position, joints in its place; train, compare, predict,
//! correct, verify, live and replay, and what must be refused or left out.
//!
//! Place in the flow: only the command and its files. The residuals are made here: a field of position times the deviation of the air
//! from 16 °C, under a little noise; a third of the rows judges.

use std::fs;
use std::sync::OnceLock;

use crate::common::assert_says;
use crate::common::files::{Bench, machine, samples, text};
use crate::common::graph::{LaunchText, MEMORY, long_recording, stream_of, topic};
use crate::common::program::{Ran, abbe, run};
use abbe_msgs::bag::BagWriter;
use abbe_msgs::{CorrectedCoordinates, CorrectionStatus, Covariates, ScaleReading};
use serde_json::Value;

const QUICK: &str = "seed = 5\nmethod = \"kriging\"\n";
/// A comparison that a test can wait for.
const QUICK_NETWORKS: &str =
    "seed = 5\n[network]\nwidth = 8\nheads = 2\n[perceptron]\nwidth = 8\n[optimiser]\nepochs = 2\n";
/// Samples of the live run, at 1 kHz.
const LIVE: u64 = 3000;

/// A number between 0 and 1 for each row: evenly spread, and in no order.
fn share(row: usize, factor: f64) -> f64 {
    (row as f64 * factor).fract()
}

fn temp_c(row: usize) -> f64 {
    18.0 + 4.0 * share(row, 0.618_034)
}

/// What is left at a place (mm) in air of this temperature (µm).
fn left_um([x, y, z]: [f64; 3], temp_c: f64) -> [f64; 3] {
    let waves = [(x / 150.0).sin() + y / 600.0, (y / 120.0 + x / 400.0).cos(), (z / 140.0).sin() - x / 800.0];
    waves.map(|wave| wave * (temp_c - 16.0) / 2.0)
}

/// The folder of all tests: `model.json`, `warm.csv` to learn from and `judge.csv`, `warm.json` and `plain.json` of it.
fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| {
        let bench = Bench::identified(9);
        let (model, residuals) = (bench.text("model.json"), bench.text("residuals.csv"));
        run(["residuals", "--model", &model, "--campaign", &bench.text("verify.csv"), "--out", &residuals]).ok();
        let read = bench.read("residuals.csv");
        // What the campaign logged comes through.
        assert_says(&read, &["temp_air_c", "load_kg", "time_s"]);
        let head = read.lines().next().unwrap();
        let rows: Vec<[f64; 3]> = read.lines().filter(|line| !line.starts_with(['#', 'x'])).map(place_mm).collect();
        let row = |k: usize, at: [f64; 3]| {
            let noise = |factor: f64| 0.1 * (share(k, factor) - 0.5);
            let [rx, ry, rz] = left_um(at, temp_c(k));
            let [x, y, z] = at;
            let (rx, ry, rz) = (rx + noise(0.7341), ry + noise(0.2913), rz + noise(0.1593));
            format!("{x},{y},{z},{rx},{ry},{rz},{},{}\n", temp_c(k), 20.0 + share(k, 0.414_214))
        };
        let part = |keep: fn(usize) -> bool| {
            let names = "x_mm,y_mm,z_mm,res_x_um,res_y_um,res_z_um,temp_air_c,temp_cellar_c";
            let rows: String = rows.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(k, at)| row(k, *at)).collect();
            format!("{head}\n{names}\n{rows}")
        };
        bench.write("warm.csv", part(|k| k % 3 != 0));
        bench.write("judge.csv", part(|k| k % 3 == 0));
        train(&bench, "warm.csv", "position,temp_air_c", "warm.json").ok();
        train(&bench, "warm.csv", "position", "plain.json").ok();
        bench
    })
}

fn place_mm(line: &str) -> [f64; 3] {
    let mut cells = line.split(',').map(|cell| cell.parse::<f64>());
    std::array::from_fn(|_| cells.next().unwrap().unwrap())
}

fn train(bench: &Bench, residuals: &str, inputs: &str, out: &str) -> Ran {
    let config = bench.write("quick.toml", QUICK);
    let (residuals, out) = (bench.text(residuals), bench.text(out));
    run(["train", "--residuals", &residuals, "--inputs", inputs, "--config", &config, "--out", &out])
}

/// A column of a table by its name; `None` for an empty cell.
fn column(table: &str, name: &str) -> Vec<Option<f64>> {
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let place = lines.next().unwrap().split(',').position(|n| n == name).unwrap_or_else(|| panic!("no {name}"));
    lines.map(|line| line.split(',').nth(place).unwrap().parse().ok()).collect()
}

fn words(table: &str, name: &str) -> Vec<String> {
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let place = lines.next().unwrap().split(',').position(|n| n == name).unwrap_or_else(|| panic!("no {name}"));
    lines.map(|line| line.split(',').nth(place).unwrap().to_owned()).collect()
}

/// Rows of `judge.csv` without their residuals, with these columns.
fn questions(bench: &Bench, cells: impl Fn(usize, &[&str]) -> String, names: &str) -> String {
    let table = bench.read("judge.csv");
    let rows = table.lines().skip(2).enumerate().map(|(k, line)| cells(k, &line.split(',').collect::<Vec<_>>()) + "\n");
    format!("{names}\n{}", rows.collect::<String>())
}

/// Root mean square (µm) of what a model misses at the judging rows, and the share within 95 %.
fn judged(bench: &Bench, model: &str) -> (f64, f64) {
    let plain = questions(
        bench,
        |_, cells| [&cells[..3], &cells[6..]].concat().join(","),
        "x_mm,y_mm,z_mm,temp_air_c,temp_cellar_c",
    );
    let (input, out) = (bench.write("ask.csv", plain), bench.text("told.csv"));
    run(["predict", "--model", &bench.text(model), "--in", &input, "--out", &out]).ok();
    let (told, truth) = (bench.read("told.csv"), bench.read("judge.csv"));
    let (mut square, mut within, mut count) = (0.0, 0, 0);
    for axis in ["x", "y", "z"] {
        let [res, u] = [format!("res_{axis}_um"), format!("u_{axis}_um")];
        for ((found, u), truth) in column(&told, &res).iter().zip(column(&told, &u)).zip(column(&truth, &res)) {
            let error = found.unwrap() - truth.unwrap();
            square += error * error;
            within += usize::from(error.abs() <= 1.96 * u.unwrap());
            count += 1;
        }
    }
    ((square / count as f64).sqrt(), within as f64 / count as f64)
}

#[test]
fn a_temperature_as_input_takes_the_error_away_and_the_uncertainty_holds() {
    let bench = bench();
    let [(warm, warm_within), (plain, plain_within)] = ["warm.json", "plain.json"].map(|model| judged(bench, model));
    println!("rms {plain:.3} → {warm:.3} µm; within 95 %: {plain_within:.3}, {warm_within:.3}");
    assert!(warm < 0.3 * plain, "{plain} {warm}");
    // 399 components of a third of the rows.
    assert!((0.90..=0.99).contains(&warm_within), "{warm_within}");
    let file = bench.read("warm.json");
    assert_says(
        &file,
        &["\"input_3\": \"temp_air_c\"", "input_low", "input_high", "input_scale", "\"input_0\": \"x_m\""],
    );
    assert!(!bench.read("plain.json").contains("input_"));
    let said = train(bench, "warm.csv", "position,temp_air_c", "again.json").ok();
    assert_eq!(bench.read("again.json"), file);
    assert_says(&said, &["x_m y_m z_m temp_air_c", "kriging (position alone)", "recommended kriging: "]);
}

/// What training wrote of its evidence into the model.
fn validation(file: &str) -> Value {
    let file: Value = serde_json::from_str(file).unwrap();
    file["residual"]["validation"].clone()
}

#[test]
fn single_vectors_that_contradict_all_others_teach_nothing_and_are_named() {
    let bench = bench();
    let spoilt = |(k, line): (usize, &str)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if [40, 90].contains(&k) {
            cells[4] = format!("{}", cells[4].parse::<f64>().unwrap() + 60.0);
        }
        cells.join(",") + "\n"
    };
    bench.write("gross.csv", bench.read("warm.csv").lines().enumerate().map(spoilt).collect::<String>());
    let ran = train(bench, "gross.csv", "position,temp_air_c", "gross.json");
    let warning = ran.errors.clone();
    assert_says(
        &warning,
        &["gross.csv: 2 of", "contradict all others and are left out", "temp_air_c", "y is +6", "µm off"],
    );
    assert_says(&ran.ok(), &["left out          2 that contradict all others"]);
    let [spoilt, clean]: [Value; 2] = ["gross.json", "warm.json"].map(|file| validation(&bench.read(file)));
    assert_eq!(spoilt["left_out"].as_array().unwrap().len(), 2);
    assert!(clean.get("left_out").is_none());
    let mse = |validation: &Value| {
        let methods = validation["held_out"].as_array().unwrap();
        let own = methods.iter().find(|scores| scores["method"] == "kriging").unwrap();
        own["scores"]["mse_um2"].as_f64().unwrap()
    };
    assert!(mse(&spoilt) < 1.3 * mse(&clean), "{} {}", mse(&spoilt), mse(&clean));
}

#[test]
fn compare_says_whether_an_input_helps_on_unseen_data() {
    let bench = bench();
    let config = bench.write("networks.toml", QUICK_NETWORKS);
    let compare = |inputs: &str, more: &[&str]| {
        let residuals = bench.text("warm.csv");
        let own = ["compare", "--residuals", &residuals, "--inputs", inputs, "--config", &config, "--seeds", "1"];
        run([&own, more].concat()).ok()
    };
    let said = compare("position,temp_air_c", &[]);
    assert_says(&said, &["kriging (position alone)", "these data speak for", "--inputs position,temp_air_c"]);
    assert!(!said.contains("do not show that the further inputs help"), "{said}");
    let table: Value = serde_json::from_str(&compare("position,temp_cellar_c", &["--json"])).unwrap();
    let recommended = table["comparison"]["recommendation"]["method"].as_str().unwrap();
    assert!(recommended.ends_with("(position alone)"), "{recommended}");
    assert_eq!(table["comparison"]["inputs"][3], "temp_cellar_c");
    let said = train(bench, "warm.csv", "position,temp_cellar_c", "cellar.json").ok();
    assert_says(&said, &["do not show that the further inputs help"]);
}

#[test]
fn a_row_without_its_input_has_no_residual_and_one_beyond_the_range_is_extrapolated() {
    let bench = bench();
    let rows = "x_mm,y_mm,z_mm,temp_air_c\n400,300,200,20.5\n400,300,200,\n400,300,200,25\n400,300,200,n/a\n";
    let (input, out) = (bench.write("gaps.csv", rows), bench.text("gaps_told.csv"));
    let ran = run(["predict", "--model", &bench.text("warm.json"), "--in", &input, "--out", &out]);
    assert_says(&ran.ok(), &["4"]);
    let told = bench.read("gaps_told.csv");
    assert_eq!(words(&told, "res_status"), ["in_volume", "covariate_missing", "extrapolated", "covariate_missing"]);
    assert_eq!(words(&told, "res_extrapolated"), ["0", "", "1", ""]);
    let (residual, u) = (column(&told, "res_x_um"), column(&told, "u_x_um"));
    assert!(residual[1].is_none() && residual[3].is_none() && u[1].is_none());
    assert!(u[2].unwrap() > 2.0 * u[0].unwrap());
    let nameless = bench.write("nameless.csv", "x_mm,y_mm,z_mm\n400,300,200\n");
    let said = run(["predict", "--model", &bench.text("warm.json"), "--in", &nameless, "--out", &out]).refused();
    assert_says(&said, &["nameless.csv", "temp_air_c", "the column is missing"]);
}

#[test]
fn correct_and_verify_take_the_input_by_its_name_from_the_row() {
    let bench = bench();
    let table = bench.read("verify.csv");
    // One cell of the temperature is emptied.
    let place = table.lines().next().unwrap().split(',').position(|name| name == "temp_air_c").unwrap();
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[4].split(',').collect();
    cells[place] = "";
    lines[4] = cells.join(",");
    let input = bench.write("gap.csv", lines.join("\n") + "\n");
    let (model, residual) = (bench.text("model.json"), bench.text("warm.json"));
    let [plain, whole] = ["gap_plain.csv", "gap_whole.csv"].map(|name| bench.text(name));
    run(["correct", "--model", &model, "--in", &input, "--out", &plain]).ok();
    run(["correct", "--model", &model, "--residual", &residual, "--in", &input, "--out", &whole]).ok();
    let (plain, whole) = (bench.read("gap_plain.csv"), bench.read("gap_whole.csv"));
    let places = ["x", "y", "z"].map(|axis| column(&plain, &format!("corrected_{axis}_mm")));
    let temps = column(&plain, "temp_air_c");
    let asked: String = (0..temps.len())
        .map(|k| {
            let temp = temps[k].map_or(String::new(), |temp| temp.to_string());
            format!("{},{},{},{temp}\n", places[0][k].unwrap(), places[1][k].unwrap(), places[2][k].unwrap())
        })
        .collect();
    let (asked, told) =
        (bench.write("asked.csv", format!("x_mm,y_mm,z_mm,temp_air_c\n{asked}")), bench.text("asked_told.csv"));
    run(["predict", "--model", &residual, "--in", &asked, "--out", &told]).ok();
    let told = bench.read("asked_told.csv");
    for (d, axis) in ["x", "y", "z"].iter().enumerate() {
        let with = column(&whole, &format!("corrected_{axis}_mm"));
        let added = column(&told, &format!("res_{axis}_um"));
        for k in 0..with.len() {
            let expected = places[d][k].unwrap() + added[k].unwrap_or(0.0) * 1e-3;
            assert!((with[k].unwrap() - expected).abs() < 3e-7, "row {k}");
        }
        let [u_plain, u_whole] = [&plain, &whole].map(|table| column(table, &format!("u_{axis}_um")));
        assert!(u_whole[3].unwrap() > u_plain[3].unwrap() + 0.1, "what was left out is in the uncertainty");
    }
    assert_eq!(words(&whole, "status")[3], "covariate_missing");
    let points = bench.text("verify.csv");
    let said = run(["verify", "--model", &model, "--residual", &residual, "--points", &points]).ok();
    assert_says(&said, &["corrected"]);
    let said = run(["verify", "--model", &model, "--residual", &residual, "--points", &points, "--json"]).ok();
    assert!(serde_json::from_str::<Value>(&said).unwrap()["after_rms_um"].as_f64().unwrap().is_finite());
}

/// A robot: no linear axes, six joints (degrees), vectors of its tip.
fn robot(rows: std::ops::Range<usize>, with_residuals: bool) -> String {
    let joint = |row: usize, j: usize| {
        120.0 * (share(row + 1, [0.819_2, 0.671_0, 0.549_7, 0.450_3, 0.368_9, 0.302_2][j]) - 0.5)
    };
    let names = ["q1_deg", "q2_deg", "q3_deg", "q4_deg", "q5_deg", "q6_deg"].join(",");
    let line = |row: usize| {
        let q: [f64; 6] = std::array::from_fn(|j| joint(row, j));
        let noise = |factor: f64| 2.0 * (share(row, factor) - 0.5);
        let [a, b] = [q[1].to_radians(), q[2].to_radians()];
        let left =
            [30.0 * a.sin() + noise(0.7341), 20.0 * (a + b).cos() + noise(0.2913), 15.0 * b.sin() + noise(0.1593)];
        let joints = q.map(|q| q.to_string()).join(",");
        if with_residuals { format!("{joints},{},{},{}\n", left[0], left[1], left[2]) } else { format!("{joints}\n") }
    };
    let residuals = if with_residuals { ",res_x_um,res_y_um,res_z_um" } else { "" };
    format!("{names}{residuals}\n{}", rows.map(line).collect::<String>())
}

#[test]
fn a_robot_is_learnt_by_its_joints_alone() {
    let bench = Bench::empty();
    bench.write("robot.csv", robot(0..240, true));
    let joints = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg";
    let said = train(&bench, "robot.csv", joints, "robot.json").ok();
    assert_says(&said, &["q1_deg q2_deg q3_deg q4_deg q5_deg q6_deg", "recommended kriging: "]);
    let (input, out) = (bench.write("ask.csv", robot(240..300, false)), bench.text("told.csv"));
    run(["predict", "--model", &bench.text("robot.json"), "--in", &input, "--out", &out]).ok();
    let (told, truth) = (bench.read("told.csv"), robot(240..300, true));
    let square = |table: &str, other: Option<&str>| -> f64 {
        let of = |axis: &str| {
            let name = format!("res_{axis}_um");
            let zero = vec![Some(0.0); 60];
            let other = other.map_or(zero, |other| column(other, &name));
            column(table, &name).iter().zip(other).map(|(a, b)| (a.unwrap() - b.unwrap()).powi(2)).sum::<f64>()
        };
        ["x", "y", "z"].into_iter().map(of).sum()
    };
    let (left, missed) = (square(&truth, None), square(&told, Some(&truth)));
    println!("robot: rms {:.2} → {:.2} µm", (left / 180.0).sqrt(), (missed / 180.0).sqrt());
    assert!(missed < 0.05 * left, "{missed} of {left}");
    let residuals = bench.text("robot.csv");
    let config = bench.write("networks.toml", QUICK_NETWORKS);
    let table =
        run(["compare", "--residuals", &residuals, "--inputs", joints, "--config", &config, "--seeds", "1"]).ok();
    assert!(!table.contains("position alone") && table.contains("perceptron-kriging"), "{table}");
    let network = bench.write("network.toml", "method = \"network\"\n");
    let out = bench.text("no.json");
    let said =
        run(["train", "--residuals", &residuals, "--inputs", joints, "--config", &network, "--out", &out]).refused();
    assert_says(&said, &["4 inputs at most", "perceptron-kriging"]);
    assert_says(&train(&bench, "robot.csv", "position", "no.json").refused(), &["x_mm"]);
    assert_says(&train(&bench, "robot.csv", "position,q1_deg", "no.json").refused(), &["position", "no columns x_mm"]);
    assert_says(&train(&bench, "robot.csv", "q1_deg,q7_deg", "no.json").refused(), &["q7_deg", "q6_deg"]);
}

/// A recording whose readings carry the temperature: now and then none, now and then an old one.
fn warm_recording(bench: &Bench) {
    long_recording(bench, LIVE);
    let readings: Vec<ScaleReading> = samples(&bench.path("long"), &topic("scale/reading"));
    fs::remove_dir_all(bench.path("long")).unwrap();
    let mut writer = BagWriter::create(bench.path("long")).unwrap();
    for (k, mut reading) in readings.into_iter().enumerate() {
        reading.covariates = Covariates::new();
        match k % 50 {
            7 => {}
            8 => reading.covariates.push("temp_air_c", temp_c(k), 11.0).unwrap(),
            _ => reading.covariates.push("temp_air_c", temp_c(k), 0.5).unwrap(),
        }
        writer.write(&topic("scale/reading"), &reading, reading.sequence).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn live_the_input_comes_with_the_scale_reading_and_all_is_replayed_to_the_byte() {
    let (taught, bench) = (bench(), Bench::simulated(9));
    for file in ["warm.json", "model.json"] {
        fs::copy(taught.path(file), bench.path(file)).unwrap();
    }
    warm_recording(&bench);
    let launch = |with_edge: bool| {
        let more = move |launch: LaunchText| {
            let launch = launch.nodes(&["recorder"]).edge("residual", "recorder", MEMORY).record("run");
            let launch = if with_edge { launch.edge("scale", "residual", MEMORY) } else { launch };
            launch.residual_model("warm.json")
        };
        stream_of(&bench, more)
    };
    let said = run(["launch", &launch(false)]).refused();
    assert_says(&said, &["warm.json", "temp_air_c", "edge from scale to residual"]);
    let _ = fs::remove_dir_all(bench.path("run"));
    let said = crate::common::program::Started::start(abbe(["launch", &launch(true)])).finish().ok();
    let residual: Value =
        said.lines().map(|l| serde_json::from_str(l).unwrap()).find(|s: &Value| s["node"] == "residual").unwrap();
    assert_eq!((&residual["lost"], &residual["sent"]), (&Value::from(0), &Value::from(LIVE)), "{residual}");

    let live: Vec<CorrectedCoordinates> = samples(&bench.path("run"), &topic("corrected"));
    assert_eq!(live.len() as u64, LIVE);
    let of = |remainder: u64| live.iter().filter(move |sample| sample.sequence % 50 == remainder);
    assert!(of(7).all(|sample| sample.status == CorrectionStatus::CovariateMissing));
    assert!(of(8).all(|sample| sample.status == CorrectionStatus::Stale));
    assert!(of(7).chain(of(8)).all(|sample| sample.residual_correction_m == [0.0; 3] && sample.corrected_valid));
    assert!(
        of(9).all(|sample| sample.status <= CorrectionStatus::Extrapolated && sample.residual_correction_m != [0.0; 3])
    );

    // Offline the same bytes, and replay finds them again.
    let (model, residual) = (bench.text("model.json"), bench.text("warm.json"));
    let (bag, offline) = (bench.text("long"), bench.text("offline"));
    run(["correct", "--model", &model, "--residual", &residual, "--in", &bag, "--out", &offline]).ok();
    assert!(live == samples::<CorrectedCoordinates>(&bench.path("offline"), &topic("corrected")));
    let said = run(["replay", "--bag", &offline, "--model", &model, "--residual", &residual]).ok();
    assert_says(&said, &["3000 of 3000 corrected messages are identical", "3000 of them with a residual correction"]);
}

#[test]
fn what_tells_no_covariates_refuses_the_model_when_it_loads() {
    let bench = bench();
    // The virtual machine logs no such temperature.
    let text = format!(
        "namespace = \"test\"\nmachine = \"{}\"\nmodel = \"model.json\"\nresidual_model = \"cellar.json\"\n\
         nodes = [\"scale\", \"geometric\", \"residual\"]\nmax_covariate_age_s = 10.0\nwait_for_subscribers_s = 20.0\nvisible_in_ros = false\n\
         [scale]\ndriver = {{ kind = \"virtual_machine\", seed = 9 }}\npace = {{ rate_hz = 1000.0 }}\n\
         [[edges]]\nfrom = \"scale\"\nto = \"geometric\"\ntransport = \"{MEMORY}\"\n\
         [[edges]]\nfrom = \"scale\"\nto = \"residual\"\ntransport = \"{MEMORY}\"\n\
         [[edges]]\nfrom = \"geometric\"\nto = \"residual\"\ntransport = \"{MEMORY}\"\n\
         [[edges]]\nfrom = \"residual\"\nto = \"*\"\ntransport = \"{MEMORY}\"\n",
        text(&machine())
    );
    train(bench, "warm.csv", "position,temp_cellar_c", "cellar.json").ok();
    let launch = bench.write("virtual.toml", text);
    assert_says(&run(["launch", &launch]).refused(), &["cellar.json", "temp_cellar_c", "temp_air_c"]);
    let (model, residual) = (bench.text("model.json"), bench.text("warm.json"));
    let proxy = ["proxy", "--to", "127.0.0.1:9", "--listen", "127.0.0.1:0", "--offset-mm", "0,0,-60"];
    let said = run([&proxy[..], &["--model", &model, "--residual", &residual]].concat()).refused();
    assert_says(&said, &["temp_air_c", "no measuring software tells"]);
}
