//! What the rays of a picture end at where surfaces let a share of the light through.
//!
//! One number of the sample decides at which of the layers behind each other its ray ends. The samples of a pixel have
//! their numbers spread evenly, so that each layer is seen by nearly its own share of them, where chance at each layer
//! would leave noise: Laine & Karras, *Stratified Sampling for Stochastic Transparency*, EGSR 2011.

use crate::geometry::{Ending, Hit, Ray, RayCaster};
use crate::scene::Scene;

/// The rays that have not ended yet, and one thread's buffers for them.
#[derive(Default)]
pub(super) struct Layers {
    rays: Vec<Ray>,
    endings: Vec<Ending>,
    hits: Vec<Option<Hit>>,
    open: Vec<Open>,
}

/// A ray that may go on behind what it met.
struct Open {
    sample: usize,
    /// Uniform in [0, 1), whatever it has passed.
    number: f32,
}

impl Layers {
    /// Finds where each ray ends, by a number in [0, 1) of its own, and returns how many rays were traced for it.
    pub(super) fn find(
        &mut self,
        (caster, scene): (&dyn RayCaster, &Scene),
        rays: &[Ray],
        numbers: &[f32],
        hits: &mut Vec<Option<Hit>>,
    ) -> usize {
        hits.clear();
        hits.resize(rays.len(), None);
        self.rays.clear();
        self.rays.extend_from_slice(rays);
        self.endings.clear();
        self.endings.extend(rays.iter().map(Ending::at_first));
        self.open.clear();
        self.open
            .extend(numbers.iter().enumerate().map(|(sample, &number)| Open { sample, number }));
        let mut traced = 0;
        while !self.open.is_empty() {
            traced += self.rays.len();
            caster.nearest_ending(&self.rays, &self.endings, &mut self.hits);
            self.go_on(scene, hits);
        }
        traced
    }

    /// Keeps the rays that go on behind what they met.
    fn go_on(&mut self, scene: &Scene, hits: &mut [Option<Hit>]) {
        let mut kept = 0;
        for k in 0..self.open.len() {
            let Open { sample, number } = self.open[k];
            hits[sample] = self.hits[k];
            let Some(hit) = self.hits[k] else { continue };
            let (ray, ending) = (self.rays[k], self.endings[k]);
            // A caster that met it again knows nothing of endings: its answers are final.
            if ending.is_random() || ending.passes(hit.triangle) {
                continue;
            }
            let opacity = scene.opacity_towards(&ray, &hit);
            if number < opacity {
                continue;
            }
            let number = (number - opacity) / (1.0 - opacity);
            self.rays[kept] = ray;
            self.endings[kept] = ending.behind(hit.triangle);
            self.open[kept] = Open { sample, number };
            kept += 1;
        }
        self.rays.truncate(kept);
        self.endings.truncate(kept);
        self.open.truncate(kept);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Tracer;
    use crate::geometry::Triangle;
    use crate::scene::{Material, MaterialId};
    use glam::Vec3;

    const RAYS: usize = 4096;

    /// Asks another caster, and knows nothing of endings.
    struct Plain(Tracer);

    impl RayCaster for Plain {
        fn nearest(&self, ray: &Ray) -> Option<Hit> {
            self.0.nearest(ray)
        }

        fn occluded(&self, ray: &Ray) -> bool {
            self.0.occluded(ray)
        }
    }

    /// Panes behind each other, of these opacities.
    fn panes(opacities: &[f32]) -> Scene {
        let of = |&opacity: &f32| Material { opacity, ..Material::fallback() };
        let at = |k: usize| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * k as f32);
        let count = opacities.len();
        let triangles = (0..count).map(|k| Triangle { p: at(k) }).collect();
        let of_triangles = (0..count as u32).map(MaterialId).collect();
        Scene::new(triangles, of_triangles, opacities.iter().map(of).collect())
    }

    /// How many rays end at each pane, and behind all of them; and how many were traced.
    fn ends(caster: &dyn RayCaster, scene: &Scene) -> (Vec<usize>, usize) {
        let away = |k| Vec3::new(0.1 + k as f32 * 1e-4, 0.1, -1.0);
        let rays: Vec<Ray> = (0..RAYS).map(|k| Ray::new(away(k), Vec3::Z)).collect();
        // Not in the order of their origins.
        let numbers: Vec<f32> = (0..RAYS).map(|k| (k * 1365 % RAYS) as f32 / RAYS as f32).collect();
        let mut hits = Vec::new();
        let traced = Layers::default().find((caster, scene), &rays, &numbers, &mut hits);
        let count = scene.triangles.len();
        let mut ends = vec![0; count + 1];
        hits.iter().for_each(|hit| ends[hit.map_or(count, |hit| hit.triangle.index())] += 1);
        (ends, traced)
    }

    #[test]
    fn each_layer_is_seen_by_its_share_of_evenly_spread_numbers() {
        let scene = panes(&[0.25, 0.0, 0.5, 0.125]);
        let (seen, traced) = ends(&Tracer::build(&scene), &scene);
        assert_eq!(seen, [1024, 0, 1536, 192, 1344]);
        assert_eq!(traced, RAYS + 3072 + 1536 + 1344);
    }

    #[test]
    fn behind_many_layers_and_through_other_casters_the_shares_are_right_on_average() {
        let scene = panes(&[0.125; 20]);
        let share = |pane: i32| 0.125 * 0.875f64.powi(pane);
        let seen = |caster: &dyn RayCaster| ends(caster, &scene).0;
        let layered = seen(&Tracer::build(&scene));
        let (by_chance, exact) = (seen(&Plain(Tracer::build(&scene))), 8);
        for pane in 0..20 {
            let expected = RAYS as f64 * share(pane);
            let deviation = (expected * (1.0 - share(pane))).sqrt();
            let off = |seen: &[usize]| (seen[pane as usize] as f64 - expected).abs();
            assert!(off(&by_chance) < 5.0 * deviation, "{pane}: {by_chance:?}");
            let allowed = if pane < exact { 1.0 } else { 5.0 * deviation };
            assert!(off(&layered) <= allowed, "{pane}: {layered:?}");
        }
    }
}
