//! Reads accessors: lists of numbers in the buffers of a glTF model.
//!
//! Every list is checked against its buffer before anything is allocated.

use super::container::{COMPRESSIONS, compressed};
use super::json::{Accessor, Root, SparseList};
use crate::error::{Error, Result};
use crate::scene::beside::Files;
use crate::scene::budget::Budget;
use rayon::prelude::*;
use std::borrow::Cow;

/// A model's JSON and its buffers.
pub(super) struct Data<'a> {
    pub root: &'a Root,
    /// `None` for a buffer that nothing is known of.
    buffers: Vec<Option<Cow<'a, [u8]>>>,
}

/// Where a list of items lies in a buffer.
struct Layout<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: Component,
}

/// A number that is read: u32 for indices, f64 for all else.
pub(super) trait Number: Copy + Send {
    fn of(number: f64) -> Self;
}

impl Number for f64 {
    fn of(number: f64) -> f64 {
        number
    }
}

impl Number for u32 {
    /// Exact, where the file has whole numbers.
    fn of(number: f64) -> u32 {
        number as u32
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl<'a> Data<'a> {
    /// Reads the buffers. `binary` is the binary chunk.
    pub(super) fn new(root: &'a Root, binary: Option<&'a [u8]>, files: &mut Files) -> Result<Self> {
        let (mut buffers, mut budget) = (Vec::new(), Budget::default());
        for (number, buffer) in root.buffers.iter().enumerate() {
            let bytes = match &buffer.uri {
                Some(uri) => Some(Cow::Owned(files.uri(uri)?)),
                None if number == 0 => binary.map(Cow::Borrowed),
                None => None,
            };
            if let Some(bytes) = bytes.as_ref().filter(|b| b.len() < buffer.byte_length) {
                return Err(Error::new(format!(
                    "buffer {number} has {} bytes, but should have {}",
                    bytes.len(),
                    buffer.byte_length
                ))
                .remedy("the file was cut off: copy or export it again"));
            }
            budget.take(bytes.as_ref().map_or(0, |bytes| bytes.len() as u64))?;
            buffers.push(bytes);
        }
        Ok(Data { root, buffers })
    }

    /// The bytes of a buffer view, and its stride.
    pub(super) fn view(&self, view: usize) -> Result<(&[u8], Option<usize>)> {
        let missing = || out_of_range(&format!("buffer view {view}"));
        let json = self.root.buffer_views.get(view).ok_or_else(missing)?;
        let Some(buffer) = self.buffers.get(json.buffer) else { return Err(missing()) };
        let Some(buffer) = buffer else {
            let known = COMPRESSIONS.iter().find(|(name, _)| json.extensions.contains_key(*name));
            return Err(match known {
                Some((name, undo)) => compressed(name, undo),
                None => Error::new(format!("buffer {} has no bytes", json.buffer))
                    .remedy("export the model again"),
            });
        };
        let end = json.byte_offset.checked_add(json.byte_length);
        let bytes = end.and_then(|end| buffer.get(json.byte_offset..end)).ok_or_else(missing)?;
        Ok((bytes, json.byte_stride.filter(|stride| *stride > 0)))
    }

    /// The items of an accessor, of N numbers each; normalised integers become shares.
    pub(super) fn read<T: Number, const N: usize>(&self, accessor: usize) -> Result<Vec<[T; N]>> {
        let json = self.accessor(accessor)?;
        let component = component(json.component_type, accessor)?;
        if components(&json.shape) != N {
            return Err(Error::new(format!("accessor {accessor} does not have {N} numbers each"))
                .remedy("export the model again"));
        }
        let mut items = match json.buffer_view {
            Some(view) => self
                .layout(accessor, (view, json.byte_offset), N, component, json.count)?
                .items(json.count, json.normalized),
            None => self.zeros(accessor, json)?,
        };
        if let Some(sparse) = &json.sparse {
            let index = |list: &SparseList| (list.buffer_view, list.byte_offset);
            let kind = component_of_index(sparse.indices.component_type, accessor)?;
            let indices: Vec<[u32; 1]> = self
                .layout(accessor, index(&sparse.indices), 1, kind, sparse.count)?
                .items(sparse.count, false);
            let values = self
                .layout(accessor, index(&sparse.values), N, component, sparse.count)?
                .items(sparse.count, json.normalized);
            for ([at], value) in indices.into_iter().zip(values) {
                *items
                    .get_mut(at as usize)
                    .ok_or_else(|| out_of_range(&format!("accessor {accessor}")))? = value;
            }
        }
        Ok(items)
    }

    /// The items of an accessor of indices.
    pub(super) fn indices(&self, accessor: usize) -> Result<Vec<u32>> {
        let json = self.accessor(accessor)?;
        component_of_index(json.component_type, accessor)?;
        Ok(self.read::<u32, 1>(accessor)?.into_flattened())
    }

    /// The items of an accessor of indices, three in a row.
    pub(super) fn triples(&self, accessor: usize) -> Result<Vec<[u32; 3]>> {
        let json = self.accessor(accessor)?;
        let component = component_of_index(json.component_type, accessor)?;
        if let (Some(view), "SCALAR", None) = (json.buffer_view, &*json.shape, &json.sparse) {
            let place = (view, json.byte_offset);
            let layout = self.layout(accessor, place, 1, component, json.count)?;
            if layout.stride == component.size() {
                // As they lie: a list of single numbers would be as long as that of the triangles.
                let stride = 3 * layout.stride;
                return Ok(Layout { stride, ..layout }.items(json.count / 3, json.normalized));
            }
        }
        Ok(self.indices(accessor)?.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
    }

    /// How many items an accessor has, for those who check before they read.
    pub(super) fn shape(&self, accessor: usize) -> Result<usize> {
        Ok(components(&self.accessor(accessor)?.shape))
    }

    fn accessor(&self, accessor: usize) -> Result<&Accessor> {
        let json = self.root.accessors.get(accessor);
        json.ok_or_else(|| out_of_range(&format!("accessor {accessor}")))
    }

    /// An accessor without a buffer is zero, except for what is sparse.
    fn zeros<T: Number, const N: usize>(
        &self,
        accessor: usize,
        json: &Accessor,
    ) -> Result<Vec<[T; N]>> {
        // Nothing else limits their number.
        let bytes: usize = self.buffers.iter().flatten().map(|bytes| bytes.len()).sum();
        if json.count > bytes {
            return Err(out_of_range(&format!("accessor {accessor}")));
        }
        Ok(vec![[T::of(0.0); N]; json.count])
    }

    fn layout(
        &self,
        accessor: usize,
        (view, offset): (usize, usize),
        numbers: usize,
        component: Component,
        count: usize,
    ) -> Result<Layout<'_>> {
        let (bytes, stride) = self.view(view)?;
        let size = numbers * component.size();
        let stride = stride.unwrap_or(size);
        let length = count.checked_sub(1).map_or(Some(0), |more| {
            stride.checked_mul(more).and_then(|length| length.checked_add(size))
        });
        let end = length.and_then(|length| length.checked_add(offset));
        let bytes = end.and_then(|end| bytes.get(offset..end)).filter(|_| stride >= size);
        let bytes = bytes.ok_or_else(|| out_of_range(&format!("accessor {accessor}")))?;
        Ok(Layout { bytes, stride, component })
    }
}

impl Layout<'_> {
    fn items<T: Number, const N: usize>(&self, count: usize, normalized: bool) -> Vec<[T; N]> {
        let size = self.component.size();
        let number = |item: usize, k: usize| {
            let at = item * self.stride + k * size;
            T::of(self.component.number(&self.bytes[at..at + size], normalized))
        };
        // A thread is not woken for a few: some models have very many short lists.
        let items = (0..count).into_par_iter().with_min_len(1 << 13);
        items.map(|item| std::array::from_fn(|k| number(item, k))).collect()
    }
}

impl Component {
    fn size(self) -> usize {
        match self {
            Component::I8 | Component::U8 => 1,
            Component::I16 | Component::U16 => 2,
            Component::U32 | Component::F32 => 4,
        }
    }

