//! The `.msg` files are the one definition: every message is written with the Rust types and read
//! back by nothing but the text of its `.msg` file. A field added, renamed, moved or retyped on one
//! side only fails here.

use crate::common;
use abbe_msgs::definition::{self, Count, Field};
use abbe_msgs::standard::{
    Clock, DiagnosticStatus, Float64, FluidPressure, Header, KeyValue, Log, Marker, Point, Range, RelativeHumidity,
    State, Temperature, Text, Time, Transition, TransitionEvent,
};
use abbe_msgs::{CorrectionStatus, Message, ResidualStatus, RosType, cdr};
use serde_json::{Map, Value};

/// Decodes CDR (little endian) by the fields of the `.msg` text.
struct ByText<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl ByText<'_> {
    fn number<const N: usize>(&mut self) -> [u8; N] {
        self.at = self.at.next_multiple_of(N);
        let number = self.bytes[self.at..self.at + N].try_into().unwrap();
        self.at += N;
        number
    }

    fn text(&mut self) -> Value {
        let length = u32::from_le_bytes(self.number()) as usize;
        let bytes = &self.bytes[self.at..self.at + length];
        self.at += length;
        let (nul, text) = bytes.split_last().unwrap();
        assert_eq!(*nul, 0, "a string ends in NUL");
        String::from_utf8(text.to_vec()).unwrap().into()
    }

    fn value(&mut self, kind: &str) -> Value {
        match kind {
            "bool" => {
                let [byte] = self.number();
                assert!(byte < 2, "a bool is 0 or 1");
                (byte == 1).into()
            }
            "uint8" | "byte" => u8::from_le_bytes(self.number()).into(),
            "int32" => i32::from_le_bytes(self.number()).into(),
            "uint32" => u32::from_le_bytes(self.number()).into(),
            "uint64" => u64::from_le_bytes(self.number()).into(),
            "float32" => f32::from_le_bytes(self.number()).into(),
            "float64" => f64::from_le_bytes(self.number()).into(),
            "string" => self.text(),
            message => self.message(message),
        }
    }

    fn message(&mut self, ros_type: &str) -> Value {
        let fields = definition::fields(ros_type).unwrap_or_else(|| panic!("{ros_type} unknown"));
        let mut values = Map::new();
        for Field { name, kind, count } in fields {
            let value = match count {
                Count::One => self.value(&kind),
                Count::Fixed(size) => (0..size).map(|_| self.value(&kind)).collect(),
                Count::Sequence => {
                    let size = u32::from_le_bytes(self.number());
                    (0..size).map(|_| self.value(&kind)).collect()
                }
            };
            values.insert(name, value);
        }
        values.into()
    }
}

fn assert_text_describes<R: RosType>(ros: &R) {
    let bytes = cdr::encode(ros).unwrap();
    assert_eq!(bytes[..4], [0, 1, 0, 0], "plain CDR, little endian");
    let mut reader = ByText { bytes: &bytes[4..], at: 0 };
    let by_text = reader.message(R::ROS_TYPE);
    assert_eq!(by_text, serde_json::to_value(ros).unwrap(), "{}", R::ROS_TYPE);
    assert_eq!(reader.at, bytes.len() - 4, "{} has no more bytes", R::ROS_TYPE);
}

#[test]
fn own_messages_are_what_their_msg_files_say() {
    assert_text_describes(&common::scales().to_ros());
    assert_text_describes(&common::tracer().to_ros());
    assert_text_describes(&common::corrected().to_ros());
    assert_text_describes(&common::residual().to_ros());
}

#[test]
fn standard_messages_are_what_their_msg_files_say() {
    let diagnostics = common::diagnostics();
    assert_text_describes(&Time { sec: -3, nanosec: 4 });
    assert_text_describes(&Header::new(common::scales().stamp, "bridge"));
    assert_text_describes::<Point>(&common::point().point);
    assert_text_describes(&common::point());
    assert_text_describes(&common::joints());
    assert_text_describes::<KeyValue>(&diagnostics.status[0].values[0]);
    assert_text_describes::<DiagnosticStatus>(&diagnostics.status[0]);
    assert_text_describes(&diagnostics);
    assert_text_describes(&Clock { clock: common::scales().stamp.into() });
    assert_text_describes(&Text { data: "<robot/>".to_owned() });
    let state = |id, label: &str| State { id, label: label.to_owned() };
    let transition = Transition { id: 3, label: "activate".to_owned() };
    let line = (30, "test.geometric".to_owned(), "a word".to_owned(), "src/node.rs".to_owned());
    let (level, name, msg, file) = line;
    assert_text_describes(&Log {
        stamp: Time { sec: 1, nanosec: 2 },
        level,
        name,
        msg,
        file,
        function: "f".into(),
        line: 7,
    });
    assert_text_describes(&transition);
    assert_text_describes(&state(2, "inactive"));
    let (start_state, goal_state) = (state(2, "inactive"), state(13, "activating"));
    assert_text_describes(&TransitionEvent { timestamp: 1 << 60, transition, start_state, goal_state });
}

