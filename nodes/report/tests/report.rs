//! What a report promises: self-contained, escaped, deterministic, never a number that is not finite.

use crate::common;
use abbe_report::*;

/// A report with one section.
fn single(section: Section) -> Report {
    Report { title: "T".into(), sections: vec![section], main_plot: Some(0), ..Report::default() }
}

fn line_plot(y: Vec<Option<f64>>) -> LinePlot {
    LinePlot {
        title: "Curves".into(),
        note: None,
        columns: 1,
        band_name: None,
        panels: vec![LinePanel {
            title: "P".into(),
            x: Axis::new("x", "mm"),
            y: Axis::new("e", "µm"),
            curves: vec![Curve {
                name: "c".into(),
                style: CurveStyle::Line(1),
                x: (0..y.len()).map(|i| i as f64).collect(),
                y,
                also: None,
                half_width: None,
            }],
        }],
    }
}

#[test]
fn same_data_gives_the_same_bytes() {
    let (a, b) = (common::demo_report(3), common::demo_report(3));
    assert_eq!(a.html().unwrap(), b.html().unwrap());
    assert_eq!(a.png().unwrap(), b.png().unwrap());
    assert_eq!(a.json().unwrap(), b.json().unwrap());
    assert_ne!(a.json().unwrap(), common::demo_report(4).json().unwrap());
}

#[test]
fn page_needs_nothing_from_outside() {
    let html = common::demo_report(1).html().unwrap();
    let (page, script) = html.split_once("<script>").unwrap();
    for outside in ["http://", "https://", "<script src", "<link", "<img", "@import", "src=\"", " on"] {
        // ` on` would begin an event handler inside a tag; in text it is a word, so only tags are searched.
        let found = page.split('<').skip(1).filter_map(|t| t.split('>').next());
        let in_tags = found.map(|t| format!("<{t}")).any(|t| t.contains(outside) && !t.starts_with("<svg"));
        assert!(!in_tags, "'{outside}' in a tag");
    }
    assert!(!html.contains("://") && page.contains("default-src 'none'"));
    let urls: Vec<_> = page.match_indices("url(").map(|(i, _)| &page[i..i + 9]).collect();
    assert_eq!(urls, ["url(data:"; 2]);
    for outside in ["fetch(", "XMLHttpRequest", "import(", "WebSocket", "localStorage", "Date", "Math.random"] {
        assert!(!script.contains(outside), "{outside} in the script");
    }
}

#[test]
fn every_text_is_escaped() {
    let evil = "<script>alert('x')</script>&\"";
    let mut data = common::demo_report(1);
    data.header.title = evil.into();
    data.header.what = evil.into();
    data.header.identity.machine = Some(evil.into());
    data.header.files[0] = FileEntry { role: evil.into(), name: evil.into() };
    data.header.software_version = evil.into();
    data.verification_note = Some(evil.into());
    data.remarks = vec![Callout { tone: Tone::Warning, title: evil.into(), text: evil.into() }];
    data.errors.curves[0].name = evil.into();
    data.errors.curves[0].axis = evil.into();
    data.errors.squareness[0].name = evil.into();
    data.stations[0].name = evil.into();
    data.residuals[0].station = evil.into();
    data.order[0].form = evil.into();
    data.rejected[0].reason = evil.into();
    data.steps[0].name = evil.into();
    data.identifiability.correlations[0].first = evil.into();
    let html = data.html().unwrap();
    assert_eq!(html.matches("<script").count(), 2, "the page's own, and the numbers of the vectors");
    assert_eq!(html.matches("</script").count(), 2);
    assert!(html.matches("&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;&amp;&quot;").count() >= 16);
    data.png().unwrap();
}

#[test]
fn drawings_hold_finite_numbers_only() {
    let html = common::demo_report(1).html().unwrap();
    let tags: Vec<_> = html.split('<').filter(|t| t.starts_with("path") || t.starts_with("rect")).collect();
    assert!(tags.len() > 300);
    for tag in tags {
        let attributes = tag.split('>').next().unwrap();
        assert!(!attributes.contains("NaN") && !attributes.contains("inf"), "{attributes}");
    }
}

