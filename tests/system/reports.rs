//! Head and end of answers, from files to files: who measured, the certificate, and the next command as page and terminal say it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use crate::common::assert_says;
use crate::common::files::{WHO, assert_names_who, text};
use crate::common::printed::follows;
use crate::common::program::run;

/// Lengths of one line, on a known day.
const LENGTHS: &str = "# measured=2026-03-05\nline,calibrated_mm,repeat,deviation_um\n\
    X,20,1,0.1\nX,20,2,0.2\nX,20,3,0.1\nX,100,1,0.3\nX,100,2,0.2\nX,100,3,0.3\n";
const LAB: &str = "[identity]\ncertificate = \"2026-014\"\noperator = \"A. Person\"\nmaker = \"Maker\"\nmodel = \"M 7\"\n\
    serial_number = \"4711\"\nperformed_at = \"customer\"\n\
    [identity.instrument]\nname = \"Step gauge\"\nserial_number = \"K-77\"\ncalibrated = \"2026-01-08\"\n\
    [identity.laboratory]\nname = \"Laboratory\"\nemail = \"lab@example.org\"\ncity = \"Town\"\ncountry = \"DE\"\n\
    [identity.customer]\nname = \"Customer\"\nemail = \"customer@example.org\"\ncity = \"City\"\n";

fn shipped(path: &str) -> String {
    text(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config").join(path).canonicalize().unwrap())
}

/// A folder with lengths and who measured them.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Bench {
        let bench = Bench(tempfile::tempdir().unwrap());
        fs::write(bench.at("lengths.csv"), LENGTHS).unwrap();
        fs::write(bench.at("lab.toml"), LAB).unwrap();
        bench
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `abbe conformity` of the lengths with more options; those that name files do it with `{}` for the folder.
    fn conformity(&self, options: &str) -> crate::common::program::Ran {
        let folder = text(self.0.path());
        let words =
            format!("conformity --lengths {{}}/lengths.csv --probing bidirectional {options}").replace("{}", &folder);
        run(words.split(' '))
    }
}

#[test]
fn who_measured_stands_in_report_pdf_and_certificate() {
    let bench = Bench::new();
    let options = "--identity {}/lab.toml --operator B.Other --out {}/out --pdf {}/test.pdf --dcc {}/test.xml";
    bench.conformity(options).ok();
    let html = fs::read_to_string(bench.at("out/report.html")).unwrap();
    let known = [
        "2026-014",
        "2026-03-05",
        "B.Other",
        "serial number 4711",
        "Step gauge, serial number K-77, calibrated 2026-01-08",
    ];
    assert_says(&html, &known);
    assert!(!html.contains("A. Person"), "the option goes before the file");
    let pdf = fs::read(bench.at("test.pdf")).unwrap();
    assert!(pdf.starts_with(b"%PDF-") && pdf.trim_ascii_end().ends_with(b"%%EOF"));
    let certificate = fs::read_to_string(bench.at("test.xml")).unwrap();
    assert_says(
        &certificate,
        &[
            "<dcc:beginPerformanceDate>2026-03-05<",
            "<dcc:performanceLocation>customer<",
            "B.Other",
            "<si:value>0.3000<",
        ],
    );
    // The same data, the same bytes.
    let again = [fs::read(bench.at("out/report.html")).unwrap(), pdf, certificate.into_bytes()];
    bench.conformity(options).ok();
    let files = ["out/report.html", "test.pdf", "test.xml"].map(|name| fs::read(bench.at(name)).unwrap());
    assert!(files == again);
}

/// A sphere of 12.7 mm with 25 points within a hundredth of a micrometre.
fn sphere() -> String {
    let mut text = "x_mm,y_mm,z_mm\n".to_owned();
    let rings = [(90.0, 1), (67.5, 4), (45.0, 8), (22.5, 4), (0.0, 8)];
    for (height, count) in rings {
        for k in 0..count {
            let (up, around) = (f64::to_radians(height), f64::to_radians(360.0 * f64::from(k) / f64::from(count)));
            let at = [up.cos() * around.cos(), up.cos() * around.sin(), up.sin()].map(|v| format!("{:.6}", 12.7 * v));
            text += &(at.join(",") + "\n");
        }
    }
    text
}

