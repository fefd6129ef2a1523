//! Keeps a small file from asking for more memory than there is.

use crate::error::Result;
use crate::memory;

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
            memory::check("the model", self.unasked, memory::available(), remedy)?;
            self.unasked = 0;
        }
        Ok(())
    }
}
