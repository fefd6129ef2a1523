//! `isolux verify --diff-image`: the whole pipeline on two tracers, and a picture of where it differs.

use crate::bvh::Surfaces;
use crate::cli::progress::Bars;
use crate::cli::render;
use crate::equivalence::{Cause, Compared, Pair, Pipeline, Summary};
use crate::error::Result;
use crate::export::file::Output;
use crate::export::picture::Format;
use crate::geometry::RayCaster;
use crate::lit_sides::lit_sides;
use crate::patches::{PatchMesh, Subdivision};
use crate::radiosity::Choices;
use crate::render::{Frame, tone};
use crate::scene::{Camera, Document, Scene};
use crate::settings;
use crate::settings::{PatchSettings, Settings};
use crate::verify::survey::Peer;
use crate::verify::{Arithmetic, Judge};
use crate::view::View;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::Path;

/// More than a usual picture takes is not done here.
const MOST_PATCHES: usize = settings::PATCHES;
const MOST_SAMPLES: u32 = Frame::SAMPLES;

/// The result, for programs.
#[derive(Serialize)]
pub(super) struct PipelineReport {
    peer: &'static str,
    patches: usize,
    #[serde(flatten)]
    pub summary: Summary,
}

/// Compares the native tracer with the most different of the peers, and draws where they differ.
pub(super) fn run(
    native: &dyn RayCaster,
    peers: &[Peer],
    (description, scene, camera): (&Document, &Scene, &Camera),
    seed: u64,
    path: &Path,
) -> Result<(PipelineReport, Output)> {
    let peer = most_different(peers);
    let judge = Judge::of_scene(scene, Arithmetic::MollerTrumbore, peer.arithmetic);
    let native = &Surfaces::new(native, scene);
    let other = &Surfaces::new(&*peer.caster, scene);
    let pair = Pair { native, peer: other, judge, peer_is_ours: peer.is_native };
    let mesh = patches(scene, description, native, seed)?;
    let samples = description.image.samples.unwrap_or(MOST_SAMPLES).min(MOST_SAMPLES);
    // Two pictures at a time, and one for the differences.
    let frame = render::frame(None, Some(samples), seed, &description.image, 3 * 36)
        .map_err(|error| error.in_file_if_none(&description.file))?;
    let settings = Choices::new(&Settings { seed, ..Settings::default() }, scene)?;
    let pipeline = Pipeline { mesh: &mesh, settings, camera, frame, crease: View::CREASE };
    let comparison = pipeline
        .compare(&pair, &Bars::new())
        .map_err(|error| error.in_file_if_none(&description.file))?;

    let automatic = || tone::automatic_exposure(&[&comparison.smooth]);
    let exposure = description.image.exposure.unwrap_or_else(automatic);
    let bytes = Format::of(path)?.encode(&comparison.difference_image(exposure), exposure)?;
    let summary = comparison.summary;
    let report = PipelineReport { peer: peer.name, patches: mesh.len(), summary };
    Ok((report, Output { path: path.to_path_buf(), bytes }))
}

/// Embree where it is built in, else the other kernel.
fn most_different<'p, 'a>(peers: &'p [Peer<'a>]) -> &'p Peer<'a> {
    let named = |name| peers.iter().find(|peer| peer.name == name);
    named("Embree robust packets").or_else(|| named("native plane")).expect("one is always asked")
}

/// The description's, unless they are too many.
fn patches(
    scene: &Scene,
    document: &Document,
    caster: &dyn RayCaster,
    seed: u64,
) -> Result<PatchMesh> {
    let sides = lit_sides(scene, caster, seed);
    if document.patches != PatchSettings::default() {
        let split = Subdivision::of(&document.patches).split(scene)?;
        let mesh = PatchMesh::new(scene, &split, &sides)?;
        if mesh.len() <= MOST_PATCHES {
            return Ok(mesh);
        }
    }
    PatchMesh::new(scene, &Subdivision::Count(MOST_PATCHES).split(scene)?, &sides)
}

impl Display for PipelineReport {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let Summary { form_factors, direct_light, coverage, radiosity, flat, smooth } =
            &self.summary;
        writeln!(f, "the whole pipeline, {} patches, held against {}\n", self.patches, self.peer)?;
        writeln!(f, "{:<26} {:>11} {:>11}  because of", "", "in all", "differ")?;
        line(f, "form-factor entries", form_factors)?;
        line(f, "patches' direct light", direct_light)?;
        line(f, "patches' coverage", coverage)?;
        let (total, differing) = (radiosity.total, radiosity.differing);
        let why = match (differing, radiosity.unexplained) {
            (0, _) => String::new(),
            (_, 0) => format!(
                "the entries, by up to {:.1e} of their value",
                radiosity.largest_relative_difference
            ),
            _ => Cause::Unexplained.to_string(),
        };
        row(f, "patches' radiosity", total, differing, &why)?;
        line(f, "flat pixels", flat)?;
        line(f, "smooth pixels", smooth)
    }
}

fn line(f: &mut Formatter, what: &str, stage: &Compared) -> fmt::Result {
    row(f, what, stage.total, stage.differing, &words(&stage.causes))
}

fn row(f: &mut Formatter, what: &str, total: u64, differing: u64, why: &str) -> fmt::Result {
    let row = format!("{what:<26} {total:>11} {differing:>11}  {why}");
    writeln!(f, "{}", row.trim_end())
}

/// "12 rounding, 3 tie".
fn words(causes: &BTreeMap<Cause, u64>) -> String {
    let each: Vec<String> =
        causes.iter().map(|(cause, count)| format!("{count} {cause}")).collect();
    each.join(", ")
}