/// The text of the page in a folder, as it is read.
fn page_of(bench: &Bench, folder: &str) -> String {
    fs::read_to_string(bench.at(folder).join("report.html")).unwrap()
}

#[test]
fn regress_an_acceptance_page_says_its_rule_once_and_has_a_verdict_on_every_limit() {
    let bench = Bench::new();
    fs::write(bench.at("sphere.csv"), sphere()).unwrap();
    let folder = text(bench.0.path());
    let words =
        "conformity --sphere {}/sphere.csv --diameter-mm 25.4 --form-limit-um 1 --size-limit-um 1 --out {}/sphere";
    let said = run(words.replace("{}", &folder).split(' ')).ok();
    let page = page_of(&bench, "sphere");
    assert_eq!(page.matches("Decision rule").count(), 1, "{page}");
    assert_says(&page, &["Form error against 1 µm", "Size error against 1 µm"]);
    assert!(!said.contains('_'), "{said}");
    // The errors keep their limit, and the range does not: both are said.
    let said = bench.conformity("--mpe 2+L/300 --r0-limit-um 0.05 --out {}/out");
    assert_eq!(said.code, Some(3), "{}", said.errors);
    assert!(!String::from_utf8_lossy(&said.output).contains("does_not_conform"));
    let page = page_of(&bench, "out");
    assert_says(
        &page,
        &[
            "Every error conforms",
            "Failed — Repeatability range against 0.05 µm",
            "Does not conform; it uses 200 %",
            "200 % of the limit",
        ],
    );
}

/// Lines of one colour or one marker are not told apart, on a screen or in print.
#[test]
fn regress_seven_lines_of_a_test_have_seven_colours_and_seven_markers() {
    let bench = Bench::new();
    let set = |k: usize| (1..=3).map(move |repeat| format!("L{},{},{repeat},0.{repeat}\n", k / 5, 20 + 90 * (k % 5)));
    let rows: String = (5..40).flat_map(set).collect();
    fs::write(bench.at("lengths.csv"), format!("line,calibrated_mm,repeat,deviation_um\n{rows}")).unwrap();
    bench.conformity("--mpe 2+L/300 --out {}/out").ok();
    let page = page_of(&bench, "out");
    let plot = page.split("<figure").find(|figure| figure.contains("data-n=\"L1\"")).expect("a plot of the lines");
    let marks = plot.split("<path class=\"mark ").skip(1).filter_map(|rest| {
        let (colour, rest) = rest.split_once('"')?;
        let line = rest.split_once("data-n=\"")?.1.split('"').next()?;
        // What follows the place of a marker, and how far beside it stands, is its outline.
        Some((line, colour, rest.split_once(" d=\"")?.1.split('z').next()?.rsplit_once('m')?.1))
    });
    let marks: BTreeSet<(&str, &str, &str)> = marks.collect();
    assert_eq!(marks.len(), 7, "{marks:?}");
    assert_eq!(marks.iter().map(|mark| mark.1).collect::<BTreeSet<_>>().len(), 7, "colours: {marks:?}");
    assert_eq!(marks.iter().map(|mark| mark.2).collect::<BTreeSet<_>>().len(), 7, "markers: {marks:?}");
    // At a length that they share they stand side by side, the middle one at its place.
    let beside = plot.split(" data-s=\"").skip(1).filter_map(|rest| rest.split('"').next());
    assert_eq!(beside.collect::<BTreeSet<_>>().len(), 6);
    // Nor is the tightest limit in the colour of a line.
    let limit = plot.split("<path class=\"ln l").nth(1).and_then(|rest| rest.split('"').next()).expect("the limit");
    assert!(marks.iter().all(|mark| mark.1 != format!("f{limit}")), "{limit}: {marks:?}");
}

