//! Seeded simulator of machine, instrument and environment.
