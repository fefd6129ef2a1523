//! The transport of light: what each patch receives, given what each sends.

use crate::color::Rgb64;
use crate::patches::PatchId;
use crate::sampling::EIGHTHS;
use rayon::prelude::*;

/// H = F B: all that Jacobi's method asks for. A new way to carry light implements this.
pub trait Transport: Send + Sync {
    /// Number of patches.
    fn len(&self) -> usize;

    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// H_i = Σ_j F_ij B_j in W·m⁻² for every patch, from B in W·m⁻².
    fn gather(&self, radiosity: &[Rgb64]) -> Vec<Rgb64>;

    /// F by eighths of its samples; `None` where these are not random, or not known apart.
    fn eighths(&self) -> Option<&dyn Eighths> {
        None
    }

    /// F row by row, for the methods that go patch by patch; `None` where only sums can be had.
    fn rows(&self) -> Option<&dyn Rows>;

    /// The largest |A_i F_ij − A_j F_ji| / min(A_i, A_j); `None` where it is not known.
    fn reciprocity_defect(&self) -> Option<f64>;
}

/// F by eighths of its samples, from which its error is known.
pub trait Eighths {
    /// What each patch receives by each eighth of its samples, given what each patch sends.
    fn apart(&self, radiosity: &[f32]) -> Vec<[f32; EIGHTHS]>;

    /// What each patch receives by all its samples, given what each patch sends in eight cases.
    fn together(&self, radiosity: &[[f32; EIGHTHS]]) -> Vec<[f32; EIGHTHS]>;
}

/// F, a row at a time: stored, or estimated when it is asked for.
pub trait Rows: Sync {
    /// Row i. A j comes once.
    fn row(&self, i: PatchId) -> Row;

    /// The rows of these patches, in their order, in parallel.
    fn rows_of(&self, patches: &[PatchId]) -> Vec<Row> {
        patches.par_iter().map(|&i| self.row(i)).collect()
    }

    /// Calls `entry(j, F_ij)` for the entries of row i above zero; a j may come more than once.
    fn for_each_in_row(&self, i: PatchId, entry: &mut dyn FnMut(usize, f64)) {
        self.row(i).entries.iter().for_each(|&(j, factor)| entry(j.index(), factor));
    }

    /// Σ_j F_ij B_j: the irradiance at patch i.
    fn gather_row(&self, i: PatchId, radiosity: &[Rgb64]) -> Rgb64 {
        let entries = self.row(i).entries;
        entries.iter().map(|&(j, factor)| radiosity[j.index()] * factor).sum()
    }

    /// The share of patch i's light that ends on black backs; `None` where that is not known apart.
    fn on_backs(&self, i: PatchId) -> Option<f64> {
        self.row(i).on_backs
    }
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

/// Σ_j F_ij for the first `count` rows.
pub fn row_sums(rows: &dyn Rows, count: usize) -> Vec<f64> {
    let sum = |i| {
        let mut sum = 0.0;
        rows.for_each_in_row(i, &mut |_, factor| sum += factor);
        sum
    };
    for_each_patch(count, sum)
}

/// The largest |Σ_j F_ij − 1|. In an open scene rows rightly sum to less than 1.
pub fn row_sum_defect(row_sums: &[f64]) -> f64 {
    row_sums.iter().map(|sum| (sum - 1.0).abs()).fold(0.0, f64::max)
}

/// [`Transport::gather`] by rows, in parallel.
pub(super) fn gather_rows(rows: &dyn Rows, radiosity: &[Rgb64]) -> Vec<Rgb64> {
    for_each_patch(radiosity.len(), |i| rows.gather_row(i, radiosity))
}

fn for_each_patch<T: Send>(count: usize, make: impl Fn(PatchId) -> T + Sync) -> Vec<T> {
    (0..count as u32).into_par_iter().with_min_len(64).map(|i| make(PatchId(i))).collect()
}
