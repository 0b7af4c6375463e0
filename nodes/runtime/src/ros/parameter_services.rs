//! The six services by which `ros2 param` lists, reads, describes and sets parameters.
//!
//! Place in the flow: served on the node's own thread, beside discovery. Those of the DDS library
//! describe neither unit nor range, so they are served here from the [`ParameterTable`]; values are those of [`Values`].

use std::sync::{Arc, Mutex};

use futures::future::{self, BoxFuture};
use ros2_client::parameters::{NumericRange, ParameterDescriptor, raw};
use ros2_client::rcl_interfaces::{
    DescribeParametersRequest, DescribeParametersResponse, GetParameterTypesRequest, GetParameterTypesResponse,
    GetParametersRequest, GetParametersResponse, ListParametersRequest, ListParametersResponse, ListParametersResult,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse,
};
use ros2_client::{Node, Parameter, ParameterValue};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::matched::Matched;
use super::parameter_values::Values;
use super::parameters::{ParameterSpec, ParameterTable, Range};
use super::service::Service;
use super::{NodeOptions, RosError, TriggerOutcome};
use crate::lock::lock;

const PACKAGE: &str = "rcl_interfaces";

/// Has new values put to use, all or none; they are of the right type and in range.
pub(crate) type Ask =
    Arc<dyn Fn(Vec<(String, raw::ParameterValue)>) -> BoxFuture<'static, TriggerOutcome> + Send + Sync>;

/// The open services.
pub(super) struct ParameterServices {
    table: ParameterTable,
    now: Arc<Values>,
    /// Who is asked before a value is set; nobody where the node looks its values up.
    ask: Option<Ask>,
    list: Service<ListParametersRequest, ListParametersResponse>,
    get: Service<GetParametersRequest, GetParametersResponse>,
    types: Service<GetParameterTypesRequest, GetParameterTypesResponse>,
    describe: Service<DescribeParametersRequest, DescribeParametersResponse>,
    set: Service<SetParametersRequest, SetParametersResponse>,
    set_all: Service<SetParametersRequest, SetParametersAtomicallyResponse>,
}

impl ParameterServices {
    /// Opens them; calm is waited for before each.
    pub(super) fn open(
        node: &mut Node,
        options: &NodeOptions,
        (now, ask): (Arc<Values>, Option<Ask>),
        matched: &Arc<Matched>,
    ) -> Result<Self, RosError> {
        let mut opener = Opener { node, matched, prefix: options.identity.qualified() };
        Ok(Self {
            table: options.parameters.clone(),
            now,
            ask,
            list: opener.open("list_parameters", "ListParameters")?,
            get: opener.open("get_parameters", "GetParameters")?,
            types: opener.open("get_parameter_types", "GetParameterTypes")?,
            describe: opener.open("describe_parameters", "DescribeParameters")?,
            set: opener.open("set_parameters", "SetParameters")?,
            set_all: opener.open("set_parameters_atomically", "SetParametersAtomically")?,
        })
    }

    /// Answers requests, for ever.
    pub(super) async fn serve(self, node: &Mutex<Node>) {
        let reading = future::join4(
            self.list.serve(async |request| ListParametersResponse {
                result: list(&lock(node).list_parameters(), &request),
            }),
            self.get.serve(async |request| GetParametersResponse {
                values: self.values(node, &request.names).map(Into::into).collect(),
            }),
            self.types.serve(async |request| GetParameterTypesResponse {
                values: self
                    .values(node, &request.names)
                    .map(|value| ParameterValue::to_parameter_type_raw(&value))
                    .collect(),
            }),
            self.describe.serve(async |request| DescribeParametersResponse {
                values: request.names.iter().map(|name| self.description(node, name)).collect(),
            }),
        );
        let writing = future::join(
            self.set.serve(async |request| {
                let mut results = Vec::with_capacity(request.parameter.len());
                for one in request.parameter {
                    results.push(self.set(node, vec![one]).await.into());
                }
                SetParametersResponse { results }
            }),
            self.set_all.serve(async |request| SetParametersAtomicallyResponse {
                result: self.set(node, request.parameter).await.into(),
            }),
        );
        future::join(reading, writing).await;
    }

    fn description(&self, node: &Mutex<Node>, name: &str) -> raw::ParameterDescriptor {
        let descriptor = match (self.table.spec(name), self.now.get(node, name)) {
            (Some(spec), _) => described(spec),
            (None, Some(value)) => ParameterDescriptor::from_value(name, &value),
            (None, None) => ParameterDescriptor::unknown(name),
        };
        descriptor.into()
    }

