//! What a motion of the tip may follow in the course of a campaign.
//!
//! Place in the flow: the looks of [`super`], and of [`super::instead`], take their courses here; [`super::cycles`] adds those that return.
//! Each is about its mean over the readings used.

use crate::columns::passed;
use crate::context::Context;
use abbe_geometry::effects::is_derived;
use abbe_identify::TIME;
use abbe_measurement::campaign::Campaign;

/// Half cycles of a course in time.
const HALF_CYCLES: usize = 8;
/// Shares of the campaign in which what comes to rest does so.
const RESTS_IN: [f64; 2] = [0.15, 0.5];

/// What a motion may follow.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Course {
    /// What it is called.
    pub(super) follows: String,
    /// Its parts at all readings, each about its mean over the readings used, with its weight.
    pub(super) parts: Vec<Vec<f64>>,
    /// Courses of this kind of which it is the best.
    pub(super) tried: f64,
    /// Whether it comes back, again and again.
    pub(super) returns: bool,
}

/// What is slow, whatever it is.
pub(super) fn in_course_of_time(campaign: &Campaign, used: &[usize]) -> Course {
    let passed = passed(campaign, used.iter().copied());
    let wave = |halves: usize| {
        let of = |passed: &f64| (std::f64::consts::PI * halves as f64 * passed).cos() / halves as f64;
        about_mean(passed.iter().map(of).collect(), used)
    };
    Course { follows: TIME.to_owned(), parts: (1..=HALF_CYCLES).map(wave).collect(), tried: 1.0, returns: false }
}

/// What goes on evenly, and what comes to rest: in such a share of the campaign all but a third is done.
pub(super) fn steady_courses(campaign: &Campaign, used: &[usize]) -> Vec<Course> {
    let passed = passed(campaign, used.iter().copied());
    let evenly = passed.clone();
    let resting = RESTS_IN.map(|share| passed.iter().map(|passed| -(-passed / share).exp_m1()).collect());
    let of =
        |values| Course { follows: TIME.to_owned(), parts: vec![about_mean(values, used)], tried: 1.0, returns: false };
    std::iter::once(evenly).chain(resting).map(of).collect()
}

/// Courses that are slow, or were logged.
pub(super) fn courses(campaign: &Campaign, context: &Context, used: &[usize]) -> Vec<Course> {
    let of = |follows: &str, parts| Course { follows: follows.to_owned(), parts, tried: 1.0, returns: false };
    let mut all = vec![in_course_of_time(campaign, used)];
    // What is slow, as it was logged: neither the side of approach nor what lags behind another one.
    let slow = context.varying.iter().filter(|name| *name != TIME && !is_derived(name) && !name.starts_with("dir_"));
    for name in slow {
        let Some(column) = campaign.covariates.iter().find(|column| column.name == *name) else { continue };
        let Some(values) = column.values.iter().copied().collect::<Option<Vec<f64>>>() else { continue };
        let values = about_mean(values, used);
        let square = used.iter().map(|k| values[*k].powi(2)).sum::<f64>() / used.len().max(1) as f64;
        if square > 0.0 {
            all.push(of(name, vec![values.into_iter().map(|value| value / square.sqrt()).collect()]));
        }
    }
    all
}

/// Values about their mean over the readings used.
pub(super) fn about_mean(values: Vec<f64>, used: &[usize]) -> Vec<f64> {
    let mean = used.iter().map(|k| values[*k]).sum::<f64>() / used.len().max(1) as f64;
    values.into_iter().map(|value| value - mean).collect()
}
