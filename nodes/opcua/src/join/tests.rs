//! Evidence for joining: what is of one instant is joined, and nothing else.

use super::*;
use proptest::prelude::*;

const MS: i64 = 1_000_000;

fn at(axis: usize, ms: i64, value: f64) -> (usize, AxisValue) {
    (axis, AxisValue { value: Ok(value), source_ns: Some(ms * MS), is_after_loss: false })
}

fn bad(axis: usize, ms: i64) -> (usize, AxisValue) {
    let value = Err(format!("{}: BadSensorFailure", NAMES[axis]));
    (axis, AxisValue { value, source_ns: Some(ms * MS), is_after_loss: false })
}

fn told(axes: Vec<(usize, AxisValue)>) -> Told {
    Told { arrived_ns: 0, answer: None, axes }
}

fn answer(ms: i64, axes: Vec<(usize, AxisValue)>) -> Told {
    Told { arrived_ns: ms * MS + 7, answer: Some(Some(ms * MS)), axes }
}

fn samples(joined: &[Joined]) -> Vec<(i64, [f64; 3])> {
    let sample = |one: &Joined| match one {
        Joined::Sample { at_ns, values } => Some((at_ns / MS, *values)),
        Joined::Refused(_) => None,
    };
    joined.iter().filter_map(sample).collect()
}

fn refusals(joined: &[Joined]) -> Vec<&str> {
    fn words(one: &Joined) -> Option<&str> {
        match one {
            Joined::Refused(words) => Some(words.as_str()),
            Joined::Sample { .. } => None,
        }
    }
    joined.iter().filter_map(words).collect()
}

fn source(apart_ms: i64) -> Joiner {
    let mut joiner = Joiner::new(JoinBy::Source { apart_ns: apart_ms * MS });
    assert_eq!(
        joiner.take(told((0..3).map(|axis| at(axis, 0, 9.0)).collect())),
        [],
        "how things stood makes no sample"
    );
    joiner
}

fn held(still_ms: i64) -> Joiner {
    let mut joiner = Joiner::new(JoinBy::Held { apart_ns: 0, still_ns: still_ms * MS });
    assert_eq!(joiner.take(told(vec![at(0, 0, 1.0), at(1, -500, 2.0), at(2, -90, 3.0)])), []);
    joiner
}

#[test]
fn equal_source_timestamps_are_joined_whatever_message_they_come_in() {
    let mut joiner = source(0);
    assert_eq!(joiner.take(told(vec![at(0, 10, 1.0), at(0, 20, 1.5), at(1, 10, 2.0)])), []);
    let joined = joiner.take(told(vec![at(1, 20, 2.5), at(2, 10, 3.0), at(2, 20, 3.5)]));
    assert_eq!(samples(&joined), [(10, [1.0, 2.0, 3.0]), (20, [1.5, 2.5, 3.5])]);
    assert_eq!(refusals(&joined), [""; 0]);
}

#[test]
fn a_value_that_is_told_again_with_its_instant_is_no_second_one() {
    let mut joiner = source(0);
    assert_eq!(joiner.take(told(vec![at(0, 10, 1.0)])), []);
    let all = |ms| told((0..3).map(|axis| at(axis, ms, 1.0)).collect());
    for ms in [10, 20] {
        let joined = joiner.take(all(ms));
        assert_eq!((samples(&joined).len(), refusals(&joined).len()), (1, 0), "{joined:?}");
    }
}

#[test]
fn values_of_different_instants_are_refused_and_not_joined() {
    let mut joiner = source(0);
    let joined = joiner.take(told(vec![at(0, 10, 1.0), at(1, 11, 2.0), at(2, 10, 3.0)]));
    assert_eq!((samples(&joined).len(), refusals(&joined).len()), (0, 2), "x and z of 10 ms have no y: {joined:?}");
    let joined = joiner.take(told(vec![at(0, 20, 1.0), at(1, 20, 2.0), at(2, 20, 3.0)]));
    assert_eq!((samples(&joined).len(), refusals(&joined).len()), (1, 1), "y of 11 ms has no x: {joined:?}");
    let mut joiner = source(2);
    let joined = joiner.take(told(vec![at(0, 10, 1.0), at(1, 11, 2.0), at(2, 12, 3.0)]));
    assert_eq!(samples(&joined), [(12, [1.0, 2.0, 3.0])], "as far apart as allowed, with the latest as its stamp");
}

#[test]
fn a_bad_value_takes_its_instant_along_and_no_other() {
    let mut joiner = source(0);
    let joined = joiner.take(told(vec![at(0, 10, 1.0), bad(1, 10), at(2, 10, 3.0)]));
    assert_eq!((samples(&joined), refusals(&joined)), (vec![], vec!["y: BadSensorFailure"]));
    let joined = joiner.take(told(vec![at(0, 20, 1.0), at(1, 20, 2.0), at(2, 20, 3.0)]));
    assert_eq!(samples(&joined).len(), 1);
    let mut joiner = held(30);
    joiner.take(told(vec![bad(1, 10)]));
    joiner.take(told(vec![at(0, 100, 1.0)]));
    let joined = joiner.take(told(vec![]));
    assert_eq!(
        (samples(&joined), refusals(&joined)),
        (vec![], vec!["y: BadSensorFailure"]),
        "it holds until there is a good one"
    );
}

