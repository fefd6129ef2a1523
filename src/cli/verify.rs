//! `isolux verify`: every ray checked, by another tracer and by a referee.

mod pipeline;

use super::progress::Bars;
use super::{complain, say, warn};
use crate::bvh::{Bvh, Surfaces};
use crate::equivalence::Summary;
#[cfg(feature = "embree")]
use crate::error::Error;
use crate::error::Result;
use crate::export::file::{Inputs, Output, check_writable, write_all};
use crate::export::picture::Format;
use crate::geometry::{BruteForce, MollerTrumbore, Plane, RayCaster, Triangle};
#[cfg(feature = "embree")]
use crate::oracle::{Device, Isa};
use crate::patches::Sides;
use crate::scene::{Document, Scene};
use crate::verify::bounds::Arithmetic;
use crate::verify::grid::{Grid, GridFinding};
use crate::verify::leaks::{Leaks, leaks};
use crate::verify::rays::{RayKind, RaySource};
use crate::verify::stress_mesh::stress_scene;
use crate::verify::survey::{Finding, Peer, sum, survey};
use crate::verify::tally::Tally;
#[cfg(feature = "embree")]
use clap::{ValueEnum, builder::PossibleValue};
use pipeline::PipelineReport;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Above this many triangles brute force is too slow to be asked.
const BRUTE_FORCE_TRIANGLES: usize = 1000;

/// Wrong answers that are printed as source for a test: enough to begin with.
const FAILURES_PRINTED: usize = 4;

/// Trace rays, ordinary and adversarial, through every tracer there is, and let an exact referee settle
/// every difference. Exit code 1 if our own tracer is ever wrong.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A scene description (.toml) or a model (.obj, .glb, .gltf, .ply, .stl)
    scene: PathBuf,

    /// Rays; each is asked for its nearest hit and for any hit, of every tracer
    #[arg(long, value_name = "N", default_value_t = 1_000_000,
          value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    rays: u64,

    /// Seed of all rays
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Write the counts as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Run the whole pipeline on a peer too (Embree if it is built in, else the other kernel), explain
    /// every number and every pixel that differs, and draw where: .png, .exr or .hdr, the scene in
    /// grey, bluish for rounding, yellow for patch boundaries, green for ties and touching, cyan for
    /// precision, magenta for a wrong peer, red for a wrong answer of ours or no explanation
    #[arg(long, value_name = "FILE")]
    diff_image: Option<PathBuf>,

    /// The instruction set that Embree traces with: its approximate reciprocals, and with them the last
    /// bits of its answers, differ from one to the next. `all`: a report for each that this
    /// processor has [default: Embree's choice]
    #[cfg(feature = "embree")]
    #[arg(long, value_name = "ISA")]
    embree_isa: Option<IsaName>,
}

/// The values of `--embree-isa`: an instruction set, or all.
#[cfg(feature = "embree")]
#[derive(Debug, Clone, Copy)]
struct IsaName(Option<Isa>);

#[cfg(feature = "embree")]
impl ValueEnum for IsaName {
    fn value_variants<'a>() -> &'a [Self] {
        const NAMES: [IsaName; Isa::ALL.len() + 1] = {
            let mut names = [IsaName(None); Isa::ALL.len() + 1];
            let mut number = 0;
            while number < Isa::ALL.len() {
                names[number] = IsaName(Some(Isa::ALL[number]));
                number += 1;
            }
            names
        };
        &NAMES
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        self.0.map_or(Some(PossibleValue::new("all")), |isa| isa.to_possible_value())
    }
}

/// How Embree is to be configured, in its notation: one report for each.
#[cfg(feature = "embree")]
fn embree_configurations(arguments: &Arguments) -> Result<Vec<&'static str>> {
    let Some(name) = arguments.embree_isa else {
        return Ok(vec![""]);
    };
    if let IsaName(Some(isa)) = name {
        return Ok(vec![isa.config()]);
    }
    if arguments.json.is_some() || arguments.diff_image.is_some() {
        return Err(Error::new("--embree-isa all makes several reports, and files hold one")
            .remedy("name one instruction set, or leave --json and --diff-image out"));
    }
    Ok(Device::available_isas().into_iter().map(Isa::config).collect())
}

