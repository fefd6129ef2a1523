//! What rays meet one after the other where surfaces let a share of the light through.
//!
//! At each surface a ray ends by chance, which leaves noise. Where it matters, as straight light and in the pixels of
//! pictures, the layers are gone through instead. Along a segment the shares that pass are multiplied. Of a pixel's
//! rays each ends at one layer, by one number of its sample that is used up by layer after layer; these numbers are
//! spread evenly, so that each layer is seen by nearly its own share of the samples: Laine & Karras, *Stratified
//! Sampling for Stochastic Transparency*, EGSR 2011.

use crate::geometry::{Ending, Hit, Ray, RayCaster};
use crate::patches::PatchMesh;

/// One thread's buffers.
#[derive(Default)]
pub(crate) struct Layers {
    /// The rays that have not ended, how they do, and their numbers among all.
    rays: Vec<Ray>,
    endings: Vec<Ending>,
    open: Vec<usize>,
    hits: Vec<Option<Hit>>,
    blocked: Vec<bool>,
    rest: Vec<f32>,
}

/// How it is found out what passes along a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Along {
    /// Layer by layer.
    Layers,
    /// All or nothing: quicker.
    Chance,
}

impl Layers {
    /// Where each ray ends, by a number in [0, 1) of its own. Returns how many rays were traced for it.
    pub(crate) fn ends(
        &mut self,
        (caster, mesh): (&dyn RayCaster, &PatchMesh),
        rays: &[Ray],
        numbers: &[f32],
        hits: &mut Vec<Option<Hit>>,
    ) -> usize {
        if !mesh.is_translucent() {
            caster.nearest_batch(rays, hits);
            return rays.len();
        }
        hits.clear();
        hits.resize(rays.len(), None);
        let mut rest = std::mem::take(&mut self.rest);
        rest.clear();
        rest.extend_from_slice(numbers);
        let traced = self.go_through((caster, mesh), rays, |ray, hit, opacity| {
            hits[ray] = hit;
            let goes_on = hit.is_some() && rest[ray] >= opacity;
            // Rounded up to 1 it would go through what is opaque.
            rest[ray] = ((rest[ray] - opacity) / (1.0 - opacity)).min(1f32.next_down());
            goes_on
        });
        self.rest = rest;
        traced
    }

    /// The share of the light in [0, 1] that passes along each segment. Returns how many rays were traced for it.
    pub(crate) fn passed(
        &mut self,
        along: Along,
        (caster, mesh): (&dyn RayCaster, &PatchMesh),
        segments: &[Ray],
        shares: &mut Vec<f32>,
    ) -> usize {
        shares.clear();
        if along == Along::Chance || !mesh.is_translucent() {
            caster.occluded_batch(segments, &mut self.blocked);
            shares.extend(self.blocked.iter().map(|blocked| if *blocked { 0.0 } else { 1.0 }));
            return segments.len();
        }
        shares.resize(segments.len(), 1.0);
        self.go_through((caster, mesh), segments, |segment, hit, opacity| {
            shares[segment] *= if hit.is_some() { 1.0 - opacity } else { 1.0 };
            hit.is_some() && shares[segment] > 0.0
        })
    }

    /// Tells of each ray what it meets, layer by layer, with the opacity there, for as long as it wants to go on. An
    /// opacity of 1 is that of a layer behind which nothing is known.
    fn go_through(
        &mut self,
        (caster, mesh): (&dyn RayCaster, &PatchMesh),
        rays: &[Ray],
        mut goes_on: impl FnMut(usize, Option<Hit>, f32) -> bool,
    ) -> usize {
        self.rays.clear();
        self.rays.extend_from_slice(rays);
        self.endings.clear();
        self.endings.extend(rays.iter().map(Ending::at_first));
        self.open.clear();
        self.open.extend(0..rays.len());
        let mut traced = 0;
        while !self.open.is_empty() {
            traced += self.rays.len();
            caster.nearest_ending(&self.rays, &self.endings, &mut self.hits);
            let mut kept = 0;
            for k in 0..self.open.len() {
                let (ray, ending, hit) = (self.rays[k], self.endings[k], self.hits[k]);
                // A caster that met it again knows nothing of endings: its answers are final.
                let is_final = |hit: &Hit| ending.is_random() || ending.passes(hit.triangle);
                let opacity = match &hit {
                    None => 0.0,
                    Some(hit) if is_final(hit) => 1.0,
                    Some(hit) => mesh.scene.opacity_towards(&ray, hit),
                };
                let wants_more = goes_on(self.open[k], hit, opacity);
                if let Some(hit) = hit.filter(|_| wants_more && opacity < 1.0) {
                    self.rays[kept] = ray;
                    self.endings[kept] = ending.behind(hit.triangle);
                    self.open[kept] = self.open[k];
                    kept += 1;
                }
            }
            self.rays.truncate(kept);
            self.endings.truncate(kept);
            self.open.truncate(kept);
        }
        traced
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Tracer;
    use crate::geometry::Triangle;
    use crate::patches::Subdivision;
    use crate::scene::{Material, MaterialId, Scene};
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
    fn panes(opacities: &[f32]) -> PatchMesh {
        let of = |&opacity: &f32| Material { opacity, ..Material::fallback() };
        let at = |k: usize| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * k as f32);
        let count = opacities.len();
        let triangles = (0..count).map(|k| Triangle { p: at(k) }).collect();
        let of_triangles = (0..count as u32).map(MaterialId).collect();
        let scene = Scene::new(triangles, of_triangles, opacities.iter().map(of).collect());
        PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap()
    }

