//! Transports (shared memory, DDS, in-process) and the ROS 2 runtime that every node shares.
