//! A secured domain: graphs with keys of a keystore beside a user on Fast DDS with DDS Security, and who has none.
//!
//! The keystores are made with `openssl`, in the layout of `ros2 security`. The user is `tests/system/peers/secured_user.cpp`, compiled here
//! against the Fast DDS in the folder that `ABBE_FAST_DDS` names (`/usr` with the Debian package libfastrtps-dev). What wants security wants
//! the feature `dds-security`; without one of these a test says that it was skipped.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::assert_says;
use crate::common::files::{Bench, text};
use crate::common::graph::{DDS, NAMESPACE, long_recording, stream_of};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, signal};
use crate::common::python::said;
use abbe_runtime::ros::Domain;
use rustix::process::Signal;

/// Whether this program can do it.
const IS_BUILT: bool = cfg!(feature = "dds-security");
/// Long enough for every user here; whoever is done first ends the graph.
const SAMPLES: u64 = 120_000;
/// Longest that a user waits for what is sure to come (s).
const PATIENCE: &str = "60";
/// Time in which nothing comes to who may not have it; with keys the first sample came within 2 s (s).
const SILENCE: &str = "8";

/// A folder in which `openssl` makes a keystore with the enclaves `/abbe` and `/user`.
struct Keystore(PathBuf);

impl Keystore {
    /// With a certificate authority of its own. All that is on the wire is encrypted; payloads once more where `data` says so.
    fn make(folder: PathBuf, data: &str) -> Keystore {
        let keystore = Keystore(folder);
        std::fs::create_dir_all(keystore.0.join("private")).unwrap();
        keystore.key("private/ca.key.pem");
        let authority =
            "req -x509 -new -sha256 -days 30 -subj /CN=authority -key private/ca.key.pem -out private/ca.cert.pem";
        keystore.openssl(authority);
        for name in ["abbe", "user"] {
            keystore.enclave(name, data);
        }
        keystore
    }

    fn enclave(&self, name: &str, data: &str) {
        let folder = format!("enclaves/{name}");
        std::fs::create_dir_all(self.0.join(&folder)).unwrap();
        self.key(&format!("{folder}/key.pem"));
        self.openssl(&format!("req -new -sha256 -subj /CN={name} -key {folder}/key.pem -out private/{name}.csr"));
        self.openssl(&format!(
            "x509 -req -sha256 -days 30 -in private/{name}.csr -CA private/ca.cert.pem -CAkey private/ca.key.pem -CAcreateserial \
             -out {folder}/cert.pem"
        ));
        for file in ["identity_ca.cert.pem", "permissions_ca.cert.pem"] {
            std::fs::copy(self.0.join("private/ca.cert.pem"), self.0.join(&folder).join(file)).unwrap();
        }
        self.sign(&format!("{folder}/governance"), &governance(data));
        self.sign(&format!("{folder}/permissions"), &permissions(name));
    }

    fn key(&self, file: &str) {
        self.openssl(&format!("genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256 -out {file}"));
    }

    fn sign(&self, file: &str, document: &str) {
        std::fs::write(self.0.join(format!("{file}.xml")), document).unwrap();
        self.openssl(&format!(
            "smime -sign -text -in {file}.xml -out {file}.p7s -signer private/ca.cert.pem -inkey private/ca.key.pem"
        ));
    }

    #[track_caller]
    fn openssl(&self, words: &str) {
        let output = Command::new("openssl").args(words.split_whitespace()).current_dir(&self.0).output().unwrap();
        assert!(output.status.success(), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    }

    fn of(&self, enclave: &str) -> PathBuf {
        self.0.join("enclaves").join(enclave)
    }
}

fn governance(data: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd\">\
         <domain_access_rules><domain_rule><domains><id_range><min>0</min><max>232</max></id_range></domains>\
         <allow_unauthenticated_participants>false</allow_unauthenticated_participants>\
         <enable_join_access_control>true</enable_join_access_control>\
         <discovery_protection_kind>ENCRYPT</discovery_protection_kind>\
         <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind><rtps_protection_kind>ENCRYPT</rtps_protection_kind>\
         <topic_access_rules><topic_rule><topic_expression>*</topic_expression>\
         <enable_discovery_protection>true</enable_discovery_protection>\
         <enable_liveliness_protection>true</enable_liveliness_protection>\
         <enable_read_access_control>true</enable_read_access_control>\
         <enable_write_access_control>true</enable_write_access_control>\
         <metadata_protection_kind>ENCRYPT</metadata_protection_kind><data_protection_kind>{data}</data_protection_kind>\
         </topic_rule></topic_access_rules></domain_rule></domain_access_rules></dds>\n"
    )
}

