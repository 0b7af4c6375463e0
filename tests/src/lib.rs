//! Whole-system tests: invariants, replay, interop, faults.
