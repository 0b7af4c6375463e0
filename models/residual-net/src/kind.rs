//! What a residual model predicts with.
//!
//! Place in the flow: part of every model and record; the table of what each kind does heads [`crate::ResidualModel`]'s file.

/// What predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ResidualMethod {
    /// Kriging alone.
    Kriging,
    /// The network alone.
    Network,
    /// Kriging, and the network on what it leaves.
    KrigingNetwork,
    /// A network on the position, and kriging of what it leaves.
    PerceptronKriging,
}

impl ResidualMethod {
    /// All of them, the simplest first.
    pub const ALL: [ResidualMethod; 4] = [
        ResidualMethod::Kriging,
        ResidualMethod::Network,
        ResidualMethod::KrigingNetwork,
        ResidualMethod::PerceptronKriging,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            ResidualMethod::Kriging => "kriging",
            ResidualMethod::Network => "network",
            ResidualMethod::KrigingNetwork => "kriging-network",
            ResidualMethod::PerceptronKriging => "perceptron-kriging",
        }
    }

    /// Whether it has networks on the neighbourhood.
    pub fn has_attention(self) -> bool {
        matches!(self, ResidualMethod::Network | ResidualMethod::KrigingNetwork)
    }

    /// Whether it has networks on the position.
    pub fn has_trend(self) -> bool {
        self == ResidualMethod::PerceptronKriging
    }

    /// Whether it has any network.
    pub fn has_network(self) -> bool {
        self.has_attention() || self.has_trend()
    }
}
