//! Scenes in which a ray meets a large part of the triangles, as these lie in one place.
//!
//! No hierarchy helps there: n triangles that share a place cost each ray a time that grows with n, and rays that grow
//! with n as well would take n². So the light of such a scene is solved with fewer of them.

use super::Scene;
use super::material::Material;
use super::sums::sum;
use crate::error::Warning;
use crate::geometry::TriangleId;
use crate::geometry::bounds::Bounds;
use crate::known::known;

/// Boxes along a line up to which a scene is an ordinary one: dense scans have a few dozen, a tree
/// with leaves of cut-out textures some hundreds.
const CROWDED: f64 = 1000.0;

/// Boxes that the rays for one purpose may come to in a crowded scene, about: a few seconds on one thread.
const MOST_TESTS: f64 = 5e8;

/// How much longer a ray takes at a triangle that may let it through.
const SEE_THROUGH: f64 = 10.0;

impl Scene {
    /// Boxes of triangles that a random line through the box around them all meets, in the mean: the share of lines that
    /// meet a convex body is that of its surface (Crofton). See-through ones count more.
    pub(crate) fn crowding(&self) -> f64 {
        *known(&self.known_crowding, || {
            let surface = |bounds: &Bounds| {
                let d = bounds.diagonal().as_dvec3();
                d.x * d.y + d.y * d.z + d.z * d.x
            };
            let see_through: Vec<bool> =
                self.materials.iter().map(Material::is_see_through).collect();
            let weight = |number: usize| {
                let is_see_through = [false, true].iter().any(|is_back| {
                    see_through[self.material_on(TriangleId(number as u32), *is_back).0 as usize]
                });
                if is_see_through { SEE_THROUGH } else { 1.0 }
            };
            let surfaces = sum(self.triangles.len(), |number| {
                surface(&self.triangles[number].bounds()) * weight(number)
            });
            // Without a surface there is nothing to meet.
            if surfaces > 0.0 { surfaces / surface(&self.bounds()) } else { 0.0 }
        })
    }

    pub(crate) fn is_crowded(&self) -> bool {
        self.crowding() > CROWDED
    }

    /// How many rays each of `count` things may have, of the `usual` number: that, but in a crowded scene.
    pub(crate) fn affordable(&self, count: usize, usual: u32) -> u32 {
        if !self.is_crowded() {
            return usual;
        }
        let rays = MOST_TESTS / self.crowding() / count.max(1) as f64;
        usual.min(rays as u32).max(1)
    }

    /// Says that little is spent on the light of a crowded scene and on its pictures.
    pub(crate) fn crowding_warning(&self) -> Option<Warning> {
        self.is_crowded().then(|| {
            Warning::new(
                "a line through the scene meets the boxes of a thousand triangles or more on average (see-through \
                 ones count as ten), which makes rays slow: its light is solved with few samples and large patches, \
                 and pixels have few samples, unless others are asked for (--samples, --direct, --levels, --spp)",
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::geometry::Triangle;
    use crate::scene::{Material, MaterialId, Scene};
    use glam::Vec3;

    fn stack(count: usize, opacity: f32) -> Scene {
        let triangle = |k: usize| {
            let z = Vec3::Z * (k as f32 / count as f32);
            Triangle::new(z, Vec3::X + z, Vec3::Y + z)
        };
        let material = Material { opacity, ..Material::fallback() };
        let triangles: Vec<Triangle> = (0..count).map(triangle).collect();
        Scene::new(triangles, vec![MaterialId(0); count], vec![material])
    }

    #[test]
    fn a_stack_has_the_crowding_of_its_faces_and_few_rays_for_many_patches() {
        let scene = stack(9000, 1.0);
        // Each box has the surface of two unit squares, that around all nearly of six.
        assert!((scene.crowding() - 3000.0).abs() < 1.0, "{}", scene.crowding());
        assert_eq!(scene.affordable(1, 128), 128);
        assert_eq!(scene.affordable(18_000, 128), 9);
        assert_eq!(scene.affordable(1_000_000_000, 128), 1);
        assert_eq!(stack(9000, 0.5).affordable(1800, 128), 9);
        assert!(scene.crowding_warning().is_some());
        let ordinary = stack(900, 1.0);
        assert_eq!(ordinary.affordable(1_000_000_000, 128), 128);
        assert!(ordinary.crowding_warning().is_none());
    }
}