#[test]
fn a_number_that_is_not_finite_is_named_with_its_section() {
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let report = single(Section::LinePlot(line_plot(vec![Some(1.0), Some(value)])));
        for error in [report.html().unwrap_err(), report.png().unwrap_err(), report.json().unwrap_err()] {
            let text = error.to_string();
            assert!(text.contains("section 'Curves': panels[0].curves[0].y[1]"), "{text}");
        }
    }
}

#[test]
fn a_nan_in_the_data_is_named_by_its_field() {
    let mut data = common::demo_report(1);
    data.verification[3].position_mm[2] = f64::NAN;
    for text in [
        data.html().unwrap_err().to_string(),
        data.png().unwrap_err().to_string(),
        data.json().unwrap_err().to_string(),
    ] {
        assert!(text.contains("verification[3].position_mm[2] is NaN"), "{text}");
    }
}

#[test]
fn finite_numbers_that_overflow_the_drawing_are_an_error() {
    let report = single(Section::LinePlot(line_plot(vec![Some(f64::MAX), Some(-f64::MAX)])));
    assert!(matches!(report.html(), Err(ReportError::Overflow { section }) if section == "Curves"));
}

#[test]
fn eight_series_of_points_are_told_apart_by_their_markers_and_their_colours() {
    let mut plot = line_plot(vec![Some(1.0)]);
    let curve = |series: u8| Curve {
        name: format!("line {series}"),
        style: CurveStyle::Points(series),
        ..plot.panels[0].curves[0].clone()
    };
    plot.panels[0].curves = (1..=9).map(curve).collect();
    let html = single(Section::LinePlot(plot)).html().unwrap();
    let drawn: Vec<&str> =
        html.split("<path class=\"mark ").skip(1).map(|rest| rest.split('/').next().unwrap()).collect();
    assert_eq!(drawn.len(), 18, "a marker and its entry in the legend each");
    let colours: std::collections::BTreeSet<&str> = drawn.iter().map(|path| path.split('"').next().unwrap()).collect();
    // What follows the place of a marker is its outline.
    let outline = |path: &&str| path.split_once('m').unwrap().1.to_owned();
    let shapes: std::collections::BTreeSet<String> = drawn.iter().map(outline).collect();
    assert_eq!((colours.len(), shapes.len()), (8, 8), "the ninth is as the first");
}

#[test]
fn missing_values_are_dashes_and_gaps() {
    let table = TableSection {
        title: "M".into(),
        note: None,
        columns: vec![Column::number("told", "mm"), Column::number("never known", "mm")],
        rows: vec![vec![None, None], vec![Cell::number(1.5, 1), None]],
        total_rows: None,
    };
    let html = single(Section::Table(table)).html().unwrap();
    assert_eq!(html.matches("<span class=\"missing\">—</span>").count(), 1);
    assert!(html.contains("told") && !html.contains("never known"), "a column of dashes tells nothing");
    let known = |label: &str, value: Option<&str>| MetaItem { label: label.into(), value: value.map(str::to_owned) };
    let meta = vec![known("Machine", Some("m1")), known("Host", None)];
    let html = Report { title: "T".into(), meta, ..Report::default() }.html().unwrap();
    assert!(html.contains("Machine") && !html.contains("Host"));
    let broken = line_plot(vec![Some(1.0), Some(2.0), None, Some(1.0), Some(0.5)]);
    let html = single(Section::LinePlot(broken)).html().unwrap();
    assert_eq!(html.matches("<path class=\"ln l1\"").count(), 3, "legend and two pieces of the curve");
}

/// Stations without readings stood side by side as dashes.
#[test]
fn regress_a_station_without_readings_is_named_and_has_no_place_in_the_plot() {
    let plot = |values: &[&[f64]]| {
        let group = |(k, own): (usize, &&[f64])| BoxGroup { label: format!("S{k}"), boxes: vec![BoxStats::of(own)] };
        let plot = BoxPlot {
            title: "B".into(),
            note: Some("Magnitudes.".into()),
            groups_label: "station".into(),
            value: Axis::new("residual", "µm"),
            series: vec!["residual".into()],
            states: Vec::new(),
            groups: values.iter().enumerate().map(group).collect(),
        };
        single(Section::BoxPlot(plot)).html().unwrap()
    };
    let html = plot(&[&[1.0, 2.0], &[], &[3.0], &[]]);
    assert!(html.contains("Magnitudes. Left out, for want of values: S1, S3.</p>"), "{html}");
    assert!(html.contains(">S0</text>") && html.contains(">S2</text>") && !html.contains(">S1</text>"));
    assert!(!html.contains(">—<") && !plot(&[&[1.0]]).contains("Left out"));
    assert!(plot(&[&[], &[]]).contains("Left out, for want of values: S0, S1."), "a page all the same");
}

