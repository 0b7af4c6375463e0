//! Any bytes as a residual model: no panic, and what is accepted predicts without one. The bytes are also put into an envelope
//! with the right hash, because no fuzzer finds a SHA-256 by chance.

#![no_main]

use abbe_files::{LoadedResidual, ResidualFile, hex};
use abbe_geometry::Vector3;
use abbe_geometry::effects::{CovariateSource, CovariateValue};
use abbe_geometry::residual_field::ResidualField;
use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};

/// Any covariate has the same value.
struct Same(f64);

impl CovariateSource for Same {
    fn covariate(&self, _name: &str) -> CovariateValue {
        CovariateValue::Fresh(self.0)
    }
}

fuzz_target!(|bytes: &[u8]| {
    let _ = ResidualFile::from_bytes(bytes, "fuzz");
    let hash = hex(&Sha256::digest(bytes));
    let head = format!("{{\"format\":\"abbe-residual\",\"version\":2,\"sha256\":\"{hash}\",\"residual\":");
    let file = [head.as_bytes(), bytes, b"}"].concat();
    let Ok((file, digest)) = ResidualFile::from_bytes(&file, "fuzz") else { return };
    let field = LoadedResidual::new(file.model, digest);
    for place in [0.0, 0.1, -3.0, 1e300, f64::NAN] {
        let Ok(prediction) = field.predict(&Vector3::new(place, 0.5 * place, 0.2), &Same(place)) else { continue };
        assert!(!prediction.residual_m.iter().any(|r| r.is_nan()));
    }
});
