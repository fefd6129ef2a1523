//! Southwell relaxation, known as progressive refinement or shooting.
//!
//! Cohen, Chen, Wallace & Greenberg, *A Progressive Refinement Approach to Fast Radiosity Image
//! Generation*, SIGGRAPH 1988: the patch with the most unshot power sends it into the scene. Only
//! that patch's row is needed, so no matrix is stored. The unshot power is the residual.
//!
//! Here a round chooses the brightest patches, which together hold most of the unshot power, and their
//! rows are traced in parallel. Then they shoot one after the other, each all that is unshot when its
//! turn comes, with what the shots before it sent. So every shot is one of Southwell's, and rounds change
//! only their order: a shooter is one of the brightest patches, instead of the brightest. Neither the
//! choice nor any sum depends on the number of threads.

use super::{Converged, Problem, Stop, cannot_converge, relative};
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::form_factor::{Row, Rows};
use crate::patches::PatchId;
use crate::progress::Progress;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The share of the unshot power that the patches of a round hold. A larger one makes fewer rounds, in
/// which more patches shoot that had better wait for more light.
const SHARE_OF_ROUND: f64 = 0.75;

/// Rows that are traced at a time: enough to keep many threads busy, few enough for the memory.
const ROWS_AT_A_TIME: usize = 256;

/// Between two chances to keep what is done no rows are on their way.
const ROWS_BETWEEN_KEEPS: usize = 16 * ROWS_AT_A_TIME;

pub(super) fn solve(
    problem: &Problem,
    rows: &dyn Rows,
    stop: Stop,
    shots: &mut Shots,
    keep: &mut dyn FnMut(&Shots) -> Result<()>,
    progress: &dyn Progress,
) -> Result<Converged> {
    let mut shooting = Shooting::new(problem, shots);
    while !shooting.is_done(stop)? {
        let mut round = &shooting.next_round(stop)[..];
        while !round.is_empty() {
            let part;
            let begun = shooting.shots.begun;
            (part, round) = round.split_at(round.len().min(ROWS_BETWEEN_KEEPS - begun));
            let (mut done, mut shooters, mut traced) = (0, &[][..], Vec::new());
            let mut is_stopped = false;
            for next in part.chunks(ROWS_AT_A_TIME).chain([&[][..]]) {
                is_stopped = progress.is_stopped();
                // The next rows are traced while the patches before them shoot, unless the run is to stop.
                let (next_traced, is_done) = if is_stopped {
                    (Vec::new(), shooting.shoot_all(shooters, traced, stop))
                } else {
                    let shoot = || shooting.shoot_all(shooters, traced, stop);
                    rayon::join(|| rows.rows_of(next), shoot)
                };
                if is_done? {
                    if is_stopped {
                        // So that these rays are counted whether it stops or not.
                        rows.rows_of(next);
                    }
                    return Ok(shooting.converged());
                }
                done += shooters.len();
                progress.advance(shooters.len() as u64);
                if is_stopped {
                    break;
                }
                (shooters, traced) = (next, next_traced);
            }
            let waiting = part[done..].iter().chain(round);
            shooting.shots.waiting = waiting.map(|patch| patch.0).collect();
            shooting.shots.begun = (begun + done) % ROWS_BETWEEN_KEEPS;
            keep(shooting.shots)?;
            if is_stopped {
                return Err(Error::stopped());
            }
        }
        (shooting.shots.waiting, shooting.shots.begun) = (Vec::new(), 0);
    }
    Ok(shooting.converged())
}

/// The light on its way, per patch. Powers are in W·m⁻² times square units.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Shots {
    /// The power that arrived before the patch's last shot; its reflection has been sent.
    settled: Vec<Rgb64>,
    /// The power that arrived since.
    arrived: Vec<Rgb64>,
    /// Σ_j F_ij of each patch that has shot.
    row_sums: Vec<Option<f64>>,
    on_backs: Vec<Option<f64>>,
    /// Σ_i A_i F_ij over the patches i that have shot.
    reception: Vec<f64>,
    /// The unshot power of all patches.
    left: Rgb64,
    count: usize,
    /// Those of the round that have yet to shoot.
    waiting: Vec<u32>,
    /// Of the patches between two chances to keep what is done, the number of those that have shot.
    begun: usize,
    /// The relative residual after the first shot, and after the last.
    residual: Vec<f64>,
    residuals: Vec<f64>,
    /// Whether no shot so far has lost any light.
    keeps_all: bool,
}

