//! Measured positions become a model, and a model becomes a map of its volumetric error, from the command line.

use crate::common::assert_says;
use crate::common::files::{Bench, listing, machine, text};
use crate::common::program::run;
use serde_json::Value;

fn json(said: &str) -> Value {
    serde_json::from_str(said).unwrap()
}

/// Arguments of a fit of the bench's verification points.
fn fit<'a>(machine: &'a str, points: &'a str, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["fit-points", "--machine", machine, "--points", points, "--out", out], more].concat()
}

#[test]
fn positions_make_a_model_that_corrects_and_can_be_mapped() {
    let bench = Bench::simulated(4);
    let (machine, points, model) = (text(&machine()), bench.text("verify.csv"), bench.text("model.json"));
    let said = run(fit(&machine, &points, &model, &["--u-um", "0.05", "--json"])).ok();
    let said = json(&said);
    let evidence = &said["evidence"];
    assert_eq!(evidence["rank"], evidence["unknowns"]);
    assert!(evidence["effective_unknowns"].as_f64().unwrap() > 40.0, "{evidence}");
    let verified = json(&run(["verify", "--model", &model, "--points", &points, "--json"]).ok());
    let (before, after) = (verified["before_rms_um"].as_f64().unwrap(), verified["after_rms_um"].as_f64().unwrap());
    assert!(after < 0.1 * before, "{verified}");
    let out = bench.text("volumetric");
    let mapped = json(
        &run(["volumetric", "--model", &model, "--out", &out, "--steps", "5", "--offset-mm", "0,0,-60", "--json"]).ok(),
    );
    assert_eq!(mapped["points"], 125);
    assert_eq!(mapped["diagonals"].as_array().unwrap().len(), 4);
    // How the whole lies in the frame of the model is no error of a part.
    let [all, aligned] = ["rms_um", "aligned_rms_um"].map(|key| mapped[key].as_f64().unwrap());
    assert!(0.0 < aligned && aligned < all, "{mapped}");
    let map = bench.read("volumetric/map.csv");
    assert!(map.starts_with("x_mm,y_mm,z_mm,error_x_um,error_y_um,error_z_um,error_um,u_x_um,u_y_um,u_z_um,status\n"));
    assert_eq!(map.lines().count(), 126);
    let page = bench.read("volumetric/report.html");
    assert_says(&page, &["Volumetric error in planes of Z", "error vector in each cell, in µm"]);
    let diagonals = bench.read("volumetric/diagonals.csv");
    assert_eq!(diagonals.lines().count(), 1 + 4 * 11);
    // What the model predicts, given back as measured, differs by its rounding only.
    let rows = diagonals.lines().skip(1).map(|row| {
        let cells: Vec<&str> = row.split(',').collect();
        format!("{},{},{},0.1\n", cells[0], cells[1], cells[5])
    });
    let measured =
        bench.write("diagonals.csv", format!("diagonal,distance_mm,deviation_um,u_um\n{}", rows.collect::<String>()));
    let compared =
        ["volumetric", "--model", &model, "--out", &out, "--offset-mm", "0,0,-60", "--diagonals", &measured, "--json"];
    let compared = run(compared).ok();
    for diagonal in json(&compared)["compared"].as_array().unwrap() {
        assert!(diagonal["largest_difference_um"].as_f64().unwrap() < 0.001, "{diagonal}");
        assert_eq!(diagonal["outside_95_percent"], 0);
    }
}