/// What is long wraps: it is neither cut nor shortened.
#[test]
fn regress_a_long_verdict_is_whole_in_callout_table_and_card() {
    let verdict = "does not conform, since ".to_owned() + &"one error is beyond its limit and ".repeat(20) + "no more";
    let callout = Callout { tone: Tone::Bad, title: "Length".into(), text: verdict.clone() };
    let card = KeyFigure { label: "share".into(), detail: Some(verdict.clone()), ..KeyFigure::default() };
    let table = TableSection {
        title: "Limits".into(),
        note: None,
        columns: vec![Column::text("limit"), Column::text("verdict")],
        rows: vec![vec![Cell::text("E0"), Cell::text(&verdict)]],
        total_rows: None,
    };
    let sections = vec![
        Section::KeyFigures(KeyFigures { title: "G".into(), figures: vec![card] }),
        Section::Callout(callout),
        Section::Table(table),
    ];
    let html = Report { title: "T".into(), sections, ..Report::default() }.html().unwrap();
    // A callout begins as a sentence does.
    assert_eq!(html.matches(&verdict[1..]).count(), 3, "{html}");
    assert!(html.contains("<td class=\"wrap\">does not conform"), "a cell of many words wraps");
    assert!(!html.contains("text-overflow"));
}

#[test]
fn an_empty_run_still_makes_a_page_but_no_main_plot() {
    let data = DemoReport::default();
    let html = data.html().unwrap();
    assert!(html.contains("did not converge") && html.contains("no verification points"));
    assert!(matches!(data.png(), Err(ReportError::MainPlot { .. })));
}

#[test]
fn a_numeric_column_without_unit_is_refused() {
    let table = TableSection {
        title: "Stations".into(),
        note: None,
        columns: vec![Column::text("x")],
        rows: vec![vec![Cell::number(1.0, 1)]],
        total_rows: None,
    };
    let text = single(Section::Table(table)).html().unwrap_err().to_string();
    assert!(text.contains("'Stations'") && text.contains("column 'x'") && text.contains("unit"), "{text}");
}

#[test]
fn parts_that_do_not_fit_are_refused() {
    let mut plot = line_plot(vec![Some(1.0)]);
    plot.panels[0].curves[0].x.push(2.0);
    let wrong = [
        Section::LinePlot(plot),
        Section::Histogram(Histogram {
            title: "H".into(),
            note: None,
            normal_name: None,
            columns: 1,
            panels: vec![HistogramPanel {
                title: "h".into(),
                x: Axis::new("r", "µm"),
                edges: vec![],
                counts: vec![],
                below: 0,
                above: 0,
                normal_sigma: None,
            }],
        }),
        Section::Isometric(Isometric {
            title: "I".into(),
            note: None,
            unit: "mm".into(),
            volume_min: [0.0; 3],
            volume_max: [1.0, 1.0, 0.0],
            points: vec![],
            lines: vec![],
        }),
    ];
    for section in wrong {
        assert!(matches!(single(section).html(), Err(ReportError::Shape { .. })));
    }
}

#[test]
fn long_lists_say_what_they_leave_out() {
    let html = common::demo_report(1).html().unwrap();
    assert!(html.contains("The first 20 of 27 rows; all of them are in the JSON file."));
}

#[test]
fn main_plot_is_a_png_of_1600_by_900() {
    let png = common::demo_report(1).png().unwrap();
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
    assert_eq!((number(16), number(20)), (1600, 900));
}

#[test]
fn every_figure_is_well_formed_and_rasterises() {
    let mut report = common::demo_report(1).report();
    let mut figures = 0;
    for index in 0..report.sections.len() {
        report.main_plot = Some(index);
        match report.png() {
            Ok(png) => {
                assert!(png.len() > 5000, "section {index} is blank");
                figures += 1;
            }
            Err(ReportError::MainPlot { .. }) => {}
            Err(other) => panic!("section {index}: {other}"),
        }
    }
    assert_eq!(figures, 10);
}