#[test]
fn what_was_given_before_a_session_ended_is_not_given_again() {
    let mut joiner = source(0);
    let all = |ms| told((0..3).map(|axis| at(axis, ms, 1.0)).collect());
    assert_eq!(samples(&joiner.take(all(10))).len(), 1);
    joiner.begin();
    assert_eq!(joiner.take(all(10)), [], "the server tells how things stand");
    assert_eq!(joiner.take(all(10)), []);
    assert_eq!(samples(&joiner.take(all(20))).len(), 1);
    let back = joiner.take(all(15));
    assert_eq!((samples(&back).len(), refusals(&back).len()), (0, 3), "{back:?}");
}

#[test]
fn an_axis_that_stands_still_holds_once_nothing_of_the_instant_is_under_way() {
    let mut joiner = held(30);
    assert_eq!(joiner.take(told(vec![at(0, 50, 1.5)])), [], "y of that instant may still come");
    assert_eq!(samples(&joiner.take(told(vec![]))), [(50, [1.5, 2.0, 3.0])]);
    let all = joiner.take(told(vec![at(0, 60, 1.6), at(1, 60, 2.1), at(2, 60, 3.1)]));
    assert_eq!(samples(&all), [(60, [1.6, 2.1, 3.1])], "all of them: nothing can be under way");
}

#[test]
fn an_axis_that_moves_is_joined_at_its_own_instants_alone() {
    let mut joiner = held(30);
    joiner.take(told(vec![at(0, 50, 1.5), at(1, 53, 2.5)]));
    let joined = joiner.take(told(vec![]));
    assert_eq!(samples(&joined), []);
    assert_eq!(refusals(&joined).len(), 2, "y begins to move 3 ms later, and x has just moved: {joined:?}");
    joiner.take(told(vec![at(2, 90, 3.5)]));
    assert_eq!(samples(&joiner.take(told(vec![]))), [(90, [1.5, 2.5, 3.5])], "both stand for 37 ms and more");
}

#[test]
fn what_comes_too_late_or_after_a_loss_is_said() {
    let mut joiner = held(30);
    joiner.take(told(vec![at(0, 50, 1.5)]));
    joiner.take(told(vec![]));
    let joined = joiner.take(told(vec![at(1, 49, 2.5)]));
    assert!(refusals(&joined)[0].contains("came after"), "{joined:?}");
    let (axis, mut value) = at(0, 100, 1.7);
    value.is_after_loss = true;
    let joined = joiner.take(told(vec![(axis, value)]));
    assert!(refusals(&joined)[0].contains("threw away"), "{joined:?}");
}

#[test]
fn answers_have_the_time_of_the_answer_while_all_axes_stand() {
    let mut joiner = Joiner::new(JoinBy::Held { apart_ns: 0, still_ns: 30 * MS });
    let axes = vec![at(0, 0, 1.0), at(1, -500, 2.0), at(2, -90, 3.0)];
    for ms in [60, 89] {
        assert_eq!(joiner.take(answer(ms, axes.clone())), [], "whether they stand is seen after 30 ms");
    }
    assert_eq!(samples(&joiner.take(answer(90, axes.clone()))), [(90, [1.0, 2.0, 3.0])]);
    assert_eq!(samples(&joiner.take(answer(110, axes.clone()))), [(110, [1.0, 2.0, 3.0])]);
    let moved = vec![at(0, 118, 1.5), at(1, -500, 2.0), at(2, -90, 3.0)];
    assert_eq!(samples(&joiner.take(answer(120, moved.clone()))), [(118, [1.5, 2.0, 3.0])]);
    assert_eq!(joiner.take(answer(125, moved)), [], "the same values are no new reading");
    let apart = vec![at(0, 128, 1.6), at(1, 126, 2.1), at(2, -90, 3.0)];
    let joined = joiner.take(answer(130, apart));
    assert_eq!((samples(&joined).len(), refusals(&joined).len()), (0, 1), "{joined:?}");
}

