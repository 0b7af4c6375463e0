//! One reading as one row: residual and sparse partial derivatives.
//!
//! Place in the flow: [`crate::normal`] sums the rows. The row holds the partials of the predicted length by geometric
//! coefficients, squareness, turn of the ram, effects and this reading's station; a station touches only its own rows.

use crate::options::U_ABSOLUTE_ZERO_M;
use crate::term::{CampaignRow, EffectTerm};
use abbe_geometry::between_nodes::BetweenNodes;
use abbe_geometry::chain::ChainPoint;
use abbe_geometry::effects::Ray;
use abbe_geometry::layout::{Layout, Locals, ModelPoint};
use abbe_geometry::machine::Machine;
use abbe_geometry::{ErrorId, Vector3};
use abbe_measurement::campaign::{Campaign, RangeReading};
use abbe_measurement::instrument::RangeUncertainty;

/// Parameters of a station: x, y, z, dead path.
pub const STATION_PARAMETERS: usize = 4;

/// Most segments of a row: eighteen errors, squareness with the turn of the ram, effects, station.
const MAX_SEGMENTS: usize = 21;

/// Residual (m) and partials of one reading.
#[derive(Debug, Clone)]
pub(crate) struct Row {
    /// Measured minus predicted length (m).
    pub(crate) residual_m: f64,
    /// Line of sight.
    pub(crate) ray: Ray,
    segments: [(u32, u32); MAX_SEGMENTS],
    segment_count: usize,
    values: Vec<f64>,
}

impl Row {
    pub(crate) fn new() -> Row {
        let ray = Ray { direction: Vector3::zeros(), range_m: 0.0 };
        Row { residual_m: 0.0, ray, segments: [(0, 0); MAX_SEGMENTS], segment_count: 0, values: Vec::new() }
    }

    fn push(&mut self, first: usize, values: impl Iterator<Item = f64>) {
        let before = self.values.len();
        self.values.extend(values);
        self.segments[self.segment_count] = (first as u32, (self.values.len() - before) as u32);
        self.segment_count += 1;
    }

    /// Runs of neighbouring parameters in ascending order: index of the first, and the partials.
    pub(crate) fn segments(&self) -> impl Iterator<Item = (usize, &[f64])> + Clone {
        let mut from = 0;
        self.segments[..self.segment_count].iter().map(move |(first, len)| {
            let values = &self.values[from..from + *len as usize];
            from += *len as usize;
            (*first as usize, values)
        })
    }

    /// Partials of the parameters that have a column, with it; see [`places`].
    pub(crate) fn entries(&self, place: &[Option<usize>]) -> impl Iterator<Item = (usize, f64)> {
        let entries = self.segments().flat_map(|(first, values)| (first..).zip(values));
        entries.filter_map(|(parameter, value)| Some((place[parameter]?, *value)))
    }
}

/// Column of each of `count` parameters where these are the columns; `None` for the others.
pub(crate) fn places(columns: &[usize], count: usize) -> Vec<Option<usize>> {
    let mut place = vec![None; count];
    columns.iter().enumerate().for_each(|(column, parameter)| place[*parameter] = Some(column));
    place
}

/// What is known before a campaign: the machine and its instrument.
#[derive(Clone, Copy)]
pub(crate) struct Setup<'a> {
    pub(crate) machine: &'a Machine,
    pub(crate) layout: &'a Layout,
    pub(crate) instrument: RangeUncertainty,
    pub(crate) terms: &'a [EffectTerm],
}

