//! The pictures of a run and their files.

use super::arguments::{RenderArguments, ShadingName};
use super::partial::Partial;
use crate::error::{Error, Result};
use crate::export::file::{Inputs, check_writable, is_replaced};
use crate::export::picture::Format;
use crate::render::Background;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// One picture to be drawn.
pub(super) struct Picture {
    /// By name; `None` is the usual one.
    pub view: Option<String>,
    pub shading: ShadingName,
    pub path: PathBuf,
    pub format: Format,
    /// Where the errors of its pixels go, if they are asked for and known.
    pub errors: Option<PathBuf>,
}

/// Names the output files and makes sure that they can be written, before anything is computed. The
/// shadings of a view follow each other.
pub(super) fn pictures(arguments: &RenderArguments) -> Result<Vec<Picture>> {
    check_options(arguments)?;
    let format = Format::of(&arguments.output)?;
    if arguments.background == Some(Background::Transparent) && format == Format::Hdr {
        return Err(Error::new("a picture in Radiance's format has no transparency")
            .in_file(&arguments.output)
            .remedy("write .png or .exr, or give --background a radiance"));
    }
    let shadings = without_repetition(&arguments.shading);
    let mut pictures = Vec::new();
    for (view, view_suffix) in views(arguments) {
        for &shading in &shadings {
            let shading_suffix = (shadings.len() > 1).then(|| shading_name(shading));
            let suffixes = view_suffix.clone().into_iter().chain(shading_suffix);
            let path = with_suffixes(&arguments.output, suffixes.clone());
            let errors = arguments.error_image.as_ref().filter(|_| knows_errors(shading));
            let errors = errors.map(|path| with_suffixes(path, suffixes));
            pictures.push(Picture { view: view.clone(), shading, path, format, errors });
        }
    }
    if let Some(path) = &arguments.error_image
        && Format::of(path)? == Format::Png
    {
        return Err(Error::new("errors are numbers, and PNG keeps colours")
            .in_file(path)
            .remedy("write them as .exr or .hdr"));
    }
    check_overwriting(arguments, &pictures, &Inputs::default())?;
    let others = arguments.run.stats.iter().chain(error_images(&pictures));
    for path in pictures.iter().map(|picture| &picture.path).chain(others) {
        check_writable(path)?;
    }
    let stream = pictures.iter().find(|picture| !is_replaced(&picture.path));
    if let Some(picture) = stream.filter(|_| arguments.preview.is_some()) {
        return Err(Error::new(
            "--preview renews a file, and this is a pipe, a device or a descriptor",
        )
        .in_file(&picture.path)
        .remedy("leave it out, or name a file"));
    }
    for partial in partials(&pictures) {
        if arguments.resume {
            partial.is_begun()?;
        } else {
            partial.check_absent()?;
        }
    }
    Ok(pictures)
}

/// Where what is done of the gathered pictures is kept.
pub(super) fn partials(pictures: &[Picture]) -> Vec<Partial> {
    let gathered = pictures.iter().filter(|picture| picture.shading == ShadingName::Gather);
    gathered.map(|picture| Partial::of(&picture.path)).collect()
}

/// The names of the views, `None` for the usual one; and what they add to the names of files, if there are several.
fn views(arguments: &RenderArguments) -> Vec<(Option<String>, Option<String>)> {
    let names = without_repetition(&arguments.look.view);
    let suffix = |name: &String| (names.len() > 1).then(|| name.clone());
    match names.is_empty() {
        true => vec![(None, None)],
        false => names.iter().map(|name| (Some(name.clone()), suffix(name))).collect(),
    }
}

/// The files of the errors.
fn error_images(pictures: &[Picture]) -> impl Iterator<Item = &PathBuf> {
    pictures.iter().filter_map(|picture| picture.errors.as_ref())
}

/// Whether the errors of such a picture's pixels are estimated.
fn knows_errors(shading: ShadingName) -> bool {
    matches!(shading, ShadingName::Gather | ShadingName::Path)
}

/// Refuses a run that would destroy its own input or write two outputs to one file.
pub(super) fn check_overwriting(
    arguments: &RenderArguments,
    pictures: &[Picture],
    inputs: &Inputs,
) -> Result<()> {
    let mut outputs: Vec<&Path> = pictures.iter().map(|picture| picture.path.as_path()).collect();
    outputs.extend(arguments.run.stats.as_deref());
    outputs.extend(error_images(pictures).map(PathBuf::as_path));
    let partials = partials(pictures);
    outputs.extend(partials.iter().map(Partial::path));
    inputs.check_distinct(&outputs)
}

fn without_repetition<T: Clone + PartialEq>(items: &[T]) -> Vec<T> {
    let first = |(i, item): &(usize, &T)| !items[..*i].contains(item);
    items.iter().enumerate().filter(first).map(|(_, item)| item.clone()).collect()
}

fn shading_name(shading: ShadingName) -> String {
    shading.to_possible_value().expect("no name is hidden").get_name().to_string()
}

/// room.png becomes room-night-flat.png.
fn with_suffixes(path: &Path, suffixes: impl Iterator<Item = String>) -> PathBuf {
    let mut file = path.file_stem().unwrap_or_default().to_os_string();
    for suffix in suffixes {
        file.push("-");
        file.push(suffix);
    }
    file.push(".");
    file.push(path.extension().unwrap_or_default());
    path.with_file_name(file)
}

/// Refuses options for kinds of pictures that are not asked for.
fn check_options(arguments: &RenderArguments) -> Result<()> {
    let options = [
        ("--error", arguments.error.is_some()),
        ("--time", arguments.time.is_some()),
        ("--preview", arguments.preview.is_some()),
        ("--resume", arguments.resume),
    ];
    let given = options.into_iter().find(|(_, is_given)| *is_given);
    match given {
        Some((name, _)) if !arguments.shading.contains(&ShadingName::Gather) => {
            Err(Error::new(format!("{name} is for gathered pictures, and none is asked for"))
                .remedy("leave it out, or draw with --shading gather"))
        }
        _ if arguments.error_image.is_some()
            && !arguments.shading.iter().any(|&shading| knows_errors(shading)) =>
        {
            Err(Error::new(
                "--error-image is for gathered and path-traced pictures, and none is asked for",
            )
            .remedy("leave it out, or draw with --shading gather or path"))
        }
        _ => Ok(()),
    }
}
