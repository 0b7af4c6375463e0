//! Any bytes as a campaign: no panic, and what is accepted holds together.

#![no_main]

use abbe_files::read_campaign;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(file) = read_campaign(bytes, "fuzz", Some([0.0; 3])) {
        let campaign = &file.campaign;
        assert!(!campaign.readings.is_empty());
        for reading in &campaign.readings {
            assert!((reading.station as usize) < campaign.stations.len());
            assert!((reading.line as usize) < campaign.lines.len());
            assert!(reading.reading_m.iter().all(|value| value.is_finite()));
        }
        assert!(campaign.covariates.iter().all(|covariate| covariate.values.len() == campaign.readings.len()));
    }
});
