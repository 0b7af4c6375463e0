//! What can be wrong with a message: text, covariates, numbers, statuses, stamps.
//!
//! Place in the flow: returned wherever a value enters from outside (DDS, bag, driver). Each error
//! names the field and says what to do; none is repaired in silence.

use thiserror::Error;

/// A text that does not fit the fixed-size sample.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TextError {
    /// Longer than the sample has room for.
    #[error("text of {bytes} bytes is longer than {capacity}; shorten it: it is not cut off here")]
    TooLong {
        /// Length of the text in bytes of UTF-8.
        bytes: usize,
        /// Room in the sample in bytes.
        capacity: usize,
    },
    /// A NUL inside the text, which readers written in C would take for its end.
    #[error("text contains a NUL at byte {at}; remove it")]
    ContainsNul {
        /// Byte offset of the first NUL.
        at: usize,
    },
    /// The bytes in memory are not a text (only from memory that another program wrote).
    #[error("text in memory is malformed; the sender runs another version, restart all nodes")]
    Malformed,
}

/// A covariate that the table cannot take.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CovariateError {
    /// The table is full.
    #[error("more than {capacity} covariates; leave out those that no effect of the model needs")]
    Full {
        /// Entries the table has room for.
        capacity: usize,
    },
    /// No name.
    #[error("a covariate has an empty name; name it with its unit as suffix (temp_scale_x_c)")]
    EmptyName,
    /// The name does not fit.
    #[error("covariate name '{name}': {source}")]
    Name {
        /// The name as it came.
        name: String,
        /// What is wrong with it.
        source: TextError,
    },
    /// The same name twice.
    #[error("covariate '{name}' occurs twice; send each name once")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// Value or age is NaN or infinite.
    #[error("covariate '{name}': {what} is {number}; leave a missing covariate out instead")]
    NotFinite {
        /// The name.
        name: String,
        /// `value` or `age_s`.
        what: &'static str,
        /// The number as it came.
        number: f64,
    },
    /// The three parallel lists of the message differ in length.
    #[error(
        "covariate_names, covariate_values and covariate_age_s have {names}, {values} and {ages} \
         entries; they must be equally long"
    )]
    Lengths {
        /// Entries of `covariate_names`.
        names: usize,
        /// Entries of `covariate_values`.
        values: usize,
        /// Entries of `covariate_age_s`.
        ages: usize,
    },
}

/// A message that must not be used, and why.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MessageError {
    /// A text field.
    #[error("field {field}: {source}")]
    Text {
        /// Name of the field in the `.msg` file.
        field: &'static str,
        /// What is wrong with it.
        source: TextError,
    },
    /// The covariates.
    #[error(transparent)]
    Covariate(#[from] CovariateError),
    /// A number that is NaN or infinite.
    #[error("field {field} is {number}, which is not a finite number; correct the sender")]
    NotFinite {
        /// Name of the field in the `.msg` file.
        field: &'static str,
        /// The number as it came.
        number: f64,
    },
    /// A standard uncertainty below zero.
    #[error("field {field} is {number}; a standard uncertainty is zero or more, correct the sender")]
    NegativeUncertainty {
        /// Name of the field in the `.msg` file.
        field: &'static str,
        /// The number as it came.
        number: f64,
    },
    /// A status that the `.msg` file does not name.
    #[error(
        "status {value} of {message} is not known (0 to {highest} are); the sender runs a newer \
         version, update this one"
    )]
    UnknownStatus {
        /// Name of the message.
        message: &'static str,
        /// The status as it came.
        value: u8,
        /// Highest known status.
        highest: u8,
    },
    /// Nanoseconds of a stamp not below one second.
    #[error("stamp has {nanosec} nanoseconds; it must be below 1000000000, correct the sender")]
    StampNanoseconds {
        /// The nanoseconds as they came.
        nanosec: u32,
    },
    /// An instant that the stamp of ROS 2 (32-bit seconds) cannot hold.
    #[error("the instant {seconds} s does not fit a ROS 2 stamp (-2147483648 s to 2147483647 s)")]
    StampRange {
        /// The instant in seconds.
        seconds: f64,
    },
    /// An instant that a bag cannot hold.
    #[error("the instant {seconds} s is before 0 (1970), from which a bag counts; correct the clock, or begin at 0")]
    LogTime {
        /// The instant in seconds.
        seconds: f64,
    },
    /// Two fields that contradict each other.
    #[error("{field} contradicts status {status}: {reason}; correct the sender")]
    Contradiction {
        /// Name of the field in the `.msg` file.
        field: &'static str,
        /// The status, by the name of its constant.
        status: &'static str,
        /// Why the two cannot stand together.
        reason: &'static str,
    },
}