/// Everything, for whoever has this name.
fn permissions(name: &str) -> String {
    let topics = "<topics><topic>*</topic></topics>";
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<dds xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:noNamespaceSchemaLocation=\"http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd\">\
         <permissions><grant name=\"{name}\"><subject_name>CN={name}</subject_name><validity>\
         <not_before>2020-01-01T00:00:00</not_before><not_after>2100-01-01T00:00:00</not_after></validity>\
         <allow_rule><domains><id_range><min>0</min><max>232</max></id_range></domains>\
         <publish>{topics}</publish><subscribe>{topics}</subscribe></allow_rule><default>DENY</default></grant></permissions></dds>\n"
    )
}

/// The user's program; none where there is nothing to compile it with, or nobody who could answer.
struct User {
    program: PathBuf,
    libraries: String,
}

impl User {
    fn compiled(bench: &Bench) -> Option<User> {
        if !IS_BUILT {
            println!("SKIPPED: this program is built without the feature dds-security");
            return None;
        }
        let Ok(prefix) = std::env::var("ABBE_FAST_DDS") else {
            println!(
                "SKIPPED: set ABBE_FAST_DDS to where Fast DDS with security is, as /usr with libfastrtps-dev of Debian"
            );
            return None;
        };
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/system/peers/secured_user.cpp");
        let (program, lib) = (bench.path("secured_user"), Path::new(&prefix).join("lib"));
        let of_architecture = format!("{}-linux-gnu", std::env::consts::ARCH);
        let (of_debian, include) = (lib.join(&of_architecture), Path::new(&prefix).join("include"));
        let output = Command::new("c++")
            .args(["-std=c++17", "-Wno-deprecated-declarations", "-Wl,--allow-shlib-undefined", "-o"])
            .args([&program, &source])
            .args([&include, &include.join(of_architecture)].map(|folder| format!("-I{}", text(folder))))
            .args([&lib, &of_debian].map(|folder| format!("-L{}", text(folder))))
            .args(["-lfastrtps", "-lfastcdr"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Some(User { program, libraries: format!("{}:{}", text(&lib), text(&of_debian)) })
    }

    /// What it says; `enclave` holds its keys.
    #[track_caller]
    fn says(&self, domain: Domain, enclave: Option<PathBuf>, words: &[&str]) -> serde_json::Value {
        let mut command = Command::new(&self.program);
        command.args(words).env("LD_LIBRARY_PATH", &self.libraries).env("ROS_DOMAIN_ID", domain.id().to_string());
        command.env_remove("ABBE_TEST_ENCLAVE").envs(enclave.map(|folder| ("ABBE_TEST_ENCLAVE", folder)));
        said(command)
    }
}

/// A graph whose residual node is in a domain that takes nobody without keys.
fn secured(bench: &Bench, domain: Domain, keystore: &Keystore, enclave: &str) -> Command {
    let file = stream_of(bench, |launch| launch.edge("residual", "*", DDS));
    let sim_time = ["-p", "use_sim_time:=true", "--enclave", enclave];
    let mut command = abbe_in(domain, ["launch", &file, "--ros-args"].into_iter().chain(sim_time));
    command.env("ROS_SECURITY_ENABLE", "true").env("ROS_SECURITY_STRATEGY", "Enforce");
    command.env("ROS_SECURITY_KEYSTORE", &keystore.0);
    command
}

#[test]
fn security_that_was_not_built_is_refused_with_the_way_to_build_it() {
    let test = "secured::security_that_was_not_built_is_refused_with_the_way_to_build_it";
    in_own_network(test, |domain| {
        if IS_BUILT {
            println!("SKIPPED: this program is built with the feature dds-security");
            return;
        }
        let bench = Bench::identified(5);
        long_recording(&bench, 100);
        let file = stream_of(&bench, |launch| launch.edge("residual", "*", DDS));
        let mut by_environment = abbe_in(domain, ["launch", &file]);
        by_environment.env("ROS_SECURITY_ENABLE", "true");
        let refused = Started::start(by_environment).finish().refused();
        assert_says(&refused, &["ROS_SECURITY_ENABLE=true", "cargo build --release --features dds-security"]);
    });
}

#[test]
fn val_fast_dds_with_keys_takes_and_is_heard_and_without_keys_or_with_those_of_others_gets_nothing() {
    let test =
        "secured::val_fast_dds_with_keys_takes_and_is_heard_and_without_keys_or_with_those_of_others_gets_nothing";
    in_own_network(test, |domain| {
        let bench = Bench::empty();
        let Some(user) = User::compiled(&bench) else { return };
        let (keystore, others) =
            (Keystore::make(bench.path("keystore"), "NONE"), Keystore::make(bench.path("others"), "NONE"));
        let graph_bench = Bench::identified(5);
        long_recording(&graph_bench, SAMPLES);
        let graph = Started::start(secured(&graph_bench, domain, &keystore, "/abbe"));
        let keys = || Some(keystore.of("user"));
        let taken = user.says(domain, keys(), &["points", NAMESPACE, "500", PATIENCE]);
        assert_eq!(taken["taken"], 500, "with keys");
        assert_eq!(user.says(domain, keys(), &["clock", "1000000", PATIENCE])["heard"], true, "with keys");
        for (enclave, whose) in [(None, "without keys"), (Some(others.of("user")), "with keys of others")] {
            let taken = user.says(domain, enclave, &["points", NAMESPACE, "1", SILENCE]);
            assert_eq!(taken["taken"], 0, "{whose}");
        }
        // All that time samples went out.
        assert_eq!(user.says(domain, keys(), &["points", NAMESPACE, "1", PATIENCE])["taken"], 1, "with keys again");
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert!(!ran.errors.contains("panicked"), "{}", ran.errors);
        ran.ok();
    });
}

#[test]
fn val_fast_dds_takes_samples_of_a_domain_that_protects_payloads_and_the_log_says_what_does_not_work_there() {
    let test = "secured::val_fast_dds_takes_samples_of_a_domain_that_protects_payloads_and_the_log_says_what_does_not_work_there";
    in_own_network(test, |domain| {
        let bench = Bench::empty();
        let Some(user) = User::compiled(&bench) else { return };
        let keystore = Keystore::make(bench.path("keystore"), "ENCRYPT");
        let graph_bench = Bench::identified(5);
        long_recording(&graph_bench, SAMPLES);
        let graph = Started::start(secured(&graph_bench, domain, &keystore, "/abbe"));
        let taken = user.says(domain, Some(keystore.of("user")), &["points", NAMESPACE, "500", PATIENCE]);
        assert_eq!(taken["taken"], 500);
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert_says(&ran.errors, &["data_protection_kind is not NONE", "services do not answer"]);
    });
}

#[test]
fn keys_that_are_not_there_or_do_not_belong_together_end_the_graph_with_words() {
    let test = "secured::keys_that_are_not_there_or_do_not_belong_together_end_the_graph_with_words";
    in_own_network(test, |domain| {
        if !IS_BUILT {
            println!("SKIPPED: this program is built without the feature dds-security");
            return;
        }
        let bench = Bench::identified(5);
        long_recording(&bench, 100);
        let keystore = Keystore::make(bench.path("keystore"), "NONE");
        let refused = |enclave| Started::start(secured(&bench, domain, &keystore, enclave)).finish().refused();
        assert_says(&refused("/nobody"), &["enclaves/nobody/identity_ca.cert.pem", "ros2 security create_enclave"]);
        // Permissions that the authority never signed.
        let permissions = keystore.of("abbe").join("permissions.p7s");
        let signed = std::fs::read_to_string(&permissions).unwrap();
        std::fs::write(&permissions, signed.replacen("<default>DENY", "<default>ALLOW", 1)).unwrap();
        assert_says(&refused("/abbe"), &["keys for ROS domain", "permissions"]);
    });
}