impl Shots {
    /// None by any of n patches.
    pub(crate) fn none(n: usize) -> Shots {
        Shots {
            settled: vec![Rgb64::ZERO; n],
            arrived: vec![Rgb64::ZERO; n],
            row_sums: vec![None; n],
            on_backs: vec![None; n],
            reception: vec![0.0; n],
            left: Rgb64::ZERO,
            count: 0,
            waiting: Vec::new(),
            begun: 0,
            residual: Vec::new(),
            residuals: Vec::new(),
            keeps_all: true,
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Whether they may be those of n patches.
    pub(crate) fn are_possible(&self, n: usize) -> bool {
        let is_power = |power: &Rgb64| power.is_finite() && power.min_element() >= 0.0;
        let is_share = |share: &Option<f64>| share.is_none_or(|share| (0.0..1e3).contains(&share));
        [self.settled.len(), self.arrived.len(), self.row_sums.len()] == [n; 3]
            && [self.on_backs.len(), self.reception.len()] == [n; 2]
            && self.settled.iter().chain(&self.arrived).all(is_power)
            && self.row_sums.iter().chain(&self.on_backs).all(is_share)
            && self.reception.iter().all(|sum| *sum >= 0.0 && sum.is_finite())
            && self.left.is_finite()
            && self.residual.iter().chain(&self.residuals).all(|residual| residual.is_finite())
            && self.residual.len() == self.count.min(2)
            && self.begun < ROWS_BETWEEN_KEEPS
            && self.waiting.iter().all(|&patch| (patch as usize) < n)
    }
}

/// A problem that is solved shot by shot.
struct Shooting<'p> {
    problem: &'p Problem,
    source_power: Rgb64,
    shots: &'p mut Shots,
}

impl<'p> Shooting<'p> {
    fn new(problem: &'p Problem, shots: &'p mut Shots) -> Self {
        let source_power = problem.power(problem.source.iter().copied());
        Shooting { problem, source_power, shots }
    }

    /// The power that patch i has not sent yet: the reflection of what arrived, and before its first shot
    /// its source.
    fn unshot(&self, i: usize) -> Rgb64 {
        let reflected = self.problem.reflectance[i] * self.shots.arrived[i];
        match self.shots.row_sums[i] {
            None => self.problem.source[i] * self.problem.areas[i] + reflected,
            Some(_) => reflected,
        }
    }

    /// The brightest patches, the lowest of equals first, and no more than may shoot; or what is left of a round.
    fn next_round(&mut self, stop: Stop) -> Vec<PatchId> {
        let waiting = std::mem::take(&mut self.shots.waiting);
        if !waiting.is_empty() {
            return waiting.into_iter().map(PatchId).collect();
        }
        let n = self.problem.len();
        // Counted anew, because the differences that each shot makes leave rounding behind.
        self.shots.left = (0..n).map(|i| self.unshot(i)).sum();
        let powers: Vec<f64> = (0..n).map(|i| self.unshot(i).element_sum()).collect();
        let mut round: Vec<usize> = (0..n).collect();
        round.par_sort_by(|&i, &j| powers[j].total_cmp(&powers[i]));
        let mut missing = SHARE_OF_ROUND * self.shots.left.element_sum();
        let is_needed = |&&i: &&usize| {
            let needed = missing > 0.0;
            missing -= powers[i];
            needed
        };
        let holders = round.iter().take_while(is_needed).count();
        // One shoots even without any power, if that many shots were asked for.
        round.truncate(holders.max(1));
        if let Stop::Iterations(shots) = stop {
            round.truncate(shots - self.shots.count);
        }
        round.into_iter().map(|i| PatchId(i as u32)).collect()
    }

