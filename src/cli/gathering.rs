//! A gathered picture on its way: previews of it, and what is kept so that it can be gone on with.

use super::partial::{ANEW, Partial};
use super::progress::Bars;
use super::warn;
use crate::error::{Error, Result, Warning};
use crate::export::file::{Inputs, Output, write_all};
use crate::export::picture::Format;
use crate::export::sealed::{self, Seal};
use crate::geometry::KernelKind;
use crate::render::gather::{Drawing, Rounds};
use crate::render::{Background, Frame, Image};
use crate::scene::Camera;
use crate::solution::Solution;
use std::cell::OnceCell;
use std::path::Path;
use std::time::{Duration, Instant};

const SEAL: Seal = Seal {
    magic: b"isolux picture\n",
    version: 4,
    name: "file of an unfinished picture",
    command: "isolux render SCENE -o FILE",
};

/// How a picture is drawn.
pub(super) struct Gathering<'a> {
    pub output: &'a Path,
    /// What must not be overwritten.
    pub inputs: &'a Inputs,
    /// See [`fingerprint`]: asked for only where something is kept, since all of the scene goes into it.
    pub fingerprint: &'a dyn Fn() -> u32,
    /// Go on with what was kept.
    pub resume: bool,
    /// Keep what is done at the end too, since other pictures follow.
    pub keep: bool,
    pub preview: Option<Duration>,
    /// For previews.
    pub exposure: &'a dyn Fn(&Image) -> f32,
}

impl Gathering<'_> {
    /// Draws to the end, or until interrupted: what was done by then is kept, at once and when it is a picture. Returns
    /// the picture, and the partial file of an interrupted one.
    ///
    /// # Errors
    /// What was kept is of another picture or damaged.
    pub(super) fn draw(
        &self,
        mut drawing: Drawing,
        bars: &Bars,
    ) -> Result<(Image, Option<Partial>)> {
        let mut partial = Partial::of(self.output);
        let known_fingerprint = OnceCell::new();
        let fingerprint = || *known_fingerprint.get_or_init(self.fingerprint);
        let is_resumed = self.resume && partial.is_begun()?;
        if is_resumed {
            take_up(&mut drawing, partial.path(), fingerprint())?;
        }
        bars.begin_picture(is_resumed);
        let after = |since: Instant| self.preview.map(|every| since + every);
        let mut preview = after(Instant::now());
        let (mut was_interrupted, mut has_failed) = (false, false);
        loop {
            let until = preview.map_or(partial.due(), |preview| preview.min(partial.due()));
            let is_over = drawing.go_on(Some(until), bars);
            let is_interrupted = bars.was_interrupted();
            let is_new = is_interrupted != was_interrupted;
            was_interrupted = is_interrupted;
            if is_new || partial.is_due() || is_over && (is_interrupted || self.keep) {
                let bytes = SEAL.close(&(fingerprint(), drawing.rounds()));
                partial.keep(bytes, self.inputs);
            }
            if is_over {
                let image = drawing.image().expect("nothing ends a picture before it is one");
                return Ok((image, is_interrupted.then_some(partial)));
            }
            if preview.is_some_and(|preview| Instant::now() >= preview) {
                self.show(drawing.image(), &mut has_failed);
                // From now on, since a preview takes time itself.
                preview = after(Instant::now());
            }
        }
    }

    /// Renews the picture's file. Where that fails the run goes on: a warning says so the first time.
    fn show(&self, image: Option<Image>, has_failed: &mut bool) {
        let Some(image) = image else { return };
        let format = Format::of(self.output);
        let bytes = format.and_then(|format| format.encode(&image, (self.exposure)(&image)));
        let path = self.output.to_path_buf();
        let shown = bytes.and_then(|bytes| write_all(vec![Output { path, bytes }], self.inputs));
        if let Err(error) = shown
            && !std::mem::replace(has_failed, true)
        {
            let text = format!("{}; the run goes on without a preview", error.cause());
            warn(&[Warning::in_file(self.output, None, text)]);
        }
    }
}

fn take_up(drawing: &mut Drawing, path: &Path, known: u32) -> Result<()> {
    let bytes = SEAL.read(path)?;
    let (fingerprint, rounds): (u32, Rounds) =
        SEAL.open(&bytes).map_err(|error| error.in_file(path).remedy(ANEW))?;
    let other = Error::new("the unfinished picture is of another scene, or of other options");
    if fingerprint != known {
        return Err(other.in_file(path).remedy(
            "repeat the options with which it was begun, or delete the file to begin anew",
        ));
    }
    match drawing.take_up(rounds) {
        true => Ok(()),
        false => Err(SEAL.contradiction().in_file(path).remedy(ANEW)),
    }
}

/// A number of all that a picture's bits depend on. Two different pictures have the same with a probability of 2⁻³².
pub(super) fn fingerprint(
    solution: &Solution,
    camera: &Camera,
    frame: &Frame,
    kernel: KernelKind,
) -> u32 {
    let background = match frame.background {
        None => (false, None),
        Some(Background::Transparent) => (true, None),
        Some(Background::Radiance(radiance)) => (true, Some(radiance)),
    };
    let Frame { width, height, samples, in_one_round, seed, error, deadline, .. } = *frame;
    let all = (
        env!("CARGO_PKG_VERSION"),
        (solution.fingerprints(), solution.irradiance(), solution.uncovered()),
        (camera, width, height, samples, in_one_round, seed),
        (error, deadline.is_some(), background, kernel == KernelKind::Plane),
    );
    sealed::fingerprint(&all)
}
