//! A node tells a real ROS 2 what its messages are made of: `~/get_type_description`.

use abbe_msgs::{definition, type_description};

use super::*;

#[test]
fn val_rclpy_asks_a_node_what_its_messages_are_and_finds_the_hash_of_what_it_is_told() {
    const OTHER: &str = "sensor_msgs/msg/JointState";
    let test = "ros2::descriptions::val_rclpy_asks_a_node_what_its_messages_are_and_finds_the_hash_of_what_it_is_told";
    in_own_network(test, |domain| {
        let node = format!("/{NAMESPACE}/residual");
        let kinds = ["abbe_msgs/msg/CorrectedCoordinates", "geometry_msgs/msg/PointStamped"];
        let Some(user) = ros2(domain, &["describe", &node, OTHER, kinds[0], kinds[1]]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        assert_says(heard["other"]["reason"].as_str().unwrap(), &[OTHER, "neither publishes nor takes"]);
        for kind in kinds {
            let (heard, hash) = (&heard[kind], type_description::hash(kind).unwrap());
            assert_eq!(heard["first"]["hash"], json!(hash), "by the generator of ROS 2");
            assert_eq!(heard["by hash"]["hash"], json!(hash));
            let fields: Vec<_> = definition::fields(kind).unwrap().into_iter().map(|field| field.name).collect();
            assert_eq!(heard["first"]["fields"], json!(fields));
            assert_eq!(heard["first"]["sources"][kind], json!(["msg", definition::text(kind)]));
            assert_eq!(heard["by hash"]["sources"], json!({}));
            assert_says(heard["wrong hash"]["reason"].as_str().unwrap(), &[kind, &hash, "not 'RIHS01_"]);
        }
    });
}
