//! Finds and decodes the pictures that materials name, each once.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use super::mtl_map::MapLine;
use super::notes::{Kind, Notes};
use crate::error::{Error, Result};
use crate::scene::budget::but_memory;
use crate::scene::text::{read_bytes, unread};
use crate::scene::texture::{Map, Texture, TextureId, Wrap, decode_texture};
use rayon::prelude::*;

/// The textures of a model.
#[derive(Debug, Default)]
pub(super) struct Pictures {
    pub textures: Vec<Texture>,
    /// The files that were read.
    pub files: Vec<PathBuf>,
    /// Of each file and use; `None` where it cannot be read.
    known: HashMap<(PathBuf, Use), Option<TextureId>>,
    /// Files that were decoded ahead, or why they cannot be.
    ahead: HashMap<PathBuf, Result<Texture>>,
}

/// What distinguishes two textures from one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Use {
    clamped: bool,
    opacity: bool,
}

impl Pictures {
    /// Decodes the pictures that maps of MTL files name, all at once: this takes most of the time that
    /// materials take.
    pub(super) fn decode_ahead<'a>(&mut self, maps: impl Iterator<Item = (&'a Path, &'a MapLine)>) {
        let path = |(file, map): (&Path, &MapLine)| locate(folder_of(file), &map.name);
        let paths: HashSet<PathBuf> = maps.filter_map(path).collect();
        let decoded = |path: PathBuf| {
            let texture = decode(&path);
            (path, texture)
        };
        self.ahead = paths.into_par_iter().map(decoded).collect();
    }

    /// The picture of a `map_Kd` or `map_Ke` in the MTL `file`; `None`, and noted, if it cannot be read.
    ///
    /// # Errors
    /// Less memory than it takes.
    pub(super) fn color(
        &mut self,
        file: &Path,
        map: &MapLine,
        notes: &mut Notes,
    ) -> Result<Option<Map>> {
        self.map(file, map, false, notes)
    }

    /// As [`Pictures::color`], of a `map_d`: its opacity, or else its luminance, is in the pixels' opacity.
    pub(super) fn opacity(
        &mut self,
        file: &Path,
        map: &MapLine,
        notes: &mut Notes,
    ) -> Result<Option<Map>> {
        self.map(file, map, true, notes)
    }

    fn map(
        &mut self,
        file: &Path,
        map: &MapLine,
        opacity: bool,
        notes: &mut Notes,
    ) -> Result<Option<Map>> {
        let folder = folder_of(file);
        let Some(path) = locate(folder, &map.name) else {
            notes.add(Kind::MissingPicture, file, map.line, &map.name);
            return Ok(None);
        };
        if !is_below(folder, &path) {
            notes.add(Kind::OutsidePicture, file, map.line, &path.to_string_lossy());
        }
        let used = Use { clamped: map.clamped, opacity };
        if let Some(known) = self.known.get(&(path.clone(), used)) {
            return Ok(known.map(|texture| Map { texture, transform: map.transform }));
        }
        let texture = match but_memory(self.texture(&path, used))? {
            Ok(texture) => Some(texture),
            Err(error) => {
                let cause = Some(error.cause().to_owned());
                notes.add_with(Kind::BadPicture, file, map.line, &map.name, cause);
                None
            }
        };
        self.known.insert((path, used), texture);
        Ok(texture.map(|texture| Map { texture, transform: map.transform }))
    }

    fn texture(&mut self, path: &Path, used: Use) -> Result<TextureId> {
        let wrap = [if used.clamped { Wrap::Clamp } else { Wrap::Repeat }; 2];
        let name = path.to_string_lossy().into_owned();
        let same_file = self.textures.iter().find(|texture| texture.name == name);
        // A file that was decoded for another use gives its pixels.
        let texture = match same_file.filter(|_| !used.opacity) {
            Some(texture) => {
                let size = [texture.width, texture.height];
                Texture::new(name, size, texture.pixels.clone(), wrap)
            }
            None => {
                // Also one that shows nothing is the user's.
                if path.exists() {
                    self.files.push(path.to_path_buf());
                }
                let decoded = self.ahead.get(path).cloned().unwrap_or_else(|| decode(path));
                let texture = decoded?.wrapped(wrap);
                if used.opacity { with_opacity(texture) } else { texture }
            }
        };
        self.textures.push(texture);
        Ok(TextureId(self.textures.len() as u32 - 1))
    }

    /// Whether a texture shows nothing but black.
    pub(super) fn is_black(&self, map: &Map) -> bool {
        let pixels = &self.textures[map.texture.0 as usize].pixels;
        pixels.iter().all(|[r, g, b, _]| [*r, *g, *b] == [0; 3])
    }
}

/// The picture in a file, or why there is none.
fn decode(path: &Path) -> Result<Texture> {
    let bytes = read_bytes(path).map_err(|error| match error.kind() {
        io::ErrorKind::OutOfMemory => unread(path, "the picture", &error),
        _ => Error::new(error.to_string()),
    })?;
    decode_texture(path.to_string_lossy().into_owned(), &bytes, [Wrap::Repeat; 2])
}

/// Where the names of pictures in an MTL file begin.
fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}