#[test]
fn temperatures_beside_lengths_and_spheres_stand_in_the_head() {
    let bench = Bench::new();
    let logged = |text: &str| -> String {
        let line = |line: &str| match line {
            comment if comment.starts_with('#') => format!("{comment}\n"),
            head if head.contains("_mm") => format!("{head},temp_air_c\n"),
            row => format!("{row},20.{}\n", row.len() % 10),
        };
        text.lines().map(line).collect()
    };
    fs::write(bench.at("lengths.csv"), logged(LENGTHS)).unwrap();
    bench.conformity("--out {}/out").ok();
    assert_says(&page_of(&bench, "out"), &["<dt>Temperature</dt><dd>20."]);
    fs::write(bench.at("sphere.csv"), logged(&sphere())).unwrap();
    let [points, out] = ["sphere.csv", "sphere"].map(|name| text(&bench.at(name)));
    run(["conformity", "--sphere", &points, "--out", &out]).ok();
    assert_says(&page_of(&bench, "sphere"), &["<dt>Temperature</dt><dd>20."]);
}

#[test]
fn regress_a_simulated_machine_has_no_certificate_no_operator_and_no_instrument() {
    let bench = Bench::new();
    let machine = fs::read_to_string(shipped("machines/bridge_xyz.toml")).unwrap() + "\n" + LAB;
    fs::write(bench.at("machine.toml"), machine).unwrap();
    let [machine, out] = ["machine.toml", "out"].map(|name| text(&bench.at(name)));
    run(["conformity", "--machine", &machine, "--seed", "4", "--mpe", "2+L/400", "--out", &out]).ok();
    let page = page_of(&bench, "out");
    assert_says(
        &page,
        &["of a simulated machine", "<dd>bridge_xyz</dd>", "machine.toml, SHA-256 ", "Largest share of the limit"],
    );
    for own in ["2026-014", "A. Person", "Step gauge"] {
        assert!(!page.contains(own), "{own}");
    }
}

/// U = 0.1 µm + L/100: 0.1 + 0.254 µm at a diameter of 25.4 mm.
#[test]
fn regress_a_certificate_of_a_sphere_states_the_uncertainty_that_the_verdict_used() {
    let bench = Bench::new();
    fs::write(bench.at("sphere.csv"), sphere()).unwrap();
    let folder = text(bench.0.path());
    let words = "conformity --sphere {}/sphere.csv --diameter-mm 25.4 --form-limit-um 900 --uncertainty 0.1+L/100 --identity {}/lab.toml \
                 --measured 2026-03-05 --dcc {}/sphere.xml --out {}/out";
    run(words.replace("{}", &folder).split_whitespace()).ok();
    let certificate = fs::read_to_string(bench.at("sphere.xml")).unwrap();
    assert_says(
        &certificate,
        &["<si:uncertainty>0.3540</si:uncertainty>", "limit 900.000 µm: conforms; decision rule: ISO 14253-1"],
    );
    assert!(!certificate.contains(">0.1000<"));
    assert_says(&page_of(&bench, "out"), &["± 0.35 µm (k = 2)"]);
}

