//! The page's script, in a real browser: Chromium without a screen, a page from a file, no network.
//!
//! Each test adds steps to a page, which act as a user does and write what they saw; the browser hands the page back. Where
//! there is no `chromium` the tests say that they were skipped, and with `ABBE_REQUIRE_PEERS=1` they fail.

use crate::common;
use abbe_report::*;
use serde_json::{Value, json};
use std::process::Command;

/// How the browser starts: no screen, and nothing of its own over the network.
const FLAGS: [&str; 12] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-logging=stderr",
    "--virtual-time-budget=5000",
    "--window-size=1400,1000",
    "--dump-dom",
];

/// What the steps may use: a pointer at a place of a drawing, and where a panel's value lies.
const HELPERS: &str = r##"
const all = (q, e = document) => [...e.querySelectorAll(q)];
const figure = (title) => all("figure").find((f) => f.querySelector("h3").textContent === title);
const client = (svg, x, y) => new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
const point = (type, svg, x, y, more = {}) => {
  const at = client(svg, x, y);
  svg.dispatchEvent(new PointerEvent(type, { clientX: at.x, clientY: at.y, bubbles: true, pointerId: 1, ...more }));
};
const press = (node, key) => node.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const tip = () => (document.querySelector(".tip").hidden ? null : all(".tip div").map((d) => d.textContent));
const seen = (node) => getComputedStyle(node).display !== "none";
"##;

/// The page after the steps as JSON, or `None` without a browser.
fn in_browser(html: &str, steps: &str) -> Option<Value> {
    if Command::new("chromium").arg("--version").output().is_err() {
        let required = std::env::var("ABBE_REQUIRE_PEERS").is_ok_and(|value| value == "1");
        assert!(!required, "ABBE_REQUIRE_PEERS=1, but there is no chromium");
        eprintln!("SKIPPED: there is no chromium");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("page.html");
    let test = format!(
        "<pre id=\"seen\"></pre><script>\"use strict\";(() => {{{HELPERS}\nconst result = (() => {{{steps}}})();\n\
         const outside = performance.getEntriesByType(\"resource\").filter((e) => !e.name.startsWith(\"data:\")).length;\n\
         document.getElementById(\"seen\").textContent = JSON.stringify({{ result, outside }});}})();</script></body>"
    );
    std::fs::write(&file, html.replace("</body>", &test)).unwrap();
    let browser = Command::new("chromium")
        .args(FLAGS)
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("file://{}", file.display()))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&browser.stderr);
    let errors: Vec<&str> = said.lines().filter(|line| line.contains("CONSOLE")).collect();
    assert!(errors.is_empty(), "the console says {errors:?}");
    let page = String::from_utf8(browser.stdout).unwrap();
    let text = page.split("<pre id=\"seen\">").nth(1).and_then(|rest| rest.split("</pre>").next()).unwrap_or_default();
    let text = text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let value: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text:?}; {said}"));
    assert_eq!(value["outside"], json!(0), "something was asked for from outside");
    Some(value["result"].clone())
}

/// Two panels whose pixels a reader can reckon: position 0 to 100 mm, one line and points.
fn two_lines() -> String {
    let curve = |name: &str, style, y: [f64; 3]| Curve {
        name: name.into(),
        style,
        x: vec![0.0, 50.0, 100.0],
        y: y.map(Some).to_vec(),
        also: None,
        half_width: matches!(style, CurveStyle::Line(_)).then(|| vec![Some(0.5); 3]),
    };
    let panel = |title: &str, curves| LinePanel {
        title: title.into(),
        x: Axis::new("position", "mm"),
        y: Axis::new("error", "µm"),
        curves,
    };
    let plot = |title: &str, style| {
        Section::LinePlot(LinePlot {
            title: title.into(),
            note: None,
            columns: 1,
            band_name: None,
            panels: vec![panel(
                "p",
                vec![curve("north", style, [-1.0, 2.5, 4.0]), curve("south", CurveStyle::Points(2), [0.5, -2.0, 3.0])],
            )],
        })
    };
    let table = TableSection {
        title: "Lines".into(),
        note: None,
        columns: vec![Column::text("line"), Column::number("largest", "µm")],
        rows: vec![
            vec![Cell::text("north"), Cell::number(4.0, 1)],
            vec![Cell::text("south"), Cell::number(3.0, 1)],
            vec![Cell::text("east"), Cell::number(1.0, 1)],
        ],
        total_rows: None,
    };
    let sections = vec![plot("One", CurveStyle::Line(1)), plot("Two", CurveStyle::Points(1)), Section::Table(table)];
    Report { title: "T".into(), sections, ..Report::default() }.html().unwrap()
}

