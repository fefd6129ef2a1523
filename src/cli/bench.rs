//! `isolux bench`: rays per second, ours and Embree's, in one run.

use super::progress::Bars;
use super::{say, warn};
use crate::bench::race::{Contender, Engine, Query, Rates, race};
use crate::bench::rays::Workload;
use crate::bench::scenes::{BenchScene, BuiltIn};
use crate::bvh::Bvh;
use crate::error::{Error, Result};
use crate::export::file::{Inputs, Output, check_writable, write_all};
use crate::geometry::{MollerTrumbore, Ray};
use crate::patches::Sides;
use crate::progress::{self, Progress};
use crate::scene::{Document, Scene};
use crate::simd;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Time rays through the native tracer and through Embree, side by side.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// cornell, room, atrium, a scene description (.toml) or a model (.obj, .glb, .gltf, .ply, .stl); the first three if none
    scenes: Vec<PathBuf>,

    /// Rays of each kind
    #[arg(long, value_name = "N", default_value_t = 1 << 20,
          value_parser = clap::value_parser!(u64).range(1..=1 << 28))]
    rays: u64,

    /// Timed rounds; each engine takes its turn in every one
    #[arg(long, value_name = "N", default_value_t = 5,
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,

    /// Numbers of threads, with commas between
    #[arg(long, value_name = "N", value_delimiter = ',', default_values_t = [1, 2],
          value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Vec<u32>,

    /// Seed of the scenes and of the rays
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// The instruction set that Embree traces with [default: Embree's choice]. ISOLUX_SIMD=avx2 or portable
    /// chooses ours
    #[cfg(feature = "embree")]
    #[arg(long, value_name = "ISA")]
    embree_isa: Option<crate::oracle::Isa>,

    /// Write the results as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(path) = &arguments.json {
        check_writable(path)?;
    }
    let built_in = || BuiltIn::ALL.map(|scene| PathBuf::from(scene.name())).to_vec();
    let scenes = if arguments.scenes.is_empty() { built_in() } else { arguments.scenes.clone() };
    let pools = arguments.threads.iter().map(|&n| pool(n)).collect::<Result<Vec<_>>>()?;

    let mut report = Report {
        native: simd::name(simd::level()?),
        oracle: oracle(arguments)?,
        ..Report::default()
    };
    let mut inputs = Inputs::default();
    let stages = scenes.iter().map(|scene| stage(scene, arguments.seed, &mut inputs));
    let stages = stages.collect::<Result<Vec<_>>>()?;
    inputs.check_distinct(arguments.json.as_deref().as_slice())?;
    for stage in stages {
        measure(&stage, &pools, arguments, &mut report)?;
    }
    if let Some(path) = &arguments.json {
        let mut text = serde_json::to_string_pretty(&report).expect("plain numbers and strings");
        text.push('\n');
        write_all(vec![Output { path: path.clone(), bytes: text.into_bytes() }], &inputs)?;
    }
    say(&report.to_text())
}

fn pool(threads: u32) -> Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads as usize).build();
    pool.map_err(|e| Error::new(format!("cannot start {threads} threads: {e}")))
}

/// A built-in scene by its name, or a file; what was read for it is added to `inputs`.
fn stage(scene: &Path, seed: u64, inputs: &mut Inputs) -> Result<BenchScene> {
    if let Some(built_in) = BuiltIn::ALL.into_iter().find(|b| Path::new(b.name()) == scene) {
        return Ok(built_in.scene(seed));
    }
    let description = Document::open(scene)?;
    let loaded = Scene::load(&description)?;
    inputs.extend(&description.inputs());
    inputs.extend(&loaded.files);
    warn(&loaded.warnings);
    let caster = Bvh::<MollerTrumbore>::build(loaded.triangles.clone());
    let camera = description.view(&loaded, &Sides::of_all(&loaded), &caster);
    Ok(BenchScene { name: description.title, triangles: loaded.triangles, camera })
}

/// The measurements, for programs.
#[derive(Default, Serialize)]
struct Report {
    /// Our instruction set.
    native: &'static str,
    oracle: String,
    builds: Vec<Build>,
    results: Vec<Outcome>,
}

/// One scene's hierarchies.
#[derive(Serialize)]
struct Build {
    scene: String,
    triangles: usize,
    /// Seconds with all threads: medians.
    native_seconds: f64,
    embree_seconds: Option<f64>,
    /// Memory with the triangles.
    native_bytes: usize,
    embree_bytes: Option<usize>,
}

