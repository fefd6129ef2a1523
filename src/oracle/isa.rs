//! The instruction sets that Embree can be made to trace with.

use std::fmt;

/// An instruction set of x86-64 for which Embree has kernels of its own, from the oldest to the newest.
///
/// Its approximate reciprocal differs between them, and with it the last bits of t, u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Isa {
    Sse2,
    #[value(name = "sse4.2")]
    Sse42,
    Avx,
    Avx2,
    Avx512,
}

impl Isa {
    pub const ALL: [Isa; 5] = [Isa::Sse2, Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512];

    /// The device's configuration, in Embree's notation.
    pub fn config(self) -> &'static str {
        match self {
            Isa::Sse2 => "isa=sse2",
            Isa::Sse42 => "isa=sse4.2",
            Isa::Avx => "isa=avx",
            Isa::Avx2 => "isa=avx2",
            Isa::Avx512 => "isa=avx512",
        }
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Isa::Sse2 => "SSE2",
            Isa::Sse42 => "SSE4.2",
            Isa::Avx => "AVX",
            Isa::Avx2 => "AVX2",
            Isa::Avx512 => "AVX-512",
        })
    }
}
