//! What the parameters of a fit took for their own of something that acts on the ranges beside them: more covariance for every model of the
//! same machine and campaign, whichever effects it has.
//!
//! Place in the flow: made of the fit that a diagnosis ends with, by whatever finds what no parameter describes; added to the models that
//! are adopted. SI.

use abbe_geometry::effects::Shape;
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
        let places: Vec<Option<usize>> = self.parameters.iter().map(|parameter| parameter.place(model)).collect();
        for (i, a) in places.iter().enumerate() {
            for (j, b) in places.iter().enumerate().take(i + 1) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                covariance[packed(*a, *b)] += self.covariance[(i, j)];
            }
        }
    }
}

/// A parameter of a model, to be found in others of the same machine and campaign.
#[derive(Debug, Clone, PartialEq)]
enum Parameter {
    Geometric(usize),
    /// Effect, shape, and number among its parameters.
    OfEffect(&'static str, Shape, usize),
    /// Number among those of stations.
    OfStation(usize),
}

impl Parameter {
    /// What stands at a place of a model's covariance.
    fn at(model: &MachineModel, place: usize) -> Parameter {
        let mut first = model.layout().len();
        if place < first {
            return Parameter::Geometric(place);
        }
        for fitted in &model.parts().effects {
            let count = fitted.parameters.len();
            if place < first + count {
                return Parameter::OfEffect(fitted.effect.name(), fitted.shape.clone(), place - first);
            }
            first += count;
        }
        Parameter::OfStation(place - first)
    }

    /// Its place in the covariance of a model; `None` where that has no such effect.
    fn place(&self, model: &MachineModel) -> Option<usize> {
        let mut first = model.layout().len();
        let effects = &model.parts().effects;
        match self {
            Parameter::Geometric(place) => Some(*place),
            Parameter::OfStation(number) => Some(model.machine_parameters() + number),
            Parameter::OfEffect(name, shape, number) => effects.iter().find_map(|fitted| {
                let own = first + number;
                first += fitted.parameters.len();
                (fitted.effect.name() == *name && fitted.shape == *shape).then_some(own)
            }),
        }
    }
}
