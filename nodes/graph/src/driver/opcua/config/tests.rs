//! Evidence for what is refused before anything is opened.

use super::*;

const AXES_OF: &str =
    "server = \"opc.tcp://h:4840\"\naxes = { x_mm = \"ns=2;s=X\", y = \"ns=2;s=Y\", z_um = \"ns=2;i=3\" }\n";

fn key_of(keys: &str, role: Role) -> Option<&'static str> {
    let config: OpcuaConfig = toml::from_str(keys).unwrap();
    config.problem(role).map(|(key, _)| key)
}

#[test]
fn what_cannot_be_is_refused_by_its_key() {
    let scale = |keys: &str| key_of(&format!("{AXES_OF}{keys}"), Role::Scale);
    assert_eq!(scale(""), None);
    assert_eq!(scale("reads = \"polled\"\njoined = \"held\"\nstill_ms = 500"), None);
    for (keys, key) in [
        ("every_s = 0", "every_s"),
        ("every_s = nan", "every_s"),
        ("silent_after_s = 0.05", "silent_after_s"),
        ("apart_ms = 50", "apart_ms"),
        ("apart_ms = -1", "apart_ms"),
        ("still_ms = 500", "still_ms"),
        ("joined = \"held\"\nstill_ms = 5", "still_ms"),
        ("joined = \"arrival\"", "joined"),
        ("offset_mm = [0.0, 0.0, nan]", "offset_mm"),
        ("security = \"Basic256Sha256\"", "certificates"),
        ("certificates = \"pki\"", "certificates"),
        ("signed_only = true", "signed_only"),
        ("password_file = \"p\"", "user"),
        ("user = \"u\"", "password_file"),
        ("user = \"u\"\npassword_file = \"p\"", "user"),
        ("covariates = { temp_air_c = \"X\" }", "covariates"),
        ("covariates = { temp_air_C = \"i=1\" }", "covariates"),
    ] {
        assert_eq!(scale(keys), Some(key), "{keys}");
    }
    assert_eq!(scale("user = \"u\"\npassword_file = \"p\"\npassword_without_security = true"), None);
    assert_eq!(
        scale("user = \"u\"\npassword_file = \"p\"\nsecurity = \"Aes256_Sha256_RsaPss\"\ncertificates = \"c\""),
        None
    );
    assert_eq!(key_of(AXES_OF, Role::Tracer), Some("kind"));
    assert_eq!(key_of(AXES_OF, Role::Sensor), Some("axes"));
    let sensor = "server = \"opc.tcp://h:4840/a/b\"\ncovariates = { temp_air_c = \"i=1\" }";
    assert_eq!(key_of(sensor, Role::Sensor), None);
    assert_eq!(key_of(sensor, Role::Scale), Some("axes"));
    for server in ["h:4840", "opc.tcp://h", "opc.tcp://:4840", "http://h:1", ""] {
        assert_eq!(key_of(&format!("server = \"{server}\"\naxes = {{}}"), Role::Scale), Some("server"), "{server}");
    }
    for axes in [
        "x = \"i=1\", y = \"i=2\"",
        "x = \"i=1\", x_mm = \"i=2\", y = \"i=3\"",
        "x = \"i=1\", y = \"i=2\", w = \"i=3\"",
    ] {
        let keys = format!("server = \"opc.tcp://h:4840\"\naxes = {{ {axes} }}");
        assert_eq!(key_of(&keys, Role::Scale), Some("axes"), "{axes}");
    }
    let unknown = toml::from_str::<OpcuaConfig>("server = \"opc.tcp://h:1\"\nsever = \"x\"");
    assert!(unknown.unwrap_err().to_string().contains("sever"));
}

#[test]
fn the_password_comes_from_its_file_and_is_never_shown() {
    let folder = tempfile::tempdir().unwrap();
    let keys = format!("{AXES_OF}user = \"u\"\npassword_file = \"secret\"\npassword_without_security = true");
    let config: OpcuaConfig = toml::from_str(&keys).unwrap();
    for (text, expected) in [
        ("geheim\n", Some("geheim")),
        ("geheim\r\n", Some("geheim")),
        ("two words", Some("two words")),
        ("", None),
        ("a\nb\n", None),
    ] {
        std::fs::write(folder.path().join("secret"), text).unwrap();
        let settings = config.settings(folder.path());
        match expected {
            Some(password) => {
                let settings = settings.unwrap();
                assert_eq!(settings.user.as_ref().unwrap().password, password);
                assert!(!format!("{settings:?} {config:?}").contains("geheim"));
            }
            None => assert_eq!(settings.unwrap_err().0, "password_file"),
        }
    }
    std::fs::remove_file(folder.path().join("secret")).unwrap();
    assert_eq!(config.settings(folder.path()).unwrap_err().0, "password_file");
}
