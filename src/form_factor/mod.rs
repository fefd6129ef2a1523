//! Form factors: F_ij, the fraction of the light leaving patch i that arrives at patch j.
//!
//! Two estimators by Monte Carlo integration: [`pairs`] samples points on both patches and keeps
//! one symmetric number per pair, [`hemisphere`] sends cosine-distributed rays from each patch and
//! keeps what they hit.

mod exchange;
pub mod hemisphere;
mod matrix;
pub mod pairs;
mod spherical;
mod stretches;
mod transport;

use crate::geometry::RayCaster;
use crate::patches::PatchMesh;
use crate::progress::Progress;
use crate::sampling::PointSet;
pub use exchange::ExchangeMatrix;
pub use hemisphere::HemisphereRows;
pub(crate) use matrix::Matrix;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU64, Ordering};
pub use transport::{Eighths, Row, Rows, Transport, row_sum_defect, row_sums};

/// Inputs of every estimate: the ray caster, the patches, the number of samples and the seed.
pub struct Estimator<'a> {
    pub caster: &'a dyn RayCaster,
    pub mesh: &'a PatchMesh,
    /// Samples per pair, or rays per row.
    pub samples: u32,
    pub points: PointSet,
    pub seed: u64,
    pub progress: &'a dyn Progress,
    rays: AtomicU64,
}

impl<'a> Estimator<'a> {
    /// # Panics
    /// If `samples` is zero, or not a square while `points` is [`PointSet::Regular`].
    pub fn new(
        caster: &'a dyn RayCaster,
        mesh: &'a PatchMesh,
        samples: u32,
        points: PointSet,
        seed: u64,
        progress: &'a dyn Progress,
    ) -> Self {
        assert!(samples > 0, "an estimate needs at least one sample");
        let side = samples.isqrt();
        assert!(points != PointSet::Regular || side * side == samples, "regular: k² samples");
        Estimator { caster, mesh, samples, points, seed, progress, rays: AtomicU64::new(0) }
    }

    /// Rays traced so far.
    pub fn rays(&self) -> u64 {
        self.rays.load(Ordering::Relaxed)
    }

    /// Counts on from this number.
    pub(crate) fn set_rays(&self, rays: u64) {
        self.rays.store(rays, Ordering::Relaxed);
    }

    pub(crate) fn count_rays(&self, rays: usize) {
        self.rays.fetch_add(rays as u64, Ordering::Relaxed);
    }
}

/// Rows by one of the estimators, each made when it is asked for: what shooting needs instead of a matrix.
/// They are those that the estimator would store, number by number.
pub struct OnDemand<'a, M> {
    of: &'a Estimator<'a>,
    method: PhantomData<fn() -> M>,
}

/// Rows by [`hemisphere`] rays.
pub struct Hemisphere;

/// Rows by samples of [`pairs`].
pub struct Pairs;

impl<'a> OnDemand<'a, Hemisphere> {
    pub fn hemisphere(of: &'a Estimator<'a>) -> Self {
        OnDemand { of, method: PhantomData }
    }
}

impl<'a> OnDemand<'a, Pairs> {
    pub fn pairs(of: &'a Estimator<'a>) -> Self {
        OnDemand { of, method: PhantomData }
    }
}