/// One scene, one kind of rays, one number of threads. Rates are in millions of rays per second.
#[derive(Serialize)]
struct Outcome {
    scene: String,
    triangles: usize,
    rays: &'static str,
    threads: usize,
    /// The fastest of ours, and of Embree's with and without its watertight kernel.
    native: f64,
    embree_best: Option<f64>,
    ratio: Option<f64>,
    embree_robust_best: Option<f64>,
    ratio_robust: Option<f64>,
    engines: Vec<Rates>,
}

/// Each side builds its hierarchy at most this many times.
const BUILDS: u32 = 5;

fn median(mut seconds: Vec<f64>) -> Option<f64> {
    seconds.sort_by(f64::total_cmp);
    seconds.get(seconds.len() / 2).copied()
}

fn measure(
    stage: &BenchScene,
    pools: &[ThreadPool],
    arguments: &Arguments,
    report: &mut Report,
) -> Result<()> {
    let (mut native_seconds, mut embree_seconds) = (Vec::new(), Vec::new());
    for _ in 0..arguments.rounds.min(BUILDS) {
        let start = Instant::now();
        drop(Bvh::<MollerTrumbore>::build(stage.triangles.clone()));
        native_seconds.push(start.elapsed().as_secs_f64());
        embree_seconds.extend(oracle_build_seconds(arguments, stage)?);
    }
    let native = Bvh::<MollerTrumbore>::build(stage.triangles.clone());
    let casters = oracle_casters(arguments, stage)?;
    report.builds.push(Build {
        scene: stage.name.clone(),
        triangles: stage.triangles.len(),
        native_seconds: median(native_seconds).expect("at least one round"),
        embree_seconds: median(embree_seconds),
        native_bytes: native.bytes() + size_of_val(&stage.triangles[..]),
        embree_bytes: casters.bytes,
    });
    let mut engines = vec![
        Engine {
            name: "native single",
            contender: Contender::Native,
            caster: &native,
            batched: false,
        },
        Engine {
            name: "native batched",
            contender: Contender::Native,
            caster: &native,
            batched: true,
        },
    ];
    engines.extend(casters.engines());
    let bars = Bars::new();
    bars.begin(progress::Stage::Bench, Some((Workload::ALL.len() * pools.len()) as u64));
    for kind in Workload::ALL {
        let rays = kind.rays(stage, arguments.rays, arguments.seed);
        for pool in pools {
            let outcome = compete(stage, kind, &rays, pool, &engines, arguments.rounds as usize);
            report.results.push(outcome);
            bars.advance(1);
        }
    }
    bars.end();
    Ok(())
}

fn compete(
    stage: &BenchScene,
    kind: Workload,
    rays: &[Ray],
    pool: &ThreadPool,
    engines: &[Engine],
    rounds: usize,
) -> Outcome {
    let query = match kind {
        Workload::Camera | Workload::Incoherent => Query::Nearest,
        Workload::Segments => Query::Occluded,
    };
    let rates = pool.install(|| race(engines, rays, query, rounds));
    let best = |contender| {
        let of_contender =
            engines.iter().zip(&rates).filter(|(engine, _)| engine.contender == contender);
        of_contender.map(|(_, rates)| rates.median).max_by(f64::total_cmp)
    };
    let native = best(Contender::Native).expect("the native engines take part");
    let (embree_best, embree_robust_best) =
        (best(Contender::Embree), best(Contender::EmbreeRobust));
    Outcome {
        scene: stage.name.clone(),
        triangles: stage.triangles.len(),
        rays: kind.name(),
        threads: pool.current_num_threads(),
        native,
        embree_best,
        ratio: embree_best.map(|rate| native / rate),
        embree_robust_best,
        ratio_robust: embree_robust_best.map(|rate| native / rate),
        engines: rates,
    }
}

#[cfg(feature = "embree")]
mod embree {
    use super::{Arguments, BenchScene, Contender, Engine, Result};
    use crate::oracle::{Device, EmbreeScene, Isa, Options, Packets};
    use std::time::Instant;

    pub(super) struct Casters {
        pub bytes: Option<usize>,
        all: Vec<(&'static str, Contender, EmbreeScene)>,
    }

    fn device(arguments: &Arguments) -> Result<Device> {
        Device::new(arguments.embree_isa.map_or("", Isa::config))
    }

    pub(super) fn oracle(arguments: &Arguments) -> Result<String> {
        Ok(device(arguments)?.description())
    }