    fn rays() -> Vec<Ray> {
        let away = |k| Vec3::new(0.1 + k as f32 * 1e-4, 0.1, -1.0);
        (0..RAYS).map(|k| Ray::new(away(k), Vec3::Z)).collect()
    }

    /// How many rays end at each pane, and behind all of them; and how many were traced.
    fn ends(caster: &dyn RayCaster, mesh: &PatchMesh) -> (Vec<usize>, usize) {
        // Not in the order of their origins.
        let numbers: Vec<f32> = (0..RAYS).map(|k| (k * 1365 % RAYS) as f32 / RAYS as f32).collect();
        let mut hits = Vec::new();
        let traced = Layers::default().ends((caster, mesh), &rays(), &numbers, &mut hits);
        let count = mesh.scene.triangles.len();
        let mut ends = vec![0; count + 1];
        hits.iter().for_each(|hit| ends[hit.map_or(count, |hit| hit.triangle.index())] += 1);
        (ends, traced)
    }

    #[test]
    fn each_layer_is_seen_by_its_share_of_evenly_spread_numbers() {
        let mesh = panes(&[0.25, 0.0, 0.5, 0.125]);
        let tracer = Tracer::build(&mesh.scene);
        let (seen, traced) = ends(&tracer, &mesh);
        assert_eq!(seen, [1024, 0, 1536, 192, 1344]);
        assert_eq!(traced, RAYS + 3072 + 1536 + 1344);
        let mut shares = Vec::new();
        Layers::default().passed(Along::Layers, (&tracer, &mesh), &rays(), &mut shares);
        assert_eq!(shares, vec![0.75 * 0.5 * 0.875; RAYS]);
        // What is left of the last number is rounded up.
        let (mesh, mut hits) = (panes(&[0.09, 1.0]), Vec::new());
        let through = (&Tracer::build(&mesh.scene) as &dyn RayCaster, &mesh);
        Layers::default().ends(through, &rays()[..1], &[1f32.next_down()], &mut hits);
        assert_eq!(hits[0].map(|hit| hit.triangle.0), Some(1));
        let mesh = panes(&[0.25, 1.0, 0.5]);
        let tracer = Tracer::build(&mesh.scene);
        assert_eq!(ends(&tracer, &mesh).0, [1024, 3072, 0, 0]);
        Layers::default().passed(Along::Layers, (&tracer, &mesh), &rays(), &mut shares);
        assert_eq!(shares, vec![0.0; RAYS]);
    }

    #[test]
    fn behind_many_layers_and_through_other_casters_the_shares_are_right_on_average() {
        let mesh = panes(&[0.125; 20]);
        let share = |pane: i32| 0.125 * 0.875f64.powi(pane);
        let seen = |caster: &dyn RayCaster| ends(caster, &mesh).0;
        let layered = seen(&Tracer::build(&mesh.scene));
        let (by_chance, exact) = (seen(&Plain(Tracer::build(&mesh.scene))), 8);
        for pane in 0..20 {
            let expected = RAYS as f64 * share(pane);
            let deviation = (expected * (1.0 - share(pane))).sqrt();
            let off = |seen: &[usize]| (seen[pane as usize] as f64 - expected).abs();
            assert!(off(&by_chance) < 5.0 * deviation, "{pane}: {by_chance:?}");
            let allowed = if pane < exact { 1.0 } else { 5.0 * deviation };
            assert!(off(&layered) <= allowed, "{pane}: {layered:?}");
        }
        for caster in
            [&Tracer::build(&mesh.scene) as &dyn RayCaster, &Plain(Tracer::build(&mesh.scene))]
        {
            let mut shares = Vec::new();
            Layers::default().passed(Along::Layers, (caster, &mesh), &rays(), &mut shares);
            let mean = shares.iter().map(|share| f64::from(*share)).sum::<f64>() / RAYS as f64;
            // Shares lie in [0, 1], so that their deviation is at most that of all or nothing.
            let expected = 0.875f64.powi(20);
            let deviation = (expected * (1.0 - expected) / RAYS as f64).sqrt();
            assert!((mean - expected).abs() < 5.0 * deviation, "{mean}");
        }
    }
}
