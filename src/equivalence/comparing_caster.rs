//! Why two tracers' results differ: the rays that they answered differently, and who was right.

use crate::geometry::{Ending, Hit, Ray, RayCaster};
use crate::patches::PatchMesh;
use crate::verify::{Judge, Verdict};
use serde::Serialize;
use std::fmt;
use std::sync::Mutex;

/// Why two tracers led to different results, from the slightest cause to the gravest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// One patch, hit at two points, both within the derived bounds of the true one.
    Rounding,
    /// One triangle, hit at two points within the bounds, with a patch boundary between them.
    PatchBoundary,
    /// See [`Verdict::Tie`].
    Tie,
    /// See [`Verdict::Touching`].
    Touching,
    /// See [`Verdict::Precision`].
    Precision,
    /// An answer of the peer is wrong, and the peer is not ours.
    PeerWrong,
    /// An answer of ours is wrong.
    NativeWrong,
    /// No ray that was answered differently accounts for it.
    Unexplained,
}

impl Cause {
    /// Whether this must not be.
    pub fn is_failure(self) -> bool {
        self >= Cause::NativeWrong
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(match self {
            Cause::Rounding => "rounding",
            Cause::PatchBoundary => "patch boundary",
            Cause::Tie => "tie",
            Cause::Touching => "touching",
            Cause::Precision => "precision",
            Cause::PeerWrong => "peer wrong",
            Cause::NativeWrong => "native wrong",
            Cause::Unexplained => "UNEXPLAINED",
        })
    }
}

/// The native tracer, and one to hold it against.
pub struct Pair<'a> {
    pub native: &'a dyn RayCaster,
    pub peer: &'a dyn RayCaster,
    /// Knows both casters' triangles and arithmetic.
    pub judge: Judge<'a>,
    /// Whether the peer is ours too, so that its being wrong is our being wrong.
    pub peer_is_ours: bool,
}

/// The part of a hit that makes a difference to a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// The patch.
    Patch,
    /// The point within the patch as well.
    Point,
}

/// Something that two tracers made different, and why.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Difference {
    pub cause: Cause,
    /// The query with a wrong answer, as source for a test.
    pub source: Option<String>,
}

impl Pair<'_> {
    /// Why two results differ; `None` if they do not. `again` makes a result from a caster.
    ///
    /// A result is a function of its rays' answers. So if asking again gives both results again,
    /// the answers that differ are all there is to explain, and each of those is judged.
    pub(super) fn difference<T: PartialEq>(
        &self,
        mesh: &PatchMesh,
        detail: Detail,
        (native, peer): (&T, &T),
        again: impl Fn(&dyn RayCaster) -> T,
    ) -> Option<Difference> {
        if native == peer {
            return None;
        }
        let comparing = ComparingCaster { pair: self, mesh, detail, gravest: Mutex::new(None) };
        let reproduced = again(&comparing) == *native && again(self.peer) == *peer;
        let gravest = comparing.gravest.into_inner().expect("no thread panics while it notes");
        let unexplained = Difference { cause: Cause::Unexplained, source: None };
        Some(gravest.filter(|_| reproduced).unwrap_or(unexplained))
    }
}

/// Answers as the native caster does, asks the peer too, and keeps the gravest of the causes why
/// their answers differ.
struct ComparingCaster<'a> {
    pair: &'a Pair<'a>,
    mesh: &'a PatchMesh,
    detail: Detail,
    gravest: Mutex<Option<Difference>>,
}

impl ComparingCaster<'_> {
    fn see_nearest(&self, ray: &Ray, native: Option<Hit>, peer: Option<Hit>) {
        self.judge_nearest(&self.pair.judge, ray, native, peer);
    }

    fn judge_nearest(&self, judge: &Judge, ray: &Ray, native: Option<Hit>, peer: Option<Hit>) {
        let judgement = judge.nearest(ray, native, peer);
        let patch = |hit: Option<Hit>| hit.and_then(|hit| self.mesh.patch_hit(ray, &hit));
        let cause = match judgement.verdict {
            Verdict::Agree if patch(native) != patch(peer) => Some(Cause::PatchBoundary),
            Verdict::Agree if self.detail == Detail::Point && native != peer => {
                Some(Cause::Rounding)
            }
            verdict => self.cause(verdict),
        };
        self.note(cause, || judge.source(ray, native, peer, &judgement));
    }

    fn see_occluded(&self, ray: &Ray, native: bool, peer: bool) {
        let judgement = self.pair.judge.occluded(ray, native, peer);
        self.note(self.cause(judgement.verdict), || {
            let answers = format!("// any hit: native {native}, other {peer}\n");
            answers + &self.pair.judge.source(ray, None, None, &judgement)
        });
    }

    fn cause(&self, verdict: Verdict) -> Option<Cause> {
        match verdict {
            Verdict::Agree => None,
            Verdict::Tie => Some(Cause::Tie),
            Verdict::Touching => Some(Cause::Touching),
            Verdict::Precision => Some(Cause::Precision),
            Verdict::PeerWrong if !self.pair.peer_is_ours => Some(Cause::PeerWrong),
            Verdict::PeerWrong | Verdict::NativeWrong | Verdict::BothWrong => {
                Some(Cause::NativeWrong)
            }
        }
    }

    fn note(&self, cause: Option<Cause>, source: impl Fn() -> String) {
        let Some(cause) = cause else { return };
        let mut gravest = self.gravest.lock().expect("no thread panics while it notes");
        if gravest.as_ref().is_none_or(|known| known.cause < cause) {
            let source = (cause >= Cause::PeerWrong).then(source);
            *gravest = Some(Difference { cause, source });
        }
    }
}

impl RayCaster for ComparingCaster<'_> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let native = self.pair.native.nearest(ray);
        self.see_nearest(ray, native, self.pair.peer.nearest(ray));
        native
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let native = self.pair.native.occluded(ray);
        self.see_occluded(ray, native, self.pair.peer.occluded(ray));
        native
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        let mut others = Vec::new();
        self.pair.native.nearest_batch(rays, hits);
        self.pair.peer.nearest_batch(rays, &mut others);
        for ((ray, native), peer) in rays.iter().zip(&*hits).zip(others) {
            self.see_nearest(ray, *native, peer);
        }
    }

    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        let mut others = Vec::new();
        self.pair.native.nearest_ending(rays, endings, hits);
        self.pair.peer.nearest_ending(rays, endings, &mut others);
        for (((ray, ending), native), peer) in rays.iter().zip(endings).zip(&*hits).zip(others) {
            self.judge_nearest(&self.pair.judge.by(*ending), ray, *native, peer);
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        let mut others = Vec::new();
        self.pair.native.occluded_batch(rays, blocked);
        self.pair.peer.occluded_batch(rays, &mut others);
        for ((ray, native), peer) in rays.iter().zip(&*blocked).zip(others) {
            self.see_occluded(ray, *native, peer);
        }
    }
}
