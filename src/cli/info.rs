//! `isolux info`: what is in a scene.

use super::render::is_light;
use super::{say, warn};
use crate::error::Result;
use crate::radiosity::{Choices, Method};
use crate::scene::inspect::Inspection;
use crate::scene::{Document, Scene};
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
        say(&(describe(&solution.title, solution.scene()) + &describe_light(&solution)));
        return Ok(());
    }
    let document = Document::open(&arguments.scene)?;
    let scene = document.scene()?;
    warn(&scene.warnings);
    say(&describe(&document.title, &scene));
    Ok(())
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
    // A title is a file's text, and must not speak to the terminal.
    let title = title.escape_debug();
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
    if facts.objects > 0 {
        let _ = writeln!(text, "  objects     {}", facts.objects);
    }
    let names: Vec<String> = scene.materials.iter().map(|m| shown(&m.name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(8);
    let _ = writeln!(
        text,
        "\n  {:width$}  {:>9}  {:>12}  {:22}  {:22}  power (W)",
        "material", "triangles", "area", "reflectance", "radiance"
    );
    for ((material, name), used) in scene.materials.iter().zip(&names).zip(&facts.materials) {
        let sides = if material.two_sided { "  two-sided" } else { "" };
        let _ = writeln!(
            text,
            "  {:width$}  {:>9}  {:>12.4}  {:22}  {:22}  {}{sides}",
            name,
            used.triangles,
            used.area,
            channels(material.reflectance.as_dvec3()),
            channels(material.radiance.as_dvec3()),
            channels(used.power),
        );
    }
    text
}

/// A name of a file for a column: it must not speak to the terminal, and one long name must not pad all others.
fn shown(name: &str) -> String {
    const LONGEST: usize = 60;
    let escaped = name.escape_debug();
    let ellipsis = if escaped.clone().nth(LONGEST).is_some() { "…" } else { "" };
    escaped.take(LONGEST).collect::<String>() + ellipsis
}

fn channels(rgb: crate::color::Rgb64) -> String {
    let short = |x: f64| if x == 0.0 { "0".to_string() } else { format!("{x:.4}") };
    format!("{} {} {}", short(rgb.x), short(rgb.y), short(rgb.z))
}
