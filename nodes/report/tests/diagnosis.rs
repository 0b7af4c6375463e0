//! The page of a diagnosis: once what is one, in words, with digits that the numbers beside allow, and its limits in few lines.

use abbe_report::diagnosis::*;
use std::collections::BTreeMap;

fn group(name: &str, mean_um: f64) -> Group {
    Group { name: name.into(), count: 543, mean_um: Some(mean_um), mean_square: Some(0.847_2) }
}

fn clean() -> Record {
    let state = Detection {
        words: "The residuals are as large as declared (χ² per degree of freedom 0.915).".into(),
        chi2_per_dof: Some(0.915),
        p_declared: Some(4.99e-33),
        groups: vec![group("station S1", -0.000_001_9), group("dir_x +1", 0.369)],
        used: 1,
        ..Detection::default()
    };
    Record {
        consistent_with_noise: true,
        detection: Both { before: state.clone(), after: state },
        not_identifiable: vec![NotIdentifiable {
            name: "scale_growth".into(),
            title: "growth of a scale".into(),
            shape: BTreeMap::from([("axis".to_owned(), "x".into()), ("tau_s".to_owned(), 1984.0.into())]),
            alias_share: Some(0.998_5),
            aliased_with: vec!["EXX".into()],
            because: None,
            decided_by: "repeat some lines".into(),
        }],
        ..Record::default()
    }
}

fn effect(title: &str) -> Effect {
    Effect {
        name: "empirical".into(),
        title: title.into(),
        kind: "empirical".into(),
        formula: "e = sum c_ij P_i(p) P_j(q)".into(),
        shape: BTreeMap::new(),
        covariates: Vec::new(),
        p_value: Some(1e-9),
        evidence: None,
        alias_share: Some(0.554),
        parameters: Vec::new(),
        held_out_gain_um: None,
        placebo: Placebo {
            gain: None,
            unit: String::new(),
            draws: 0,
            median: None,
            quantile_95: None,
            share_as_good: None,
        },
        cannot_be_told_from: Vec::new(),
        averaged_with: Vec::new(),
        corrects: true,
        size_um: None,
        predicts: Predicts::default(),
    }
}

fn page(record: Record) -> String {
    let residuals = Residuals {
        label: "range residual".into(),
        before_um: vec![0.1, -0.2],
        after_um: vec![0.1, -0.2],
        groups_label: "station".into(),
        groups: vec!["S1".into()],
        group: vec![0, 0],
        ..Residuals::default()
    };
    let residuals = Some(residuals);
    DiagnosisReport { record, residuals, figures: Vec::new(), identity: Default::default(), next: None }.html().unwrap()
}

/// What is seen of a page: no styles, no script.
fn seen(html: &str) -> &str {
    html.split("<main>").nth(1).unwrap().split("</main>").next().unwrap()
}

/// A campaign in which nothing was found showed every figure twice.
#[test]
fn regress_a_clean_campaign_is_shown_once() {
    let html = page(clean());
    let html = seen(&html);
    assert!(html.contains("Is it noise?") && html.contains("By station, offset and direction"));
    for twice in [">before<", ">after<", "probability before", "mean after", "mean before"] {
        assert!(!html.contains(twice), "{twice}");
    }
    let html = page(Record { effects: vec![effect("product of y_m and temp_arm_c")], ..clean() });
    for twice in [">before<", "probability after", "mean after"] {
        assert!(html.contains(twice), "{twice}");
    }
}

/// A mean of two picometres, and a chance of 4.99e-33.
#[test]
fn regress_numbers_side_by_side_have_digits_of_the_largest_and_chances_a_power() {
    let html = page(clean());
    assert!(html.contains("<td class=\"num\">0.000</td>") && html.contains("<td class=\"num\">0.369</td>"), "{html}");
    assert!(html.contains("below 10⁻³²") && !html.contains("4.99") && !html.contains("chi2"));
}