#[test]
fn val_ptb_rules_accept_the_certificates_and_refuse_what_breaks_them() {
    let Some(mut judge) = crate::common::python::python("certificate.py") else { return };
    let bench = Bench::new();
    bench.conformity("--identity {}/lab.toml --uncertainty 0.1+L/2000 --mpe 1.9+L/300 --dcc {}/lengths.xml").ok();
    fs::write(bench.at("sphere.csv"), sphere()).unwrap();
    let folder = text(bench.0.path());
    let words = "conformity --sphere {}/sphere.csv --diameter-mm 25.4 --identity {}/lab.toml --measured 2026-03-05 --dcc {}/sphere.xml";
    run(words.replace("{}", &folder).split(' ')).ok();
    let whole = fs::read_to_string(bench.at("lengths.xml")).unwrap();
    let method = whole.find("<dcc:usedMethods>").unwrap()..whole.find("<dcc:usedSoftware>").unwrap();
    let broken = [
        whole.replace(&whole[method], ""),
        whole.replace("<dcc:usedLangCodeISO639_1>en<", "<dcc:usedLangCodeISO639_1>xx<"),
        whole.replace("\\micro\\metre", "um"),
        whole.replacen("<si:value>", "<si:value>about ", 1),
        whole.replacen("<dcc:eMail>lab@example.org</dcc:eMail>", "", 1),
    ];
    judge.args([bench.at("lengths.xml"), bench.at("sphere.xml")]);
    for (number, certificate) in broken.iter().enumerate() {
        assert_ne!(*certificate, whole);
        let path = bench.at(&format!("broken{number}.xml"));
        fs::write(&path, certificate).unwrap();
        judge.arg(path);
    }
    let found = crate::common::python::said(judge);
    let count = |number: usize, judge: &str| found[number][judge].as_array().unwrap().len();
    for number in 0..2 {
        assert_eq!((count(number, "schematron"), count(number, "structure")), (0, 0), "{}", found[number]);
    }
    // PTB's rules refuse the first two, those of the schema the others.
    let refused: Vec<_> =
        (2..7).map(|number| (count(number, "schematron") > 0, count(number, "structure") > 0)).collect();
    assert_eq!(refused, [(true, false), (true, false), (false, true), (false, true), (false, true)], "{found}");
    if std::env::var_os("ABBE_DCC_SCHEMA").is_none() {
        eprintln!("SKIPPED: ABBE_DCC_SCHEMA names no copy of PTB's dcc.xsd 3.1.2");
        return;
    }
    let by_schema: Vec<_> = (0..7).map(|number| count(number, "schema") > 0).collect();
    // It leaves methods, languages and units to other rules.
    assert_eq!(by_schema, [false, false, false, false, false, true, true], "{found}");
}

#[test]
fn what_contradicts_the_data_or_is_missing_is_refused_and_nothing_is_written() {
    let bench = Bench::new();
    let wrong_day = bench.conformity("--measured 2026-04-01 --out {}/out --pdf {}/test.pdf").refused();
    assert_says(&wrong_day, &["--measured 2026-04-01", "the data say 2026-03-05"]);
    let no_day = bench.conformity("--measured yesterday");
    assert_says(&no_day.ended(2), &["--measured"]);
    fs::write(bench.at("lab.toml"), LAB.replace("serial_number = \"4711\"\n", "")).unwrap();
    let lacking = bench.conformity("--identity {}/lab.toml --out {}/out --pdf {}/test.pdf --dcc {}/test.xml").refused();
    assert_says(&lacking, &["--dcc", "serial_number"]);
    let of_runs = bench.conformity("--operator X --identity {}/none.toml").refused();
    assert_says(&of_runs, &["none.toml"]);
    for name in ["out", "test.pdf", "test.xml"] {
        assert!(!bench.at(name).exists(), "{name}");
    }
    // The file of another machine than the model's.
    let model = bench.at("model.json");
    let identified = model_of(&bench, &model);
    let other = shipped("machines/fyxz.toml");
    fs::write(bench.at("other.toml"), fs::read_to_string(other).unwrap() + "\n[identity]\noperator = \"X\"\n").unwrap();
    let named = ["--identity".to_owned(), text(&bench.at("other.toml"))];
    let arguments =
        ["volumetric".to_owned(), "--model".to_owned(), text(&model), "--out".to_owned(), text(&bench.at("map"))];
    assert_says(&run(arguments.iter().chain(&named)).refused(), &["other.toml", "fyxz", "bridge_xyz"]);
    assert!(identified.contains("next, "));
}