#[test]
fn what_sensors_publish_is_what_their_msg_files_say() {
    let header = Header::new(common::scales().stamp, "sensor");
    assert_text_describes(&Float64 { data: 1.5 });
    assert_text_describes(&Temperature { header: header.clone(), temperature: 20.5, variance: 0.25 });
    assert_text_describes(&FluidPressure { header: header.clone(), fluid_pressure: 101_325.0, variance: 4.0 });
    assert_text_describes(&RelativeHumidity { header: header.clone(), relative_humidity: 0.5, variance: 0.125 });
    assert_text_describes(&Range {
        header,
        radiation_type: 1,
        field_of_view: 0.5,
        min_range: 0.25,
        max_range: 20.0,
        range: 1.75,
        variance: 0.0625,
    });
}

#[test]
fn frames_and_markers_are_what_their_msg_files_say() {
    assert_text_describes(&common::frames());
    assert_text_describes(&common::frames().transforms[0]);
    assert_text_describes(&common::markers().markers[0].pose);
    assert_text_describes(&common::markers().markers[0]);
    assert_text_describes(&common::markers());
}

/// Name and value of the constants of a `.msg` file.
fn constants(ros_type: &str) -> Vec<(String, i32)> {
    let text = definition::text(ros_type).unwrap();
    text.lines()
        .map(|line| line.split('#').next().unwrap())
        .filter_map(|line| line.split_once('='))
        .map(|(declared, value)| {
            let name = declared.split_whitespace().nth(1).unwrap();
            (name.to_owned(), value.trim().parse().unwrap())
        })
        .collect()
}

#[test]
fn statuses_are_the_constants_of_the_msg_files() {
    let correction: Vec<_> =
        CorrectionStatus::ALL.iter().map(|status| (format!("STATUS_{}", status.name()), *status as i32)).collect();
    assert_eq!(constants("abbe_msgs/msg/CorrectedCoordinates"), correction);
    let residual: Vec<_> =
        ResidualStatus::ALL.iter().map(|status| (format!("STATUS_{}", status.name()), *status as i32)).collect();
    assert_eq!(constants("abbe_msgs/msg/RangeResidual"), residual);
    let levels = [
        ("OK", DiagnosticStatus::OK),
        ("WARN", DiagnosticStatus::WARN),
        ("ERROR", DiagnosticStatus::ERROR),
        ("STALE", DiagnosticStatus::STALE),
    ]
    .map(|(name, value)| (name.to_owned(), i32::from(value)));
    assert_eq!(constants("diagnostic_msgs/msg/DiagnosticStatus"), levels);
    let shapes = [
        ("ARROW", Marker::ARROW),
        ("LINE_LIST", Marker::LINE_LIST),
        ("TEXT_VIEW_FACING", Marker::TEXT_VIEW_FACING),
        ("ADD", Marker::ADD),
        ("DELETE", Marker::DELETE),
    ]
    .map(|(name, value)| (name.to_owned(), value));
    assert_eq!(constants("visualization_msgs/msg/Marker"), shapes);
}

#[test]
fn every_definition_has_a_schema_with_all_it_contains() {
    for (name, text) in definition::DEFINITIONS {
        let schema = definition::schema(name).unwrap_or_else(|| panic!("{name} has no schema"));
        assert!(schema.starts_with(text));
    }
    let schema = definition::schema("diagnostic_msgs/msg/DiagnosticArray").unwrap();
    let embedded: Vec<_> = schema.lines().filter(|line| line.starts_with("MSG: ")).collect();
    assert_eq!(
        embedded,
        [
            "MSG: std_msgs/Header",
            "MSG: diagnostic_msgs/DiagnosticStatus",
            "MSG: builtin_interfaces/Time",
            "MSG: diagnostic_msgs/KeyValue",
        ]
    );
    assert_eq!(definition::schema("abbe_msgs/msg/Nothing"), None);
}

#[test]
fn the_interface_package_of_ros_2_holds_every_message_and_this_version() {
    let cmake = include_str!("../CMakeLists.txt");
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("msg");
    let mut messages: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| format!("msg/{}", file.unwrap().file_name().into_string().unwrap()))
        .collect();
    messages.sort();
    let listed: Vec<&str> = cmake.split('"').filter(|word| word.ends_with(".msg")).collect();
    assert_eq!(listed, messages);
    let version = format!("<version>{}</version>", env!("CARGO_PKG_VERSION"));
    assert!(include_str!("../package.xml").contains(&version), "package.xml has another version than Cargo.toml");
}
