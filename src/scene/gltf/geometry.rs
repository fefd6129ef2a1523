//! The triangles of glTF meshes, in the scene's coordinates.

use super::accessor::Data;
use super::checks::finite;
use super::json::{self, Node, Primitive};
use super::materials::quoted;
use super::nodes::AGAIN;
use super::pose::{self, Pose};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::scene::budget::Budget;
use crate::scene::material::MaterialId;
use crate::scene::mesh::{Mesh, Origin, Part, PerCorner};
use crate::scene::model::checked_position;
use glam::{DVec3, Vec2, Vec3};
use std::collections::HashMap;

/// Collects the triangles of a scene.
#[derive(Default)]
pub(super) struct Geometry {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub material_of: Vec<MaterialId>,
    parts: Vec<Part>,
    origins: Vec<Origin>,
    texture: Attribute<Vec2>,
    normals: Attribute<Vec3>,
    colors: Attribute<Rgb>,
    /// How many primitives are points or lines, or have no positions.
    pub not_triangles: usize,
    budget: Budget,
    /// The positions of accessors that primitives of the current object share.
    shared: HashMap<usize, Vertices>,
}

/// Positions of a primitive.
#[derive(Debug, Clone, Copy)]
struct Vertices {
    first: u32,
    count: u32,
    /// Whether the pose turns triangles round.
    mirrored: bool,
}

/// Values at corners, and each triangle's numbers of them, as far as there are any.
#[derive(Default)]
struct Attribute<T> {
    values: Vec<T>,
    numbers: Vec<[u32; 3]>,
    /// The number of the first value, and how many there are, of accessors that primitives share.
    shared: HashMap<usize, (u32, u32)>,
}

impl<T: Copy> Attribute<T> {
    /// Adds the values of an accessor, if there is one and it is new, and those that a primitive's triangles have;
    /// `before` is the number of triangles so far.
    fn extend(
        &mut self,
        accessor: Option<usize>,
        triangles: &[[u32; 3]],
        before: usize,
        read: impl FnOnce(usize) -> Result<Vec<T>>,
    ) -> Result<()> {
        let Some(accessor) = accessor else { return Ok(()) };
        let (first, count) = match self.shared.get(&accessor) {
            Some(known) => *known,
            None => {
                let values = read(accessor)?;
                let new = (self.values.len() as u32 + 1, values.len() as u32);
                self.values.extend(values);
                self.shared.insert(accessor, new);
                new
            }
        };
        if count > 0 {
            let number = |corner: u32| if corner < count { first + corner } else { 0 };
            self.numbers.resize(before, [0; 3]);
            self.numbers.extend(triangles.iter().map(|corners| corners.map(number)));
        }
        Ok(())
    }

    /// The values of all triangles, of which there are `count`.
    fn take(&mut self, count: usize) -> Option<PerCorner<T>> {
        if !self.values.is_empty() {
            self.numbers.resize(count, [0; 3]);
        }
        PerCorner::new(std::mem::take(&mut self.values), std::mem::take(&mut self.numbers))
    }
}

/// A primitive of a mesh, where its mesh stands.
pub(super) struct Placement<'a> {
    pub node: &'a Node,
    pub mesh: usize,
    pub primitive: usize,
    pub pose: Pose<'a>,
    /// The material's number, and its set of texture coordinates.
    pub material: MaterialId,
    pub texture_set: u32,
}

impl Geometry {
    /// Begins an object with the name of a node, or of its mesh.
    pub(super) fn object(&mut self, name: Option<&String>) {
        self.parts.push(Part { model: 0, object: name.cloned(), group: None });
        // Each object has a pose of its own.
        self.shared.clear();
        self.normals.shared.clear();
    }

    /// Adds a primitive to the object that was begun last.
    pub(super) fn add(&mut self, data: &Data, place: &Placement) -> Result<()> {
        let mesh = &data.root.meshes[place.mesh];
        let primitive = &mesh.primitives[place.primitive];
        let positions = json::index(&primitive.attributes, "POSITION");
        let (Some(positions), 4..=6) = (positions, primitive.mode.unwrap_or(4)) else {
            self.not_triangles += 1;
            return Ok(());
        };
        let name = quoted(&mesh.name, place.mesh);
        let vertices = self.vertices(data, place, primitive, positions, &name)?;
        let mut triangles = triangles(data, primitive, vertices.count as usize, &name)?;
        self.reserve(0, triangles.len())?;
        if vertices.mirrored {
            triangles.iter_mut().for_each(|[_, b, c]| std::mem::swap(b, c));
        }
        self.attributes(data, place, primitive, &triangles)?;
        let part = self.parts.len() as u32 - 1;
        let first = self.triangles.len() as u32 + 1;
        self.origins.extend((first..).zip(&triangles).map(|(face, _)| Origin { face, part }));
        self.material_of.extend(triangles.iter().map(|_| place.material));
        self.triangles.extend(triangles.iter().map(|t| t.map(|corner| corner + vertices.first)));
        Ok(())
    }

