//! What ships works as its first lines say: the model of the virtual machine corrects the virtual machine.

use crate::common::dds::PATIENCE;
use crate::common::files::{Bench, machine, text};
use crate::common::graph::{NAMESPACE, user};
use crate::common::network::in_own_network;
use crate::common::program::{Started, abbe_in, run, signal};
use abbe_msgs::RangeResidual;
use abbe_runtime::RunId;
use rustix::process::Signal;

const SHIPPED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../launch-config/bridge_xyz_virtual.toml");
/// Residuals that are looked at: nearly all of the tracer's.
const LOOKED_AT: usize = 2800;
/// Readings a second: at a thousand a busy machine loses some.
const RATE: &str = "rate_hz = 250.0";

#[test]
fn regress_the_model_of_the_virtual_machine_is_found_good_by_the_shipped_graph() {
    let test = "shipped::regress_the_model_of_the_virtual_machine_is_found_good_by_the_shipped_graph";
    in_own_network(test, |domain| {
        let bench = Bench::empty();
        run(["simulate", "--machine", &text(&machine()), "--seed", "1", "--out", &bench.text("virtual")]).ok();
        let (campaign, model) = (bench.text("virtual/campaign.csv"), bench.text("model.json"));
        run(["identify", "--machine", &text(&machine()), "--campaign", &campaign, "--out", &model]).ok();
        let mut launch = std::fs::read_to_string(SHIPPED).unwrap();
        for (from, to) in [
            (" = \"bridge_xyz\"", format!(" = \"{NAMESPACE}\"")),
            ("machines/bridge_xyz.toml\"", format!("{}\"", text(&machine()))),
            ("../out/virtual/model.json", model),
            ("rate_hz = 100.0", RATE.to_owned()),
        ] {
            assert!(launch.contains(from), "{from}");
            let (head, tail) = launch.split_once("namespace").unwrap();
            launch = format!("{head}namespace{}", tail.replace(from, &to));
        }
        launch += "\n[[edges]]\nfrom = \"monitor\"\nto = \"user\"\ntransport = \"shared-memory\"\n";
        let (file, run_name) = (bench.write("launch.toml", launch), RunId::unique());
        let graph = Started::start(abbe_in(domain, ["launch", &file, "--run", run_name.as_str()]));
        let mut residuals = user::<RangeResidual>(&run_name, "monitor/range_residual");
        let mut square = 0.0;
        for seen in 0..LOOKED_AT {
            let residual = residuals.take_within(PATIENCE).unwrap();
            let residual = residual.unwrap_or_else(|| panic!("the residuals ended after {seen}"));
            let (residual_m, u_m) = residual.residual().expect("a range is predicted for each reading");
            square += (residual_m / u_m).powi(2) / LOOKED_AT as f64;
        }
        assert!((0.7..1.2).contains(&square), "mean square of residual over uncertainty {square}");
        signal(graph.id(), Signal::INT);
        let ran = graph.finish();
        assert!(!ran.errors.contains("exceed their uncertainties"), "{}", ran.errors);
        ran.ok();
    });
}
