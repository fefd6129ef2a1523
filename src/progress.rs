//! The progress of a long computation, and a way to stop it.

/// A step of a run that can take long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    DirectLight,
    FormFactors,
    /// Iterations on a stored matrix.
    Solve,
    /// Shots of light, with rows on demand.
    Shots,
    /// The search for patches that others cover.
    Coverage,
    /// The light of each patch, gathered from the elements.
    Patches,
    /// How far the light is from the truth, at most.
    Certificate,
    Render,
    Verify,
    Bench,
}

/// Receives the progress of a computation, from any thread, and can ask it to stop. `()` ignores it.
pub trait Progress: Sync {
    /// A stage begins. `amount`: how much there is to do, where that is known.
    fn begin(&self, stage: Stage, amount: Option<u64>);

    /// This much more of the stage is done.
    fn advance(&self, amount: u64);

    /// The stage is over.
    fn end(&self);

    /// A picture that becomes better round by round has at present this error:
    /// see [`Image::relative_error`](crate::render::Image::relative_error).
    fn estimate(&self, error: f32) {
        let _ = error;
    }

    /// Whether to give up: the computation returns an error of kind
    /// [`Stopped`](crate::error::ErrorKind::Stopped) soon after.
    fn is_stopped(&self) -> bool {
        false
    }

    /// Whether to end with what there is: a picture that becomes better round by round ends with those that it has,
    /// once it has one. Once true it stays true.
    fn is_enough(&self) -> bool {
        false
    }
}

impl Progress for () {
    fn begin(&self, _: Stage, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn end(&self) {}
}
