//! Triangles that emit.
//!
//! Where a texture makes the radiance vary, each patch emits its mean: the pattern inside a patch is not sampled.

use super::{Light, LightSample};
use crate::color::{Rgb, Rgb64, luminance};
use crate::form_factor::pairs::{Facet, PairPoint, sample};
use crate::geometry::TriangleId;
use crate::patches::{Members, PatchId, PatchMesh, Side};
use crate::scene::Scene;
use glam::Vec3;
use std::f32::consts::PI;

/// The sides that emit, or their patches, each chosen with a probability in proportion to its power.
pub struct EmittingTriangles {
    emitters: Vec<Emitter>,
    /// Sum of the probabilities up to and including each emitter; the last is 1.
    cumulative: Vec<f64>,
}

/// Points of which one is chosen. Their places are spread evenly.
const CANDIDATES: usize = 4;
const GOLDEN: f32 = 0.618_034;

/// Above this share of the scene's area emitters are not small, and rays find them.
const SMALL: f64 = 0.1;

struct Emitter {
    facet: Facet,
    exitance: Rgb64,
    probability: f64,
    /// The square of the distance from nearer than which points of it do not count.
    far: f32,
}

impl EmittingTriangles {
    /// Whole sides, as if no texture made their radiance vary.
    pub fn of(scene: &Scene) -> Self {
        let triangles = (0..scene.triangles.len() as u32).map(TriangleId);
        let shines =
            |(t, is_back): &(TriangleId, bool)| scene.radiance_on(*t, *is_back) != Rgb::ZERO;
        let sides = triangles
            .flat_map(|triangle| [(triangle, false), (triangle, true)])
            .filter(shines)
            .map(|(triangle, is_back)| Side::new(scene, triangle, is_back));
        let emitter = |side: Side| Emitter {
            facet: Facet::new(side.shape(scene), &side),
            exitance: (scene.radiance_on(side.triangle, side.is_back) * PI).as_dvec3(),
            probability: 0.0,
            far: 0.0,
        };
        EmittingTriangles::new(sides.map(emitter).collect())
    }

    /// As `of`, for the patches of a scene: where a texture makes the radiance vary, each patch is an emitter.
    pub fn of_patches(mesh: &PatchMesh) -> Self {
        EmittingTriangles::of_sides(mesh, |_| true)
    }

    /// As `of_patches`, for those sides alone of which `counts` is true.
    pub(crate) fn of_sides(mesh: &PatchMesh, counts: impl Fn(&Side) -> bool) -> Self {
        let sides = mesh.sides().iter().filter(|side| counts(side));
        EmittingTriangles::new(sides.flat_map(|side| emitters_of(mesh, side)).collect())
    }

    /// Whether there are emitters, so small a part of the scene that rays rarely find them, and they should be
    /// sampled themselves.
    pub fn are_small(scene: &Scene) -> bool {
        scene.emits() && EmittingTriangles::of(scene).area() <= SMALL * scene.area()
    }

    fn new(mut emitters: Vec<Emitter>) -> Self {
        let power = |e: &Emitter| luminance(e.exitance.as_vec3()) as f64 * e.facet.area();
        let total: f64 = emitters.iter().map(power).sum();
        let mut sum = 0.0;
        let mut cumulative = Vec::with_capacity(emitters.len());
        for emitter in &mut emitters {
            let probability = power(emitter) / total;
            emitter.probability = probability;
            sum += probability;
            cumulative.push(sum);
        }
        if let Some(last) = cumulative.last_mut() {
            *last = 1.0;
        }
        EmittingTriangles { emitters, cumulative }
    }

    /// Patches of a solution as sources of what they send: with their radiosity in W·m⁻², and the square of the
    /// distance from which they count.
    pub(crate) fn of_bright(mesh: &PatchMesh, patches: &[(PatchId, Rgb, f32)]) -> Self {
        let facets = patches.iter().flat_map(|&(patch, radiosity, far)| {
            let exitance = (radiosity * mesh.opacity(patch) as f32).as_dvec3();
            let members = Members::of(mesh, patch);
            let sides = mesh.members(patch).iter();
            sides.map(move |side| {
                let facet = Facet::new(members.part(side), side);
                Emitter { facet, exitance, probability: 0.0, far }
            })
        });
        EmittingTriangles::new(facets.collect())
    }

    /// As [`sample_at`](Light::sample_at), by one of several points that is chosen in proportion to what it would
    /// bring: power alone would often choose what is far away or faces aside (Talbot, Cline & Egbert, *Importance
    /// Resampling for Global Illumination*, EGSR 2005). Unbiased, as each point is uniform by itself.
    pub(crate) fn resampled_at(
        &self,
        point: Vec3,
        normal: Vec3,
        [y0, y1, choice, _]: [f32; 4],
    ) -> Option<LightSample> {
        let of_candidate = |k: usize| {
            let y = [y0 + k as f32 / CANDIDATES as f32, y1 + k as f32 * GOLDEN];
            // Rounding may make a 1 of the fraction.
            let sample =
                self.sample_at(point, normal, y.map(|y| y.fract().min(1f32.next_down())))?;
            (sample.irradiance.element_sum() > 0.0).then_some(sample)
        };
        let candidates: [_; CANDIDATES] = std::array::from_fn(of_candidate);
        let weight = |sample: &LightSample| luminance(sample.irradiance.as_vec3()) as f64;
        let total: f64 = candidates.iter().flatten().map(weight).sum();
        let mut left = choice as f64 * total;
        let chosen = candidates.into_iter().flatten().find(|sample| {
            left -= weight(sample);
            left < 0.0
        })?;
        let factor = total / (CANDIDATES as f64 * weight(&chosen));
        Some(LightSample { irradiance: chosen.irradiance * factor, ..chosen })
    }

