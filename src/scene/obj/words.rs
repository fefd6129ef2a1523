//! The words of `v` and `f` lines: positions, colours and indices, and the errors of those without meaning.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::scene::text::{LARGEST, number, quote, words};
use glam::DVec3;

/// The position of a `v` line, and its colour as it is written, if it has one; NaN if that is malformed.
pub(super) fn position(rest: &str) -> (Result<DVec3>, Option<Rgb>) {
    let mut values = [0.0; 7];
    let (mut count, mut malformed) = (0, None);
    for word in words(rest) {
        let value = number(word).unwrap_or_else(|error| {
            // A malformed colour is no malformed position.
            if count < 3 {
                malformed.get_or_insert(error);
            }
            f64::NAN
        });
        if let Some(slot) = values.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    let color = || Rgb::new(values[3] as f32, values[4] as f32, values[5] as f32);
    let (w, color) = match count {
        3 => (1.0, None),
        6 | 7 => (1.0, Some(color())),
        4 => (values[3], None),
        _ => return (Err(malformed.unwrap_or_else(|| wrong_vertex(count))), None),
    };
    let position = malformed.map_or_else(|| weighted(DVec3::from_slice(&values), w), Err);
    (position, color)
}

fn wrong_vertex(count: usize) -> Error {
    Error::new(format!("a vertex has 3 coordinates, this line has {count} numbers"))
        .remedy("write `v x y z`, `v x y z w` or `v x y z r g b`")
}

fn weighted(coordinates: DVec3, w: f64) -> Result<DVec3> {
    if w.is_nan() {
        return Err(Error::new("the weight w is not a number").remedy("delete w, or set it to 1"));
    }
    if w == 0.0 {
        return Err(Error::new("the weight w is 0, so the vertex is infinitely far away")
            .remedy("delete w, or set it to 1"));
    }
    let position = coordinates / w;
    match position.to_array().into_iter().find(|x| x.abs() > LARGEST as f64) {
        Some(x) => Err(Error::new(format!("coordinate {x:e} is larger than {LARGEST:e}"))
            .remedy("scale the model down, for instance from millimetres to metres")),
        None => Ok(position),
    }
}

/// The vertex index of a face's corner, and the words for its texture coordinate and its normal, which may be
/// empty.
pub(super) fn corner(word: &str) -> Result<(i64, &str, &str)> {
    let (vertex, others) = word.split_once('/').unwrap_or((word, ""));
    let numerals = others.bytes().all(|byte| b"0123456789+-/".contains(&byte));
    let Some(index) = vertex.parse::<i64>().ok().filter(|_| numerals) else {
        return Err(Error::new(format!("{} is not a vertex index", quote(word)))
            .remedy("write each corner of a face as v, v/vt, v//vn or v/vt/vn"));
    };
    let (texture, normal) = others.split_once('/').unwrap_or((others, ""));
    Ok((index, texture, normal))
}

/// The number of a texture coordinate or normal, of which there are `count` so far; 0 if the face
/// gives none.
pub(super) fn number_or_none(word: &str, count: usize) -> u32 {
    let index: i64 = word.parse().unwrap_or(0);
    let number = if index < 0 { count as i64 + 1 + index } else { index };
    u32::try_from(number).unwrap_or(0)
}

/// -1 is the latest of the `vertices` so far.
pub(super) fn resolve_negative(index: i64, vertices: usize) -> Result<u32> {
    usize::try_from(index.unsigned_abs())
        .ok()
        .and_then(|back| (vertices + 1).checked_sub(back))
        .filter(|number| *number > 0)
        .map(|number| number as u32)
        .ok_or_else(|| out_of_range(index, &format!("{vertices} vertices precede this line")))
}

pub(super) fn out_of_range(index: i64, range: &str) -> Error {
    Error::new(format!("vertex index {index} is out of range: {range}"))
        .remedy("correct the index, or restore the missing `v` lines")
}

pub(super) fn zero_index() -> Error {
    Error::new("vertex index 0 does not exist")
        .remedy("count vertices from 1, or backwards from -1, the vertex before the face")
}
