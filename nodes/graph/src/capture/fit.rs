//! The campaign so far, identified beside the capture.
//!
//! Place in the flow: [`super::run`] hands over what is captured after each line, as soon as the fit before is done; what comes back
//! is a model that readings are held against, and the uncertainty that identification would state if nothing more came. A thread
//! of its own, so that no reading waits for it. SI.

use abbe_diagnose::stated;
use abbe_files::{MachineFile, OrderChoice};
use abbe_geometry::model::MachineModel;
use abbe_identify::verdict::{Finding, of_campaign};
use abbe_identify::{IdentifyError, IdentifyOptions, identify};
use abbe_measurement::campaign::Campaign;
use abbe_plan::u_over;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{Builder, JoinHandle};

/// What the campaign so far says.
#[derive(Debug, Clone)]
pub struct SoFar {
    /// Readings that went in.
    pub readings: usize,
    /// The model of the fit alone, which readings are held against.
    pub model: MachineModel,
    /// Rms over the volume of the plan of the standard uncertainty of a corrected point, in space (m), as `abbe identify` would state it of these
    /// readings and as the plan promises it.
    pub u_m: f64,
    /// What the fit says against itself.
    pub findings: Vec<Finding>,
}

/// Over which readings (m) and offsets (m) the uncertainty is stated.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Lowest and highest reading of each axis.
    pub reading_m: [(f64, f64); 3],
    /// Offsets.
    pub offsets_m: Vec<[f64; 3]>,
}

/// How a campaign of this machine is identified, where nobody asks for anything else.
pub fn identify_options(machine: &MachineFile) -> IdentifyOptions {
    let order = match machine.order {
        OrderChoice::Evidence => abbe_identify::OrderChoice::Evidence,
        OrderChoice::Fixed => abbe_identify::OrderChoice::Fixed,
    };
    IdentifyOptions { order, absolute_range: machine.absolute_range, ..IdentifyOptions::default() }
}

/// Identifies the campaign.
///
/// # Errors
/// Why it cannot be identified yet.
pub fn so_far(
    machine: &MachineFile,
    volume: &Volume,
    campaign: &Campaign,
    mut goes_on: impl FnMut() -> bool,
) -> Result<SoFar, String> {
    let options = identify_options(machine);
    let fit = identify(&machine.machine, machine.instrument, campaign, &options, &mut |_| goes_on());
    let fit = fit.map_err(|error| error.to_string())?;
    if !goes_on() {
        return Err(IdentifyError::Stopped.to_string());
    }
    let (model, verdict) =
        stated(&fit, machine.instrument, campaign, of_campaign(campaign, &fit)).map_err(|error| error.to_string())?;
    let u_m = u_over(&model, &volume.reading_m, &volume.offsets_m).map_err(|error| error.to_string())?;
    Ok(SoFar { readings: campaign.readings.len(), model: fit.model, u_m, findings: verdict.findings })
}

/// The thread that fits.
pub(super) struct Fitter {
    give: Option<SyncSender<Campaign>>,
    found: Receiver<Result<SoFar, String>>,
    is_busy: bool,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Fitter {
    pub(super) fn start(machine: MachineFile, volume: Volume) -> std::io::Result<Fitter> {
        let (give, campaigns) = sync_channel::<Campaign>(1);
        let (tell, found) = sync_channel(1);
        let is_stopped = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&is_stopped);
        let work = move || {
            for campaign in campaigns {
                let outcome = so_far(&machine, &volume, &campaign, || !stopped.load(Ordering::Relaxed));
                if tell.send(outcome).is_err() {
                    return;
                }
            }
        };
        let thread = Builder::new().name("fit".into()).spawn(work)?;
        Ok(Fitter { give: Some(give), found, is_busy: false, is_stopped, thread: Some(thread) })
    }

    /// Whether it has nothing to do.
    pub(super) fn is_idle(&self) -> bool {
        !self.is_busy
    }

    /// Fits this campaign; nothing happens while it is busy.
    pub(super) fn fit(&mut self, campaign: Campaign) {
        if let Some(give) = &self.give
            && !self.is_busy
        {
            self.is_busy = give.try_send(campaign).is_ok();
        }
    }

    /// What it has found since the last look.
    pub(super) fn found(&mut self) -> Option<Result<SoFar, String>> {
        let found = self.found.try_recv().ok()?;
        self.is_busy = false;
        Some(found)
    }
}

impl Drop for Fitter {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        self.give = None;
        if let Some(thread) = self.thread.take() {
            // A pass that has begun is ended first, and so is what follows the last.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // A test fails by panicking.
mod tests {
    use super::*;
    use abbe_files::read_machine;
    use abbe_virtual_machine::effects::from_text;
    use abbe_virtual_machine::environment::EnvironmentConfig;
    use abbe_virtual_machine::instrument::InstrumentConfig;
    use abbe_virtual_machine::plan::presets;
    use abbe_virtual_machine::{SimulationConfig, TruthRecipe, simulate_campaign};
    use std::path::Path;

    /// A machine whose errors no chain of rigid bodies describes: lines that are left out show more than the fit itself.
    #[test]
    fn the_uncertainty_so_far_holds_what_identification_would_add_to_that_of_the_fit() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines/bridge_xyz.toml");
        let machine = read_machine(&file).unwrap();
        let truth = TruthRecipe::default().bridge_xyz().unwrap();
        let stroke_m = truth.stroke_m;
        let undescribed =
            "undescribed seed=3 of=x_mm of_from=0 of_to=800 and=y_mm and_from=0 and_to=600 along=z size_um=5";
        let simulated = simulate_campaign(&SimulationConfig {
            seed: 5,
            plan: presets::plan_b(stroke_m, 5).build().unwrap(),
            machine: truth,
            instrument: InstrumentConfig::LASER_TRACER,
            environment: EnvironmentConfig::constant(),
            effects: vec![from_text(undescribed).unwrap()],
        });
        let volume =
            Volume { reading_m: stroke_m.map(|[low_m, high_m]| (low_m, high_m)), offsets_m: vec![[0.0, 0.0, -0.06]] };
        let said = so_far(&machine, &volume, &simulated.unwrap().campaign, || true).unwrap();
        let of_fit_m = u_over(&said.model, &volume.reading_m, &volume.offsets_m).unwrap();
        assert!(said.u_m > 1.01 * of_fit_m, "{} {of_fit_m}", said.u_m);
    }
}
