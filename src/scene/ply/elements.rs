//! The elements of a PLY file that are used, and how the parser fills them.

use super::header::TEXTURE;
use crate::color::srgb_decode;
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult, ScalarType};

#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Vertex {
    pub position: [f64; 3],
    pub normal: [f32; 3],
    /// Linear.
    pub color: [f32; 3],
    pub texture: [f32; 2],
}

/// A face or a strip.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Face {
    /// Numbers of vertices from 0, as the file has them.
    pub corners: Vec<f64>,
    /// Linear.
    pub color: [f32; 3],
    /// u and v of each corner, if they are the face's own.
    pub texture: Vec<f32>,
    /// Which of the file's pictures it shows.
    pub picture: usize,
}

/// An element that is not used.
#[derive(Debug, Clone, Default)]
pub(super) struct Skipped;

/// Something that takes the properties of an element.
pub(super) trait Element: Default {
    fn scalar(&mut self, _name: &str, _value: f64, _kind: &ScalarType) {}
    fn list(&mut self, _name: &str, _values: Vec<f64>) {}
}

impl Element for Vertex {
    fn scalar(&mut self, name: &str, value: f64, kind: &ScalarType) {
        match name {
            "x" => self.position[0] = value,
            "y" => self.position[1] = value,
            "z" => self.position[2] = value,
            "nx" => self.normal[0] = finite(value),
            "ny" => self.normal[1] = finite(value),
            "nz" => self.normal[2] = finite(value),
            _ if color(&mut self.color, name, value, kind) => {}
            _ if TEXTURE.iter().any(|names| names[0] == name) => self.texture[0] = finite(value),
            _ if TEXTURE.iter().any(|names| names[1] == name) => self.texture[1] = finite(value),
            _ => {}
        }
    }
}

impl Element for Face {
    fn scalar(&mut self, name: &str, value: f64, kind: &ScalarType) {
        match name {
            "texnumber" => self.picture = value as usize,
            _ => drop(color(&mut self.color, name, value, kind)),
        }
    }

    fn list(&mut self, name: &str, values: Vec<f64>) {
        match name {
            "vertex_indices" | "vertex_index" => self.corners = values,
            "texcoord" => self.texture = values.into_iter().map(finite).collect(),
            _ => {}
        }
    }
}

impl Element for Skipped {}

/// Texture coordinates and normals only matter to the look: one that has no meaning is 0.
fn finite(value: f64) -> f32 {
    if (value as f32).is_finite() { value as f32 } else { 0.0 }
}

/// Whole numbers are shares of the largest in sRGB; others are linear.
fn color(color: &mut [f32; 3], name: &str, value: f64, kind: &ScalarType) -> bool {
    let channel = match name {
        "red" => 0,
        "green" => 1,
        "blue" => 2,
        _ => return false,
    };
    let value = finite(value);
    color[channel] = match kind {
        ScalarType::Float | ScalarType::Double => value.clamp(0.0, 1.0),
        ScalarType::Short | ScalarType::UShort => srgb_decode(value / 65535.0),
        _ => srgb_decode(value / 255.0),
    };
    true
}

/// What the parser of binary files fills.
#[derive(Debug, Default)]
pub(super) struct Row<E>(pub E);

impl<E: Element> PropertyAccess for Row<E> {
    fn new() -> Self {
        Row(E::default())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        use Property as P;
        use ScalarType as S;
        let element = &mut self.0;
        match property {
            P::Char(x) => element.scalar(name, x.into(), &S::Char),
            P::UChar(x) => element.scalar(name, x.into(), &S::UChar),
            P::Short(x) => element.scalar(name, x.into(), &S::Short),
            P::UShort(x) => element.scalar(name, x.into(), &S::UShort),
            P::Int(x) => element.scalar(name, x.into(), &S::Int),
            P::UInt(x) => element.scalar(name, x.into(), &S::UInt),
            P::Float(x) => element.scalar(name, x.into(), &S::Float),
            P::Double(x) => element.scalar(name, x, &S::Double),
            P::ListChar(list) => element.list(name, numbers(list)),
            P::ListUChar(list) => element.list(name, numbers(list)),
            P::ListShort(list) => element.list(name, numbers(list)),
            P::ListUShort(list) => element.list(name, numbers(list)),
            P::ListInt(list) => element.list(name, numbers(list)),
            P::ListUInt(list) => element.list(name, numbers(list)),
            P::ListFloat(list) => element.list(name, numbers(list)),
            P::ListDouble(list) => element.list(name, list),
        }
        PropertyAccessResult::Set
    }
}

fn numbers(list: Vec<impl Into<f64>>) -> Vec<f64> {
    list.into_iter().map(Into::into).collect()
}