#[test]
fn the_page_of_an_identification_shows_the_fit_and_misses_no_verification() {
    let bench = Bench::new();
    let machine = shipped("machines/bridge_xyz.toml");
    model_of(&bench, &bench.at("model.json"));
    fs::write(bench.at("who.toml"), WHO).unwrap();
    let [campaign, model, page, who] =
        ["practice/campaign.csv", "again.json", "page.html", "who.toml"].map(|name| text(&bench.at(name)));
    let said = run([
        "identify",
        "--machine",
        &machine,
        "--campaign",
        &campaign,
        "--out",
        &model,
        "--html",
        &page,
        "--identity",
        &who,
    ]);
    let (said, html) = (said.ok(), fs::read_to_string(&page).unwrap());
    assert_names_who(&html);
    let sha256 = said.split("model sha256").nth(1).unwrap().split_whitespace().next().unwrap();
    assert_says(
        &html,
        &[
            "Identified model of bridge_xyz",
            "The 21 errors",
            "Identified stations",
            sha256,
            "abbe verify --model …/again.json",
        ],
    );
    for absent in ["Error before and after", "no verification points", "Duration", "Live"] {
        assert!(!html.contains(absent), "{absent} is no part of a fit");
    }
    // The page is no number of the model: with and without it, the same bytes.
    assert_eq!(fs::read(&model).unwrap(), fs::read(bench.at("model.json")).unwrap());
    // What contradicts the data leaves nothing.
    let other = text(&bench.at("other.json"));
    let wrong =
        run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &other, "--html", &other]).refused();
    assert_says(&wrong, &["two files would be written here"]);
    assert!(!bench.at("other.json").exists());
}

/// A model of a simulated machine; what `abbe identify` said.
fn model_of(bench: &Bench, model: &Path) -> String {
    let machine = shipped("machines/bridge_xyz.toml");
    let practice = text(&bench.at("practice"));
    let simulated = run(["simulate", "--machine", &machine, "--seed", "4", "--out", &practice]).ok();
    follows(bench.0.path(), &simulated, "identify");
    let campaign = text(&bench.at("practice/campaign.csv"));
    run(["identify", "--machine", &machine, "--campaign", &campaign, "--out", &text(model)]).ok()
}

/// Runs of one axis on a known day, the scale's temperature beside them.
#[test]
fn runs_say_their_day_and_their_temperatures() {
    let bench = Bench::new();
    let mut rows = "# measured=2026-03-05\naxis,target_mm,direction,cycle,measured_mm,temp_scale_c\n".to_owned();
    for cycle in 1..=5 {
        for (k, target) in [10, 47, 111].into_iter().enumerate() {
            for direction in ["+", "-"] {
                let off = if direction == "+" { "0.002" } else { "0.001" };
                rows += &format!("X,{target},{direction},{cycle},{target}{},{}\n", &off[1..], 20.0 + 0.2 * k as f64);
            }
        }
    }
    fs::write(bench.at("runs.csv"), rows).unwrap();
    for (command, option, out) in [("conformity", "--runs", "figures"), ("diagnose", "--campaign", "causes")] {
        let [runs, folder] = ["runs.csv", out].map(|name| text(&bench.at(name)));
        run([command, option, &runs, "--out", &folder]).ok();
        let html = fs::read_to_string(bench.at(out).join("report.html")).unwrap();
        assert_says(&html, &["<dd>2026-03-05</dd>", "<dd>20.0 to 20.4 °C</dd>", "runs.csv, SHA-256 "]);
    }
    let html = fs::read_to_string(bench.at("figures/report.html")).unwrap();
    assert_says(&html, &["Accuracy A, axis X", "Repeatability R, axis X", "Reversal value B, axis X"]);
}

