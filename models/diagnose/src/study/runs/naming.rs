//! What each shape of positioning runs is called, with formula, parameters and the measurement that decides.
//!
//! Place in the flow: makes the candidates of the study of runs from their shapes.

use super::shape::{Ranges, Shape};
use crate::explanation::Explanation;
use crate::study::candidate::{Candidate, Goes};
use crate::study::step::DECIDED_BY;
use abbe_geometry::effects::ParameterSpec;

/// Largest error of an axis believed (m).
const PLAUSIBLE_M: f64 = 200e-6;
/// Largest expansion coefficient believed (1/K): aluminium with something on top.
const PLAUSIBLE_PER_K: f64 = 30e-6;

/// The candidate of a shape on one axis.
pub(super) fn named(axis: &str, ranges: &Ranges, shape: &Shape) -> Candidate {
    let (time, key) = if ranges.is_order { ("the order of measurement", "order") } else { ("time", "time_s") };
    let (what, family, kind, covariates, formula): (String, &str, Explanation, Vec<String>, &str) = match shape {
        Shape::Position(1) => {
            ("position, straight".into(), "position", Explanation::Attributed, vec![], "e = p_1 P_1(x)")
        }
        Shape::Position(d) => (
            format!("position, degree {d}"),
            "position",
            Explanation::Attributed,
            vec![],
            "e = sum p_k P_k(x), Legendre",
        ),
        Shape::PositionTable => {
            ("position, target by target".into(), "position", Explanation::Attributed, vec![], "e = table of targets")
        }
        Shape::Lost(0) => (
            "reversal value, constant".into(),
            "lost motion",
            Explanation::Attributed,
            vec![],
            "e = B sign(approach) / 2",
        ),
        Shape::Lost(d) => (
            format!("reversal value, degree {d}"),
            "lost motion",
            Explanation::Attributed,
            vec![],
            "e = B(x) sign(approach) / 2, B(x) = sum B_k P_k(x)",
        ),
        Shape::LostTable => (
            "reversal value, target by target".into(),
            "lost motion",
            Explanation::Attributed,
            vec![],
            "e = B_i sign(approach) / 2",
        ),
        Shape::Cycle(_) => {
            ("drift with the cycle".into(), "drift", Explanation::Empirical, vec!["cycle".into()], "e = d_1 P_1(cycle)")
        }
        Shape::Time(d) => (
            format!("drift with {time}, degree {d}"),
            "drift",
            Explanation::Empirical,
            vec![key.into()],
            "e = sum d_k P_k(t), Legendre",
        ),
        Shape::TimeAndTarget => (
            format!("drift of offset and scale with {time}"),
            "drift",
            Explanation::Empirical,
            vec![key.into()],
            "e = d_1 P_1(t) + d_1 x_1 P_1(t) P_1(x)",
        ),
        Shape::DriftTable => (
            "drift with the cycle, target by target".into(),
            "drift",
            Explanation::Empirical,
            vec!["cycle".into()],
            "e = d_i P_1(cycle)",
        ),
        Shape::LostWithCycle => (
            "reversal value, growing with the cycle".into(),
            "lost motion and cycle",
            Explanation::Empirical,
            vec!["cycle".into()],
            "e = B_1 P_1(cycle) sign(approach) / 2",
        ),
        Shape::LostBy(name) => (
            format!("reversal value by {name}"),
            "lost motion",
            Explanation::Empirical,
            vec![name.clone()],
            "e = B_1 P_1(quantity) sign(approach) / 2",
        ),
        Shape::Step(jump) => (jump.name.clone(), "step", Explanation::Empirical, vec![key.into()], &jump.formula),
        Shape::Creep(tau_s) => (
            format!("warm-up, time constant {}", span(*tau_s, ranges)),
            "drift",
            Explanation::Attributed,
            vec![key.into()],
            "e = growth (1 - exp(-t / tau))",
        ),
        Shape::Growth(tau_s) => (
            format!("warm-up of offset and scale, time constant {}", span(*tau_s, ranges)),
            "drift",
            Explanation::Attributed,
            vec![key.into()],
            "e = (growth + growth x_1 P_1(x)) (1 - exp(-t / tau) - its mean)",
        ),
        Shape::Expansion(sensor) => (
            format!("expansion of the scale by {sensor}"),
            "expansion",
            Explanation::Attributed,
            vec![sensor.clone()],
            "e = alpha (T - 20 C) x + shift (T - 20 C); steel 11-12 µm/(m K)",
        ),
        Shape::Periodic(period_m) => (
            format!("periodic error, period {:.4} mm", period_m * 1e3),
            "periodic",
            Explanation::Attributed,
            vec![],
            "e = s sin(2 pi x / p) + c cos(2 pi x / p)",
        ),
        Shape::Smooth(name, d) => (
            format!("dependence on {name}, degree {d}"),
            name.as_str(),
            Explanation::Empirical,
            vec![name.clone()],
            "e = sum p_k P_k(quantity), Legendre",
        ),
        Shape::ScaleBy(name) => (
            format!("offset and scale by {name}"),
            name.as_str(),
            Explanation::Empirical,
            vec![name.clone()],
            "e = (p_1 + p_1 x_1 P_1(x)) P_1(quantity)",
        ),
    };
    let spec = |(name, unit): (String, &'static str)| {
        ParameterSpec::new(name, unit, if unit == "1/K" { PLAUSIBLE_PER_K } else { PLAUSIBLE_M })
    };
    Candidate {
        name: format!("{what}, axis {}", axis),
        formula: formula.to_owned(),
        kind,
        family: format!("{family}, axis {}", axis),
        covariates,
        parameters: shape.parameters(ranges).into_iter().map(spec).collect(),
        decided_by: decided_by(shape),
        essential: Vec::new(),
        stands_apart: matches!(shape, Shape::Periodic(_)),
        goes: Goes::ByEvidence,
    }
}

/// A time constant in words.
fn span(tau_s: f64, ranges: &Ranges) -> String {
    format!("{tau_s:.0} {}", if ranges.is_order { "approaches" } else { "s" })
}

fn decided_by(shape: &Shape) -> String {
    match shape {
        Shape::Position(_) | Shape::PositionTable | Shape::Periodic(_) => {
            "measure at further targets, between those there are and at irregular steps"
        }
        Shape::Lost(_) | Shape::LostTable => "approach every target from both sides, at two feeds",
        Shape::Cycle(_)
        | Shape::Time(_)
        | Shape::TimeAndTarget
        | Shape::DriftTable
        | Shape::LostWithCycle
        | Shape::Creep(_)
        | Shape::Growth(_) => "log temperatures and times, pause between cycles, and return to one target throughout",
        Shape::Step(_) => DECIDED_BY,
        Shape::Expansion(_) | Shape::Smooth(..) | Shape::LostBy(_) | Shape::ScaleBy(_) => {
            "vary the logged quantities independently of each other, of time and of the target"
        }
    }
    .to_owned()
}
