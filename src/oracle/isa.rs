//! The instruction sets that Embree can be made to trace with.

use super::Device;
use std::fmt;

/// An instruction set of x86-64 for which Embree has kernels of its own, from the oldest to the newest.
///
/// Its approximate reciprocal differs between them, and with it the last bits of t, u and v.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Isa {
    Sse2,
    Sse42,
    Avx,
    Avx2,
    Avx512,
}

impl Isa {
    pub const ALL: [Isa; 5] = [Isa::Sse2, Isa::Sse42, Isa::Avx, Isa::Avx2, Isa::Avx512];

    /// The sets that both the processor and the installed library have. Embree refuses a device of any
    /// other.
    pub fn available() -> Vec<Isa> {
        Isa::ALL.into_iter().filter(|isa| Device::new(isa.config()).is_ok()).collect()
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_x86_64_processor_has_the_oldest_and_the_default_is_the_newest() {
        let available = Isa::available();
        assert_eq!(available.first(), Some(&Isa::Sse2));
        assert!(available.is_sorted());
        assert_eq!(Device::new("").unwrap().isa(), available.last().copied());
    }
}
