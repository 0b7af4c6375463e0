//! Any bytes as a model: no panic. The bytes are also put into an envelope with the right hash, because no fuzzer
//! finds a SHA-256 by chance.

#![no_main]

use abbe_files::{ModelFile, hex};
use libfuzzer_sys::fuzz_target;
use sha2::{Digest, Sha256};

fuzz_target!(|bytes: &[u8]| {
    let _ = ModelFile::from_bytes(bytes, "fuzz");
    let hash = hex(&Sha256::digest(bytes));
    let mut file = format!("{{\"format\":\"abbe-model\",\"version\":1,\"sha256\":\"{hash}\",\"model\":").into_bytes();
    file.extend_from_slice(bytes);
    file.push(b'}');
    if let Ok((model, digest)) = ModelFile::from_bytes(&file, "fuzz") {
        assert_eq!(hex(&digest), hash);
        model.to_bytes("fuzz").expect("an accepted model can be written");
    }
});
