//! Any text as the name of a node of OPC UA: a name that is written as it was read, or a refusal in words, never a panic.

#![no_main]

use abbe_opcua::node::NodeName;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match NodeName::parse(text) {
        Ok(node) => assert_eq!(node.to_string(), text),
        Err(problem) => assert!(!problem.is_empty()),
    }
});
