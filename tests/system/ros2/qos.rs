//! Quality of service as a real ROS 2 finds it: what overrides make of it, and what a bag says of it.

use abbe_msgs::bag::messages;

use super::*;

#[test]
fn val_rclpy_finds_best_effort_on_the_topics_whose_overrides_say_so_and_reliable_on_others() {
    let test = "ros2::qos::val_rclpy_finds_best_effort_on_the_topics_whose_overrides_say_so_and_reliable_on_others";
    in_own_network(test, |domain| {
        let [reading, joints, corrected, point] =
            ["scale/reading", "scale/joint_states", "corrected", "corrected_point"].map(topic);
        let Some(user) = ros2(domain, &["offers", &reading, &joints, &corrected, &point]) else { return };
        let bench = Bench::identified(5);
        let file = endless_stream_of(&bench, |launch| launch.edge("scale", "*", DDS).edge("residual", "*", DDS));
        let argument = format!("residual:qos_overrides.{point}.publisher.reliability:=best_effort");
        let parameters = format!(
            "/{NAMESPACE}/scale:\n  ros__parameters:\n    qos_overrides:\n      {joints}:\n        publisher:\n          \
             reliability: best_effort\n"
        );
        let parameters = bench.write("parameters.yaml", parameters);
        let words = ["launch", &file, "--ros-args", "-p", &argument, "--params-file", &parameters];
        let heard = beside(Started::start(abbe_in(domain, words)), user);
        for (topic, reliability) in
            [(reading, "RELIABLE"), (joints, "BEST_EFFORT"), (corrected, "RELIABLE"), (point, "BEST_EFFORT")]
        {
            assert_eq!(heard[&topic], json!([[reliability, "VOLATILE"]]), "{topic}");
        }
    });
}

/// As `ros2 bag play` offers it again.
#[test]
fn val_rclpy_a_bag_says_what_was_offered_and_subscribers_of_either_kind_take_what_is_played_so() {
    let test = "ros2::qos::val_rclpy_a_bag_says_what_was_offered_and_subscribers_of_either_kind_take_what_is_played_so";
    in_own_network(test, |domain| {
        let corrected = topic("corrected");
        let Some(user) = ros2(domain, &["offers", &corrected]) else { return };
        let bench = Bench::identified(5);
        let heard = beside(graph(&bench, domain), user);
        let first = messages(bench.path("recorded")).unwrap().next().unwrap().unwrap();
        assert_eq!(first.topic(), corrected);
        let played = said(ros2(domain, &["plays", &first.channel().offered_qos_profiles]).unwrap());
        assert_eq!(heard[&corrected], json!([played["offered"]]));
    });
}