/// Points inside of the stroke: the corner from which every diagonal counts is outside of what they show, and so is all of it. A
/// measured diagonal begins where its first target is.
#[test]
fn diagonals_say_where_they_begin_and_what_they_are_worth() {
    let bench = Bench::simulated(4);
    let (machine, points, model) = (text(&machine()), bench.text("verify.csv"), bench.text("model.json"));
    run(fit(&machine, &points, &model, &["--u-um", "0.05"])).ok();
    let out = bench.text("volumetric");
    let asked = ["volumetric", "--model", &model, "--out", &out, "--steps", "5", "--offset-mm", "0,0,-60"];
    let said = run(asked).ok();
    assert_says(&said, &["of 11 targets extrapolated, U may be too small there"]);
    let page = bench.read("volumetric/report.html");
    assert!(page.contains("targets extrapolated, U may be too small there"));
    let figures = json(&run([&asked[..], &["--json"]].concat()).ok());
    let diagonal = &figures["diagonals"][0];
    assert_eq!((&diagonal["extrapolated"], &diagonal["targets"][5]["status"]), (&11.into(), &"extrapolated".into()));
    let csv = bench.read("volumetric/diagonals.csv");
    assert!(csv.starts_with("diagonal,distance_mm,x_mm,y_mm,z_mm,deviation_um,u_um_k2,status\n"), "{csv}");
    assert!(csv.lines().nth(3).unwrap().ends_with(",extrapolated"), "{csv}");

    let head = "diagonal,distance_mm,deviation_um,u_um,start_mm,runs\n";
    let with = |name: &str, rows: &str| {
        let measured = bench.write(name, format!("{head}{rows}"));
        run([&asked[..], &["--diagonals", &measured, "--json"]].concat())
    };
    // Where the first target lies changes what the model says of the others.
    let differs = |start_mm: u32| {
        let rows = format!("PPP,0,0,0.1,{start_mm},5\nPPP,400,4,0.1,{start_mm},5\n");
        json(&with("start.csv", &rows).ok())["compared"][0]["largest_difference_um"].as_f64().unwrap()
    };
    assert!((differs(0) - differs(200)).abs() > 0.5, "{} {}", differs(0), differs(200));
    for rows in ["PPP,0,0,0.1,0,5\nPPP,1300,1,0.1,0,5\n", "PPP,0,0,0.1,900,5\nPPP,400,1,0.1,900,5\n"] {
        let says = ["diagonal PPP: its last target would lie 1300.000 mm", "start_mm and distance_mm"];
        assert_says(&with("beyond.csv", rows).refused(), &says);
    }
    // The machine repeats to 0.25 µm along every direction: 0.35 between two approaches, a tenth of that in the mean of a hundred.
    let outside = |runs: usize| {
        let rows = format!("PPP,400,4,0.1,200,{runs}\n");
        json(&with("runs.csv", &rows).ok())["compared"][0]["outside_95_percent"].as_u64().unwrap()
    };
    // 0.45 µm from what the model says.
    assert_eq!((outside(1), outside(100)), (0, 1));
}

#[test]
fn the_same_seed_gives_the_same_model_by_jade() {
    let bench = Bench::simulated(4);
    let (machine, points) = (text(&machine()), bench.text("verify.csv"));
    let models = ["one.json", "two.json"].map(|name| {
        let out = bench.text(name);
        let more = ["--u-um", "3", "--degree", "1", "--loss", "squares", "--method", "jade", "--seed", "5"];
        run(fit(&machine, &points, &out, &more)).ok();
        bench.read(name)
    });
    assert_eq!(models[0], models[1]);
    assert!(models[0].contains("\"seed\": 5"));
}

#[test]
fn wrong_input_is_refused_and_leaves_nothing() {
    let bench = Bench::simulated(4);
    let (machine, points, out) = (text(&machine()), bench.text("verify.csv"), bench.text("refused.json"));
    let lines: Vec<String> = bench.read("verify.csv").lines().map(str::to_owned).collect();
    let few = bench.write("few.csv", lines[..8].join("\n"));
    let twice = bench.write("twice.csv", [&lines[..], &lines[7..8]].concat().join("\n"));
    let cases: [(&str, &[&str], &[&str]); 7] = [
        (&points, &[], &["u_actual_um", "--u-um"]),
        (&points, &["--u-um", "0"], &["point 1", "uncertainty"]),
        (&points, &["--u-um", "0.1", "--degree", "11"], &["degree 1 to 10"]),
        (&points, &["--u-um", "0.1", "--method", "jade", "--population", "3"], &["population of 3"]),
        (&points, &["--u-um", "0.1", "--functions", "machine", "--degree", "3"], &["--degree belongs to"]),
        (&few, &["--u-um", "0.1"], &["7 points", "unknowns", "measure more points"]),
        (&twice, &["--u-um", "0.1"], &["point 401 repeats point 7"]),
    ];
    for (points, more, says) in cases {
        let before = listing(&bench.path(""));
        assert_says(&run(fit(&machine, points, &out, more)).refused(), says);
        assert_eq!(listing(&bench.path("")), before, "something was left behind by {more:?}");
    }
    let model = bench.text("missing.json");
    assert_says(&run(["volumetric", "--model", &model, "--out", &out]).refused(), &["missing.json"]);
}

