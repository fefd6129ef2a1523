//! Counts of everything in a scene.

use super::Scene;
use crate::color::Rgb64;
use crate::geometry::TriangleId;
use crate::geometry::bounds::Bounds;

/// The facts that `isolux info` prints.
#[derive(Debug, Clone)]
pub(crate) struct Inspection {
    pub triangles: usize,
    /// Objects that the model files name.
    pub objects: usize,
    /// Triangles without area, which are not among `triangles`.
    pub degenerate: usize,
    /// Triangles that are there more than once.
    pub duplicates: usize,
    /// Distinct positions.
    pub vertices: usize,
    /// Edges with a triangle on one side only; 0 means that the mesh is closed.
    pub open_edges: usize,
    /// In square units.
    pub area: f64,
    pub bounds: Bounds,
    /// One per material, in the scene's order.
    pub materials: Vec<MaterialUse>,
}

/// How much of the scene has a material.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct MaterialUse {
    pub triangles: usize,
    /// In square units, one side.
    pub area: f64,
    /// Emitted power per channel in watts.
    pub power: Rgb64,
}

impl Inspection {
    pub(crate) fn of(scene: &Scene) -> Inspection {
        let topology = scene.topology();
        // The slowest two counts.
        let (open_edges, duplicates) =
            rayon::join(|| topology.open_edges(), || topology.duplicates());
        Inspection {
            triangles: scene.triangles.len(),
            objects: scene.mesh.object_count(),
            degenerate: scene.degenerate,
            duplicates,
            vertices: topology.vertex_count,
            open_edges,
            area: scene.area(),
            bounds: scene.bounds(),
            materials: material_uses(scene),
        }
    }

    pub(crate) fn emitting_triangles(&self) -> usize {
        self.materials.iter().filter(|m| m.power != Rgb64::ZERO).map(|m| m.triangles).sum()
    }
}

fn material_uses(scene: &Scene) -> Vec<MaterialUse> {
    let mut uses = vec![MaterialUse::default(); scene.materials.len()];
    let square_metres = scene.metres_per_unit * scene.metres_per_unit;
    for (index, triangle) in scene.triangles.iter().enumerate() {
        let id = TriangleId(index as u32);
        let material = scene.material(id);
        let sides = if material.emits_on_back { 2.0 } else { 1.0 };
        let used = &mut uses[scene.material_of[index].0 as usize];
        used.triangles += 1;
        used.area += triangle.area();
        // Exitance is π times the radiance of a Lambertian emitter.
        used.power += material.radiance.as_dvec3()
            * (std::f64::consts::PI * triangle.area() * sides * square_metres);
    }
    uses
}