    fn number(self, bytes: &[u8], normalized: bool) -> f64 {
        let two = || bytes.try_into().expect("two bytes");
        let four = || bytes.try_into().expect("four bytes");
        let (number, largest): (f64, f64) = match self {
            Component::I8 => ((bytes[0] as i8).into(), 127.0),
            Component::U8 => (bytes[0].into(), 255.0),
            Component::I16 => (i16::from_le_bytes(two()).into(), 32767.0),
            Component::U16 => (u16::from_le_bytes(two()).into(), 65535.0),
            Component::U32 => (u32::from_le_bytes(four()).into(), 4294967295.0),
            Component::F32 => return f32::from_le_bytes(four()).into(),
        };
        if normalized { (number / largest).max(-1.0) } else { number }
    }
}

fn component(code: u64, accessor: usize) -> Result<Component> {
    match code {
        5120 => Ok(Component::I8),
        5121 => Ok(Component::U8),
        5122 => Ok(Component::I16),
        5123 => Ok(Component::U16),
        5125 => Ok(Component::U32),
        5126 => Ok(Component::F32),
        _ => Err(Error::new(format!("accessor {accessor} has no known kind of number: {code}"))
            .remedy("export the model again")),
    }
}

fn component_of_index(code: u64, accessor: usize) -> Result<Component> {
    match component(code, accessor)? {
        kind @ (Component::U8 | Component::U16 | Component::U32) => Ok(kind),
        _ => Err(Error::new(format!("accessor {accessor} has indices that are not whole numbers"))
            .remedy("export the model again")),
    }
}

fn components(shape: &str) -> usize {
    match shape {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => 0,
    }
}

fn out_of_range(what: &str) -> Error {
    Error::new(format!("{what} reaches beyond its buffer, or does not exist"))
        .remedy("the file was cut off, or its exporter is at fault: export the model again")
}
