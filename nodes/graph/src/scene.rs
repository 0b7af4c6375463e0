//! A machine as ROS 2 tools look at it: frames for `/tf` and `/tf_static`, and its description in URDF.
//!
//! Place in the flow: machine file and model in, what the residual node hands its gateway out; pure. The machine frame is
//! that of the workpiece: each axis of the chain, from the workpiece through the bed to the ram, moves the next part by its
//! reading along its own direction, those that carry the workpiece as well (seen from the table it is the bed that goes).
//! Metres. The description is nominal: it knows no errors, and where the tip really is stands in a frame of its own.
//! Source of the format: the URDF specification, <https://wiki.ros.org/urdf/XML>.

use abbe_geometry::Axis;
use abbe_geometry::machine::{Machine, Side};
use abbe_geometry::model::Station;
use abbe_msgs::Stamp;
use abbe_msgs::standard::TransformStamped;
use abbe_runtime::gateway::{Frames, Volume};
use std::fmt::Write as _;

/// Names of the joints X, Y, Z, in the description and in `sensor_msgs/JointState`.
pub fn joint_names() -> [String; 3] {
    Axis::ALL.map(|axis| axis.lower().to_owned())
}

/// The frames that move.
pub fn frames(machine: &Machine) -> Frames {
    let name = |part: &str| frame(machine, part);
    Frames { frame_id: machine.frame_id.clone(), links: links(machine), tip: name("tip"), actual: name("tip_actual") }
}

/// The working volume.
pub fn volume(machine: &Machine) -> Volume {
    Volume { frame_id: machine.frame_id.clone(), stroke_m: machine.stroke_m }
}

/// The frames that stand still: the table, the point at which every error function is zero, and the tracer's stations.
pub fn standing_frames(machine: &Machine, stations: &[Station]) -> Vec<TransformStamped> {
    let at =
        |part: &str, place_m| TransformStamped::at(Stamp::default(), &machine.frame_id, &frame(machine, part), place_m);
    let mut frames = vec![at("table", [0.0; 3]), at("reference", machine.stroke_m.map(|(lower_m, _)| lower_m))];
    frames.extend(stations.iter().map(|station| {
        let place_m = [station.position_m.x, station.position_m.y, station.position_m.z];
        at(&format!("station/{}", station.name), place_m)
    }));
    frames
}

/// The machine in URDF: one prismatic joint an axis, with its stroke.
pub fn urdf(machine: &Machine) -> String {
    let [x_m, y_m, z_m] = machine.travel_m();
    let longest_m = x_m.max(y_m).max(z_m);
    let thick_m = 0.03 * longest_m;
    let root = escaped(&machine.frame_id);
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escaped(&machine.name));
    text += &format!("  <link name=\"{root}\"/>\n");
    let [(x0, x1), (y0, y1), (z0, _)] = machine.stroke_m;
    let plate = Shape { size_m: [x_m, y_m, thick_m], centre_m: [(x0 + x1) / 2.0, (y0 + y1) / 2.0, z0 - thick_m / 2.0] };
    text += &link(&frame(machine, "table"), &plate);
    text += &format!(
        "  <joint name=\"table\" type=\"fixed\">\n    <parent link=\"{root}\"/>\n    <child link=\"{}\"/>\n  </joint>\n",
        escaped(&frame(machine, "table"))
    );
    let mut parent = machine.frame_id.clone();
    let all = links(machine);
    for (place, (name, axis)) in all.iter().enumerate() {
        let is_ram = place + 1 == all.len();
        // Of the ram, its end is the frame, as readings and offsets have it.
        let shape = if is_ram {
            Shape { size_m: [thick_m, thick_m, z_m.max(thick_m)], centre_m: [0.0, 0.0, z_m.max(thick_m) / 2.0] }
        } else {
            Shape { size_m: [2.0 * thick_m; 3], centre_m: [0.0; 3] }
        };
        text += &link(name, &shape);
        text += &joint(machine, Axis::ALL[*axis], &parent, name);
        parent.clone_from(name);
    }
    text + "</robot>\n"
}

/// A frame of this machine: none of another that has the same part.
fn frame(machine: &Machine, part: &str) -> String {
    format!("{}/{part}", machine.frame_id)
}

