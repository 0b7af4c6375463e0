//! Chain of linear axes as data, error functions, effects, and the one function that corrects a coordinate.
