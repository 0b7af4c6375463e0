//! The quality of service that a recorded topic was offered with.
//!
//! Place in the flow: written with each channel and, equal to it, into `metadata.yaml`: some
//! readers match the two and yield no message when they differ. `ros2 bag play` offers it again.

/// Quality of service of a topic, as far as this project chooses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Qos {
    /// Whether lost samples are sent again.
    pub reliable: bool,
    /// Whether late subscribers receive the last samples.
    pub transient_local: bool,
    /// How many samples are kept for that.
    pub depth: u32,
}

impl Qos {
    /// Streams: reliable, as nodes offer them, so that subscribers of either kind match; volatile, the last ten samples.
    pub const STREAM: Self = Self { reliable: true, transient_local: false, depth: 10 };

    /// Values that late subscribers need: reliable, transient local, the last sample.
    pub const LATCHED: Self = Self { reliable: true, transient_local: true, depth: 1 };

    /// The profile as rosbag2 writes it up to metadata version 8: YAML inside a string, with the
    /// numbers of the ROS middleware interface (`rmw/types.h`); times of zero mean unspecified.
    pub(super) fn to_yaml(self) -> String {
        const KEEP_LAST: u32 = 1;
        const LIVELINESS_AUTOMATIC: u32 = 1;
        let (reliable, best_effort) = (1, 2);
        let (transient_local, volatile) = (1, 2);
        let reliability = if self.reliable { reliable } else { best_effort };
        let durability = if self.transient_local { transient_local } else { volatile };
        let depth = self.depth;
        format!(
            "- history: {KEEP_LAST}\n  depth: {depth}\n  reliability: {reliability}\n  \
             durability: {durability}\n  deadline:\n    sec: 0\n    nsec: 0\n  lifespan:\n    \
             sec: 0\n    nsec: 0\n  liveliness: {LIVELINESS_AUTOMATIC}\n  \
             liveliness_lease_duration:\n    sec: 0\n    nsec: 0\n  \
             avoid_ros_namespace_conventions: false"
        )
    }
}