#[cfg(not(feature = "embree"))]
fn embree_configurations(_: &Arguments) -> Result<Vec<&'static str>> {
    Ok(vec![""])
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let mut worst = ExitCode::SUCCESS;
    for embree in embree_configurations(arguments)? {
        let code = verify(arguments, embree)?;
        if code != ExitCode::SUCCESS {
            worst = code;
        }
    }
    Ok(worst)
}

/// One report. `embree` is Embree's configuration.
fn verify(arguments: &Arguments, embree: &str) -> Result<ExitCode> {
    let outputs: Vec<&Path> =
        arguments.json.iter().chain(&arguments.diff_image).map(PathBuf::as_path).collect();
    arguments.diff_image.as_deref().map(Format::of).transpose()?;
    outputs.iter().try_for_each(|path| check_writable(path))?;
    let description = Document::open(&arguments.scene)?;
    let mut inputs = Inputs::new(&description.inputs());
    inputs.check_distinct(&outputs)?;
    let scene = Scene::load(&description)?;
    inputs.extend(&scene.files);
    inputs.check_distinct(&outputs)?;
    warn(&scene.warnings);

    let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
    let surfaces = Surfaces::new(&native, &scene);
    let camera = description.view(&scene, &Sides::of_all(&scene), &surfaces);
    let source = RaySource::new(&scene, &camera, arguments.seed);
    let (peers, oracle) = peers(&scene.triangles, embree)?;
    let scenery = (&description, &scene, &camera);
    let pipeline = arguments
        .diff_image
        .as_deref()
        .map(|path| pipeline::run(&native, &peers, scenery, arguments.seed, path))
        .transpose()?;
    let (pipeline, picture) = pipeline.unzip();
    let findings = survey(&scene, &native, &peers, &source, arguments.rays, &Bars::new());
    let leaks = leaks(&scene.triangles, &native, &peers, arguments.rays / 4, arguments.seed);

    let stress_mesh = survey_stress_mesh(arguments, embree)?;
    let grid = ask_grids(arguments, embree)?;

    let built_in = BuiltIn { stress_mesh: by_caster(&stress_mesh), grid };
    let verdict = Report {
        pipeline,
        ..Report::new(&description.title, &oracle, arguments, &findings, leaks, built_in)
    };
    let json = arguments.json.as_ref();
    let json = json.map(|path| Output { path: path.clone(), bytes: verdict.to_json() });
    write_all(json.into_iter().chain(picture).collect(), &inputs)?;
    say(&verdict.to_text(&findings))?;
    Ok(conclude(&verdict, &[findings, stress_mesh].concat()))
}

/// Prints the failures and decides the exit code: 1 if a tracer of ours was wrong.
fn conclude(report: &Report, findings: &[Finding]) -> ExitCode {
    let grid = report.built_in.grid.iter().filter(|finding| finding.is_native);
    let failures = findings.iter().map(|finding| finding.total().failures()).sum::<u64>()
        + grid.clone().map(|finding| finding.wrong).sum::<u64>();
    let failing = findings.iter().flat_map(|f| f.failures.iter().map(|failure| (f.peer, failure)));
    let on_grid = grid.flat_map(|f| f.failures.iter().map(|failure| (f.caster, failure)));
    for (peer, failure) in failing.take(FAILURES_PRINTED) {
        complain(&format!("\nagainst {peer}:\n{failure}"));
    }
    for (caster, failure) in on_grid.take(FAILURES_PRINTED) {
        complain(&format!("\n{caster} on the integer grid:\n{failure}"));
    }
    let summary = report.pipeline.as_ref().map(|pipeline| &pipeline.summary);
    for source in summary.into_iter().flat_map(Summary::sources).take(FAILURES_PRINTED) {
        complain(&format!("\nin the pipeline:\n{source}"));
    }
    let unequal = summary.map_or(0, Summary::failures);
    if failures + unequal == 0 {
        return ExitCode::SUCCESS;
    }
    if failures > 0 {
        complain(&format!("error: {failures} answers of our own tracer are wrong\n"));
    }
    if unequal > 0 {
        complain(&format!("error: {unequal} numbers of the pipeline are wrong or unexplained\n"));
    }
    ExitCode::from(1)
}

/// Rays about each scene that is built in: a share of the user's scene's, within reason.
fn built_in_rays(arguments: &Arguments) -> u64 {
    (arguments.rays / 10).clamp(10_000, 50_000)
}

