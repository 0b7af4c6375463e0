//! Sensors on other boxes: their values as covariates of the scale readings.
//!
//! Place in the flow: in the scale node. Each sensor of the launch file has a thread that waits for it, so that none delays a
//! reading; the loop joins what has come so far.

use super::traffic::{Trouble, Troubles};
use super::{NodeContext, NodeError, NodeSummary};
use crate::driver::{SensorDriver, open_sensor};
use crate::link::Link;
use crate::step::SensorMemory;
use abbe_msgs::ScaleReading;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

/// The sensors of a launch file.
pub(super) struct Sensors {
    memory: Arc<Mutex<SensorMemory>>,
}

impl Sensors {
    /// Opens all, and gives how they stand.
    pub(super) fn open(context: &NodeContext) -> Result<(Sensors, Vec<(String, Link)>), NodeError> {
        let memory = Arc::new(Mutex::new(SensorMemory::default()));
        let mut links = Vec::new();
        for (place, config) in context.launch.covariates.iter().enumerate() {
            let driver = open_sensor(config, &context.base, &context.machine, &context.shutdown, context.ros.as_ref())?;
            links.extend(driver.link().map(|link| (format!("covariates {place}"), link)));
            let (memory, troubles) = (Arc::clone(&memory), Troubles::by_clock(context.clock()));
            let listening = move || listen(driver, (&memory, place), troubles);
            thread::Builder::new().name("sensor".into()).spawn(listening).map_err(NodeError::Thread)?;
        }
        Ok((Sensors { memory }, links))
    }

    /// Adds to a reading what the sensors said by its instant.
    pub(super) fn join(&self, reading: &mut ScaleReading, summary: &mut NodeSummary) {
        for refused in lock(&self.memory).join(reading) {
            summary.troubles.note(Trouble::Covariate, format!("a sensor's value was left out: {refused}"));
        }
    }
}

fn lock(memory: &Mutex<SensorMemory>) -> MutexGuard<'_, SensorMemory> {
    memory.lock().unwrap_or_else(PoisonError::into_inner)
}

fn listen(mut driver: Box<dyn SensorDriver>, (memory, place): (&Mutex<SensorMemory>, usize), mut troubles: Troubles) {
    loop {
        let heard = driver.next_values();
        for name in heard.iter().flatten().flat_map(|said| &said.missing) {
            lock(memory).forget(name);
            troubles
                .note(Trouble::Covariate, format!("a sensor has no value of {name}: it is missing until it has one"));
        }
        match heard {
            Ok(Some(said)) => lock(memory).note(place, said.stamp, &said.values),
            Ok(None) => return,
            Err(error) if error.is_of_one_reading() => troubles.note(Trouble::Malformed, error),
            // Its values grow old from now on, which the correction notices.
            Err(error) => {
                tracing::error!("a sensor is given up: {error}");
                return;
            }
        }
    }
}