    /// All or nothing: every value is checked, and put to use, before the first is set. (The library itself lets
    /// `use_sim_time` pass.)
    async fn set(&self, node: &Mutex<Node>, parameters: Vec<raw::Parameter>) -> Result<(), String> {
        for parameter in parameters.iter().cloned().map(Parameter::from) {
            let checked = self.table.check_change(&parameter.name, &parameter.value);
            checked.map_err(|error| error.to_string())?;
        }
        if let Some(ask) = &self.ask {
            let is_new =
                |one: &&raw::Parameter| self.now.get(node, &one.name) != Some(ParameterValue::from(one.value.clone()));
            let news: Vec<_> =
                parameters.iter().filter(is_new).map(|one| (one.name.clone(), one.value.clone())).collect();
            if !news.is_empty() {
                ask(news).await?;
            }
        }
        if !parameters.is_empty() {
            self.now.set(node, parameters);
        }
        Ok(())
    }

    fn values<'a>(&'a self, node: &'a Mutex<Node>, names: &'a [String]) -> impl Iterator<Item = ParameterValue> + 'a {
        names.iter().map(move |name| self.now.get(node, name).unwrap_or(ParameterValue::NotSet))
    }
}

struct Opener<'a> {
    node: &'a mut Node,
    matched: &'a Arc<Matched>,
    prefix: String,
}

impl Opener<'_> {
    fn open<Request, Reply>(&mut self, name: &str, service: &str) -> Result<Service<Request, Reply>, RosError>
    where
        Request: DeserializeOwned,
        Reply: Serialize,
    {
        self.matched.await_calm();
        Service::open(self.node, self.matched, &format!("{}/{name}", self.prefix), PACKAGE, service)
    }
}

/// As rclcpp: without prefixes all names of fewer than `depth` dots (0: all); with prefixes those
/// that are one, or lie below one by at most `depth` parts.
fn list(names: &[String], request: &ListParametersRequest) -> ListParametersResult {
    let depth = usize::try_from(request.depth).unwrap_or(usize::MAX);
    let parts_fit = |parts: usize| depth == 0 || parts <= depth;
    let below = |name: &str, prefix: &str| {
        let rest = name.strip_prefix(prefix).and_then(|rest| rest.strip_prefix('.'));
        name == prefix || rest.is_some_and(|rest| parts_fit(rest.split('.').count()))
    };
    let listed = |name: &&String| match request.prefixes.is_empty() {
        true => parts_fit(name.split('.').count()),
        false => request.prefixes.iter().any(|prefix| below(name, prefix)),
    };
    let names: Vec<String> = names.iter().filter(listed).cloned().collect();
    let spaces = names.iter().filter_map(|name| name.rsplit_once('.'));
    let mut prefixes: Vec<String> = spaces.map(|(space, _)| space.to_owned()).collect();
    prefixes.sort();
    prefixes.dedup();
    ListParametersResult { names, prefixes }
}

fn described(spec: &ParameterSpec) -> ParameterDescriptor {
    let (range, constraints) = match &spec.range {
        Range::Integer(from, to) => {
            (NumericRange::IntegerRange { from_value: *from, to_value: *to, step: 1 }, String::new())
        }
        Range::Double(from, to) => {
            (NumericRange::FloatingPointRange { from_value: *from, to_value: *to, step: 0.0 }, String::new())
        }
        Range::OneOf(_) | Range::NotEmpty => (NumericRange::NotSpecified, spec.range.to_string()),
        Range::Any => (NumericRange::NotSpecified, String::new()),
    };
    let unit = match spec.unit {
        "" => String::new(),
        unit => format!(" [{unit}]"),
    };
    ParameterDescriptor {
        name: spec.name.to_owned(),
        param_type: spec.default.to_parameter_type(),
        description: format!("{}{unit}", spec.description),
        additional_constraints: constraints,
        read_only: spec.read_only,
        dynamic_typing: false,
        range,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listing_follows_prefix_and_depth() {
        let names = ["a", "b.c", "b.d.e", "bb"].map(str::to_owned);
        let listed = |prefixes: &[&str], depth| {
            let prefixes = prefixes.iter().map(|one| (*one).to_owned()).collect();
            list(&names, &ListParametersRequest { prefixes, depth }).names
        };
        assert_eq!(listed(&[], 0), names);
        assert_eq!(listed(&[], 1), ["a", "bb"]);
        assert_eq!(listed(&["b"], 0), ["b.c", "b.d.e"]);
        assert_eq!(listed(&["b"], 1), ["b.c"]);
        assert_eq!(listed(&["b.d.e"], 1), ["b.d.e"]);
    }
}
