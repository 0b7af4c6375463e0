//! Whatever finite numbers come in, a section draws with finite coordinates or refuses by name; it never panics.

use abbe_report::*;
use proptest::collection::vec;
use proptest::num::f64::{INFINITE, NEGATIVE, NORMAL, POSITIVE, QUIET_NAN, SUBNORMAL, ZERO};
use proptest::prelude::*;

/// Any finite number, from subnormal to the largest.
fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO, -1e3..1e3_f64]
}

fn axis() -> Axis {
    Axis::new("v", "µm")
}

fn line_plot(points: &[(f64, Option<f64>, f64)], style: CurveStyle) -> Section {
    Section::LinePlot(LinePlot {
        title: "S".into(),
        note: None,
        columns: 3,
        band_name: None,
        panels: vec![LinePanel {
            title: "p".into(),
            x: axis(),
            y: axis(),
            curves: vec![Curve {
                name: "c".into(),
                style,
                x: points.iter().map(|p| p.0).collect(),
                y: points.iter().map(|p| p.1).collect(),
                also: None,
                half_width: Some(points.iter().map(|p| Some(p.2.abs())).collect()),
            }],
        }],
    })
}

fn map(points: &[(f64, Option<f64>, f64)]) -> Section {
    let points = points.iter().map(|&(x, y, value)| MapPoint { x, y: y.unwrap_or(1.0), value });
    Section::ResidualMap(ResidualMap {
        title: "S".into(),
        note: None,
        value: axis(),
        limit: None,
        panels: vec![MapPanel { title: "p".into(), x: axis(), y: axis(), points: points.collect(), of: Vec::new() }],
    })
}

fn comparison(points: &[(f64, Option<f64>, f64)]) -> Section {
    Section::Comparison(Comparison {
        title: "S".into(),
        note: None,
        label: "e".into(),
        unit: "µm".into(),
        states: vec!["b".into(), "m".into(), "a".into()],
        groups: vec![ComparisonGroup {
            label: "3-D".into(),
            states: vec![
                points.iter().map(|p| p.0.abs()).collect(),
                points.iter().map(|p| p.2.abs()).collect(),
                points.iter().filter_map(|p| p.1).map(f64::abs).collect(),
            ],
        }],
    })
}

fn histogram(points: &[(f64, Option<f64>, f64)]) -> Section {
    let values: Vec<f64> = points.iter().map(|p| p.0).collect();
    let sigma = points.first().map(|p| p.2.abs()).filter(|&s| s > 0.0);
    Section::Histogram(Histogram {
        title: "S".into(),
        note: None,
        normal_name: Some("n".into()),
        columns: 0,
        panels: vec![HistogramPanel::from_values("p", axis(), &values, 31, sigma)],
    })
}

fn isometric(points: &[(f64, Option<f64>, f64)]) -> Section {
    let at = |p: &(f64, Option<f64>, f64)| [p.0, p.1.unwrap_or(0.0), p.2];
    Section::Isometric(Isometric {
        title: "S".into(),
        note: None,
        unit: "mm".into(),
        volume_min: [0.0; 3],
        volume_max: [1.0; 3],
        points: points.iter().map(|p| IsoPoint { name: "s".into(), at: at(p) }).collect(),
        lines: vec![],
    })
}

fn bars(points: &[(f64, Option<f64>, f64)]) -> Section {
    Section::Bars(Bars {
        title: "S".into(),
        note: None,
        value: axis(),
        decimals: 3,
        bars: points.iter().map(|p| Bar { name: "n".into(), value: p.1 }).collect(),
    })
}

/// The page if it is drawn; any refusal must name the section.
fn page_or_named_refusal(section: Section) -> Option<String> {
    let report = Report { sections: vec![section], ..Report::default() };
    match report.html() {
        Ok(html) => Some(html),
        Err(error) => {
            assert!(error.to_string().contains("section 'S'"), "{error}");
            None
        }
    }
}

/// Attributes of the drawing's elements.
fn attributes(html: &str) -> impl Iterator<Item = &str> {
    let svg = html.split_once("<svg").map_or("", |(_, rest)| rest);
    svg.split('<').filter_map(|tag| tag.split('>').next())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn drawings_are_finite_or_refused(points in vec((finite(), proptest::option::of(finite()), finite()), 0..12)) {
        let sections = [
            line_plot(&points, CurveStyle::Line(0)),
            line_plot(&points, CurveStyle::Points(200)),
            map(&points),
            comparison(&points),
            histogram(&points),
            isometric(&points),
            bars(&points),
        ];
        for html in sections.into_iter().filter_map(page_or_named_refusal) {
            prop_assert!(!attributes(&html).any(|a| a.contains("NaN") || a.contains("inf")));
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_always_refused(bad in INFINITE | QUIET_NAN, at in 0..3_usize) {
        let mut points = vec![(1.0, Some(2.0), 3.0); 3];
        points[at].0 = bad;
        for section in [line_plot(&points, CurveStyle::Line(1)), map(&points), isometric(&points)] {
            let refused = Report { sections: vec![section], ..Report::default() }.html();
            let named = matches!(refused, Err(ReportError::NotFinite { .. }));
            prop_assert!(named);
        }
    }

    #[test]
    fn everyday_numbers_are_always_drawn(points in vec((0.0..1e4_f64, Just(Some(1.0)), -50.0..50.0_f64), 2..40)) {
        for section in [line_plot(&points, CurveStyle::Line(1)), map(&points), comparison(&points), histogram(&points)] {
            prop_assert!(page_or_named_refusal(section).is_some());
        }
    }
}
