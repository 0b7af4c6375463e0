//! Trains the residual network and judges it against its rivals on the same data.
//!
//! Place in the flow: measured residual vectors in, a trained network out.