#[test]
fn regress_names_of_the_program_stay_off_the_page_and_in_the_json() {
    let record = Record { effects: vec![effect("product of y_m and temp_arm_c")], ..clean() };
    let html = page(record.clone());
    let html = seen(&html);
    for words in [
        "product of Y and temp_arm_c",
        "Σ cᵢⱼ Pᵢ(p) Pⱼ(q)",
        "growth of a scale (axis X, time constant 33.1 min)",
        "above 0.99",
        "X approached in +",
    ] {
        assert!(html.contains(words), "{words}: {html}");
    }
    for own in ["scale_growth", "tau_s", "y_m", "dir_x", "c_ij"] {
        assert!(!html.contains(own), "{own}");
    }
    let report =
        DiagnosisReport { record, residuals: None, figures: Vec::new(), identity: Default::default(), next: None };
    assert!(report.json().unwrap().contains("scale_growth"));
}

/// One warning an effect filled the first screen.
#[test]
fn regress_what_limits_several_effects_alike_is_one_warning() {
    let html = page(Record { effects: ["a", "b", "c", "d"].map(effect).to_vec(), ..clean() });
    assert_eq!(html.matches("class=\"callout warning\"").count(), 1);
    assert!(html.contains("surer than its size: 55 % of a; 55 % of b; 55 % of c; 55 % of d."));
}

/// Where the error surely grows at points that are known, the page says by what, and claims no cause where it found none.
#[test]
fn an_error_that_grows_is_said_first_and_with_what_it_grew() {
    let figures = |um: f64| ErrorFigures { verify_rms_um: Some(um), ..ErrorFigures::default() };
    let grown = |effects: Vec<Effect>, gain_um2: (f64, f64)| {
        let verification = Verification {
            file: File { file: "verify.csv".into(), sha256: String::new() },
            points: 400,
            extrapolated: 0,
            covariate_missing: 0,
            gain_interval_um2: Some(gain_um2),
        };
        let (before, after) = (figures(1.28), figures(1.94));
        Record { before, after, effects, verification: Some(verification), ..clean() }.grown()
    };
    let found = grown(vec![effect("backlash")], (-3.0, -1.2)).unwrap();
    assert!(found.contains("from 1.28 to 1.94 µm with what was found"), "{found}");
    let none = grown(Vec::new(), (-3.0, -1.2)).unwrap();
    assert!(none.contains("though no effect is new in it") && !none.contains("what was found"), "{none}");
    // It may be chance.
    assert_eq!(grown(vec![effect("backlash")], (-3.0, 0.2)), None);
}

/// Readings may be described by what corrects nothing; the error that they lose is then none of coordinates.
#[test]
fn regress_a_gain_of_the_readings_is_not_sold_as_one_of_coordinates() {
    let words = |corrects: &[bool]| {
        let effects =
            corrects.iter().map(|corrects| Effect { corrects: *corrects, ..effect("empirical term") }).collect();
        Record { effects, ..clean() }.words()
    };
    assert!(!words(&[true]).contains("error of the readings"));
    assert!(words(&[false]).contains("coordinates gain nothing"), "{}", words(&[false]));
    assert!(words(&[true, false]).contains("gain by what corrects alone"), "{}", words(&[true, false]));
}

/// A stand that had jumped was set aside, and the first sentence said that no effect was missing.
#[test]
fn regress_finer_error_functions_beside_what_was_set_aside_do_not_say_that_nothing_is_missing() {
    let finer = || Record { enriched: true, ..clean() };
    assert!(finer().words().starts_with("No effect is missing."), "{}", finer().words());
    let jump = SetAside {
        name: "stand_jump".into(),
        title: "jump of the stand".into(),
        shape: BTreeMap::new(),
        because: "lines left out are not predicted better beyond chance".into(),
    };
    let words = Record { set_aside: vec![jump], ..finer() }.words();
    assert!(words.starts_with("No effect was adopted. Set aside"), "{words}");
    assert!(words.contains("geometry, unless it is what was set aside"), "{words}");
}