/// Every kind of ray about the stress mesh.
fn survey_stress_mesh(arguments: &Arguments, embree: &str) -> Result<Vec<Finding>> {
    let (scene, camera) = stress_scene(arguments.seed);
    let native = Bvh::<MollerTrumbore>::build(scene.triangles.clone());
    let source = RaySource::new(&scene, &camera, arguments.seed);
    let (peers, _) = peers(&scene.triangles, embree)?;
    let rays = built_in_rays(arguments);
    Ok(survey(&scene, &native, &peers, &source, rays, &()))
}

fn by_caster(findings: &[Finding]) -> BTreeMap<&'static str, Tally> {
    findings.iter().map(|finding| (finding.peer, finding.total())).collect()
}

/// Every tracer, the native one first, on both integer grids.
fn ask_grids(arguments: &Arguments, embree: &str) -> Result<Vec<GridFinding>> {
    let rays = built_in_rays(arguments) / 2;
    let ask = |grid: Grid| {
        let (mut casters, _) = peers(&grid.triangles, embree)?;
        casters.insert(
            0,
            Peer {
                name: "native",
                caster: Box::new(Bvh::<MollerTrumbore>::build(grid.triangles.clone())),
                arithmetic: Arithmetic::MollerTrumbore,
                is_native: true,
                single: false,
            },
        );
        Ok(grid.ask(&casters))
    };
    let general = ask(Grid::general(rays, arguments.seed))?;
    let dyadic = ask(Grid::dyadic(rays, arguments.seed))?;
    Ok(general.into_iter().zip(dyadic).map(|(a, b)| a.and(b)).collect())
}

/// Everyone to hold the native tracer against, and what is known of the oracle among them.
fn peers<'t>(triangles: &'t Arc<[Triangle]>, embree: &str) -> Result<(Vec<Peer<'t>>, String)> {
    let native = |name, caster: Box<dyn RayCaster>, arithmetic, single| Peer {
        name,
        caster,
        arithmetic,
        is_native: true,
        single,
    };
    let (cramer, plane) = (Arithmetic::MollerTrumbore, Arithmetic::Plane);
    let bvh = || Box::new(Bvh::<MollerTrumbore>::build(triangles.clone()));
    let mut peers = vec![
        native("native single", bvh(), cramer, true),
        native("native plane", Box::new(Bvh::<Plane>::build(triangles.clone())), plane, false),
    ];
    if triangles.len() <= BRUTE_FORCE_TRIANGLES {
        let brute_cramer = Box::new(BruteForce::<MollerTrumbore>::new(triangles));
        let brute_plane = Box::new(BruteForce::<Plane>::new(triangles));
        peers.push(native("brute force", brute_cramer, cramer, false));
        peers.push(native("brute force plane", brute_plane, plane, false));
    }
    let oracle = add_embree(&mut peers, triangles, embree)?;
    Ok((peers, oracle))
}

#[cfg(feature = "embree")]
fn add_embree<'t>(
    peers: &mut Vec<Peer<'t>>,
    triangles: &'t [Triangle],
    configuration: &str,
) -> Result<String> {
    use crate::oracle::{EmbreeScene, Options, Packets};
    let device = Device::new(configuration)?;
    for (robust, arithmetic, single, batched) in [
        (false, Arithmetic::EmbreeDefault, "Embree single", "Embree packets"),
        (true, Arithmetic::EmbreeRobust, "Embree robust single", "Embree robust packets"),
    ] {
        for (name, packets, is_single) in
            [(single, Packets::Single, true), (batched, Packets::Packet16, false)]
        {
            let scene = EmbreeScene::build(&device, triangles, Options { robust, packets })?;
            peers.push(Peer {
                name,
                caster: Box::new(scene),
                arithmetic,
                is_native: false,
                single: is_single,
            });
        }
    }
    Ok(device.description())
}

#[cfg(not(feature = "embree"))]
fn add_embree(_: &mut Vec<Peer>, _: &[Triangle], _: &str) -> Result<String> {
    Ok("without Embree; to ask it too, build with --features embree (see the README)".into())
}

