//! Triangles that emit.

use super::{Light, LightSample};
use crate::color::{Rgb64, luminance};
use crate::form_factor::pairs::{Facet, PairPoint, sample};
use crate::geometry::Triangle;
use crate::patches::{PatchMesh, Side};

/// The sides that emit, each chosen with a probability in proportion to its power.
pub struct EmittingTriangles<'m> {
    emitters: Vec<Emitter<'m>>,
    /// Sum of the probabilities up to and including each emitter; the last is 1.
    cumulative: Vec<f64>,
}

struct Emitter<'m> {
    facet: Facet<'m>,
    exitance: Rgb64,
    probability: f64,
}

impl<'m> EmittingTriangles<'m> {
    pub fn of(mesh: &'m PatchMesh) -> Self {
        let mut emitters: Vec<Emitter> = mesh
            .sides()
            .iter()
            .filter(|side| mesh.exitance(side.first) != glam::Vec3::ZERO)
            .map(|side| Emitter {
                facet: Facet::new(whole(mesh, side), side),
                exitance: mesh.exitance(side.first).as_dvec3(),
                probability: 0.0,
            })
            .collect();
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

    /// In square units.
    pub fn area(&self) -> f64 {
        self.emitters.iter().map(|e| e.facet.area()).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// The emitter for ξ, and ξ stretched over its share so that it can be used again.
    fn choose(&self, xi: f32) -> (&Emitter<'m>, f32) {
        let last = self.emitters.len() - 1;
        let xi = xi as f64;
        let index = self.cumulative.partition_point(|&sum| sum <= xi).min(last);
        let below = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let share = self.cumulative[index] - below;
        let stretched = ((xi - below) / share) as f32;
        (&self.emitters[index], stretched.clamp(0.0, 1f32.next_down()))
    }
}

fn whole(mesh: &PatchMesh, side: &Side) -> Triangle {
    let mut shape = mesh.scene.triangles[side.triangle.index()];
    if side.is_back {
        shape.p.swap(1, 2);
    }
    shape
}

impl Light for EmittingTriangles<'_> {
    /// Samples one of the triangles, as a pair with the receiver.
    fn sample(&self, receiver: &Facet, [x0, x1, y0, y1]: [f32; 4]) -> Option<LightSample> {
        let (emitter, y0) = self.choose(y0);
        let pair = sample(receiver, &emitter.facet, &PairPoint::uniform([x0, x1, y0, y1]))?;
        let factor = pair.exchange as f64 / receiver.area();
        let irradiance = emitter.exitance * (factor / emitter.probability);
        Some(LightSample { segment: pair.segment, irradiance })
    }
}