/// 100 mm/s, axes of different cycles, and a controller's clock half a second behind its server's: by both clocks each value was
/// older than `still_ms`, and 9 mm of way became one pose.
#[test]
fn regress_a_clock_behind_the_servers_makes_no_axis_stand() {
    let mut joiner = Joiner::new(JoinBy::Held { apart_ns: 0, still_ns: 300 * MS });
    let mut refused = 0;
    for answered in (0..3000).step_by(100) {
        let source = answered - 500;
        let axes = vec![at(0, source, 0.1), at(1, source - 90, 0.2), at(2, source - 90, 0.3)];
        let joined = joiner.take(answer(answered, axes));
        assert_eq!(samples(&joined), [], "90 ms apart, and it moves");
        refused += refusals(&joined).len();
    }
    assert_eq!(refused, 29, "each but the first");
    // It stands, and is given once that was seen for 300 ms by the server's clock alone.
    let stands = vec![at(0, 2500, 0.1), at(1, 2410, 0.2), at(2, 2410, 0.3)];
    let given: Vec<i64> = (3000..=3500)
        .step_by(100)
        .flat_map(|ms| samples(&joiner.take(answer(ms, stands.clone()))))
        .map(|(at, _)| at)
        .collect();
    assert_eq!(given, [3300, 3400, 3500]);
    // What moves on by the clock that is behind is said to be left out, and not joined by both.
    let moved = vec![at(0, 3100, 0.4), at(1, 3100, 0.5), at(2, 3100, 0.6)];
    let joined = joiner.take(answer(3600, moved.clone()));
    assert!(samples(&joined).is_empty() && refusals(&joined)[0].contains("0.400 s before"), "{joined:?}");
    assert_eq!(joiner.take(answer(3700, moved)), [], "and once");
}

#[test]
fn without_timestamps_only_answers_are_joined_and_by_their_arrival() {
    let bare = |axis: usize| (axis, AxisValue { value: Ok(1.0), source_ns: None, is_after_loss: false });
    for by in [JoinBy::Source { apart_ns: MS }, JoinBy::Held { apart_ns: MS, still_ns: 9 * MS }] {
        let joined = Joiner::new(by).take(answer(10, (0..3).map(bare).collect()));
        assert_eq!(samples(&joined), []);
        assert!(refusals(&joined)[0].contains("no source timestamp"), "{joined:?}");
    }
    let mut joiner = Joiner::new(JoinBy::Arrival);
    let joined = joiner.take(answer(10, (0..3).map(bare).collect()));
    assert_eq!(joined, [Joined::Sample { at_ns: 10 * MS + 7, values: [1.0; 3] }]);
    let joined = joiner.take(answer(20, (0..2).map(bare).collect()));
    assert_eq!(refusals(&joined), ["the answer has no z"]);
}

/// Whether a session begins; the time of an answer (ms); axes with their time (ms), and whether they are good.
type AnyTold = (bool, Option<i64>, Vec<(usize, Option<i64>, bool)>);

/// Any values, in any order, of any session.
fn any_told() -> impl Strategy<Value = AnyTold> {
    let one = (0..3_usize, proptest::option::weighted(0.9, 0..40_i64), proptest::bool::weighted(0.9));
    (proptest::bool::weighted(0.05), proptest::option::of(0..40_i64), proptest::collection::vec(one, 0..6))
}

proptest! {
    /// Whatever comes: stamps rise, and by source each sample has values that were told at its stamp (the value is the instant).
    #[test]
    fn stamps_rise_and_samples_are_of_one_instant(messages in proptest::collection::vec(any_told(), 0..40), rule in 0..3) {
        let by = match rule {
            0 => JoinBy::Source { apart_ns: 0 },
            1 => JoinBy::Held { apart_ns: 0, still_ns: 5 * MS },
            _ => JoinBy::Arrival,
        };
        let (mut joiner, mut last) = (Joiner::new(by), None);
        // What answers of this session said, and when.
        let mut answers: Vec<(i64, Vec<f64>)> = Vec::new();
        for (is_new, answered, axes) in messages {
            if is_new {
                joiner.begin();
                answers.clear();
            }
            let first = |axis| axes.iter().find(|(number, ..)| *number == axis).and_then(|(_, ms, _)| Some((*ms)? as f64));
            if let (Some(ms), Some(told)) = (answered, (0..3).map(first).collect()) {
                answers.push((ms, told));
            }
            let value = |(axis, ms, is_good): (usize, Option<i64>, bool)| {
                let source_ns = ms.map(|ms| ms * MS);
                let value = if is_good { Ok(ms.unwrap_or(0) as f64) } else { Err("bad".to_owned()) };
                (axis, AxisValue { value, source_ns, is_after_loss: false })
            };
            let axes = axes.into_iter().map(value).collect();
            let told = Told { arrived_ns: last.unwrap_or(0) + 1, answer: answered.map(|ms| Some(ms * MS)), axes };
            for one in joiner.take(told) {
                let Joined::Sample { at_ns, values } = one else { continue };
                prop_assert!(last.is_none_or(|last| at_ns > last));
                last = Some(at_ns);
                if rule == 0 {
                    prop_assert!(values.iter().all(|value| *value == (at_ns / MS) as f64));
                }
                if rule == 1 {
                    let is_whole = |value: &f64| *value == (at_ns / MS) as f64 || (at_ns / MS) as f64 - value >= 5.0;
                    let has_stood = answers.iter().any(|(ms, told)| *told == values && at_ns / MS - ms >= 5);
                    prop_assert!(values.iter().all(is_whole) || has_stood, "{values:?} at {at_ns}");
                }
            }
        }
    }
}
