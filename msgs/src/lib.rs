//! ROS 2 messages, shared-memory samples, CDR, and rosbag2-readable MCAP bags.
