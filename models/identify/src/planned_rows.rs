//! Rows of readings that nobody has taken: what each would tell of the machine and of its station.
//!
//! Place in the flow: the search of a plan adds and takes out lines by these rows. They are those of the fit ([`crate::design`]),
//! divided by each reading's standard uncertainty, at a machine without errors. SI, machine frame.

use crate::belief::Belief;
use crate::design::{Estimate, Row, STATION_PARAMETERS, Setup};
use crate::error::IdentifyError;
use crate::term::{self, EffectTerm};
use abbe_geometry::layout::Layout;
use abbe_geometry::machine::Machine;
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use faer::Mat;

/// What is known of machine and instrument before a campaign.
#[derive(Debug)]
pub struct PlannedRows<'a> {
    machine: &'a Machine,
    instrument: RangeUncertainty,
    terms: &'a [EffectTerm],
    layout: Layout,
}

/// Whitened partials of the lengths, one row a reading.
#[derive(Debug, Clone)]
pub struct SplitRows {
    /// By geometry and effects.
    pub machine: Mat<f64>,
    /// By x, y, z and dead path of the station.
    pub station: Mat<f64>,
}

impl<'a> PlannedRows<'a> {
    /// Rows of this machine, whose ram turns about this offset (m, ram frame).
    ///
    /// # Errors
    /// A machine whose description is wrong.
    pub fn new(
        machine: &'a Machine,
        instrument: RangeUncertainty,
        terms: &'a [EffectTerm],
        offset_centre_m: [f64; 3],
    ) -> Result<PlannedRows<'a>, IdentifyError> {
        Ok(PlannedRows { machine, instrument, terms, layout: Layout::new(machine, offset_centre_m)? })
    }

    fn setup(&self) -> Setup<'_> {
        Setup { machine: self.machine, layout: &self.layout, instrument: self.instrument, terms: self.terms }
    }

    /// Where each parameter stands.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Number of parameters of geometry and effects.
    pub fn machine_parameters(&self) -> usize {
        self.setup().machine_parameters()
    }

    /// Precision of what is known of them beforehand: smoothness (`None`: the orders are fixed), turn of the ram, effects.
    pub fn precision(&self, belief: Option<&Belief>) -> Mat<f64> {
        let mut smoothness = belief.map(|belief| belief.smoothness(&self.layout)).unwrap_or_default();
        smoothness.priors = self.setup().priors();
        let all: Vec<usize> = (0..self.machine_parameters()).collect();
        smoothness.precision(&all, 1.0).0
    }

    /// Rows of readings that are all from this one station (m).
    ///
    /// # Errors
    /// A covariate that an effect needs and a reading lacks.
    pub fn rows(&self, campaign: &Campaign, station_m: [f64; 3]) -> Result<SplitRows, IdentifyError> {
        term::check(self.terms, campaign)?;
        let own = self.machine_parameters();
        let mut parameters = vec![0.0; own];
        // Whichever of the campaign's stations they are from, it stands here.
        for _ in &campaign.stations {
            parameters.extend(station_m.into_iter().chain([0.0]));
        }
        let estimate = Estimate::new(self.setup(), campaign, &parameters);
        let count = campaign.readings.len();
        let mut rows = SplitRows { machine: Mat::zeros(count, own), station: Mat::zeros(count, STATION_PARAMETERS) };
        let mut row = Row::new();
        for k in 0..count {
            estimate.row(k, &mut row);
            let u_m = estimate.setup.u_m(&row.ray);
            for (first, values) in row.segments() {
                for (j, value) in values.iter().enumerate() {
                    match (first + j).checked_sub(own) {
                        None => rows.machine[(k, first + j)] = value / u_m,
                        Some(of_station) => rows.station[(k, of_station % STATION_PARAMETERS)] = value / u_m,
                    }
                }
            }
        }
        Ok(rows)
    }

    /// Partials of the corrected point by geometry (3 × parameters, m per unit); effects are left out.
    pub fn tip(&self, reading_m: [f64; 3], offset_m: [f64; 3]) -> Mat<f64> {
        let mut tip = Mat::zeros(3, self.machine_parameters());
        let coefficients = vec![0.0; self.layout.len()];
        let point = self.layout.point(self.machine, &coefficients, reading_m, offset_m);
        self.layout.visit_errors(&point, |first, partial, values| {
            for (k, value) in values.iter().enumerate() {
                (0..3).for_each(|d| tip[(d, first + k)] = partial[d] * value);
            }
        });
        let squareness = self.layout.squareness().zip(&point.chain.by_squareness);
        for (k, column) in squareness.chain(self.layout.ram_turn().zip(&point.by_ram_turn)) {
            (0..3).for_each(|d| tip[(d, k)] = column[d]);
        }
        tip
    }
}
