//! Rays, triangles and hits as Rust source, bit for bit, ready to be pasted into a test.

use crate::geometry::{Hit, Ray, Triangle};
use glam::Vec3;

pub(crate) fn number(x: f32) -> String {
    format!("f32::from_bits({:#010x})", x.to_bits())
}

pub(crate) fn vector(v: Vec3) -> String {
    let [x, y, z] = v.to_array().map(number);
    format!("Vec3::from_array([{x}, {y}, {z}])")
}

pub(crate) fn ray(ray: &Ray) -> String {
    format!(
        "Ray {{ origin: {}, direction: {}, t_min: {}, t_max: {} }}",
        vector(ray.origin),
        vector(ray.direction),
        number(ray.t_min),
        number(ray.t_max),
    )
}

pub(crate) fn triangle(triangle: &Triangle) -> String {
    let [p0, p1, p2] = triangle.p.map(vector);
    format!("Triangle {{ p: [{p0}, {p1}, {p2}] }}")
}

/// A hit or none, with its triangle's number replaced by `index`.
pub(crate) fn hit(hit: Option<Hit>, index: usize) -> String {
    match hit {
        None => "None".to_string(),
        Some(hit) => format!(
            "Some(Hit {{ triangle: TriangleId({index}), t: {}, u: {}, v: {} }})",
            number(hit.t),
            number(hit.u),
            number(hit.v),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::TriangleId;

    #[test]
    fn what_is_printed_is_what_it_was() {
        // The expected text below is Rust source: it stands here once as text and once as code.
        let original =
            Ray { t_max: f32::INFINITY, ..Ray::new(Vec3::new(-0.0, 1.0, 1e-45), Vec3::X) };
        assert_eq!(
            ray(&original),
            "Ray { origin: Vec3::from_array([f32::from_bits(0x80000000), \
             f32::from_bits(0x3f800000), f32::from_bits(0x00000001)]), direction: \
             Vec3::from_array([f32::from_bits(0x3f800000), f32::from_bits(0x00000000), \
             f32::from_bits(0x00000000)]), t_min: f32::from_bits(0x00000000), t_max: \
             f32::from_bits(0x7f800000) }"
        );
        let pasted = Ray {
            origin: Vec3::from_array([
                f32::from_bits(0x80000000),
                f32::from_bits(0x3f800000),
                f32::from_bits(0x00000001),
            ]),
            direction: Vec3::from_array([f32::from_bits(0x3f800000), 0.0, 0.0]),
            t_min: f32::from_bits(0x00000000),
            t_max: f32::from_bits(0x7f800000),
        };
        assert_eq!(ray(&pasted), ray(&original));
        let answer = Hit { triangle: TriangleId(1234), t: 2.0, u: 0.5, v: 0.0 };
        assert_eq!(
            hit(Some(answer), 1),
            "Some(Hit { triangle: TriangleId(1), t: f32::from_bits(0x40000000), u: \
             f32::from_bits(0x3f000000), v: f32::from_bits(0x00000000) })"
        );
        assert_eq!(hit(None, 0), "None");
    }
}