#[test]
fn the_pointer_reads_the_values_that_were_drawn() {
    // The middle vertex of the first curve lies where the path says; x is the middle of the panel.
    let steps = r#"
        const svg = figure("One").querySelector("svg");
        const line = svg.querySelector(".pts [data-n=north].ln");
        const [, x, y] = [...line.getAttribute("d").matchAll(/[ML](\S+?) ([-\d.]+)/g)][1].map(Number);
        point("pointermove", svg, x + 3, y - 4);
        const near = tip();
        point("pointermove", svg, x + 3, y + 60);
        const far = tip();
        return { near, far };"#;
    let Some(seen) = in_browser(&two_lines(), steps) else { return };
    // 0.01 px of some 960 px for 100 mm, and of 240 px for 7 µm: three and four decimals would be guesses.
    assert_eq!(seen["near"], json!(["north", "position 50.00 mm", "error 2.500 µm (band ± 0.50)"]));
    assert_eq!(seen["far"], Value::Null);
}

/// Seven lines of a length test lay on each other. What stands beside its place still tells its own values.
#[test]
fn regress_points_beside_their_place_are_read_as_they_are() {
    let curve = |name: &str, beside_px, y| Curve {
        name: name.into(),
        style: CurveStyle::PointsBeside(1, beside_px),
        x: vec![0.0, 50.0, 100.0],
        y: vec![Some(y); 3],
        also: None,
        half_width: None,
    };
    let plot = Section::LinePlot(LinePlot {
        title: "One".into(),
        note: None,
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: "p".into(),
            x: Axis::new("length", "mm"),
            y: Axis::new("error", "µm"),
            curves: vec![curve("left", -12, 1.0), curve("right", 12, 1.0)],
        }],
    });
    let page = Report { title: "T".into(), sections: vec![plot], ..Report::default() }.html().unwrap();
    let steps = r#"
        const svg = figure("One").querySelector("svg");
        const of = (name) => {
          const path = svg.querySelector(`.pts [data-n=${name}]`);
          const box = path.getBBox();
          const [, x, y] = [...path.getAttribute("d").matchAll(/M(\S+?) ([-\d.]+)/g)][1].map(Number);
          point("pointermove", svg, x + Number(path.dataset.s), y);
          return { tip: tip(), middle: Math.round(box.x + box.width / 2 - x) };
        };
        return { left: of("left"), right: of("right") };"#;
    let Some(seen) = in_browser(&page, steps) else { return };
    for (name, beside_px) in [("left", -12), ("right", 12)] {
        assert_eq!(seen[name]["tip"][0], json!(name), "{seen:#}");
        assert_eq!(seen[name]["tip"][1], json!("length 50.00 mm"), "{seen:#}");
        assert_eq!(seen[name]["middle"], json!(beside_px), "{seen:#}");
    }
}

#[test]
fn a_plot_is_enlarged_about_the_pointer_moved_and_given_back_whole() {
    let steps = r#"
        const svg = figure("One").querySelector("svg");
        const data = svg.querySelector(".pts");
        const whole = svg.querySelector(".panel").innerHTML;
        const vertex = () => [...data.querySelector(".ln").getAttribute("d").matchAll(/[ML](\S+?) ([-\d.]+)/g)]
          .map((m) => [Number(m[1]), Number(m[2])]);
        const [before] = [vertex()];
        const at = client(svg, ...before[1]);
        svg.dispatchEvent(new PointerEvent("dblclick", { clientX: at.x, clientY: at.y, bubbles: true }));
        const large = vertex();
        const marks = all(".tx text", svg).length;
        const clipped = data.hasAttribute("clip-path");
        point("pointermove", svg, large[1][0], large[1][1]);
        const read = tip();
        press(svg, "ArrowLeft");
        const moved = vertex();
        press(svg, "0");
        return { stays: Math.hypot(large[1][0] - before[1][0], large[1][1] - before[1][1]) < 0.1,
          twice: (large[2][0] - large[1][0]) / (before[2][0] - before[1][0]), clipped, marks: marks > 3, read: read[2],
          moved: moved[1][0] - large[1][0], whole: svg.querySelector(".panel").innerHTML === whole };"#;
    let Some(seen) = in_browser(&two_lines(), steps) else { return };
    let twice = seen["twice"].as_f64().unwrap();
    assert!((twice - 2.0).abs() < 1e-3, "{twice}");
    assert_eq!(
        (seen["stays"].clone(), seen["clipped"].clone(), seen["marks"].clone()),
        (json!(true), json!(true), json!(true))
    );
    assert_eq!(seen["read"], json!("error 2.500 µm (band ± 0.50)"), "a value is the same however large it is drawn");
    assert_eq!(seen["moved"].as_f64().unwrap().round(), 40.0);
    assert_eq!(seen["whole"], json!(true));
}

