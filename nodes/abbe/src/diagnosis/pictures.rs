//! What the pictures of a campaign's diagnosis show: residuals before and after over the quantities of each effect.
//!
//! Place in the flow: fits of the library in, plain columns for the report out (µm, mm, s). An effect that moves one
//! axis is shown along that axis: the line of sight holds a share of it, and the report divides by that share.

use abbe_diagnose::{DiagnoseError, Diagnosis, Found};
use abbe_geometry::effects::{Acts, Effect, ShapeValue, State};
use abbe_geometry::model::FittedEffect;
use abbe_geometry::{Axis, ErrorId};
use abbe_identify::{CampaignRow, Rows, TIME, with_lagged};
use abbe_measurement::campaign::Campaign;
use abbe_measurement::instrument::RangeUncertainty;
use abbe_report::Axis as Labelled;
use abbe_report::diagnosis::{Residuals, Split, View};

/// Quantities shown for each effect.
const QUANTITIES: usize = 3;

/// Readings used both before and after.
struct Used<'a> {
    campaign: &'a Campaign,
    readings: Vec<usize>,
}

/// Everything that the pictures need; `labels` are the names of the effects found, in their order.
pub(super) fn residuals(
    diagnosis: &Diagnosis,
    instrument: RangeUncertainty,
    campaign: &Campaign,
    labels: &[String],
) -> Result<Residuals, DiagnoseError> {
    let (before, after) = (&diagnosis.before, &diagnosis.after);
    let campaign = &with_lagged(campaign.clone(), &after.model.reads());
    let is_used = |k: &usize| before.weights[*k] > 0.0 && after.weights[*k] > 0.0;
    let used = Used { campaign, readings: (0..campaign.readings.len()).filter(is_used).collect() };
    let pick = |values: &[f64]| used.readings.iter().map(|k| values[*k] * 1e6).collect::<Vec<f64>>();
    let rows = Rows::new(after, instrument, campaign);
    let mut views = Vec::new();
    for (found, label) in diagnosis.found.iter().zip(labels) {
        let effects = &after.model.parts().effects;
        let fitted = effects.iter().find(|f| f.effect.name() == found.name && f.shape == found.shape);
        if let Some(fitted) = fitted {
            views.extend(used.views(&rows, found, fitted, label)?);
        }
    }
    let start_s = campaign.readings.first().map_or(0.0, |r| r.time_s);
    Ok(Residuals {
        label: "range residual".to_owned(),
        before_um: pick(&before.residuals_m),
        after_um: pick(&after.residuals_m),
        time_s: Some(used.readings.iter().map(|k| campaign.readings[*k].time_s - start_s).collect()),
        groups_label: "station".to_owned(),
        groups: campaign.stations.clone(),
        group: used.readings.iter().map(|k| campaign.readings[*k].station as usize).collect(),
        views,
    })
}

