//! Where networks are trained: the processor, or a graphics card.
//!
//! Place in the flow: chosen on the command line, handed to [`crate::train()`], kept in the record of the training. Only the steps of
//! the optimiser run there; kriging, the judging of held-out points and all predictions are the processor's. The processor
//! gives the same bytes each time. A graphics card adds up in an order of its own: its networks are as good, not the same.

use thiserror::Error;

/// Where networks are trained.
#[derive(Debug, Clone)]
pub struct Device {
    name: String,
    burn: burn::tensor::Device,
}

/// Why there is no graphics card to train on.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DeviceError {
    /// Compiled without it.
    #[error(
        "this program is built without graphics cards; build it with `cargo build --release -p abbe-train --features wgpu`"
    )]
    NotBuilt,
    /// None that works, or it is in use already.
    #[error("no graphics card that can be trained on: {0}")]
    None(String),
}

impl Device {
    /// The processor.
    pub fn cpu() -> Device {
        Device { name: "cpu".into(), burn: burn::tensor::Device::flex() }
    }

    /// The graphics card that the drivers of Vulkan, Metal or DirectX offer first; to be asked for once in a program.
    #[cfg(feature = "wgpu")]
    pub fn wgpu() -> Result<Device, DeviceError> {
        let options = burn::tensor::Device::wgpu_options();
        let (burn, setup) = options.init_with_setup().map_err(|error| DeviceError::None(error.to_string()))?;
        let card = setup.adapter.get_info();
        Ok(Device { name: format!("wgpu: {}, {}", card.name, card.backend), burn })
    }

    /// The graphics card: this program is built without.
    #[cfg(not(feature = "wgpu"))]
    pub fn wgpu() -> Result<Device, DeviceError> {
        Err(DeviceError::NotBuilt)
    }

    /// Name in records and reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// As the framework knows it.
    pub fn burn(&self) -> &burn::tensor::Device {
        &self.burn
    }
}