/// A sine and a cosine are the model's parameters; a reader asks for the period and the height of the wave.
#[test]
fn regress_a_wave_is_said_with_its_period_and_amplitude() {
    let parameter = |name: &str, value: f64| Parameter {
        name: name.into(),
        value: Some(value),
        unit: "m".into(),
        u: Some(2e-8),
        plausible: Some(2e-5),
        is_plausible: true,
    };
    let wave = Effect {
        kind: "attributed".into(),
        shape: BTreeMap::from([("axis".to_owned(), "x".into()), ("period_m".to_owned(), 0.007_297.into())]),
        parameters: vec![parameter("sine", 1e-6), parameter("cosine", -2e-6)],
        size_um: Some(0.9),
        ..effect("periodic scale error")
    };
    // 2.236 = the root of 1² + 2²; equal uncertainties stay what they are.
    let said = "periodic scale error of X, period 7.30 mm, amplitude 2.236 ± 0.020 µm (k = 1)";
    let words = Record { enriched: true, effects: vec![wave.clone()], ..Record::default() }.words();
    assert!(words.contains(said), "{words}");
    let unlike = Effect { parameters: vec![parameter("bow", 1e-6), parameter("cosine", -2e-6)], ..wave };
    assert_eq!((unlike.amplitude(), unlike.label().as_str()), (None, "periodic scale error of X, period 7.30 mm"));
}

/// "The model lacks: A" where B and C together weigh more than A names a cause that is probably not it.
#[test]
fn regress_the_first_sentence_names_what_is_hardly_less_likely() {
    let other = |sensor: &str, share: f64| Averaged {
        name: "scale_expansion".into(),
        title: "expansion".into(),
        shape: BTreeMap::from([("axis".to_owned(), "x".into()), ("sensor".to_owned(), sensor.into())]),
        share: Some(share),
    };
    let found = Effect {
        shape: other("temp_scale_x_c", 0.0).shape,
        // Weights 1, 0.8, 0.5 and 0.2: their sum is 2.5.
        averaged_with: vec![other("temp_air_c", 0.32), other("temp_granite_c", 0.2), other("temp_ram_c", 0.08)],
        kind: "attributed".into(),
        ..effect("expansion")
    };
    let words = Record { enriched: true, effects: vec![found.clone()], ..Record::default() }.words();
    let said = "The model lacks: expansion of X by temp_scale_x_c (43 %, or expansion of X by temp_air_c 35 %, or expansion of X by \
                temp_granite_c 22 %).";
    assert!(words.starts_with(said), "{words}");
    let sure = Effect { averaged_with: vec![other("temp_air_c", 0.1)], ..found };
    let words = Record { enriched: true, effects: vec![sure], ..Record::default() }.words();
    assert!(words.starts_with("The model lacks: expansion of X by temp_scale_x_c."), "{words}");
}

/// "Cannot be told from" stood below a claim that the first sentence made without a doubt.
#[test]
fn regress_the_answer_says_which_other_causes_explain_as_much_and_which_sizes_are_not_known() {
    let rival =
        |name: &str| Rival { name: name.into(), title: String::new(), shape: BTreeMap::new(), evidence_behind: None };
    let mut scale = Effect { kind: "attributed".into(), ..effect("scale of Y (EYY, straight part)") };
    let described = "smooth in y_m and time_s, degree 3, component y";
    let growth =
        ["growth of a scale with time (y, tau_s 532)", "growth of a scale with time (y, tau_s 681)", described];
    scale.cannot_be_told_from = growth.map(rival).to_vec();
    let considered = |name: &str| Considered {
        name: name.into(),
        kind: "empirical".into(),
        tested: 3,
        p_value: None,
        p_holm: None,
        evidence: None,
        alias_share: None,
    };
    let record = Record { effects: vec![scale.clone()], considered: vec![considered(described)], ..Record::default() };
    let words = record.words();
    assert!(words.contains("These data do not tell scale of Y from growth of a scale with time."), "{words}");
    assert!(!words.contains("do not trust its size"), "{words}");
    scale.alias_share = Some(0.993);
    scale.cannot_be_told_from.clear();
    let words = Record { effects: vec![scale], ..Record::default() }.words();
    assert!(!words.contains("do not tell"), "{words}");
    assert!(words.contains("so do not trust its size: scale of Y (99.3 %)."), "{words}");
}