impl Setup<'_> {
    /// Number of parameters before those of the stations: geometry and effects.
    pub(crate) fn machine_parameters(&self) -> usize {
        self.layout.len() + self.terms.iter().map(EffectTerm::len).sum::<usize>()
    }

    /// Parameters with a prior about zero, and its standard deviation: the turn of the ram, which no plan need tell, and
    /// effects.
    pub(crate) fn priors(&self) -> Vec<(usize, f64)> {
        let of_effects = self.terms.iter().flat_map(EffectTerm::priors);
        let of_effects = of_effects.enumerate().map(|(k, size)| (self.layout.len() + k, size));
        self.layout.ram_turn().zip(self.machine.u_ram_turn_rad).chain(of_effects).collect()
    }

    /// The same with the dead paths of so many stations, where the instrument says that they are zero.
    pub(crate) fn priors_with(&self, stations: usize, is_absolute: bool) -> Vec<(usize, f64)> {
        let mut priors = self.priors();
        let last_of = |k: usize| self.machine_parameters() + STATION_PARAMETERS * (k + 1) - 1;
        let told = if is_absolute { 0..stations } else { 0..0 };
        priors.extend(told.map(|k| (last_of(k), U_ABSOLUTE_ZERO_M)));
        priors
    }

    /// Standard uncertainty of one range: the instrument's, and the machine's repeatability along the sight (m).
    pub(crate) fn u_m(&self, ray: &Ray) -> f64 {
        self.instrument.with_repeatability_m(ray.range_m, &ray.direction, self.machine.repeatability_m)
    }
}

/// The current estimate that rows are linearised at.
pub(crate) struct Estimate<'a> {
    pub(crate) setup: Setup<'a>,
    pub(crate) campaign: &'a Campaign,
    /// Geometric parameters, effects, then x, y, z, dead path of each station.
    pub(crate) parameters: &'a [f64],
    /// Basis functions at each reading, where passes over them share them.
    locals: &'a [Locals],
}

