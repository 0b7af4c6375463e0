//! No text on the command line or in a parameter file makes a node panic, and what is accepted is
//! what was written.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // A test fails by panicking.

use abbe_runtime::RunId;
use abbe_runtime::ros::{DiscoveryRange, Domain, NodeIdentity, RosArgs, StaticPeers, YamlValue, resolve};
use proptest::prelude::*;

fn split(words: &[&str]) -> Option<(RosArgs, Vec<String>)> {
    RosArgs::split(words.iter().map(|word| (*word).to_owned())).ok()
}

/// Text near what the parsers understand: the characters that steer them, and any others.
fn text() -> impl Strategy<Value = String> {
    prop_oneof![
        "[a-z_/~:=\\[\\]{}&*!|>'\"%@` \n\t0-9.,#-]{0,40}",
        "(/\\*\\*|n|ros__parameters|a): ?\n? *[a-z0-9:{}\\[\\], \n]{0,30}",
        any::<String>(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_argument_is_understood_or_refused(words in proptest::collection::vec(text(), 0..6)) {
        let words: Vec<&str> = std::iter::once("--ros-args").chain(words.iter().map(String::as_str)).collect();
        if let Some((args, _)) = split(&words) {
            let _ = args.identity("/", "node");
        }
    }

    #[test]
    fn any_value_is_understood_or_refused(value in text()) {
        split(&["--ros-args", "-p", &format!("name:={value}")]);
        split(&["--ros-args", "-r", &value]);
    }

    #[test]
    fn any_parameter_file_is_understood_or_refused(content in text()) {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), content).unwrap();
        split(&["--ros-args", "--params-file", file.path().to_str().unwrap()]);
    }

    #[test]
    fn a_number_on_the_command_line_is_that_number(number in any::<i64>(), real in -1e300..1e300_f64) {
        for (text, value) in [
            (number.to_string(), YamlValue::Integer(number)),
            (format!("{real:?}"), YamlValue::Double(real)),
        ] {
            let (args, _) = split(&["--ros-args", "-p", &format!("x:={text}")]).unwrap();
            prop_assert_eq!(&args.parameters[0].value, &value);
        }
    }

    #[test]
    fn a_resolved_name_is_absolute_and_resolves_to_itself(name in text()) {
        let node = NodeIdentity::new("/cmm", "geometric").unwrap();
        if let Ok(resolved) = resolve(&name, &node, &[]) {
            prop_assert!(resolved.starts_with('/'));
            prop_assert_eq!(resolve(&resolved, &node, &[]).unwrap(), resolved);
        }
    }

    #[test]
    fn a_run_or_domain_of_any_text_is_understood_or_refused(name in text()) {
        if let Ok(run) = name.parse::<RunId>() {
            prop_assert!(!run.as_str().contains(['/', '_', '.']));
        }
        let _ = Domain::from_variables(|_| Some(name.clone()));
        for range in [DiscoveryRange::Subnet, DiscoveryRange::Localhost] {
            let _ = StaticPeers::of(&name, range);
        }
    }
}

#[test]
fn nesting_without_end_is_refused() {
    for opening in ["[", "{a: ", "- "] {
        let value = opening.repeat(100_000);
        assert!(split(&["--ros-args", "-p", &format!("x:={value}")]).is_none(), "{opening}");
    }
}