/// A picture that is opaque everywhere means its luminance: masks hold no opacity of their own. Grey values of
/// masks are shares, not sRGB.
fn with_opacity(texture: Texture) -> Texture {
    if texture.pixels.iter().any(|pixel| pixel[3] != 255) {
        return texture;
    }
    let masked = |&[r, g, b, _]: &[u8; 4]| {
        let luminance = 0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b);
        [r, g, b, luminance.round() as u8]
    };
    let pixels: Arc<[[u8; 4]]> = texture.pixels.iter().map(masked).collect();
    Texture::new(texture.name, [texture.width, texture.height], pixels, texture.wrap)
}

/// The file that `name` means: in the folder, where its letters may be of the other case; elsewhere; or in the
/// folder by its last part alone, since exporters write the paths of the machine that they ran on.
fn locate(folder: &Path, name: &str) -> Option<PathBuf> {
    let slashed = name.replace('\\', "/");
    let base = slashed.rsplit('/').next().unwrap_or(&slashed);
    let relative = Path::new(&slashed);
    let inside = relative.is_relative().then(|| matching(folder, relative)).flatten();
    let elsewhere = || Some(folder.join(relative)).filter(|path| path.is_file());
    inside.or_else(elsewhere).or_else(|| matching(folder, Path::new(base)))
}

/// The file below `folder` with that path, whatever the case of its letters.
fn matching(folder: &Path, path: &Path) -> Option<PathBuf> {
    let mut found = folder.to_path_buf();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::Normal(part) => {
                let exact = found.join(part);
                found = if exact.exists() { exact } else { alike(&found, part.to_str()?)? };
            }
            _ => return None,
        }
    }
    found.is_file().then_some(found)
}

/// The entry of a folder whose name differs only in case; the first by name if there are several.
fn alike(folder: &Path, name: &str) -> Option<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let wanted = name.to_lowercase();
    let entries = fs::read_dir(folder).ok()?.flatten();
    let same = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.is_some_and(|name| name.to_lowercase() == wanted)
    };
    entries.map(|entry| entry.path()).filter(same).min()
}

/// Whether a path leads nowhere but down from the folder, links aside.
fn is_below(folder: &Path, path: &Path) -> bool {
    let below = path.strip_prefix(folder);
    below.is_ok_and(|rest| {
        rest.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgba, RgbaImage};

    fn save(path: &Path, pixel: [u8; 4]) {
        RgbaImage::from_pixel(2, 1, Rgba(pixel)).save(path).expect("a picture");
    }

    fn map(name: &str) -> MapLine {
        MapLine::parse(3, name).expect("a name")
    }

    #[test]
    fn pictures_are_found_where_exporters_meant_them_and_decoded_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("sub/a.mtl");
        fs::create_dir_all(folder.path().join("sub/Maps")).expect("a folder");
        save(&folder.path().join("sub/Maps/Wood 1.PNG"), [9, 9, 9, 255]);
        save(&folder.path().join("sub/tile.png"), [1, 2, 3, 255]);
        save(&folder.path().join("outside.png"), [1, 2, 3, 255]);
        let (mut pictures, mut notes) = (Pictures::default(), Notes::default());
        for name in ["maps/wood 1.png", "Maps\\Wood 1.PNG", "./Maps/Wood 1.PNG"] {
            let found = pictures.color(&file, &map(name), &mut notes).unwrap().expect(name);
            assert_eq!(found.texture, TextureId(0), "{name}");
        }
        for name in ["C:\\Users\\x\\tile.png", "/no/such/Tile.png", "tile.png"] {
            let found = pictures.color(&file, &map(name), &mut notes).unwrap().expect(name);
            assert_eq!(found.texture.0, 1);
        }
        let clamped = pictures.color(&file, &map("-clamp on tile.png"), &mut notes).unwrap();
        let clamped = clamped.expect("tile");
        assert_eq!((clamped.texture.0, pictures.files.len()), (2, 2));
        assert_eq!(notes.warnings().count(), 0);

        let mut notes = Notes::default();
        fs::write(folder.path().join("sub/bad.png"), "text").expect("a file");
        for (name, is_read) in [
            ("../outside.png", true),
            ("bad.png", false),
            ("none.png", false),
            ("none too.png", false),
        ] {
            let found = pictures.color(&file, &map(name), &mut notes).unwrap();
            assert_eq!(found.is_some(), is_read, "{name}");
        }
        let said: Vec<String> = notes.warnings().map(|w| w.to_string()).collect();
        assert_eq!(said.len(), 3, "{said:?}");
        assert!(said[2].contains("2 in all: `none.png`, `none too.png`"), "{said:?}");
    }

    #[test]
    fn a_mask_gives_its_opacity_or_else_its_luminance() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.mtl");
        save(&folder.path().join("clear.png"), [200, 200, 200, 64]);
        save(&folder.path().join("grey.png"), [128, 128, 128, 255]);
        let (mut pictures, mut notes) = (Pictures::default(), Notes::default());
        for (name, opacity) in [("clear.png", 64), ("grey.png", 128)] {
            let found = pictures.opacity(&file, &map(name), &mut notes).unwrap().expect(name);
            assert_eq!(pictures.textures[found.texture.0 as usize].pixels[0][3], opacity);
        }
    }
}