#[test]
fn a_line_is_picked_out_in_every_plot_and_table_that_knows_it() {
    let steps = r#"
        const options = all(".bar option").map((o) => o.value);
        figure("One").querySelector(".pts [data-n=north]").dispatchEvent(new MouseEvent("click", { bubbles: true }));
        const dim = () => all(".dim").map((n) => `${n.tagName.toLowerCase()} ${n.dataset.n}`).sort();
        const first = new Set(dim());
        const [rows, chosen] = [all("tr.picked").map((r) => r.cells[0].textContent), document.querySelector("select").value];
        const both = ["One", "Two"].map((title) => figure(title).querySelectorAll(".dim").length > 0);
        const east = all("tr").some((row) => row.textContent.startsWith("east") && row.classList.contains("dim"));
        figure("Two").querySelector(".pts [data-n=north]").dispatchEvent(new MouseEvent("click", { bubbles: true }));
        return { options, first: [...first], rows, chosen, both, east, after: dim() };"#;
    let Some(seen) = in_browser(&two_lines(), steps) else { return };
    assert_eq!(seen["options"], json!(["", "north", "south"]));
    assert_eq!(seen["first"], json!(["path south", "text south", "tr south"]));
    assert_eq!((seen["rows"].clone(), seen["chosen"].clone()), (json!(["north"]), json!("north")));
    assert_eq!((seen["both"].clone(), seen["after"].clone()), (json!([true, true]), json!([])));
    assert_eq!(seen["east"], json!(false), "what no figure shows is not dimmed");
}

/// The plot over time called a station otherwise than the others did, and went on showing all of them.
#[test]
fn regress_a_station_is_picked_out_in_every_figure_that_tells_stations_apart() {
    let steps = r#"
        const choice = document.querySelector(".bar select");
        choice.value = "B";
        choice.dispatchEvent(new Event("change"));
        const titles = ["Mean residual by position", "Residual against time, by station", "Residual magnitude by station",
          "Volume, stations and measured lines"];
        const left = (f) => all("[data-n]:not(.dim)", f).map((n) => n.dataset.n.split("\t"));
        const without = (of) => titles.map((title) => left(figure(title)).filter((names) => !names.includes(of)).length);
        const gone = () => titles.map((title) => all("[data-n].dim", figure(title)).length > 0);
        const station = [without("B"), gone()];
        const press = () => all("[data-n]", figure("Residual against time, by station")).find((n) => n.dataset.n === "B\tB-1")
          .dispatchEvent(new MouseEvent("click", { bubbles: true }));
        press();
        const line = [choice.value, without("B-1").filter((_, k) => k !== 2), all("tr.picked").length];
        press();
        return { station, line, none: [choice.value, all(".dim").length] };"#;
    let Some(seen) = in_browser(&common::demo_report(1).html().unwrap(), steps) else { return };
    assert_eq!(seen["station"], json!([[0, 0, 0, 0], [true, true, true, true]]));
    // No box is of a line: that figure stays as it is. Four readings of it were rejected.
    assert_eq!(seen["line"], json!(["B-1", [0, 0, 0], 4]));
    assert_eq!(seen["none"], json!(["", 0]));
}