/// From the workpiece to the ram: the part that each axis moves, and the axis.
fn links(machine: &Machine) -> Vec<(String, usize)> {
    let last = machine.joints.len() - 1;
    let part = |place: usize| {
        let joint = machine.joints[place];
        let carries_bed =
            joint.side == Side::Workpiece && machine.joints.get(place + 1).is_none_or(|next| next.side == Side::Tool);
        match (place == last, carries_bed) {
            (true, _) => "ram".to_owned(),
            (false, true) => "bed".to_owned(),
            (false, false) => joint.axis.lower().to_owned(),
        }
    };
    (0..=last).map(|place| (frame(machine, &part(place)), machine.joints[place].axis.index())).collect()
}

/// A box to look at, in its link.
struct Shape {
    size_m: [f64; 3],
    centre_m: [f64; 3],
}

fn link(name: &str, shape: &Shape) -> String {
    let numbers = |values: [f64; 3]| values.map(|value| value.to_string()).join(" ");
    format!(
        "  <link name=\"{}\">\n    <visual>\n      <origin xyz=\"{}\" rpy=\"0 0 0\"/>\n      <geometry><box size=\"{}\"/></geometry>\n    \
         </visual>\n  </link>\n",
        escaped(name),
        numbers(shape.centre_m),
        numbers(shape.size_m)
    )
}

fn joint(machine: &Machine, axis: Axis, parent: &str, child: &str) -> String {
    let (lower_m, upper_m) = machine.stroke_m[axis.index()];
    let direction = axis.direction();
    let mut text = format!("  <joint name=\"{}\" type=\"prismatic\">\n", axis.lower());
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n    <axis xyz=\"{} {} {}\"/>\n",
        escaped(parent),
        escaped(child),
        direction.x,
        direction.y,
        direction.z
    );
    text += "    <!-- The format asks for effort and velocity; the machine file has none. -->\n";
    text + &format!("    <limit lower=\"{lower_m}\" upper=\"{upper_m}\" effort=\"0\" velocity=\"0\"/>\n  </joint>\n")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use abbe_files::read_machine;
    use std::path::Path;

    fn shipped(name: &str) -> Machine {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../launch-config/machines");
        read_machine(&folder.join(format!("{name}.toml"))).unwrap().machine
    }

    fn parts(machine: &Machine) -> Vec<(String, usize)> {
        let without = |(name, axis): (String, usize)| (name[machine.frame_id.len() + 1..].to_owned(), axis);
        frames(machine).links.into_iter().map(without).collect()
    }

    #[test]
    fn the_chain_leads_from_the_workpiece_through_the_bed_to_the_ram() {
        let named = |list: [(&str, usize); 3]| list.map(|(name, axis)| (name.to_owned(), axis)).to_vec();
        assert_eq!(parts(&shipped("bridge_xyz")), named([("x", 0), ("y", 1), ("ram", 2)]));
        // Seen from the table, which carries the workpiece, the bed moves.
        assert_eq!(parts(&shipped("moving_table")), named([("bed", 1), ("x", 0), ("ram", 2)]));
        assert_eq!(parts(&shipped("fyxz")), named([("y", 1), ("x", 0), ("ram", 2)]));
    }

    #[test]
    fn a_description_holds_each_axis_once_with_its_stroke_and_no_sign_that_ends_it() {
        let machine = Machine { name: "a\"b<c>&".to_owned(), ..shipped("bridge_xyz") };
        let text = urdf(&machine);
        assert!(text.contains("<robot name=\"a&quot;b&lt;c&gt;&amp;\">"), "{text}");
        for (axis, upper) in [("x", "0.8"), ("y", "0.6"), ("z", "0.6")] {
            assert_eq!(text.matches(&format!("<joint name=\"{axis}\" type=\"prismatic\">")).count(), 1);
            assert!(text.contains(&format!("lower=\"0\" upper=\"{upper}\"")), "{text}");
        }
    }

    #[test]
    fn stations_stand_where_the_model_has_them_and_the_reference_where_errors_are_zero() {
        let mut machine = shipped("bridge_xyz");
        machine.stroke_m[2] = (-0.6, 0.0);
        let station = Station { name: "S1".to_owned(), position_m: [0.1, -0.2, 0.3].into(), dead_path_m: 0.5 };
        let found = standing_frames(&machine, &[station]);
        let names: Vec<_> = found.iter().map(|frame| frame.child_frame_id.as_str()).collect();
        let root = &machine.frame_id;
        assert_eq!(names, [format!("{root}/table"), format!("{root}/reference"), format!("{root}/station/S1")]);
        assert_eq!(found[1].transform.translation, [0.0, 0.0, -0.6].into());
        assert_eq!(found[2].transform.translation, [0.1, -0.2, 0.3].into());
    }
}
