//! Simple closed shapes, for examples and tests.

use super::Triangle;
use glam::{DVec3, Vec3};

/// The parallelogram with edges `u` and `v` at `corner`; its front looks along u × v.
pub fn square(corner: Vec3, u: Vec3, v: Vec3) -> Vec<Triangle> {
    let [a, b, c, d] = [corner, corner + u, corner + u + v, corner + v];
    vec![Triangle::new(a, b, c), Triangle::new(a, c, d)]
}

/// The six faces of a cube, looking outwards.
pub fn cube(corner: Vec3, edge: f32) -> Vec<Triangle> {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * edge);
    [(x, y, z), (y, z, x), (z, x, y)]
        .into_iter()
        .flat_map(|(u, v, w)| [square(corner, v, u), square(corner + w, u, v)].concat())
        .collect()
}

/// The triangles with their fronts where their backs were: a room of a block.
pub fn inside_out(mut triangles: Vec<Triangle>) -> Vec<Triangle> {
    triangles.iter_mut().for_each(|t| t.p.swap(1, 2));
    triangles
}

/// 20 · 4^levels triangles, their corners on the unit sphere, looking outwards.
pub fn icosphere(levels: u32) -> Vec<Triangle> {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let corner = |i: usize| {
        let (one, phi) = ([1.0, -1.0][i % 2], [golden, -golden][i / 2 % 2]);
        [DVec3::new(0.0, one, phi), DVec3::new(one, phi, 0.0), DVec3::new(phi, 0.0, one)][i / 4]
            .normalize()
    };
    // The icosahedron's faces are its triples of corners one edge, 2 / √(1 + φ²), apart.
    let edge = 2.0 / (1.0 + golden * golden).sqrt();
    let near = |a: usize, b: usize| (corner(a).distance(corner(b)) - edge).abs() < 1e-9;
    let mut faces = Vec::new();
    for (a, b, c) in
        (0..12).flat_map(|a| (a..12).flat_map(move |b| (b..12).map(move |c| (a, b, c))))
    {
        if near(a, b) && near(b, c) && near(c, a) {
            let [a, b, c] = [a, b, c].map(corner);
            let outwards = (b - a).cross(c - a).dot(a) > 0.0;
            faces.push(if outwards { [a, b, c] } else { [a, c, b] });
        }
    }
    assert_eq!(faces.len(), 20);
    for _ in 0..levels {
        faces = faces
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
            })
            .collect();
    }
    faces.into_iter().map(|p| Triangle { p: p.map(|p| p.as_vec3()) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(triangles: &[Triangle]) -> f64 {
        triangles.iter().map(Triangle::area).sum()
    }

    /// A sixth of Σ p₀·(p₁ × p₂), positive if the fronts look outwards.
    fn volume(triangles: &[Triangle]) -> f64 {
        let six = |t: &Triangle| {
            let [a, b, c] = t.p.map(|p| p.as_dvec3());
            a.dot(b.cross(c))
        };
        triangles.iter().map(six).sum::<f64>() / 6.0
    }

    #[test]
    fn a_cube_has_its_area_and_volume() {
        let cube = cube(Vec3::splat(-1.0), 2.0);
        assert_eq!((cube.len(), area(&cube), volume(&cube)), (12, 24.0, 8.0));
        assert_eq!(volume(&inside_out(cube)), -8.0);
    }

    #[test]
    fn an_icosphere_nears_the_sphere() {
        for levels in 0..4 {
            let sphere = icosphere(levels);
            assert_eq!(sphere.len(), 20 << (2 * levels));
            let missing = 1.0 - volume(&sphere) / (4.0 / 3.0 * std::f64::consts::PI);
            // The icosahedron lacks 39 %; each level lacks less than a third of what the last one did.
            assert!(missing > 0.0 && missing < 0.4 / 3f64.powi(levels as i32), "{missing}");
        }
    }
}
