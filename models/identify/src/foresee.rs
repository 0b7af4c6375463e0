//! The fit that a campaign will give, before a length of it is read.
//!
//! Place in the flow: planning asks here what a plan will reach. A campaign of nominal readings goes in with its stations;
//! lengths play no part, they are put to what a perfect machine would give. What comes out is made by the same rows,
//! priors, observability, solve and covariance as [`crate::identify`]'s, with the smoothness that is believed ([`Belief`]) in
//! place of the one that data choose. SI, machine frame.

use crate::belief::Belief;
use crate::design::{Estimate, Setup};
use crate::error::IdentifyError;
use crate::identified::Identified;
use crate::normal::residuals;
use crate::observability;
use crate::options::{IdentifyOptions, OrderChoice, Progress};
use crate::plausibility;
use crate::solve::{Fit, Settled};
use crate::station_start::StationStart;
use crate::term::{self, EffectTerm};
use crate::unseen_expansion::common_scale;
use abbe_geometry::layout::{Layout, centre_of};
use abbe_geometry::machine::Machine;
use abbe_geometry::unseen_expansion::UnseenExpansions;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;

/// The fit of a planned campaign: its model has the covariance of everything, its coefficients are zero.
///
/// # Errors
/// What [`crate::identify_with`] would refuse: too few readings or stations, stations that cannot be placed, unknowns that the
/// plan does not tell.
pub fn foresee(
    machine: &Machine,
    instrument: RangeUncertainty,
    (campaign, stations): (&Campaign, &[StationStart]),
    terms: &[EffectTerm],
    belief: &Belief,
    options: &IdentifyOptions,
) -> Result<Identified, IdentifyError> {
    term::check(terms, campaign)?;
    let layout = Layout::new(machine, centre_of(campaign.readings.iter().map(|r| r.offset_m)))?;
    let setup = Setup { machine, layout: &layout, instrument, terms };
    let predicted = as_predicted(setup, campaign, stations);
    plausibility::check_readings(machine, &predicted)?;
    plausibility::place_stations(&predicted, options.absolute_range)?;
    let observe: &mut dyn FnMut(Progress) -> bool = &mut |_| true;
    let mut fit = Fit::new(setup, &predicted, stations, options, observe);
    if options.order == OrderChoice::Evidence {
        fit.smoothness = belief.smoothness(&layout);
        fit.smoothness.priors = setup.priors_with(stations.len(), options.absolute_range);
    }
    if predicted.readings.len() < fit.free.len() {
        return Err(IdentifyError::TooFewReadings { readings: predicted.readings.len(), unknowns: fit.free.len() });
    }
    fit.order_chosen = true;
    fit.passes = 1;
    let linear = fit.linearise(vec![1.0; predicted.readings.len()]);
    let seen = observability::check(&fit.estimate(), &predicted, &linear.normal, options.absolute_range)?;
    fit.observability = Some(seen);
    let mut solution = fit.solve(&linear, false).map_err(|_| IdentifyError::Singular)?;
    // Lengths without noise say nothing of it: it is what the instrument declares.
    solution.noise_factor = 1.0;
    let residuals = residuals(&fit.estimate());
    let settled = Settled { solution, residuals, weights: linear.weights, scale: 1.0, largest_step: 0.0 };
    let fit = fit.finish(settled)?;
    let absorbed = common_scale(&fit, instrument, &predicted).into_iter().collect();
    let unseen = UnseenExpansions { absorbed, ..UnseenExpansions::default() };
    Ok(Identified { model: fit.model.with_unseen_expansions(unseen)?, ..fit })
}

/// The campaign with the lengths that a perfect machine would give.
fn as_predicted(setup: Setup, campaign: &Campaign, stations: &[StationStart]) -> Campaign {
    let mut parameters = vec![0.0; setup.machine_parameters()];
    for station in stations {
        parameters.extend(station.position_m.iter().chain([&station.dead_path_m]));
    }
    let estimate = Estimate::new(setup, campaign, &parameters);
    let mut predicted = campaign.clone();
    for (reading, (residual_m, _)) in predicted.readings.iter_mut().zip(residuals(&estimate)) {
        reading.length_m -= residual_m;
    }
    predicted
}
