//! Matrices that are estimated in stretches, so that what is done of a long estimate can be kept.

use super::Estimator;
use crate::error::{Error, Result};
use crate::progress::Stage;

/// A matrix of which some of its rows, or tiles, are there.
pub(crate) trait InStretches {
    /// How many are there, and how many there will be.
    fn amounts(&self) -> [usize; 2];

    /// Adds some, and tells the estimator's progress of them. Once that is to stop, they may be anything.
    fn add(&mut self, of: &Estimator);

    /// Forgets all but the first `done`.
    fn take_back(&mut self, done: usize);
}

impl Estimator<'_> {
    /// Adds what a matrix lacks. After each stretch, and before `progress` stops it, `keep` may store what is there.
    ///
    /// # Errors
    /// What `keep` says; or `progress` asked to stop.
    pub(crate) fn in_stretches<M: InStretches>(
        &self,
        matrix: &mut M,
        keep: &mut dyn FnMut(&M) -> Result<()>,
    ) -> Result<()> {
        let [mut done, all] = matrix.amounts();
        self.progress.begin(Stage::FormFactors, Some(all as u64));
        self.progress.advance(done as u64);
        while done < all {
            let rays = self.rays();
            matrix.add(self);
            let is_stopped = self.progress.is_stopped();
            if is_stopped {
                matrix.take_back(done);
                self.set_rays(rays);
            }
            keep(matrix)?;
            if is_stopped {
                self.progress.end();
                return Err(Error::stopped());
            }
            [done, _] = matrix.amounts();
        }
        self.progress.end();
        Ok(())
    }
}