/// Chapters of a simulated test stood there whatever state was chosen.
#[test]
fn regress_the_switch_reaches_chapters_that_have_the_name_of_a_state() {
    let curve = |name: &str, state| Curve {
        name: name.into(),
        also: None,
        style: CurveStyle::PointsOf(state),
        x: vec![0.0, 1.0],
        y: vec![Some(1.0), Some(2.0)],
        half_width: None,
    };
    let panel = LinePanel {
        title: String::new(),
        x: Axis::new("length", "mm"),
        y: Axis::new("error", "µm"),
        curves: vec![curve("Before correction", State::Before), curve("After correction", State::After)],
    };
    let plot = LinePlot { title: "Both".into(), note: None, columns: 1, band_name: None, panels: vec![panel] };
    let chapter = |title: &str| {
        let text = format!("in {title}");
        [
            Section::Heading(Heading { title: title.into(), intro: None }),
            Section::Callout(Callout { tone: Tone::Good, title: String::new(), text }),
        ]
    };
    let sections: Vec<Section> = std::iter::once(Section::LinePlot(plot))
        .chain(["Before correction", "After correction"].into_iter().flat_map(chapter))
        .collect();
    let meta = vec![MetaItem::software("abbe")];
    let html = Report { title: "T".into(), meta, sections, ..Report::default() }.html().unwrap();
    let steps = r#"
        const shown = () => all("main > h2, main > .callout, main > .made").filter(seen).length;
        const choose = (text) => { all(".bar button").find((b) => b.textContent === text).click(); return shown(); };
        return [shown(), choose("before"), choose("after"), choose("before and after")];"#;
    let Some(seen) = in_browser(&html, steps) else { return };
    assert_eq!(seen, json!([5, 3, 3, 5]));
}

#[test]
fn before_and_after_are_seen_alone_and_vectors_turn_and_stretch() {
    let steps = r#"
        const three = document.querySelector("figure.three");
        const svg = three.querySelector("svg");
        const lines = () => ["B", "A"].map((letter) => svg.querySelector(`.scene .l${letter}`).getAttribute("d"));
        const first = lines();
        const slider = three.querySelector("input");
        slider.value = "1";
        slider.dispatchEvent(new Event("input"));
        const length = (d) => [...d.matchAll(/M(\S+) ([^L]+)L(\S+) ([^M]+)/g)]
          .map((m) => m.map(Number)).reduce((sum, [, a, b, c, e]) => sum + Math.hypot(c - a, e - b), 0);
        const stretched = lines().map((d, k) => length(d) / length(first[k]));
        const note = svg.querySelector(".magnified").textContent;
        all("button", three).find((b) => b.textContent === "Whole").click();
        const again = lines().map((d, k) => length(d) / length(first[k]));
        point("pointerdown", svg, 500, 200);
        point("pointermove", svg, 560, 200);
        point("pointerup", svg, 560, 200);
        const turned = lines()[0] !== first[0];
        all("button", three).find((b) => b.textContent === "XY").click();
        // From above, the corners of floor and ceiling coincide.
        const corners = new Set(svg.querySelector(".vol").getAttribute("d").match(/-?[\d.]+ -?[\d.]+/g)).size;
        all(".bar button").find((b) => b.textContent === "before").click();
        const alone = ["B", "A"].map((letter) => seen(svg.querySelector(`.scene .l${letter}`)));
        const elsewhere = all("figure:not(.three) .lA").some(seen);
        all(".bar button").find((b) => b.textContent === "before and after").click();
        return { stretched, note, again, turned, corners, alone, elsewhere, back: seen(svg.querySelector(".scene .lA")) };"#;
    let Some(seen) = in_browser(&common::demo_report(1).html().unwrap(), steps) else { return };
    for factor in seen["stretched"].as_array().unwrap() {
        // Ends are rounded to a hundredth of a pixel, of vectors of a pixel and more.
        assert!((factor.as_f64().unwrap() - 10.0).abs() < 0.1, "{factor}");
    }
    for factor in seen["again"].as_array().unwrap() {
        assert!((factor.as_f64().unwrap() - 1.0).abs() < 0.01, "{factor}");
    }
    assert!(seen["note"].as_str().unwrap().starts_with("vectors enlarged"), "{}", seen["note"]);
    assert_eq!((seen["turned"].clone(), seen["corners"].clone()), (json!(true), json!(4)));
    assert_eq!((seen["alone"].clone(), seen["elsewhere"].clone()), (json!([true, false]), json!(false)));
    assert_eq!(seen["back"], json!(true));
}

