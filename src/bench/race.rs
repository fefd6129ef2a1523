//! Every engine over the same rays, in turns, so that noise falls on all of them alike.

use crate::geometry::{Ray, RayCaster};
use rayon::prelude::*;
use serde::Serialize;
use std::time::Instant;

/// The tracer, and its kernel, that an engine competes for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Contender {
    Native,
    /// Embree's default kernel, which is not watertight.
    Embree,
    /// Embree's watertight kernel.
    EmbreeRobust,
}

/// A tracer and a way to ask it.
pub(crate) struct Engine<'t> {
    pub name: &'static str,
    pub contender: Contender,
    pub caster: &'t (dyn RayCaster + 't),
    /// Whether it is asked in batches rather than ray by ray.
    pub batched: bool,
}

/// The question that is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Query {
    Nearest,
    Occluded,
}

/// One engine's rounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Rates {
    pub engine: &'static str,
    /// Millions of rays per second: the median round, the slowest and the fastest.
    pub median: f64,
    pub min: f64,
    pub max: f64,
    /// Rays that hit something.
    pub hits: u64,
}

/// Rays that a thread takes at a time, as form factors and pixels do.
const BATCH: usize = 4096;

/// Lets each engine trace all rays `rounds` times in this thread's pool, after one round that is not
/// timed.
pub(crate) fn race(engines: &[Engine], rays: &[Ray], query: Query, rounds: usize) -> Vec<Rates> {
    let hits: Vec<u64> = engines.iter().map(|engine| engine.trace(rays, query)).collect();
    let mut times = vec![Vec::with_capacity(rounds); engines.len()];
    for _ in 0..rounds {
        for (engine, times) in engines.iter().zip(&mut times) {
            let start = Instant::now();
            engine.trace(rays, query);
            times.push(start.elapsed().as_secs_f64());
        }
    }
    let rates = |((engine, mut times), hits): ((&Engine, Vec<f64>), u64)| {
        times.sort_by(f64::total_cmp);
        let rate = |seconds: f64| rays.len() as f64 / seconds * 1e-6;
        Rates {
            engine: engine.name,
            median: rate(times[rounds / 2]),
            min: rate(times[rounds - 1]),
            max: rate(times[0]),
            hits,
        }
    };
    engines.iter().zip(times).zip(hits).map(rates).collect()
}

impl Engine<'_> {
    /// Answers all rays and returns how many hit something.
    fn trace(&self, rays: &[Ray], query: Query) -> u64 {
        rays.par_chunks(BATCH).map(|rays| self.trace_batch(rays, query)).sum()
    }

    fn trace_batch(&self, rays: &[Ray], query: Query) -> u64 {
        let caster = self.caster;
        let count = match (query, self.batched) {
            (Query::Nearest, false) => {
                rays.iter().filter(|ray| caster.nearest(ray).is_some()).count()
            }
            (Query::Occluded, false) => rays.iter().filter(|ray| caster.occluded(ray)).count(),
            (Query::Nearest, true) => {
                let mut hits = Vec::with_capacity(rays.len());
                caster.nearest_batch(rays, &mut hits);
                hits.iter().flatten().count()
            }
            (Query::Occluded, true) => {
                let mut blocked = Vec::with_capacity(rays.len());
                caster.occluded_batch(rays, &mut blocked);
                blocked.iter().filter(|blocked| **blocked).count()
            }
        };
        count as u64
    }
}
