//! What straight lines between nodes do to the parameters that are fitted with them.
//!
//! Place in the flow: the last step of both fits. A reading between nodes sees the function depart from its chord
//! ([`BetweenNodes`]), and the fit takes that for something else. Departures b of covariance S that are considered, not
//! estimated, add the covariance A S Aᵀ, A = (JᵀWJ + P)⁻¹ JᵀWB, B the partials by b (consider covariance: Tapley, Schutz and
//! Born 2004, Statistical Orbit Determination, section 6.2). Readings at nodes have B = 0.

use abbe_geometry::between_nodes::BetweenNodes;
use abbe_geometry::model::packed;
use faer::Mat;

/// JᵀWB, summed row by row.
pub(crate) struct Chords {
    /// Parameters × departures.
    shared: Mat<f64>,
}

impl Chords {
    /// Nothing yet, for so many parameters.
    pub(crate) fn new(parameters: usize, between_nodes: &BetweenNodes) -> Chords {
        Chords { shared: Mat::zeros(parameters, between_nodes.len()) }
    }

    /// Adds what one reading says: partial by a parameter, by a departure, and the weight.
    pub(crate) fn add(&mut self, parameter: usize, departure: usize, weighted_product: f64) {
        self.shared[(parameter, departure)] += weighted_product;
    }

    /// A S Aᵀ as a packed lower triangle over `size` parameters, of which `free` were fitted; `inverse` is (JᵀWJ + P)⁻¹ of
    /// these. Empty where no reading lies between nodes.
    pub(crate) fn packed(
        &self,
        between_nodes: &BetweenNodes,
        (free, inverse): (&[usize], &Mat<f64>),
        size: usize,
    ) -> Vec<f64> {
        let seen = |k: &usize| free.iter().any(|index| self.shared[(*index, *k)] != 0.0);
        let departures: Vec<usize> = (0..between_nodes.len()).filter(seen).collect();
        if departures.is_empty() {
            return Vec::new();
        }
        let scaled = Mat::from_fn(free.len(), departures.len(), |i, k| {
            self.shared[(free[i], departures[k])] * between_nodes.variance(departures[k]).sqrt()
        });
        let moved = inverse * scaled;
        let added = &moved * moved.transpose();
        let mut triangle = vec![0.0; size * (size + 1) / 2];
        for (i, row) in free.iter().enumerate() {
            for (j, column) in free.iter().enumerate().take(i + 1) {
                triangle[packed(*row, *column)] = added[(i, j)];
            }
        }
        triangle
    }
}