#[test]
fn json_reads_back_as_the_same_data() {
    let data = common::demo_report(5);
    let text = data.json().unwrap();
    assert_eq!(serde_json::from_str::<DemoReport>(&text).unwrap(), data);
    let report = data.report();
    assert_eq!(serde_json::from_str::<Report>(&report.json().unwrap()).unwrap(), report);
}

#[test]
fn key_figures_of_a_known_sample() {
    let point = |e: f64| VerificationPoint {
        position_mm: [e, 0.0, 0.0],
        before_um: [3.0 * e, 4.0 * e, 0.0],
        after_um: Some([0.0, 0.0, e]),
        after_loop_um: None,
    };
    let data = DemoReport { verification: vec![point(1.0), point(7.0)], ..DemoReport::default() };
    let Section::KeyFigures(key) = &data.report().sections[0] else { panic!("key figures come first") };
    // 3-D lengths are 5 and 35 before, 1 and 7 after: both rms are 5 times those of (1, 7), which is 5.
    assert_eq!(key.figures[0].before, Some(Quantity::new(25.0, 1)));
    assert_eq!(key.figures[0].value, Some(Quantity::new(5.0, 2)));
    assert_eq!(key.figures[1].value, Some(Quantity::new(7.0, 2)));
}

/// How a loop may end that found one effect.
fn closing() -> Closing {
    let effect = serde_json::json!({
        "name": "bow", "title": "bow under load", "kind": "attributed", "formula": "", "shape": { "axis": "y" },
        "covariates": [], "p_value": 1e-9, "evidence": 80.0, "alias_share": 0.69,
        "parameters": [{ "name": "curvature", "value": -31.8e-6, "unit": "1/(m K)", "u": 2.8e-6, "plausible": null, "is_plausible": true }],
        "held_out_gain_um": 0.5, "size_um": 0.99,
        "placebo": { "gain": 1.0, "unit": "", "draws": 0, "median": null, "quantile_95": null, "share_as_good": null },
        "cannot_be_told_from": [{ "name": "sag", "shape": {}, "evidence_behind": 3.0 }]
    });
    let in_use = Some(InUse { model_hash: "ab".repeat(32), first_sample: 27_412 });
    Closing { effects: vec![serde_json::from_value(effect).unwrap()], in_use, ..Closing::default() }
}

#[test]
fn what_the_model_lacked_is_named_with_size_uncertainty_and_rival() {
    let words = closing().sentences().join(" ");
    for told in [
        "bow under load of Y",
        "0.99 µm rms",
        "curvature −31.8 ± 2.8 µrad/(m·K) (k = 1)",
        "cannot tell it from: sag",
        "69 %",
    ] {
        assert!(words.contains(told), "{told:?}: {words}");
    }
    let mut data = common::demo_report(1);
    data.verification.iter_mut().for_each(|point| point.after_loop_um = point.after_um.map(|e| e.map(|v| v / 4.0)));
    data.closing = Some(closing());
    let html = data.html().unwrap();
    for told in
        ["after geometry", "after the loop", "bow under load of Y", "What it could be confused with", "from sample 27"]
    {
        assert!(html.contains(told), "{told:?}");
    }
    data.png().unwrap();
    assert_eq!(serde_json::from_str::<DemoReport>(&data.json().unwrap()).unwrap(), data);
    let nothing = Closing { outcome: "The monitor asked for no diagnosis".into(), ..Closing::default() };
    assert_eq!(nothing.sentences(), ["The monitor asked for no diagnosis."]);
    data.closing = Some(nothing);
    assert!(data.html().unwrap().contains("asked for no diagnosis"));
}

#[test]
fn thinned_points_are_announced() {
    let mut plot = line_plot((0..20_000).map(|i| Some(f64::from(i))).collect());
    plot.panels[0].curves[0].style = CurveStyle::Points(1);
    let html = single(Section::LinePlot(plot)).html().unwrap();
    assert!(html.contains("One point in 3 is drawn"));
}

