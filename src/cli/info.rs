//! `isolux info`: what is in a scene.

use super::render::is_light;
use super::{say, warn};
use crate::color::Rgb64;
use crate::error::{Result, in_one_line};
use crate::patches::{PatchId, PatchMesh, Subdivision};
use crate::radiosity::{Choices, Method};
use crate::scene::inspect::Inspection;
use crate::scene::{Document, Material, Scene};
use crate::solution::Solution;
use clap::ValueEnum;
use std::fmt::Write;
use std::path::PathBuf;

/// Count what is in a scene: triangles, materials, emitters, and what is wrong with the mesh.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A scene description (.toml), a model (.obj, .glb, .gltf, .ply, .stl), or solved light (.light)
    scene: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if is_light(&arguments.scene) {
        let solution = Solution::load(&arguments.scene)?;
        return say(&(describe(&solution.title, solution.scene()) + &describe_light(&solution)));
    }
    let document = Document::open(&arguments.scene)?;
    let scene = document.scene()?;
    warn(&scene.warnings);
    say(&describe(&document.title, &scene))
}

fn describe_light(solution: &Solution) -> String {
    let Choices { method, samples, points, direct_samples, solver, seed, .. } = solution.choices;
    let views: Vec<&str> = solution.views.keys().map(String::as_str).collect();
    let per = match method {
        Method::Pairs => "samples per pair",
        Method::Hemisphere => "rays per patch",
    };
    let [scene, choices] = solution.fingerprints();
    let residual = match solution.figures.residuals.last() {
        Some(residual) => format!("residual {residual:.1e}"),
        None => "not iterated".into(),
    };
    format!(
        "\n\x20 light       {} patches, {samples} {per} ({}), {direct_samples} points of lamps\n\
         \x20 solved by   {}, seed {seed}, {residual} after {} iterations\n\
         \x20 views       {}\n\
         \x20 fingerprint {scene:08x} of the scene, {choices:08x} of the choices\n",
        solution.irradiance().len(),
        name(&points),
        name(&solver),
        solution.figures.iterations,
        if views.is_empty() { "none by name".into() } else { views.join(", ") },
    )
}

/// As the command line and descriptions spell it.
fn name(value: &impl ValueEnum) -> String {
    value.to_possible_value().expect("no name is hidden").get_name().to_string()
}

fn describe(title: &str, scene: &Scene) -> String {
    let facts = Inspection::of(scene);
    let bounds = facts.bounds;
    let closed = if facts.open_edges == 0 { " (closed)" } else { "" };
    let title = in_one_line(title);
    let mut text = format!(
        "{title}\n\
         \x20 triangles   {} ({} degenerate left out, {} duplicates)\n\
         \x20 vertices    {}\n\
         \x20 open edges  {}{closed}\n\
         \x20 area        {:.6} square units, {:.6} m²\n\
         \x20 bounds      {} to {}\n\
         \x20 emitters    {} triangles\n",
        facts.triangles,
        facts.degenerate,
        facts.duplicates,
        facts.vertices,
        facts.open_edges,
        facts.area,
        facts.area * scene.metres_per_unit.powi(2),
        bounds.min,
        bounds.max,
        facts.emitting_triangles(),
    );
    let overlapping = scene.overlaps().triangles().count();
    let counts = [
        ("objects", facts.objects, ""),
        ("textures", scene.textures.len(), ""),
        ("overlaps", overlapping, " triangles in one plane with others"),
    ];
    for (name, count, what) in counts.into_iter().filter(|(_, count, _)| *count > 0) {
        let _ = writeln!(text, "  {name:<11} {count}{what}");
    }
    let names: Vec<String> = scene.materials.iter().take(ROWS).map(|m| shown(&m.name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(8);
    let _ = writeln!(
        text,
        "\n  {:width$}  {:>9}  {:>12}  {:22}  {:22}  power (W)",
        "material", "triangles", "area", "reflectance", "radiance"
    );
    let power = emitted(scene);
    let rows = names.iter().zip(scene.materials.iter().zip(&facts.materials));
    for (k, (name, (material, used))) in rows.enumerate() {
        let _ = writeln!(
            text,
            "  {:width$}  {:>9}  {:>12.4}  {:22}  {:22}  {}{}",
            name,
            used.triangles,
            used.area,
            channels(material.reflectance.as_dvec3()),
            channels(material.radiance.as_dvec3()),
            channels(power.as_ref().map_or(used.power, |power| power[k])),
            remarks(material),
        );
    }
    if let more @ 1.. = scene.materials.len() - names.len() {
        let _ = writeln!(text, "  and {more} more");
    }
    text
}

/// At most this many materials are listed.
const ROWS: usize = 1000;

/// Remarks on a material that the columns leave out.
fn remarks(material: &Material) -> String {
    let mut text = String::new();
    let mut add = |is_so: bool, words: &str| {
        if is_so {
            text += "  ";
            text += words;
        }
    };
    add(material.two_sided, "two-sided");
    add(material.reflectance_map.is_some(), "textured");
    add(material.radiance_map.is_some(), "glowing texture");
    let opacity = format!("opacity {}", material.opacity);
    add(material.opacity < 1.0, &opacity);
    add(material.opacity_map.is_some(), "cut out");
    text
}

/// The power of each material in watts, where textures make it vary.
fn emitted(scene: &Scene) -> Option<Vec<Rgb64>> {
    scene.materials.iter().find(|material| material.radiance_map.is_some())?;
    let mesh = PatchMesh::subdivide(scene, Subdivision::Levels(0)).ok()?;
    let mut power = vec![Rgb64::ZERO; scene.materials.len()];
    for patch in (0..mesh.len() as u32).map(PatchId) {
        let area = mesh.opaque_area(patch) * scene.metres_per_unit.powi(2);
        power[mesh.side(patch).material.0 as usize] += mesh.exitance(patch).as_dvec3() * area;
    }
    Some(power)
}

/// A name of a file for a column: it must not speak to the terminal, and one long name must not pad all others.
fn shown(name: &str) -> String {
    const LONGEST: usize = 60;
    // Escaping makes nothing shorter.
    let start: String = name.chars().take(LONGEST + 1).collect();
    let escaped = in_one_line(&start);
    let ellipsis = if escaped.chars().nth(LONGEST).is_some() { "…" } else { "" };
    escaped.chars().take(LONGEST).collect::<String>() + ellipsis
}

fn channels(rgb: Rgb64) -> String {
    let short = |x: f64| if x == 0.0 { "0".to_string() } else { format!("{x:.4}") };
    format!("{} {} {}", short(rgb.x), short(rgb.y), short(rgb.z))
}