    /// In square units.
    pub fn area(&self) -> f64 {
        self.emitters.iter().map(|e| e.facet.area()).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// The emitter for ξ, and ξ stretched over its share so that it can be used again.
    fn choose(&self, xi: f32) -> (&Emitter, f32) {
        let last = self.emitters.len() - 1;
        let xi = xi as f64;
        let index = self.cumulative.partition_point(|&sum| sum <= xi).min(last);
        let below = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let share = self.cumulative[index] - below;
        let stretched = ((xi - below) / share) as f32;
        (&self.emitters[index], stretched.clamp(0.0, 1f32.next_down()))
    }
}

/// A side is one emitter where it is alike everywhere, else one per patch, each with its patch's mean: near a
/// picture that shines, one place is brighter than another.
fn emitters_of(mesh: &PatchMesh, side: &Side) -> Vec<Emitter> {
    if !side.radiates {
        return Vec::new();
    }
    let emitter = |facet, exitance: Rgb| {
        let exitance = exitance.as_dvec3();
        (exitance != Rgb64::ZERO).then_some(Emitter { facet, exitance, probability: 0.0, far: 0.0 })
    };
    if mesh.is_patterned_light(side) {
        let patches = side.patches();
        let exitance = |p| mesh.exitance(p) * mesh.opacity(p) as f32;
        patches.filter_map(|p| emitter(Facet::patch(mesh, p), exitance(p))).collect()
    } else {
        let facet = Facet::new(side.shape(&mesh.scene), side);
        let exitance = mesh.exitance(side.first) * mesh.opacity(side.first) as f32;
        emitter(facet, exitance).into_iter().collect()
    }
}

impl Light for EmittingTriangles {
    /// Samples one of the triangles, as a pair with the receiver.
    fn sample(&self, receiver: &Facet, [x0, x1, y0, y1]: [f32; 4]) -> Option<LightSample> {
        if self.is_empty() {
            return None;
        }
        let (emitter, y0) = self.choose(y0);
        let pair = sample(receiver, &emitter.facet, &PairPoint::uniform([x0, x1, y0, y1]))?;
        // The area in the exchange is that of f32 corners, which a sliver's patches can lose.
        let factor =
            if receiver.area() > 0.0 { pair.exchange as f64 / receiver.area() } else { 0.0 };
        let irradiance = emitter.exitance * (factor / emitter.probability);
        Some(LightSample { segment: pair.segment, irradiance })
    }

    /// Samples one of the triangles by its area.
    fn sample_at(&self, point: Vec3, normal: Vec3, [y0, y1]: [f32; 2]) -> Option<LightSample> {
        if self.is_empty() {
            return None;
        }
        let (emitter, y0) = self.choose(y0);
        let (segment, factor) = emitter.facet.seen_from(point, normal, [y0, y1])?;
        if segment.direction.length_squared() < emitter.far {
            return None;
        }
        let irradiance = emitter.exitance * (factor as f64 / emitter.probability);
        Some(LightSample { segment, irradiance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangle;
    use crate::patches::{PatchId, Subdivision, tests::patterned};
    use crate::sampling::{PointSet, Purpose, Stream};
    use crate::scene::{Material, MaterialId};

    #[test]
    fn emitters_and_patches_emit_one_power() {
        for wanted in [0, 3] {
            let scene = patterned();
            let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(wanted)).unwrap();
            let light = EmittingTriangles::of_patches(&mesh);
            let emitted: Rgb64 = light.emitters.iter().map(|e| e.exitance * e.facet.area()).sum();
            let patches = (0..mesh.len() as u32).map(PatchId);
            let power: Rgb64 = patches.map(|p| mesh.exitance(p).as_dvec3() * mesh.area(p)).sum();
            assert!((emitted - power).abs().max_element() < 1e-6 * power.max_element());
            assert!(power.min_element() > 0.0);
        }
    }

    /// Below the corner of a unit square that faces it, near and far: Howell's catalogue, C-11 for a point.
    #[test]
    fn a_square_lights_a_point_below_its_corner_as_the_closed_form_says() {
        for height in [0.5f32, 10.0] {
            let corner = |x: f32, y: f32| Vec3::new(x, y, height);
            let [a, b, c, d] =
                [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)].map(|(x, y)| corner(x, y));
            let material = Material { radiance: Rgb::splat(2.0), ..Material::fallback() };
            let triangles = vec![Triangle::new(a, b, c), Triangle::new(a, c, d)];
            let scene = Scene::new(triangles, vec![MaterialId(0); 2], vec![material]);
            let light = EmittingTriangles::of(&scene);
            let side = 1.0 / height as f64;
            let root = (1.0 + side * side).sqrt();
            let expected = 2.0 * (side / root) * (side / root).atan();
            let stream = Stream::new(1, Purpose::Bench, 0, PointSet::Sobol);
            let sample = |k| {
                let [y0, y1, ..] = stream.point(k);
                light.sample_at(Vec3::ZERO, Vec3::Z, [y0, y1]).map_or(0.0, |s| s.irradiance.x)
            };
            let found = (0..4096).map(sample).sum::<f64>() / 4096.0;
            // 4096 independent points would be off by about 0.5 %; low-discrepancy ones are by far less.
            assert!((found / expected - 1.0).abs() < 2e-3, "{height}: {found} and {expected}");
        }
    }
}