#[test]
fn a_report_says_the_command_that_the_terminal_says_without_folders_of_this_machine() {
    let bench = Bench::new();
    let out = text(&bench.at("out"));
    let said = bench.conformity("--out {}/out").ok();
    assert_says(
        &said,
        &["next, to hold the figures against a limit:\n  abbe conformity --lengths ", "--mpe 'A+L/K'\n"],
    );
    let html = fs::read_to_string(bench.at("out/report.html")).unwrap();
    let next = "<b>Next</b>, to hold the figures against a limit:</p>\n\
         <pre><code>abbe conformity --lengths …/lengths.csv --probing bidirectional --mpe &#39;A+L/K&#39;</code></pre>";
    assert_says(&html, &[next]);
    assert!(!html.contains(&text(bench.0.path())), "no folder of somebody's machine");
    // After the figures and what limits them, before the first picture.
    let place = |part: &str| html.find(part).unwrap_or_else(|| panic!("{part}"));
    assert!(place("class=\"cards\"") < place("class=\"callout") && place("class=\"callout") < place("class=\"next\""));
    assert!(place("class=\"next\"") < place("<figure"));
    // With a limit the next is another one.
    let judged = bench.conformity("--mpe 1.9+L/300").ok();
    assert_says(&judged, &["next, to take the uncertainty of the test into account:\n"]);
    // The verdict is the answer then; digits are those that the uncertainty of the test allows: 0.3 ± 0.15 µm at 100 mm.
    bench.conformity("--mpe 1.9+L/300 --uncertainty 0.1+L/2000 --out {}/judged").ok();
    let html = fs::read_to_string(bench.at("judged/report.html")).unwrap();
    let place = |part: &str| html.find(part).unwrap_or_else(|| panic!("{part}"));
    assert!(
        place("Every error conforms") < place("class=\"cards\"") && place("class=\"cards\"") < place("class=\"next\"")
    );
    assert_says(&html, &["Largest share of the limit", "0.30<span", "± 0.15 µm (k = 2), on X at 100.0 mm"]);
    assert!(!html.contains("0.300") && !html.contains("100.0000"), "digits that nobody measured");
    let failed = bench.conformity(&format!("--mpe 0.01 --out {out}"));
    assert_eq!(failed.code, Some(3), "{}", failed.errors);
    follows(bench.0.path(), &String::from_utf8(failed.output).unwrap(), "plan");
}

#[test]
fn regress_a_correction_that_makes_it_worse_is_said() {
    let bench = crate::common::files::Bench::identified(5);
    let (model, page) = (bench.text("model.json"), bench.text("verify.html"));
    // The same machine with every error turned round: what is added goes the wrong way.
    let mut table = crate::common::spoil::Table::of(&bench.read("verify.csv"));
    for line in 2..=table.0.len() {
        for axis in ["x", "y", "z"] {
            let number = |table: &mut crate::common::spoil::Table, name: &str| -> f64 {
                table.cell(line, name).parse().unwrap()
            };
            let nominal = number(&mut table, &format!("{axis}_mm")) + number(&mut table, &format!("offset_{axis}_mm"));
            let actual = number(&mut table, &format!("actual_{axis}_mm"));
            *table.cell(line, &format!("actual_{axis}_mm")) = format!("{:.6}", 2.0 * nominal - actual);
        }
    }
    let turned = bench.write("turned.csv", table.text());
    let said = "the correction makes the errors larger: ";
    let verify = |points: &str, last: &[&str]| {
        run(["verify", "--model", &model, "--points", points].iter().chain(last).copied().collect::<Vec<_>>())
    };
    let ran = verify(&turned, &["--html", &page]);
    assert_says(
        &ran.errors,
        &["abbe: warning: ", "turned.csv", said, "µm rms indicated", "do not correct with this model"],
    );
    ran.ok();
    assert_says(&fs::read_to_string(&page).unwrap(), &["The correction makes it worse", "µm rms indicated"]);
    assert_says(&verify(&turned, &["--json"]).ok(), &["\"correction_makes_worse\": true"]);
    let good = bench.text("verify.csv");
    let ran = verify(&good, &["--html", &page]);
    assert!(!ran.errors.contains(said), "{}", ran.errors);
    ran.ok();
    assert!(!fs::read_to_string(&page).unwrap().contains("The correction makes it worse"));
    assert_says(&verify(&good, &["--json"]).ok(), &["\"correction_makes_worse\": false"]);
}
