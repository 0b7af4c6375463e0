//! Tests of the parameter table: what is refused, and that nothing is changed by a refusal.

use super::*;

fn specs() -> [ParameterSpec; 3] {
    [
        ParameterSpec {
            name: "max_age_s",
            default: ParameterValue::Double(0.1),
            unit: "s",
            range: Range::Double(0.0, 10.0),
            read_only: false,
            description: "Age above which a covariate is stale.",
        },
        ParameterSpec {
            name: "depth",
            default: ParameterValue::Integer(4096),
            unit: "samples",
            range: Range::Integer(1, 65536),
            read_only: true,
            description: "Samples a subscriber can be behind.",
        },
        ParameterSpec {
            name: "mode",
            default: ParameterValue::String("live".into()),
            unit: "",
            range: Range::OneOf(&["live", "replay"]),
            read_only: false,
            description: "Where time comes from.",
        },
    ]
}

fn assignment(node: &str, name: &str, value: YamlValue) -> ParameterAssignment {
    let meant = super::super::Meant::parse(node).unwrap();
    ParameterAssignment { meant, name: name.into(), value, origin: "p.yaml".into() }
}

fn assigned(node: &str, name: &str, value: YamlValue) -> Result<ParameterValue, ParameterError> {
    let identity = NodeIdentity::new("/cmm", "geometric").unwrap();
    let table = ParameterTable::new(specs())?.with_assignments(&identity, &[assignment(node, name, value)])?;
    let found = table.values().find(|(known, _)| *known == name);
    Ok(found.unwrap().1.clone())
}

#[test]
fn a_value_meant_for_the_node_counts_and_another_nodes_does_not() {
    for node in ["/**", "geometric", "/cmm/geometric"] {
        let value = assigned(node, "max_age_s", YamlValue::Double(1.5)).unwrap();
        assert_eq!(value, ParameterValue::Double(1.5), "{node}");
    }
    let value = assigned("tracer", "max_age_s", YamlValue::Double(1.5)).unwrap();
    assert_eq!(value, ParameterValue::Double(0.1));
}

#[test]
fn a_value_for_every_node_may_be_another_nodes_and_one_for_this_may_not() {
    let identity = NodeIdentity::new("/cmm", "geometric").unwrap();
    let for_all =
        [assignment("/**", "rate_hz", YamlValue::Double(5.0)), assignment("/**", "depth", YamlValue::Integer(1))];
    let table = ParameterTable::new(specs()).unwrap().with_assignments(&identity, &for_all).unwrap();
    assert_eq!(table.strangers(&identity, &for_all).map(|one| one.name.as_str()).collect::<Vec<_>>(), ["rate_hz"]);
    assert!(assigned("geometric", "rate_hz", YamlValue::Double(5.0)).unwrap_err().to_string().contains("no parameter"));
    // What it has is checked, whoever it is for.
    assert!(assigned("/**", "depth", YamlValue::Integer(0)).is_err());
}

#[test]
fn a_whole_number_is_a_double_where_a_double_is_declared() {
    let value = assigned("/**", "max_age_s", YamlValue::Integer(2)).unwrap();
    assert_eq!(value, ParameterValue::Double(2.0));
}

#[test]
fn wrong_values_are_refused_with_origin_name_and_remedy() {
    for (name, value, part) in [
        ("max_age_s", YamlValue::Double(10.1), "within 0 to 10 s"),
        ("max_age_s", YamlValue::Double(f64::NAN), "within"),
        ("max_age_s", YamlValue::Text("1".into()), "a double, not a text"),
        ("depth", YamlValue::Integer(0), "within 1 to 65536 samples"),
        ("depth", YamlValue::Double(4.0), "an integer, not a double"),
        ("mode", YamlValue::Text("fast".into()), "one of live, replay"),
        ("max_age", YamlValue::Double(1.0), "depth, max_age_s, mode"),
    ] {
        let message = assigned("geometric", name, value).unwrap_err().to_string();
        assert!(message.contains("p.yaml") && message.contains(part), "{message}");
    }
}

#[test]
fn a_running_node_refuses_to_unset_and_to_change_what_is_fixed() {
    let table = ParameterTable::new(specs()).unwrap();
    table.check_change("max_age_s", &ParameterValue::Double(3.0)).unwrap();
    table.check_change("depth", &ParameterValue::Integer(4096)).unwrap();
    for (name, value) in [
        ("max_age_s", ParameterValue::NotSet),
        ("max_age_s", ParameterValue::Double(-1.0)),
        ("depth", ParameterValue::Integer(8192)),
        ("nothing", ParameterValue::Integer(1)),
    ] {
        assert!(table.check_change(name, &value).is_err(), "{name} {value:?}");
    }
}

#[test]
fn a_table_that_contradicts_itself_is_refused() {
    let [mut age, depth, _] = specs();
    assert!(ParameterTable::new([depth.clone(), depth]).is_err());
    age.default = ParameterValue::Double(11.0);
    assert!(ParameterTable::new([age.clone()]).is_err());
    age.default = ParameterValue::Integer(1); // the range is one of doubles
    assert!(ParameterTable::new([age]).is_err());
}
