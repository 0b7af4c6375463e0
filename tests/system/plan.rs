//! A placeholder that the build needs.
