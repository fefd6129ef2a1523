//! Draws with a ray caster of one's own: here one that counts what it passes on.
//!
//! `cargo run --release --example own_caster`

use isolux::geometry::{Hit, Ray};
use isolux::settings::PatchSettings;
use isolux::{Document, Frame, RayCaster, Settings, Solution, Tracer};
use std::sync::atomic::{AtomicU64, Ordering};

/// Passes every ray on and counts it.
struct Counting<C> {
    caster: C,
    rays: AtomicU64,
}

impl<C: RayCaster> RayCaster for Counting<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.rays.fetch_add(1, Ordering::Relaxed);
        self.caster.nearest(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.rays.fetch_add(1, Ordering::Relaxed);
        self.caster.occluded(ray)
    }
}

fn main() -> isolux::Result<()> {
    let document = Document::open("scenes/cornell-box.toml")?;
    let scene = document.scene()?;
    let counting = Counting { caster: Tracer::build(&scene), rays: AtomicU64::new(0) };
    let patches = PatchSettings { levels: Some(3), max_edge: None };
    let settings = Settings { patches, ..Settings::default() };
    let light = Solution::solve(&document, &scene, &counting, &settings, &())?;
    println!("the light took {} rays", counting.rays.load(Ordering::Relaxed));
    let picture = light.flat().draw(&counting, &light.camera, &Frame::new(256, 256), &())?;
    println!("with the picture {} rays", counting.rays.load(Ordering::Relaxed));
    picture.save("counted.png", light.exposure(&picture))
}