/// A vision machine's view of a grid plate: two columns of actual positions, turned by an unknown angle.
#[test]
fn a_plate_makes_a_model_of_its_plane_and_names_what_it_cannot_tell() {
    let bench = Bench::simulated(4);
    let (machine, model) = (text(&machine()), bench.text("plate.json"));
    let mut table = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm,actual_x_mm,actual_y_mm,pose\n".to_owned();
    for k in 0..128 {
        let (x, y) = (50.0 + 100.0 * f64::from(k % 8), 40.0 + 75.0 * f64::from(k / 8 % 8));
        // Scale of X 20 µm/m, squareness 8 µrad; 0.05 µm of something else.
        let rest = |a: f64| 1.7e-4 * (((a * f64::from(k + 1)).sin() * 43_758.545_3).abs().fract() - 0.5);
        let (p, q) = (x + 20e-6 * x - 8e-6 * y + rest(12.9898), y + rest(78.233));
        let (sine, cosine) = (0.4 + 1.2 * f64::from(k / 64)).sin_cos();
        let (u, v) = (cosine * p - sine * q + 11.0, sine * p + cosine * q - 22.0);
        table += &format!("{x},{y},150,0,0,-60,{u:.7},{v:.7},pose {}\n", k / 64);
    }
    let points = bench.write("plate.csv", &table);
    let said = json(&run(fit(&machine, &points, &model, &["--u-um", "0.05", "--json"])).ok());
    let evidence = &said["evidence"];
    let unseen: Vec<&str> =
        evidence["not_identifiable"].as_array().unwrap().iter().map(|own| own["name"].as_str().unwrap()).collect();
    assert!(["B0Z", "A0Z", "EZZ", "EBX", "ECZ"].iter().all(|name| unseen.contains(name)), "{unseen:?}");
    assert!(["C0Y", "EXX", "EYY"].iter().all(|name| !unseen.contains(name)), "{unseen:?}");
    let file: Value = serde_json::from_str(&bench.read("plate.json")).unwrap();
    assert!(file.to_string().contains("measured on plates"), "the model says what it does not know");
    // Two points 700 mm apart along X come out 14 µm further apart, and off the plane they are extrapolated.
    let ask = "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm\n";
    let ask = bench.write("ask.csv", format!("{ask}50,300,150,0,0,-60\n750,300,150,0,0,-60\n750,300,400,0,0,-60\n"));
    let out = bench.text("corrected.csv");
    run(["correct", "--model", &model, "--in", &ask, "--out", &out]).ok();
    let corrected = bench.read("corrected.csv");
    let rows: Vec<Vec<&str>> = corrected.lines().skip(1).map(|row| row.split(',').collect()).collect();
    let x = |k: usize| rows[k][6].parse::<f64>().unwrap();
    assert!((x(1) - x(0) - 700.014).abs() < 2e-4, "{corrected}");
    assert_eq!([rows[0][12], rows[2][12]], ["in_volume", "extrapolated"], "{corrected}");
    let mixed = bench.write("mixed.csv", table.replacen("pose 1", "elsewhere", 1));
    assert_says(&run(fit(&machine, &mixed, &model, &["--u-um", "0.05"])).refused(), &["mixed.csv", "four points"]);
}

/// The offset of the campaign was taken where the machine file had another by now, and a machine of another size passed.
#[test]
fn regress_a_table_without_offsets_is_corrected_at_the_tip_of_the_machine_file_that_is_given() {
    let bench = Bench::simulated(4);
    let (own, points, model) = (text(&machine()), bench.text("verify.csv"), bench.text("model.json"));
    run(fit(&own, &points, &model, &["--u-um", "0.05"])).ok();
    let told = std::fs::read_to_string(&own).unwrap();
    let longer = bench.write("longer.toml", format!("default_offset_mm = [0.0, 40.0, -90.0]\n{told}"));
    let other = bench.write("other.toml", told.replace("\n[stroke_mm]\nX = [0.0, ", "\n[stroke_mm]\nX = [-50.0, "));
    let bare = bench.write("bare.csv", "x_mm,y_mm,z_mm\n100,100,200\n400,300,150\n");
    let with_columns = bench.write(
        "columns.csv",
        "x_mm,y_mm,z_mm,offset_x_mm,offset_y_mm,offset_z_mm\n100,100,200,0,40,-90\n400,300,150,0,40,-90\n",
    );
    let corrected = |input: &str, more: &[&str]| {
        let out = bench.text("corrected.csv");
        run([&["correct", "--model", &model, "--in", input, "--out", &out], more].concat()).ok();
        let table = bench.read("corrected.csv");
        let names: Vec<String> = table.lines().next().unwrap().split(',').map(str::to_owned).collect();
        let place = |name: &str| names.iter().position(|own| own == name).unwrap();
        let columns = ["corrected_x_mm", "corrected_y_mm", "corrected_z_mm"].map(place);
        let row = |row: &str| columns.map(|k| row.split(',').nth(k).unwrap().to_owned());
        table.lines().skip(1).map(row).collect::<Vec<_>>()
    };
    assert_eq!(corrected(&bare, &["--machine", &longer]), corrected(&with_columns, &[]));
    let refused = ["correct", "--model", &model, "--machine", &other, "--in", &bare, "--out", &bench.text("no.csv")];
    assert_says(&run(refused).refused(), &["key machine.stroke_m", "stroke of X from 0 to 800 mm", "-50 to 800 mm"]);
}
