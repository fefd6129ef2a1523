//! Keeps a small file from asking for more memory than there is.

use crate::error::{Error, ErrorKind, Result};
use crate::memory;

/// Refuses what a file asks for, such as "the model", if it needs more bytes than there are.
pub(super) fn check(what: &str, bytes: u64, remedy: &str) -> Result<()> {
    memory::check(what, bytes, memory::available(), remedy).map_err(Error::of_a_file)
}

/// What a default can make up for where a file is to blame. Want of memory is an error wherever it shows.
pub(super) fn but_memory<T>(read: Result<T>) -> Result<Result<T>> {
    match read {
        Err(error) if error.kind() == ErrorKind::Memory => Err(error),
        read => Ok(read),
    }
}

/// Counts bytes that are taken; small files can name large lists many times.
#[derive(Debug, Default)]
pub(super) struct Budget {
    /// Bytes since it was last asked how many there are.
    unasked: u64,
}

impl Budget {
    /// How many bytes are taken without asking.
    const STEP: u64 = 1 << 28;

    /// # Errors
    /// More bytes than there are.
    pub(super) fn take(&mut self, bytes: u64) -> Result<()> {
        self.unasked += bytes;
        if self.unasked > Self::STEP {
            let remedy = "simplify the model, or use a machine with more memory";
            check("the model", self.unasked, remedy)?;
            self.unasked = 0;
        }
        Ok(())
    }
}
