//! Form factors: F_ij, the fraction of the light leaving patch i that arrives at patch j.
//!
//! Two estimators by Monte Carlo integration: [`pairs`] samples points on both patches and keeps
//! one symmetric number per pair, [`hemisphere`] sends cosine-distributed rays from each patch and
//! keeps what they hit. [`direct`] estimates the light that arrives straight from the emitters.

pub mod direct;
mod exchange;
pub mod hemisphere;
pub mod pairs;
mod spherical;

use crate::color::Rgb64;
use crate::geometry::RayCaster;
use crate::patches::{PatchId, PatchMesh};
use crate::progress::Progress;
use crate::sampling::PointSet;
pub use exchange::ExchangeMatrix;
pub use hemisphere::HemisphereRows;
use std::sync::atomic::{AtomicU64, Ordering};

/// Inputs of every estimate: the ray caster, the patches, the number of samples and the seed.
pub struct Estimator<'a, C> {
    pub caster: &'a C,
    pub mesh: &'a PatchMesh,
    /// Samples per pair, or rays per row.
    pub samples: u32,
    pub points: PointSet,
    pub seed: u64,
    pub progress: &'a dyn Progress,
    rays: AtomicU64,
}

impl<'a, C: RayCaster> Estimator<'a, C> {
    /// # Panics
    /// If `samples` is zero, or not a square while `points` is [`PointSet::Regular`].
    pub fn new(
        caster: &'a C,
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

    fn count_rays(&self, rays: usize) {
        self.rays.fetch_add(rays as u64, Ordering::Relaxed);
    }
}

/// A stored matrix of form factors.
pub enum FormFactors {
    /// One number for F_ij and F_ji.
    Exchange(ExchangeMatrix),
    /// Rows of hits.
    Rows(HemisphereRows),
}

/// How far a matrix is from what form factors must obey. Raw: nothing was corrected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defects {
    /// The largest |Σ_j F_ij − 1|. In an open scene rows rightly sum to less than 1.
    pub row_sum: f64,
    /// The largest |A_i F_ij − A_j F_ji| / min(A_i, A_j).
    pub reciprocity: f64,
}

impl FormFactors {
    /// Number of patches.
    pub fn len(&self) -> usize {
        match self {
            FormFactors::Exchange(matrix) => matrix.len(),
            FormFactors::Rows(rows) => rows.len(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Calls `entry(j, F_ij)` for the entries of row i above zero; a j may come more than once.
    #[inline]
    pub fn for_each_in_row(&self, i: PatchId, entry: impl FnMut(usize, f64)) {
        match self {
            FormFactors::Exchange(matrix) => matrix.for_each_in_row(i, entry),
            FormFactors::Rows(rows) => rows.for_each_in_row(i, entry),
        }
    }

    /// Σ_j F_ij B_j: the irradiance at patch i.
    #[inline]
    pub fn gather_row(&self, i: PatchId, radiosity: &[Rgb64]) -> Rgb64 {
        match self {
            FormFactors::Exchange(matrix) => matrix.gather_row(i, radiosity),
            FormFactors::Rows(rows) => rows.gather_row(i, radiosity),
        }
    }

    /// [`gather_row`](Self::gather_row) for every patch, in parallel.
    pub fn gather(&self, radiosity: &[Rgb64]) -> Vec<Rgb64> {
        use rayon::prelude::*;
        (0..self.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| self.gather_row(PatchId(i as u32), radiosity))
            .collect()
    }

    /// Σ_j F_ij for every patch.
    pub fn row_sums(&self) -> Vec<f64> {
        use rayon::prelude::*;
        (0..self.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| {
                let mut sum = 0.0;
                self.for_each_in_row(PatchId(i as u32), |_, factor| sum += factor);
                sum
            })
            .collect()
    }

    /// The share of each patch's light that ends on black backs; `None` where that is not known apart.
    pub fn on_backs(&self) -> Option<Vec<f64>> {
        match self {
            FormFactors::Exchange(_) => None,
            FormFactors::Rows(rows) => Some(rows.on_backs()),
        }
    }

    /// `row_sums` as [`FormFactors::row_sums`] gives them.
    pub fn defects(&self, row_sums: &[f64]) -> Defects {
        Defects {
            row_sum: row_sum_defect(row_sums),
            reciprocity: match self {
                // One stored number serves both directions.
                FormFactors::Exchange(_) => 0.0,
                FormFactors::Rows(rows) => rows.reciprocity_defect(),
            },
        }
    }
}

/// The largest |Σ_j F_ij − 1|.
pub fn row_sum_defect(row_sums: &[f64]) -> f64 {
    row_sums.iter().map(|sum| (sum - 1.0).abs()).fold(0.0, f64::max)
}

/// One row of form factors.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Row {
    /// The entries (j, F_ij) above zero.
    pub entries: Vec<(PatchId, f64)>,
    /// The share of the patch's light that ends on black backs; `None` where an estimate cannot tell it
    /// from what leaves the scene.
    pub on_backs: Option<f64>,
}

impl Row {
    /// Σ_j F_ij.
    pub fn sum(&self) -> f64 {
        self.entries.iter().map(|(_, factor)| factor).sum()
    }
}

/// One row, computed when it is asked for: what shooting needs instead of a matrix.
pub trait RowSource: Sync {
    /// Row i.
    fn row(&self, i: PatchId) -> Row;
}
