//! Figures of the standards for coordinate measuring machines and machine tools.
//!
//! Place in the flow: measured deviations in, the figures that ISO 10360 and ISO 230 define out.