impl<'a> Estimate<'a> {
    pub(crate) fn new(setup: Setup<'a>, campaign: &'a Campaign, parameters: &'a [f64]) -> Estimate<'a> {
        Estimate { setup, campaign, parameters, locals: &[] }
    }

    /// With the basis functions at each reading; none where they are to be found again.
    pub(crate) fn sharing(self, locals: &'a [Locals]) -> Estimate<'a> {
        Estimate { locals, ..self }
    }

    /// The point of a reading, which the campaign need not hold.
    fn point(&self, reading: &RangeReading, index: Option<usize>) -> ModelPoint {
        let Setup { machine, layout, .. } = self.setup;
        let locals = match index.and_then(|index| self.locals.get(index)) {
            Some(shared) => Locals::from_slice(shared),
            None => layout.locals(reading.reading_m),
        };
        layout.point_from(machine, self.parameters, (reading.reading_m, reading.offset_m), locals)
    }

    /// Where the tip is at one of the campaign's readings (m).
    fn position_m(&self, index: usize) -> Vector3<f64> {
        let Setup { machine, layout, .. } = self.setup;
        let reading = &self.campaign.readings[index];
        let at = (reading.reading_m, reading.offset_m);
        match self.locals.get(index) {
            Some(shared) => layout.position_from_m(machine, self.parameters, at, shared),
            None => layout.position_m(machine, self.parameters, reading.reading_m, reading.offset_m),
        }
    }

    /// Residual (m) and line of sight of one of the campaign's readings, without partials.
    pub(crate) fn residual(&self, index: usize) -> (f64, Ray) {
        let (setup, reading) = (&self.setup, &self.campaign.readings[index]);
        if setup.terms.is_empty() {
            return self.residual_of(reading, &self.position_m(index));
        }
        let point = self.point(reading, Some(index));
        let (residual_m, ray) = self.residual_of(reading, &point.chain.position_m);
        let columns = self.effect_columns(index, ray, &point.chain);
        (residual_m - self.effects_m(&columns), ray)
    }

    /// Fills `row` for one of the campaign's readings, and gives its point.
    pub(crate) fn row(&self, index: usize, row: &mut Row) -> ModelPoint {
        self.fill(&self.campaign.readings[index], Some(index), row)
    }

    /// Fills `row` for a reading that the campaign need not hold, without its effects.
    pub(crate) fn row_without_effects(&self, reading: &RangeReading, row: &mut Row) {
        self.fill(reading, None, row);
    }

    /// Calls `visit(departure, partial)` for the length's partial by each departure between nodes at a reading, given its
    /// line of sight and point.
    pub(crate) fn visit_departures(
        &self,
        index: usize,
        (between_nodes, ray, point): (&BetweenNodes, &Ray, &ModelPoint),
        mut visit: impl FnMut(usize, f64),
    ) {
        let reading = &self.campaign.readings[index];
        for id in ErrorId::all() {
            if let Some((departure, shape)) = between_nodes.at(id, reading.reading_m[id.axis().index()]) {
                visit(departure, shape * ray.direction.dot(&point.chain.by_error[id.index()]));
            }
        }
    }

    fn fill(&self, reading: &RangeReading, index: Option<usize>, row: &mut Row) -> ModelPoint {
        row.values.clear();
        row.segment_count = 0;
        let setup = &self.setup;
        let point = self.point(reading, index);
        let (residual_m, ray) = self.residual_of(reading, &point.chain.position_m);
        row.residual_m = residual_m;
        row.ray = ray;
        setup.layout.visit_errors(&point, |index, partial, values| {
            let along = ray.direction.dot(partial);
            row.push(index, values.iter().map(|value| value * along));
        });
        let angles = point.chain.by_squareness.iter().chain(&point.by_ram_turn);
        row.push(setup.layout.squareness().start, angles.map(|column| ray.direction.dot(column)));
        if let Some(index) = index.filter(|_| !setup.terms.is_empty()) {
            let columns = self.effect_columns(index, ray, &point.chain);
            row.residual_m -= self.effects_m(&columns);
            row.push(setup.layout.len(), columns.into_iter());
        }
        row.push(self.first_of_station(reading), ray.direction.iter().map(|u| -u).chain([-1.0]));
        point
    }

    fn residual_of(&self, reading: &RangeReading, point_m: &Vector3<f64>) -> (f64, Ray) {
        let first = self.first_of_station(reading);
        let station = &self.parameters[first..first + 4];
        let station_m = Vector3::new(station[0], station[1], station[2]);
        let ray = Ray::between(&station_m, point_m);
        (reading.length_m - (ray.range_m - station[3]), ray)
    }

    /// Partials of the length by the effects' parameters; covariates were checked before.
    fn effect_columns(&self, index: usize, ray: Ray, chain: &ChainPoint) -> Vec<f64> {
        let row = CampaignRow { campaign: self.campaign, reading: index };
        let mut columns = vec![0.0; self.setup.terms.iter().map(EffectTerm::len).sum()];
        let mut rest = columns.as_mut_slice();
        for term in self.setup.terms {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(term.len());
            if row.add_columns(term.effect.as_ref(), ray, &chain.by_error, own).is_err() {
                own.fill(0.0);
            }
            rest = others;
        }
        columns
    }

    /// What the effects add to the length (m).
    fn effects_m(&self, columns: &[f64]) -> f64 {
        let values = &self.parameters[self.setup.layout.len()..];
        columns.iter().zip(values).map(|(column, value)| column * value).sum()
    }

    fn first_of_station(&self, reading: &RangeReading) -> usize {
        self.setup.machine_parameters() + 4 * reading.station as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_geometry::Axis;
    use abbe_geometry::effects::Shape;
    use abbe_geometry::error_function::FunctionKind;
    use abbe_geometry::machine::{Joint, Side, Squareness};
    use abbe_geometry::rotation::RotationForm;
    use abbe_measurement::campaign::Covariate;

    /// A chain given from the workpiece to the tool.
    fn machine(chain: [(Axis, Side); 3], rotation: RotationForm) -> Machine {
        let kinds = [
            FunctionKind::Polynomial { degree: 4 },
            FunctionKind::Nodes { count: 5 },
            FunctionKind::BSpline { intervals: 4 },
        ];
        let tilt = |name: &str, tilts, about| Squareness { name: name.to_owned(), tilts, about };
        Machine {
            name: "chain".to_owned(),
            frame_id: "machine".to_owned(),
            joints: chain.map(|(axis, side)| Joint { axis, side }),
            stroke_m: [(-0.1, 0.7), (0.0, 0.6), (-0.3, 0.3)],
            squareness: [tilt("C0Y", Axis::Y, Axis::Z), tilt("B0Z", Axis::Z, Axis::Y), tilt("A0Z", Axis::Z, Axis::X)],
            rotation,
            kinds: std::array::from_fn(|k| Some(kinds[k % 3])),
            repeatability_m: [0.3e-6; 3],
            u_ram_turn_rad: [abbe_geometry::machine::USUAL_RAM_TURN_RAD; 3],
            default_offset_m: None,
        }
    }

    #[test]
    fn partials_of_a_row_agree_with_central_differences_far_from_zero() {
        use Side::{Tool, Workpiece};
        let chains = [
            [(Axis::X, Tool), (Axis::Y, Tool), (Axis::Z, Tool)],
            [(Axis::Y, Tool), (Axis::X, Tool), (Axis::Z, Tool)],
            [(Axis::Y, Workpiece), (Axis::X, Tool), (Axis::Z, Tool)],
            [(Axis::X, Workpiece), (Axis::Y, Workpiece), (Axis::Z, Tool)],
        ];
        for chain in chains {
            for rotation in [RotationForm::Exact, RotationForm::SmallAngle] {
                assert_partials(&machine(chain, rotation));
            }
        }
    }

    /// One effect on an axis with two parameters, one on the tip, one on the range.
    fn terms(machine: &Machine) -> Vec<EffectTerm> {
        let smooth = |acts: &str| {
            let shape = Shape::new().text("acts", acts).number("degree", 2.0);
            shape.text("p", "temp_air_c").number("p_low", 19.0).number("p_high", 24.0)
        };
        let reversal = Shape::new().text("axis", "y").text("over", "y").number("terms", 2.0);
        [("reversal", reversal), ("empirical", smooth("z")), ("empirical", smooth("range"))]
            .map(|(name, shape)| EffectTerm::new(name, shape, machine).unwrap())
            .to_vec()
    }

    fn assert_partials(machine: &Machine) {
        let layout = Layout::new(machine, [0.01, 0.02, -0.05]).unwrap();
        let terms = terms(machine);
        let setup = Setup {
            machine,
            layout: &layout,
            instrument: RangeUncertainty { constant_m: 1e-7, per_metre: 1e-7, common_per_metre: 0.0 },
            terms: &terms,
        };
        // Errors of centimetres and hundredths of a radian, where a Jacobian taken at zero is far off.
        let mut parameters: Vec<f64> = (0..layout.len()).map(|k| 0.02 * (1.7 * k as f64).sin()).collect();
        parameters.extend((0..terms.iter().map(EffectTerm::len).sum()).map(|k| 1e-10 * (2.3 * k as f64).cos()));
        parameters.extend([0.9, -0.4, 0.2, 0.15, -0.7, 1.1, 0.5, 0.3]);
        let reading = RangeReading {
            station: 1,
            line: 0,
            time_s: 0.0,
            reading_m: [0.37, 0.21, -0.13],
            offset_m: [0.05, -0.08, -0.11],
            length_m: 0.4,
        };
        let logged = |name: &str, value| Covariate { name: name.to_owned(), values: vec![Some(value)] };
        let campaign = Campaign {
            stations: ["S1", "S2"].map(str::to_owned).to_vec(),
            lines: vec!["L1".to_owned()],
            readings: vec![reading],
            covariates: vec![logged("dir_y", -1.0), logged("temp_air_c", 22.0)],
        };
        let row_at = |parameters: &[f64]| {
            let mut row = Row::new();
            let estimate = Estimate::new(setup, &campaign, parameters);
            estimate.row(0, &mut row);
            assert_eq!(estimate.residual(0).0, row.residual_m);
            row
        };
        let mut partials = vec![0.0; parameters.len()];
        let row = row_at(&parameters);
        row.segments().for_each(|(first, values)| partials[first..first + values.len()].copy_from_slice(values));
        let step = 1e-6;
        for k in 0..parameters.len() {
            let shifted = |by: f64| {
                let mut shifted = parameters.clone();
                shifted[k] += by;
                // The residual is measured minus predicted: its change is minus the prediction's.
                -row_at(&shifted).residual_m
            };
            let difference = (shifted(step) - shifted(-step)) / (2.0 * step);
            // Rounding 1e-16/1e-6, curvature 1e-12.
            assert!((partials[k] - difference).abs() < 2e-9, "{:?} {k}: {} {difference}", machine.joints, partials[k]);
        }
        // Every error takes part, so that none of the comparisons is of zeros only.
        let touched = ErrorId::all().filter(|id| layout.range(*id).any(|k| partials[k] != 0.0)).count();
        assert_eq!(touched, 18);
        assert!(layout.ram_turn().all(|k| partials[k] != 0.0));
    }
}