    /// These patches shoot, one after the other, until it is time to stop. Whether it is.
    fn shoot_all(&mut self, shooters: &[PatchId], rows: Vec<Row>, stop: Stop) -> Result<bool> {
        for (i, row) in shooters.iter().zip(rows) {
            self.shoot(i.index(), row)?;
            if self.is_done(stop)? {
                return Ok(true);
            }
        }
        self.is_done(stop)
    }

    fn is_done(&self, stop: Stop) -> Result<bool> {
        let most = super::MOST_ITERATIONS.max(1000 * self.problem.len());
        stop.reached(self.shots.count, &self.shots.residual, most)
    }

    /// Patch i sends all its unshot power along its row.
    fn shoot(&mut self, i: usize, row: Row) -> Result<()> {
        let problem = self.problem;
        let sent = self.unshot(i);
        self.shots.settled[i] += std::mem::take(&mut self.shots.arrived[i]);
        // The share of what is sent that will be sent again.
        let mut kept = Rgb64::ZERO;
        for &(PatchId(j), factor) in &row.entries {
            let j = j as usize;
            self.shots.arrived[j] += sent * factor;
            kept += problem.reflectance[j] * factor;
        }
        self.shots.left += sent * kept - sent;
        if self.shots.row_sums[i].replace(row.sum()).is_none() {
            self.shots.on_backs[i] = row.on_backs;
            for (PatchId(j), factor) in row.entries {
                self.shots.reception[j as usize] += factor * problem.areas[i];
            }
        }
        self.check_loss(i, sent, kept)?;
        self.shots.count += 1;
        self.keep_residual();
        Ok(())
    }

    /// Refuses light of which no shot loses any: all of it is reflected, here and where it arrives.
    fn check_loss(&mut self, i: usize, sent: Rgb64, kept: Rgb64) -> Result<()> {
        let reflectance = self.problem.reflectance[i];
        self.shots.keeps_all &=
            (0..3).any(|c| sent[c] > 0.0 && reflectance[c] >= 1.0 && kept[c] >= 1.0);
        // The first n shots come from nearly all patches that have light to send.
        if self.shots.keeps_all && self.shots.count >= self.problem.len() {
            return Err(cannot_converge(format!(
                "patch {i} loses none of its light, nor does any that shot before it"
            )));
        }
        Ok(())
    }

    fn keep_residual(&mut self) {
        let residual = relative(self.shots.left, self.source_power);
        self.shots.residual.truncate(1);
        self.shots.residual.push(residual);
        if (self.shots.count - 1).is_multiple_of(self.problem.len().div_ceil(1000)) {
            self.shots.residuals.push(residual);
        }
    }

    fn converged(self) -> Converged {
        let shots = self.shots.clone();
        let mut residuals = shots.residuals;
        if residuals.last() != shots.residual.last() {
            residuals.extend(shots.residual.last());
        }
        let Problem { areas, reflectance, source } = self.problem;
        let n = self.problem.len();
        // By reciprocity F_ji = F_ij A_i / A_j: what patch j received of i's power, per area. Patches that
        // others cover have none.
        let per_area = |j: usize| if areas[j] > 0.0 { 1.0 / areas[j] } else { 0.0 };
        let irradiance: Vec<Rgb64> =
            (0..n).map(|j| (shots.settled[j] + shots.arrived[j]) * per_area(j)).collect();
        let all_have_shot = shots.row_sums.iter().all(Option::is_some);
        let reception = || (0..n).map(|j| shots.reception[j] * per_area(j)).collect();
        Converged {
            radiosity: (0..n).map(|j| source[j] + reflectance[j] * irradiance[j]).collect(),
            irradiance,
            residuals,
            iterations: shots.count,
            reception_sums: all_have_shot.then(reception),
            row_sums: shots.row_sums,
            on_backs: shots.on_backs,
            slow_rate: None,
        }
    }
}
