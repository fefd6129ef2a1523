//! Taking samples, and estimating the light at them.

use super::row::Row;
use super::spot::{self, Spot};
use crate::color::Rgb;
use crate::paths::{Paths, Start};
use crate::render::samples::{Eye, Samples, TILE, Wanted};
use crate::sampling::{QUARTERS, block};
use std::ops::Range;

/// Rays that gather light, per sample.
const RAYS: u32 = 2;

/// One thread's buffers.
#[derive(Default)]
pub(super) struct Work<'m> {
    wanted: Vec<Wanted>,
    samples: Samples<'m>,
    starts: Vec<Start>,
    direct: Vec<Rgb>,
    /// Of each ray that gathers.
    soft: Vec<Rgb>,
}

impl<'m> Work<'m> {
    /// Adds samples to a row's pixels; `numbers` says which, by the pixel's place in the row.
    pub(super) fn add(
        &mut self,
        eye: &Eye<'m>,
        paths: &Paths,
        (y, row): (usize, &mut Row),
        numbers: impl Fn(usize) -> Range<u32>,
    ) {
        let before = std::mem::take(row);
        let mut pixels = (0..eye.frame.width as usize).peekable();
        while pixels.peek().is_some() {
            self.wanted.clear();
            let mut count = 0;
            while let Some(x) = pixels.next_if(|_| count < TILE) {
                let Range { start: from, end: to } = numbers(x);
                self.wanted.push(Wanted { x, y, from, to });
                count += (to - from) as usize;
            }
            self.samples.take(eye, &self.wanted);
            paths.count_rays(self.samples.traced());
            self.light(eye, paths);
            self.keep(eye, &before, row);
        }
    }

    /// Estimates the light at the points of the samples.
    fn light(&mut self, eye: &Eye, paths: &Paths) {
        let points = &self.samples.points;
        let first = (eye.frame.samples * RAYS).next_power_of_two();
        self.starts.clear();
        self.starts.extend(points.iter().map(Start::at));
        self.direct.clear();
        self.direct.resize(points.len(), Rgb::ZERO);
        paths.add_sampled(&self.starts, &mut self.direct);
        self.starts.clear();
        let rays = |point| (0..RAYS).map(move |ray| Start::of_square(point, ray, RAYS, first));
        self.starts.extend(points.iter().flat_map(rays));
        self.soft.clear();
        self.soft.resize(self.starts.len(), Rgb::ZERO);
        paths.add_unsampled(&self.starts, &mut self.soft);
    }

    /// Adds the samples of a tile, pixel by pixel, to what was known before.
    fn keep(&self, eye: &Eye, before: &Row, row: &mut Row) {
        let fewest = eye.frame.samples.max(QUARTERS as u32);
        let mut hits = self.samples.hits.iter();
        let mut next = 0;
        for (wanted, tally) in self.wanted.iter().zip(&self.samples.tallies) {
            let (mut sharp, spots) = before.pixel(wanted.x);
            let of_pixel = row.spots.len();
            row.spots.extend_from_slice(spots);
            for _ in 0..sharp.lengthen(wanted.from, wanted.to, fewest) {
                row.spots[of_pixel..].iter_mut().for_each(Spot::lengthen);
            }
            let rays = sharp.in_quarters * RAYS;
            let quarter = |number, ray| block(number * RAYS + ray, rays, QUARTERS);
            for (number, hit) in (wanted.from..wanted.to).zip(&mut hits) {
                sharp.count(quarter(number, 0), hit.is_none(), eye.background());
            }
            for k in next..next + tally.points {
                let point = &self.samples.points[k];
                let look = if eye.mesh.varies() {
                    self.samples.looks[k]
                } else {
                    self.samples.plain_look(eye, k)
                };
                let soft = &self.soft[k * RAYS as usize..(k + 1) * RAYS as usize];
                let quarter = |ray: usize| quarter(point.sample.number, ray as u32);
                sharp.add(quarter(0), &look, point.side.radiates, self.direct[k], soft);
                let spot = Spot::sample(point, look.reflectance, soft, quarter);
                spot::add(&mut row.spots, of_pixel, &spot);
            }
            next += tally.points;
            row.sharp.push(sharp);
            row.ends.push(row.spots.len() as u32);
        }
    }
}
