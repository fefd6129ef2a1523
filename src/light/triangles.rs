//! Triangles that emit.

use super::{Light, LightSample};
use crate::color::{Rgb64, luminance};
use crate::form_factor::pairs::{Facet, PairPoint, sample};
use crate::geometry::TriangleId;
use crate::patches::Side;
use crate::scene::Scene;
use glam::Vec3;
use std::f32::consts::PI;

/// The sides that emit, each chosen with a probability in proportion to its power.
pub struct EmittingTriangles {
    emitters: Vec<Emitter>,
    /// Sum of the probabilities up to and including each emitter; the last is 1.
    cumulative: Vec<f64>,
}

struct Emitter {
    facet: Facet,
    exitance: Rgb64,
    probability: f64,
}

impl EmittingTriangles {
    pub fn of(scene: &Scene) -> Self {
        let triangles = (0..scene.triangles.len() as u32).map(TriangleId);
        let sides = triangles.filter(|t| scene.material(*t).emits()).flat_map(|triangle| {
            let backs = if scene.material(triangle).emits_on_back { 0..2 } else { 0..1 };
            backs.map(move |is_back| Side::new(scene, triangle, is_back == 1))
        });
        let emitter = |side: Side| Emitter {
            facet: Facet::new(side.shape(scene), &side),
            exitance: (scene.material(side.triangle).radiance * PI).as_dvec3(),
            probability: 0.0,
        };
        let mut emitters: Vec<Emitter> = sides.map(emitter).collect();
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
        let irradiance = emitter.exitance * (factor as f64 / emitter.probability);
        Some(LightSample { segment, irradiance })
    }
}