    /// The time that Embree's default kernel takes, at its highest quality.
    pub(super) fn oracle_build_seconds(
        arguments: &Arguments,
        stage: &BenchScene,
    ) -> Result<Option<f64>> {
        let device = device(arguments)?;
        let start = Instant::now();
        EmbreeScene::build(&device, &stage.triangles, Options::default())?;
        Ok(Some(start.elapsed().as_secs_f64()))
    }

    pub(super) fn oracle_casters(arguments: &Arguments, stage: &BenchScene) -> Result<Casters> {
        let device = device(arguments)?;
        let mut casters = Casters { bytes: None, all: Vec::new() };
        for (contender, names) in [
            (Contender::Embree, ["Embree 1", "Embree 8", "Embree 16"]),
            (Contender::EmbreeRobust, ["Embree robust 1", "Embree robust 8", "Embree robust 16"]),
        ] {
            let robust = contender == Contender::EmbreeRobust;
            let options = Options { robust, packets: Packets::Single };
            let scene = EmbreeScene::build(&device, &stage.triangles, options)?;
            casters.bytes.get_or_insert(scene.bytes());
            let packets = [Packets::Single, Packets::Packet8, Packets::Packet16];
            for (name, packets) in names.into_iter().zip(packets) {
                casters.all.push((name, contender, scene.with_packets(packets)));
            }
        }
        Ok(casters)
    }

    impl Casters {
        pub(super) fn engines(&self) -> impl Iterator<Item = Engine<'_>> {
            self.all.iter().map(|(name, contender, scene)| Engine {
                name,
                contender: *contender,
                caster: scene,
                batched: true,
            })
        }
    }
}
#[cfg(feature = "embree")]
use embree::{oracle, oracle_build_seconds, oracle_casters};

#[cfg(not(feature = "embree"))]
mod alone {
    use super::{Arguments, BenchScene, Engine, Result};

    pub(super) struct Casters {
        pub bytes: Option<usize>,
    }

    pub(super) fn oracle(_: &Arguments) -> Result<String> {
        Ok("nothing; to race Embree, build with --features embree (see the README)".into())
    }

    pub(super) fn oracle_build_seconds(_: &Arguments, _: &BenchScene) -> Result<Option<f64>> {
        Ok(None)
    }

    pub(super) fn oracle_casters(_: &Arguments, _: &BenchScene) -> Result<Casters> {
        Ok(Casters { bytes: None })
    }

    impl Casters {
        pub(super) fn engines(&self) -> impl Iterator<Item = Engine<'_>> {
            std::iter::empty()
        }
    }
}
#[cfg(not(feature = "embree"))]
use alone::{oracle, oracle_build_seconds, oracle_casters};

impl Report {
    fn to_text(&self) -> String {
        let mut text = format!("native ({}) against {}\n\n", self.native, self.oracle);
        let _ = writeln!(
            text,
            "{:<22} {:>9} {:>10} {:>10} {:>12} {:>12}",
            "hierarchy", "triangles", "native s", "Embree s", "native B/tri", "Embree B/tri"
        );
        for build in &self.builds {
            let of_each = |bytes: usize| bytes as f64 / build.triangles as f64;
            let _ = writeln!(
                text,
                "{:<22} {:>9} {:>10.4} {:>10} {:>12.1} {:>12}",
                build.scene,
                build.triangles,
                build.native_seconds,
                number(build.embree_seconds, 4),
                of_each(build.native_bytes),
                number(build.embree_bytes.map(of_each), 1),
            );
        }
        let _ = writeln!(
            text,
            "\n{:<22} {:<10} {:>7} {:>8} {:>8} {:>7} {:>8} {:>7}",
            "Mrays/s", "rays", "threads", "native", "Embree", "ratio", "robust", "ratio"
        );
        for outcome in &self.results {
            let _ = writeln!(
                text,
                "{:<22} {:<10} {:>7} {:>8.2} {:>8} {:>7} {:>8} {:>7}",
                outcome.scene,
                outcome.rays,
                outcome.threads,
                outcome.native,
                number(outcome.embree_best, 2),
                number(outcome.ratio, 2),
                number(outcome.embree_robust_best, 2),
                number(outcome.ratio_robust, 2),
            );
            for rates in &outcome.engines {
                let Rates { engine, median, min, max, .. } = rates;
                let _ = writeln!(text, "    {engine:<20} {median:>8.2} ({min:.2} to {max:.2})");
            }
        }
        text
    }
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}
