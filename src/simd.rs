//! The instruction set, chosen once for the whole run.

use crate::error::{Error, Result};
use fearless_simd::Level;
use std::sync::OnceLock;

/// Names of instruction sets that [`VARIABLE`] may ask for.
const NAMES: [&str; 3] = ["avx512", "avx2", "portable"];

/// Asks for an instruction set, to test or to time it. Every one gives the same bits.
const VARIABLE: &str = "ISOLUX_SIMD";

/// The best instruction set that the processor has, or the one that `ISOLUX_SIMD` asks for.
///
/// # Errors
/// If the variable holds an unknown name or the processor lacks what it asks for.
pub(crate) fn level() -> Result<Level> {
    static ASKED: OnceLock<Option<String>> = OnceLock::new();
    let asked = ASKED
        .get_or_init(|| std::env::var_os(VARIABLE).map(|name| name.to_string_lossy().into_owned()));
    match asked {
        None => Ok(Level::new()),
        Some(name) => level_of(name),
    }
}

/// [`level`], where that has been asked before.
///
/// # Panics
/// If `ISOLUX_SIMD` asks for an instruction set that there is not.
pub(crate) fn chosen() -> Level {
    level().expect("an instruction set that there is")
}

/// The usual name of an instruction set.
pub(crate) fn name(level: Level) -> &'static str {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512(_) => "AVX-512",
        #[cfg(target_arch = "x86_64")]
        Level::Avx2(_) => "AVX2",
        _ => "portable",
    }
}

/// The instruction set of that name.
pub(crate) fn level_of(name: &str) -> Result<Level> {
    let level = match name {
        "portable" => Some(Level::baseline()),
        #[cfg(target_arch = "x86_64")]
        "avx2" => Level::new().as_avx2().map(Level::Avx2),
        #[cfg(target_arch = "x86_64")]
        "avx512" => Some(Level::new()).filter(|level| matches!(level, Level::Avx512(_))),
        _ if NAMES.contains(&name) => None,
        _ => {
            return Err(Error::new(format!(
                "{VARIABLE} is \"{name}\", which is no instruction set"
            ))
            .remedy(format!("set it to {}, or not at all", NAMES.join(", "))));
        }
    };
    level.ok_or_else(|| {
        Error::new(format!("{VARIABLE} asks for {name}, which this processor does not have"))
            .remedy("set it to portable, or not at all")
    })
}