/// The counts, for programs.
#[derive(Serialize)]
struct Report {
    scene: String,
    oracle: String,
    rays: u64,
    seed: u64,
    #[serde(flatten)]
    total: Tally,
    by_caster: BTreeMap<&'static str, Tally>,
    by_kind: BTreeMap<&'static str, Tally>,
    by_caster_and_kind: BTreeMap<&'static str, BTreeMap<&'static str, Tally>>,
    /// Rays out of closed meshes, per caster; empty if all of the scene's are open.
    leaks: Vec<Leaks>,
    /// With `--diff-image`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pipeline: Option<PipelineReport>,
    #[serde(flatten)]
    built_in: BuiltIn,
}

/// Findings on the scenes that are built in.
#[derive(Serialize)]
struct BuiltIn {
    /// The mesh of slivers, duplicates and overlaps, per caster; not in the totals.
    stress_mesh: BTreeMap<&'static str, Tally>,
    /// Scenes of small integers, where our bits are demanded, per caster.
    grid: Vec<GridFinding>,
}

impl Report {
    fn new(
        scene: &str,
        oracle: &str,
        arguments: &Arguments,
        findings: &[Finding],
        leaks: Vec<Leaks>,
        built_in: BuiltIn,
    ) -> Self {
        let kinds = |finding: &Finding| -> BTreeMap<&'static str, Tally> {
            RayKind::ALL
                .iter()
                .map(|kind| kind.name())
                .zip(finding.by_kind.iter().copied())
                .collect()
        };
        let by_caster = by_caster(findings);
        Report {
            scene: scene.into(),
            oracle: oracle.into(),
            rays: arguments.rays,
            seed: arguments.seed,
            total: sum(by_caster.values()),
            by_kind: RayKind::ALL
                .iter()
                .map(|&kind| (kind.name(), sum(findings.iter().map(|f| &f.by_kind[kind as usize]))))
                .collect(),
            by_caster_and_kind: findings.iter().map(|f| (f.peer, kinds(f))).collect(),
            by_caster,
            leaks,
            pipeline: None,
            built_in,
        }
    }

    fn to_json(&self) -> Vec<u8> {
        let mut text = serde_json::to_string_pretty(self).expect("plain numbers and strings");
        text.push('\n');
        text.into_bytes()
    }

    fn to_text(&self, findings: &[Finding]) -> String {
        let mut text =
            format!("{}: native Möller–Trumbore hierarchy, {}\n\n", self.scene, self.oracle);
        heading(&mut text, "held against");
        for finding in findings {
            row(&mut text, finding.peer, &finding.total());
        }
        text.push('\n');
        heading(&mut text, "kind of ray");
        for kind in RayKind::ALL {
            row(&mut text, kind.name(), &self.by_kind[kind.name()]);
        }
        text.push('\n');
        row(&mut text, "total", &self.total);
        for leaks in &self.leaks {
            let _ = writeln!(text, "{leaks}");
        }
        text.push('\n');
        heading(&mut text, "on the stress mesh");
        for (peer, tally) in &self.built_in.stress_mesh {
            row(&mut text, peer, tally);
        }
        text.push('\n');
        for finding in &self.built_in.grid {
            let _ = writeln!(text, "{finding}");
        }
        if let Some(pipeline) = &self.pipeline {
            let _ = write!(text, "\n{pipeline}");
        }
        text
    }
}

fn heading(text: &mut String, first: &str) {
    let _ = writeln!(
        text,
        "{first:<22} {:>11} {:>11} {:>9} {:>9} {:>9} {:>7} {:>7} {:>6}  {:>9}",
        "queries", "agree", "tie", "touching", "precision", "native", "peer", "both", "Δt"
    );
    let _ = writeln!(
        text,
        "{:<22} {:>11} {:>11} {:>9} {:>9} {:>9} {:>7} {:>7} {:>6}  {:>9}",
        "", "", "", "", "", "", "wrong", "wrong", "wrong", "ulps"
    );
}

fn row(text: &mut String, name: &str, t: &Tally) {
    let _ = writeln!(
        text,
        "{name:<22} {:>11} {:>11} {:>9} {:>9} {:>9} {:>7} {:>7} {:>6}  {:>9}",
        t.queries,
        t.agree,
        t.tie,
        t.touching,
        t.precision,
        t.native_wrong,
        t.peer_wrong,
        t.both_wrong,
        t.largest_t_ulps
    );
}
