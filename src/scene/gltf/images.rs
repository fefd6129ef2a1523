//! The pictures of a glTF model, decoded several at a time.

use super::accessor::Data;
use crate::error::{Error, Result};
use crate::scene::beside::Files;
use crate::scene::budget::{Budget, but_memory};
use crate::scene::texture::{Texture, Wrap, decode_texture};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;

/// Reads and decodes the images with the numbers `wanted`, in this order, and gives them by number.
///
/// # Errors
/// Less memory than they take.
pub(super) fn decode(
    data: &Data,
    files: &mut Files,
    wanted: &[usize],
) -> Result<HashMap<usize, Result<Texture>>> {
    let (mut images, mut budget) = (HashMap::new(), Budget::default());
    // No more at once than there are threads, so that the budget is asked before the next ones.
    for some in wanted.chunks(rayon::current_num_threads()) {
        let sources: Vec<_> = some.iter().map(|image| source(data, files, *image)).collect();
        let decoded: Vec<Result<Texture>> = sources
            .into_par_iter()
            .map(|source| {
                source.and_then(|(name, bytes)| decode_texture(name, &bytes, [Wrap::Repeat; 2]))
            })
            .collect();
        for (image, texture) in some.iter().zip(decoded) {
            let affordable = texture.and_then(|texture| {
                budget.take(size_of_val(&*texture.pixels) as u64)?;
                Ok(texture)
            });
            images.insert(*image, but_memory(affordable)?);
        }
    }
    Ok(images)
}

/// An image's name and its encoded bytes.
fn source<'a>(data: &'a Data, files: &mut Files, image: usize) -> Result<(String, Cow<'a, [u8]>)> {
    let json = data.root.images.get(image);
    let json = json.ok_or_else(|| Error::new("it does not exist"))?;
    let name = json.name.clone().unwrap_or_else(|| match &json.uri {
        Some(uri) if !uri.starts_with("data:") => uri.clone(),
        _ => format!("image {image}"),
    });
    let bytes = match (&json.uri, json.buffer_view) {
        (Some(uri), _) => Cow::Owned(files.uri(uri)?),
        (None, Some(view)) => Cow::Borrowed(data.view(view)?.0),
        (None, None) => return Err(Error::new("it has no bytes")),
    };
    Ok((name, bytes))
}