impl Used<'_> {
    fn views(
        &self,
        rows: &Rows,
        found: &Found,
        fitted: &FittedEffect,
        label: &str,
    ) -> Result<Vec<View>, DiagnoseError> {
        let mut views = self.over_quantities(rows, found, fitted, label);
        views.push(View {
            effect: label.to_owned(),
            x: Labelled::new("what the effect does to the range", "µm"),
            values: self.contribution_um(rows, fitted)?,
            share: None,
            split: None,
        });
        Ok(views)
    }

    /// What the effect adds to each range read (µm).
    fn contribution_um(&self, rows: &Rows, fitted: &FittedEffect) -> Result<Vec<f64>, DiagnoseError> {
        let columns = rows.columns(fitted.effect.as_ref())?;
        let of = |k: &usize| {
            let sum: f64 = fitted.parameters.iter().enumerate().map(|(j, p)| columns[(*k, j)] * p).sum();
            sum / rows.whitening[*k] * 1e6
        };
        Ok(self.readings.iter().map(of).collect())
    }

    fn over_quantities(&self, rows: &Rows, found: &Found, fitted: &FittedEffect, label: &str) -> Vec<View> {
        let share = self.moved_axis(fitted.effect.as_ref()).map(|axis| {
            let share = |k: &usize| rows.rays[*k].direction[axis.index()];
            (format!("displacement along {}", axis.letter()), self.readings.iter().map(share).collect())
        });
        let view = |(x, values): (Labelled, Vec<f64>), split: Option<Split>| View {
            effect: label.to_owned(),
            x,
            values,
            share: share.clone(),
            split,
        };
        let direction = found.covariates.iter().find(|name| name.starts_with("dir_"));
        if let (Some(direction), Some(position)) = (direction, self.position(found)) {
            return vec![view(position, self.split(direction))];
        }
        if let (Some(ShapeValue::Number(period_m)), Some((_, mm))) =
            (found.shape.0.get("period_m"), self.position(found))
        {
            let x = Labelled::new(format!("position within the period of {:.4} mm", period_m * 1e3), "mm");
            return vec![view((x, mm.iter().map(|mm| mm.rem_euclid(period_m * 1e3)).collect()), None)];
        }
        let quantities = found.covariates.iter().filter_map(|name| self.quantity(name));
        quantities.take(QUANTITIES).map(|quantity| view(quantity, None)).collect()
    }

    /// The one axis along which an effect moves the tip, if it is one and nothing else is moved.
    fn moved_axis(&self, effect: &dyn Effect) -> Option<Axis> {
        let mut along: Option<Axis> = None;
        let mut is_one = true;
        let first = *self.readings.first()?;
        self.state(first, |state| {
            let mut part = |_: usize, acts: Acts, _: f64| {
                let direction = match acts {
                    Acts::Tip(axis) => Some(axis),
                    Acts::Error(id) => Axis::ALL.into_iter().find(|axis| ErrorId::linear(*axis, id.axis()) == id),
                };
                is_one &= direction.is_some() && along.is_none_or(|axis| Some(axis) == direction);
                along = direction;
            };
            effect.motion(state, &mut part).ok()
        })?;
        along.filter(|_| is_one)
    }

    fn state<T>(&self, reading: usize, ask: impl FnOnce(&State) -> Option<T>) -> Option<T> {
        let row = CampaignRow { campaign: self.campaign, reading };
        let r = &self.campaign.readings[reading];
        ask(&State { reading_m: r.reading_m, offset_m: r.offset_m, covariates: &row })
    }

    /// Position of the axis that an effect is over or about, in mm.
    fn position(&self, found: &Found) -> Option<(Labelled, Vec<f64>)> {
        let axis = ["over", "axis"].iter().find_map(|key| match found.shape.0.get(*key) {
            Some(ShapeValue::Text(axis)) => Some(axis),
            _ => None,
        })?;
        self.quantity(&format!("{axis}_m"))
    }

    /// A quantity by name; lengths in mm. `None` where some reading lacks it.
    fn quantity(&self, name: &str) -> Option<(Labelled, Vec<f64>)> {
        let value = |k: &usize| self.state(*k, |state| state.quantity(name).ok());
        let values: Vec<f64> = self.readings.iter().map(value).collect::<Option<_>>()?;
        let positions = ["x_m", "y_m", "z_m", "offset_x_m", "offset_y_m", "offset_z_m"];
        if positions.contains(&name) {
            let label = name.trim_end_matches("_m").replace('_', " ");
            return Some((Labelled::new(label, "mm"), values.iter().map(|m| m * 1e3).collect()));
        }
        let label = if name == TIME { Labelled::new("time", "s") } else { logged(name) };
        Some((label, values))
    }

    /// Readings by the sign of a direction of approach.
    fn split(&self, direction: &str) -> Option<Split> {
        let (_, signs) = self.quantity(direction)?;
        // An axis that did not move tells nothing of its play.
        let of = |sign: &f64| if *sign == 0.0 { None } else { Some(usize::from(*sign > 0.0)) };
        let names = ["approach −", "approach +"].map(str::to_owned).to_vec();
        Some(Split { names, of: signs.iter().map(of).collect() })
    }
}

/// A logged quantity with the unit that its name ends with.
pub(super) fn logged(name: &str) -> Labelled {
    let units = [("_c", "°C"), ("_hpa", "hPa"), ("_pct", "%"), ("_kg", "kg"), ("_mm_s", "mm/s"), ("_deg", "°")];
    let of = |(end, unit): (&str, &str)| Some(Labelled::new(name.strip_suffix(end)?.replace('_', " "), unit));
    units.into_iter().find_map(of).unwrap_or_else(|| Labelled::new(name, "1"))
}
