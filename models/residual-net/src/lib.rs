//! The residual network as it runs live and offline.
//!
//! Place in the flow: trained parameters in, residual of a point (m, machine frame) with its uncertainty out.
