//! What the parameters of a fit took for their own of something that acts on the ranges beside them: more covariance for every model of the
//! same machine and campaign, whichever effects it has.
//!
//! Place in the flow: made of the fit that a diagnosis ends with, by whatever finds what no parameter describes; added to the models that
//! are adopted. SI.

use abbe_geometry::ErrorId;
use abbe_geometry::effects::Shape;
use abbe_geometry::error_function::Basis;
use abbe_geometry::layout::Layout;
use abbe_geometry::model::{MachineModel, packed};
use abbe_identify::Rows;
use faer::{Mat, Scale};

/// Parameters of a fit, and the covariance of what they took.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Taken {
    parameters: Vec<Parameter>,
    covariance: Mat<f64>,
}

impl Taken {
    /// Of the fit of a model to rows.
    pub(crate) fn new(model: &MachineModel, rows: &Rows, covariance: Mat<f64>) -> Taken {
        Taken { parameters: rows.parameters.iter().map(|place| Parameter::at(model, *place)).collect(), covariance }
    }

    /// A share of it.
    pub(crate) fn scaled(&self, share: f64) -> Taken {
        Taken { parameters: self.parameters.clone(), covariance: Scale(share) * &self.covariance }
    }

    /// Adds it to a packed covariance of this model.
    pub(crate) fn add(&self, model: &MachineModel, covariance: &mut [f64]) {
        let of_parameter = |(k, parameter): (usize, &Parameter)| -> Vec<(usize, usize, f64)> {
            parameter.places(model).into_iter().map(|(place, share)| (k, place, share)).collect()
        };
        let shares: Vec<(usize, usize, f64)> = self.parameters.iter().enumerate().flat_map(of_parameter).collect();
        for (i, a, own) in &shares {
            for (j, b, other) in shares.iter().filter(|(_, b, _)| b <= a) {
                covariance[packed(*a, *b)] += own * other * self.covariance[(*i, *j)];
            }
        }
    }
}

/// A parameter of a model, to be found in others of the same machine and campaign.
#[derive(Debug, Clone, PartialEq)]
enum Parameter {
    /// Function, its basis, and number among its coefficients.
    Coefficient(ErrorId, Basis, usize),
    /// Number among the squareness errors and turns of the ram.
    Frame(usize),
    /// Effect, shape, and number among its parameters.
    Effect(&'static str, Shape, usize),
    /// Number among those of stations.
    Station(usize),
}

impl Parameter {
    /// What stands at a place of a model's covariance.
    fn at(model: &MachineModel, place: usize) -> Parameter {
        let layout = model.layout();
        let mut first = layout.len();
        let of_error = |id: ErrorId| Some((id, *layout.basis(id)?, layout.range(id)));
        if let Some((id, basis, range)) = ErrorId::all().filter_map(of_error).find(|(.., range)| range.contains(&place))
        {
            return Parameter::Coefficient(id, basis, place - range.start);
        }
        if place < first {
            return Parameter::Frame(place - layout.squareness().start);
        }
        for fitted in &model.parts().effects {
            let count = fitted.parameters.len();
            if place < first + count {
                return Parameter::Effect(fitted.effect.name(), fitted.shape.clone(), place - first);
            }
            first += count;
        }
        Parameter::Station(place - first)
    }

    /// Its places in the covariance of a model, each with its share; none where that has no such function or effect.
    fn places(&self, model: &MachineModel) -> Vec<(usize, f64)> {
        let layout = model.layout();
        match self {
            Parameter::Coefficient(id, basis, number) => in_basis(layout, *id, (basis, *number)),
            Parameter::Frame(number) => vec![(layout.squareness().start + number, 1.0)],
            Parameter::Station(number) => vec![(model.machine_parameters() + number, 1.0)],
            Parameter::Effect(name, shape, number) => {
                let mut first = layout.len();
                let place = model.parts().effects.iter().find_map(|fitted| {
                    let own = first + number;
                    first += fitted.parameters.len();
                    (fitted.effect.name() == *name && fitted.shape == *shape).then_some(own)
                });
                place.map(|own| (own, 1.0)).into_iter().collect()
            }
        }
    }
}

/// A coefficient of an error function in a layout whose functions may be coarser or finer: those coefficients that come closest to what
/// it does. What coarser functions cannot do is not in it.
fn in_basis(layout: &Layout, id: ErrorId, (basis, number): (&Basis, usize)) -> Vec<(usize, f64)> {
    let (Some(own), range) = (layout.basis(id), layout.range(id)) else { return Vec::new() };
    if own == basis {
        return vec![(range.start + number, 1.0)];
    }
    let mut alone = vec![0.0; basis.len()];
    alone[number] = 1.0;
    range.zip(own.coefficients_of(|position_m| basis.at(position_m).dot(&alone))).collect()
}
