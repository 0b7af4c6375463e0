//! What a node was told while it ran, and keeps when it is started again: its state, and values of parameters.
//!
//! Place in the flow: a node says it on standard output when it is told; its launcher gives the last of it to the process that
//! takes the node's place ([`AsTold`]). Who stops a correction, or gives it another model, has not taken that back because a
//! process died.

use super::say;
use abbe_runtime::ros::{LifecycleState, ParameterValue};
use std::collections::BTreeMap;

/// Begins a line that tells the state that a manager took the node to.
pub(crate) const STATE: &str = "state ";
/// Begins a line that tells all values of parameters that were set since the first start.
pub(crate) const PARAMETERS: &str = "parameters ";

/// What the process before was told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct AsTold {
    /// Where the node stays, where that is not at work.
    pub(super) stays: Option<LifecycleState>,
    pub(super) parameters: BTreeMap<String, ParameterValue>,
}

impl AsTold {
    /// Of the words that a launcher gives: a state, and values as JSON.
    ///
    /// # Errors
    /// What is wrong with the words.
    pub fn parse(stays: Option<&str>, changed: Option<&str>) -> Result<AsTold, String> {
        let stays = match stays {
            None => None,
            Some(word) => Some(rest(word).ok_or_else(|| format!("--stays {word}: give inactive or unconfigured"))?),
        };
        let wrong = |problem: String| format!("--changed: {problem}");
        let values: BTreeMap<String, serde_json::Value> =
            changed.map_or(Ok(BTreeMap::new()), serde_json::from_str).map_err(|error| wrong(error.to_string()))?;
        let parameters = values
            .into_iter()
            .map(|(name, value)| match from_json(&value) {
                Some(known) => Ok((name, known)),
                None => Err(wrong(format!("{name} is no value of a parameter: {value}"))),
            })
            .collect::<Result<_, _>>()?;
        Ok(AsTold { stays, parameters })
    }
}

/// The state of this label, where a node in it is not at work and can be brought back.
pub(crate) fn rest(label: &str) -> Option<LifecycleState> {
    [LifecycleState::Inactive, LifecycleState::Unconfigured].into_iter().find(|state| state.label() == label)
}

pub(super) fn say_state(state: LifecycleState) {
    say(&format!("{STATE}{}", state.label()));
}

pub(super) fn say_parameters(values: &BTreeMap<String, ParameterValue>) {
    say(&format!("{PARAMETERS}{}", to_json(values)));
}

fn to_json(values: &BTreeMap<String, ParameterValue>) -> serde_json::Value {
    let one = |(name, value): (&String, &ParameterValue)| {
        let value = match value {
            ParameterValue::Boolean(value) => serde_json::Value::from(*value),
            ParameterValue::Integer(value) => serde_json::Value::from(*value),
            ParameterValue::Double(value) => serde_json::Value::from(*value),
            ParameterValue::String(value) => serde_json::Value::from(value.as_str()),
            // No node has parameters of other types that can be changed.
            _ => return None,
        };
        Some((name.clone(), value))
    };
    serde_json::Value::Object(values.iter().filter_map(one).collect())
}

fn from_json(value: &serde_json::Value) -> Option<ParameterValue> {
    match value {
        serde_json::Value::Bool(value) => Some(ParameterValue::Boolean(*value)),
        serde_json::Value::String(text) => Some(ParameterValue::String(text.clone())),
        serde_json::Value::Number(number) => {
            number.as_i64().map(ParameterValue::Integer).or_else(|| number.as_f64().map(ParameterValue::Double))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_node_says_is_what_the_next_one_is_told() {
        let values = BTreeMap::from([
            ("match_within_s".to_owned(), ParameterValue::Double(5.0)),
            ("model".to_owned(), ParameterValue::String("a \"b\".json".to_owned())),
            ("window".to_owned(), ParameterValue::Integer(7)),
        ]);
        let told = AsTold::parse(Some("inactive"), Some(&to_json(&values).to_string())).unwrap();
        assert_eq!(told, AsTold { stays: Some(LifecycleState::Inactive), parameters: values });
        assert_eq!(AsTold::parse(None, None).unwrap(), AsTold::default());
        assert!(AsTold::parse(Some("active"), None).unwrap_err().contains("--stays active"));
        assert!(AsTold::parse(None, Some("{\"a\": []}")).unwrap_err().contains("a is no value"));
    }
}
