//! The widest vector registers that the processor has.
//!
//! Place in the flow: around the loops of a prediction. The program is built for any x86-64, whose registers hold two numbers;
//! inside [`wide`] the same operations run in the same order on four or eight at once where the processor can. Nothing is
//! contracted or reordered, so the bits are those of the plain loop. Measured with `benches/network.rs` of the training crate.

use pulp::{Arch, Simd, WithSimd};

/// Loops that can be compiled for several kinds of registers.
pub(crate) trait Loops {
    /// What they compute.
    type Output;

    /// Runs them. Must be inlined, with all that it calls (`#[inline(always)]`): a function apart keeps the narrow registers.
    fn run(self) -> Self::Output;
}

/// Runs loops compiled for the registers that this processor has.
#[inline(always)]
pub(crate) fn wide<L: Loops>(loops: L) -> L::Output {
    Arch::new().dispatch(Inlined(loops))
}

struct Inlined<L>(L);

impl<L: Loops> WithSimd for Inlined<L> {
    type Output = L::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> L::Output {
        self.0.run()
    }
}
