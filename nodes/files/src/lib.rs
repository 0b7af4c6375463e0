//! Reading and writing of machine, campaign, model and point files.
