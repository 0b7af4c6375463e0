//! What a residual model predicts with.
//!
//! Place in the flow: part of every model and record; the table of what each kind does heads [`crate::ResidualModel`]'s file.

/// What predicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Kriging alone.
    Kriging,
    /// The network alone.
    Network,
    /// Kriging, and the network on what it leaves.
    KrigingNetwork,
    /// A network on the position, and kriging of what it leaves.
    PerceptronKriging,
}

impl Kind {
    /// All of them, the simplest first.
    pub const ALL: [Kind; 4] = [Kind::Kriging, Kind::Network, Kind::KrigingNetwork, Kind::PerceptronKriging];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Kriging => "kriging",
            Kind::Network => "network",
            Kind::KrigingNetwork => "kriging-network",
            Kind::PerceptronKriging => "perceptron-kriging",
        }
    }

    /// Whether it has networks on the neighbourhood.
    pub fn has_attention(self) -> bool {
        matches!(self, Kind::Network | Kind::KrigingNetwork)
    }

    /// Whether it has networks on the position.
    pub fn has_trend(self) -> bool {
        self == Kind::PerceptronKriging
    }

    /// Whether it has any network.
    pub fn has_network(self) -> bool {
        self.has_attention() || self.has_trend()
    }
}