#[test]
fn the_next_command_stands_after_the_answer_and_before_the_first_picture() {
    let callout =
        Callout { tone: Tone::Warning, title: "Limit of 3 µm".into(), text: "line X is -0.5 µm off".into() };
    let heading = |title: &str| Section::Heading(Heading { title: title.into(), intro: None });
    let next = NextStep { what_for: "to see <more>".into(), command: "abbe verify --model 'a & b'".into() };
    let mut report = Report {
        title: "T".into(),
        next: Some(next),
        sections: vec![
            Section::Callout(callout.clone()),
            heading("First"),
            Section::Callout(callout),
            heading("Second"),
        ],
        ..Report::default()
    };
    let html = report.html().unwrap();
    let command =
        "<p><b>Next</b>, to see &lt;more&gt;:</p>\n<pre><code>abbe verify --model &#39;a &amp; b&#39;</code></pre>";
    assert_eq!(html.matches(command).count(), 1, "{html}");
    let place = |part: &str| html.find(part).unwrap();
    assert!(place("Limit of 3 µm") < place(command) && place(command) < place(">First</h2>"));
    // A sentence that begins small follows no file name here, and reads as written by hand.
    assert!(html.contains("</b> Line X is −0.5 µm off"), "{html}");
    // Also where there is nothing else. A certificate has none: who gets it runs no command.
    report.sections.truncate(1);
    assert_eq!(report.html().unwrap().matches(command).count(), 1);
    let with = report.pdf().unwrap().len();
    report.next = None;
    assert!(!report.html().unwrap().contains("class=\"next\""));
    assert_eq!(report.pdf().unwrap().len(), with);
}

/// Nine warnings of a diagnosis pushed the next command off the screen.
#[test]
fn regress_many_warnings_leave_the_next_command_on_the_first_screen() {
    let callout = |k: usize| {
        let tone = if k == 8 { Tone::Bad } else { Tone::Warning };
        Section::Callout(Callout { tone, title: String::new(), text: format!("Limit {k} of 9") })
    };
    let next = NextStep { what_for: "to go on".into(), command: "abbe next".into() };
    let sections = (0..9).map(callout).collect();
    let html = Report { title: "T".into(), next: Some(next), sections, ..Report::default() }.html().unwrap();
    let place = |part: &str| html.find(part).unwrap_or_else(|| panic!("{part} is gone"));
    let before: Vec<usize> = (0..9).filter(|k| place(&format!("Limit {k} of 9")) < place("abbe next")).collect();
    assert_eq!(before, [0, 1, 2, 8], "what failed stands first as well");
    assert!(html.contains("5 more to heed"), "what follows is announced");
}

#[test]
fn what_a_page_was_made_from_is_named_alike() {
    let meta = vec![MetaItem::file("data", "a.csv", Some("12ab")), MetaItem::software("abbe 1.2.3")];
    let footer = Some("abbe 1.2.3  ·  data 12ab".to_owned());
    let html = Report { title: "T".into(), meta, footer, ..Report::default() }.html().unwrap();
    assert!(html.contains("<dt>Data</dt><dd>a.csv, SHA-256 12ab</dd>\n<dt>Software</dt><dd>abbe 1.2.3</dd>"), "{html}");
    assert_eq!(html.matches("abbe 1.2.3").count(), 1, "the version stands once");
}

/// Points that were aligned to their reference had a column of zeros, and a first row without a factor.
#[test]
fn regress_an_aligned_mean_has_no_column_and_every_state_its_factor() {
    let mut data = common::demo_report(1);
    let count = data.verification.len() as f64;
    for axis in 0..3 {
        let of = |p: &VerificationPoint| [p.before_um[axis], p.after_um.unwrap()[axis]];
        let sums = data.verification.iter().map(of).fold([0.0; 2], |sum, v| [sum[0] + v[0], sum[1] + v[1]]);
        for point in &mut data.verification {
            point.before_um[axis] -= sums[0] / count;
            point.after_um.as_mut().unwrap()[axis] -= sums[1] / count;
        }
    }
    let html = data.html().unwrap();
    let table = html.split("Error by component").nth(1).unwrap().split("</table>").next().unwrap();
    assert!(!table.contains(">mean<") && !table.contains("missing"), "{table}");
    assert!(table.contains("smaller by a factor") && table.contains(">1.00<"), "{table}");
}
