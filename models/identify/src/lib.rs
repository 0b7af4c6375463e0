//! Identification of the machine model from a tracer campaign.