    /// The vertices whose positions an accessor holds: added here, unless another primitive of the object has
    /// added them and nothing of its own moves this one's.
    fn vertices(
        &mut self,
        data: &Data,
        place: &Placement,
        primitive: &Primitive,
        accessor: usize,
        name: &str,
    ) -> Result<Vertices> {
        let is_shared = primitive.targets.is_empty() && place.pose.joints.is_none();
        if let Some(known) = self.shared.get(&accessor).filter(|_| is_shared) {
            return Ok(*known);
        }
        let mut positions = data.read::<f64, 3>(accessor)?;
        let mesh = &data.root.meshes[place.mesh];
        pose::morph(data, place.node, mesh, primitive, &mut positions)?;
        self.reserve(positions.len(), 0)?;
        let (positions, mirrored) = place.pose.apply(data, primitive, positions)?;
        let (first, count) = (self.positions.len() as u32, positions.len() as u32);
        for (number, position) in positions.into_iter().enumerate() {
            let place =
                format_args!("mesh {name}, primitive {}, vertex {number}: ", place.primitive);
            self.positions.push(checked_position(position, place)?);
        }
        let vertices = Vertices { first, count, mirrored };
        if is_shared {
            self.shared.insert(accessor, vertices);
        }
        Ok(vertices)
    }

    fn attributes(
        &mut self,
        data: &Data,
        place: &Placement,
        primitive: &Primitive,
        triangles: &[[u32; 3]],
    ) -> Result<()> {
        let accessor = |name: &str| json::index(&primitive.attributes, name);
        let before = self.triangles.len();
        // v runs down in glTF.
        let up = |[u, v]: [f64; 2]| finite(Vec2::new(u as f32, (1.0 - v) as f32));
        let texture = accessor(&format!("TEXCOORD_{}", place.texture_set));
        self.texture.extend(texture, triangles, before, |accessor| {
            Ok(data.read::<f64, 2>(accessor)?.into_iter().map(up).collect())
        })?;
        self.normals.extend(accessor("NORMAL"), triangles, before, |accessor| {
            Ok(place.pose.normals(data.read::<f64, 3>(accessor)?))
        })?;
        self.colors
            .extend(accessor("COLOR_0"), triangles, before, |accessor| colors(data, accessor))
    }

    /// Many small meshes may name one large list.
    fn reserve(&mut self, positions: usize, triangles: usize) -> Result<()> {
        const PER_POSITION: u64 = 2 * size_of::<DVec3>() as u64 + 32;
        const PER_TRIANGLE: u64 = 5 * size_of::<[u32; 3]>() as u64 + 12;
        let large = |before: usize, more: usize| before + more > u32::MAX as usize - 1;
        if large(self.positions.len(), positions) || large(self.triangles.len(), triangles) {
            return Err(Error::new("the model has more triangles than can be numbered")
                .remedy("split the model, or simplify it"));
        }
        self.budget.take(positions as u64 * PER_POSITION + triangles as u64 * PER_TRIANGLE)
    }

    pub(super) fn mesh(&mut self) -> Mesh {
        let count = self.triangles.len();
        Mesh {
            origins: std::mem::take(&mut self.origins),
            parts: std::mem::take(&mut self.parts),
            texture: self.texture.take(count),
            normals: self.normals.take(count),
            colors: self.colors.take(count),
        }
    }
}

/// The triangles of a primitive, as indices into its own vertices.
fn triangles(
    data: &Data,
    primitive: &Primitive,
    vertices: usize,
    mesh: &str,
) -> Result<Vec<[u32; 3]>> {
    let corners = || match primitive.indices {
        Some(accessor) => data.indices(accessor),
        None => Ok((0..vertices as u32).collect()),
    };
    let triangles: Vec<[u32; 3]> = match (primitive.mode, primitive.indices) {
        (Some(5), _) => {
            let turned = |(k, w): (usize, &[u32])| [w[0], w[1 + k % 2], w[2 - k % 2]];
            corners()?.windows(3).enumerate().map(turned).collect()
        }
        (Some(6), _) => {
            let corners = corners()?;
            let rim = corners.get(1..).unwrap_or_default();
            rim.windows(2).map(|w| [corners[0], w[0], w[1]]).collect()
        }
        (_, Some(accessor)) => data.triples(accessor)?,
        (_, None) => (0..vertices as u32 / 3).map(|k| [0, 1, 2].map(|c| 3 * k + c)).collect(),
    };
    match triangles.as_flattened().iter().find(|corner| **corner as usize >= vertices) {
        None => Ok(triangles),
        Some(corner) => {
            let cause =
                format!("mesh {mesh} names vertex {corner}, but it has {vertices} vertices");
            Err(Error::new(cause).remedy(AGAIN))
        }
    }
}

/// Linear colours; their opacity is left aside.
fn colors(data: &Data, accessor: usize) -> Result<Vec<Rgb>> {
    let color = |r: f64, g: f64, b: f64| {
        finite(Rgb::new(r as f32, g as f32, b as f32)).clamp(Rgb::ZERO, Rgb::ONE)
    };
    Ok(match data.shape(accessor)? {
        4 => {
            data.read::<f64, 4>(accessor)?.into_iter().map(|[r, g, b, _]| color(r, g, b)).collect()
        }
        _ => data.read::<f64, 3>(accessor)?.into_iter().map(|[r, g, b]| color(r, g, b)).collect(),
    })
}