/// Maps by region and tables showed both states whatever was chosen, and a browser took a second to say what a station is.
#[test]
fn regress_the_switch_reaches_maps_and_tables_and_shapes_say_at_once_what_they_are() {
    let steps = r#"
        const row = (state) => all("tr").filter((r) => [...r.cells].some((c) => c.textContent === state));
        const clear = (node) => getComputedStyle(node).opacity === "1";
        const shown = (state, letter) => [row(state).some(seen), all(`g.p${letter}`).some(clear)];
        const choose = (text) => all(".bar button").find((b) => b.textContent === text).click();
        const both = [shown("as indicated", "B"), shown("corrected", "A")];
        choose("before");
        const before = [shown("as indicated", "B"), shown("corrected", "A")];
        choose("after");
        const after = [shown("as indicated", "B"), shown("corrected", "A")];
        const stations = figure("Volume, stations and measured lines").querySelector("svg");
        const over = (node) => { node.dispatchEvent(new PointerEvent("pointermove", { bubbles: true })); return tip(); };
        const station = over(stations.querySelector("circle[data-told]"));
        const lines = over(stations.querySelector(".hair[data-n]"));
        const cell = over(document.querySelector("g.pA rect[data-told]"));
        const three = document.querySelector("figure.three svg");
        const [, x, y] = three.querySelector(".scene .muteds").getAttribute("d").match(/M(\S+) ([-\d.]+)/).map(Number);
        point("pointermove", three, x + 2, y + 2);
        const vector = tip();
        return { both, before, after, station, lines, cell, vector, left: all("figure > svg * > title").length };"#;
    let Some(seen) = in_browser(&common::demo_report(1).html().unwrap(), steps) else { return };
    assert_eq!(seen["both"], json!([[true, true], [true, true]]));
    assert_eq!(seen["before"], json!([[true, true], [false, false]]));
    assert_eq!(seen["after"], json!([[false, false], [true, true]]));
    assert!(seen["station"][0].as_str().unwrap().starts_with("A: x "), "{}", seen["station"]);
    assert_eq!(seen["lines"], json!(["A, A-0"]));
    assert!(seen["cell"][0].as_str().unwrap().ends_with(" µm"), "{}", seen["cell"]);
    assert!(seen["vector"][0].as_str().unwrap().starts_with("x "), "{}", seen["vector"]);
    assert_eq!(seen["left"], json!(0), "a browser would say it a second time");
}

/// A verdict of many words is read whole on a screen: nothing cuts it, and no table has to be moved for it.
#[test]
fn regress_a_long_verdict_is_not_cut_on_a_screen() {
    let verdict = "does not conform, since ".to_owned() + &"one error is beyond its limit and ".repeat(20) + "no more";
    let table = TableSection {
        title: "Limits".into(),
        note: None,
        columns: vec![Column::text("limit"), Column::text("verdict")],
        rows: vec![vec![Cell::text("E0"), Cell::text(&verdict)]],
        total_rows: None,
    };
    let card = KeyFigure { label: "share".into(), detail: Some(verdict.clone()), ..KeyFigure::default() };
    let sections = vec![
        Section::KeyFigures(KeyFigures { title: "G".into(), figures: vec![card] }),
        Section::Callout(Callout { tone: Tone::Bad, title: "Length".into(), text: verdict }),
        Section::Table(table),
    ];
    let html = Report { title: "T".into(), sections, ..Report::default() }.html().unwrap();
    let steps = r#"
        const long = all(".card .d, .callout p, td.wrap");
        const cut = (n) => n.scrollWidth > n.clientWidth + 1 || n.scrollHeight > n.clientHeight + 1;
        return { count: long.length, cut: long.filter(cut).length, whole: long.every((n) => n.textContent.includes("and no more")),
          moved: all(".scroll:not(.fits)").length };"#;
    let Some(seen) = in_browser(&html, steps) else { return };
    assert_eq!(seen, json!({ "count": 3, "cut": 0, "whole": true, "moved": 0 }));
}

/// On a phone every table said that it is wider than the screen, three narrow columns too.
#[test]
fn regress_only_what_does_not_fit_says_that_it_can_be_moved() {
    let steps = r#"
        const table = document.querySelector(".scroll");
        const whole = table.classList.contains("fits");
        table.style.width = "40px";
        dispatchEvent(new Event("resize"));
        return { whole, cut: table.classList.contains("fits") };"#;
    let Some(seen) = in_browser(&two_lines(), steps) else { return };
    assert_eq!(seen, json!({ "whole": true, "cut": false }));
}
