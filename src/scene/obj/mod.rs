//! Loads a Wavefront OBJ model and its MTL materials.
//!
//! Each line is looked at once, so that what is malformed is reported with its line. The colours of
//! materials are read by `tobj`. Then polygons are cut into triangles and materials are judged.

mod exporter;
mod ignored;
mod mtl_files;
mod mtl_map;
mod mtl_materials;
mod mtl_reader;
mod notes;
mod pictures;
mod reader;
mod words;

use super::material::{Material, MaterialId};
use super::mesh::{Origin, PerCorner};
use super::model::Model;
use super::triangulate::{Crossings, Triangulator};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::scene::text::{Format, decode, read_text_bytes, unread};
use glam::DVec3;
use mtl_files::read_library;
use mtl_materials::{Materials, Role, materials};
use mtl_reader::Library;
use reader::{ObjFile, read_obj};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

/// Loads the OBJ file at `path` and the MTL files it names, which are looked for beside it.
///
/// Fails if the OBJ file is malformed (with the lines), cannot be read or has no faces, or where memory is short.
/// What has a sensible
/// default, such as a missing MTL file or a Kd above 1, is a warning of the model instead.
///
/// A scene description overrides the reflectance of the materials whose name `overrides`: nothing is said
/// of their Kd, and their textures are not read.
pub(crate) fn load(path: &Path, overrides: impl Fn(&str) -> bool) -> Result<Model> {
    let text = text_of(path)?;
    let (mut obj, usual_up) = (read_obj(path, &text)?, exporter::up(&text));
    // Large models come near to filling the memory.
    drop(text);
    let mut library = read_library(path, &mut obj)?;
    let mut warnings = std::mem::take(&mut obj.warnings);

    let of_runs = materials_of_runs(&obj, &library);
    let default = library.entries.len();
    let mut used = vec![false; default + 1];
    of_runs.iter().for_each(|id| used[id.0 as usize] = true);
    let role = |i: usize| Role { used: used[i], replaced: overrides(&library.entries[i].name) };
    let Materials { list: mut materials, textures, files } =
        materials(&library, role, &mut warnings)?;
    library.files.extend(files);
    if used[default] {
        materials.push(Material::fallback());
    }
    if !obj.colors.is_empty() {
        // Colours without a material are all that the file says of its surfaces.
        let defined = |i: usize| library.entries.get(i).is_some_and(|entry| entry.file.is_some());
        let undefined = materials.iter_mut().enumerate().filter(|(i, _)| !defined(*i));
        undefined.for_each(|(_, material)| material.reflectance = Rgb::ONE);
    }
    let model = cut(path, obj, &of_runs);
    warnings.extend_from_slice(&model.warnings);
    Ok(Model { materials, textures, files: library.files, warnings, usual_up, ..model })
}

fn text_of(path: &Path) -> Result<String> {
    if path.as_os_str().is_empty() {
        return Err(Error::new("the path of the model is empty").remedy("name an OBJ file"));
    }
    let bytes = read_text_bytes(path).map_err(|error| unread(path, "the model", &error))?;
    decode(bytes, path, Format::Obj)
}

/// Each run's material, an index into the entries of `library`; the number of entries stands for
/// the default.
fn materials_of_runs(obj: &ObjFile, library: &Library) -> Vec<MaterialId> {
    let known = |name| library.find(name).expect("undefined materials have been added");
    let numbers: Vec<usize> = obj.materials.iter().map(|named| known(&named.name)).collect();
    let number = |material: Option<usize>| material.map_or(library.entries.len(), |m| numbers[m]);
    obj.runs.iter().map(|run| MaterialId(number(run.material) as u32)).collect()
}

/// Cuts the faces into triangles, in file order; `of_runs` are the materials of the runs.
fn cut(path: &Path, obj: ObjFile, of_runs: &[MaterialId]) -> Model {
    let (mut model, mut texture, mut normals) = (Model::default(), Vec::new(), Vec::new());
    let (mut triangulator, mut crossing) = (Triangulator::new(), Crossings::default());
    let (mut polygon, mut cuts) = (Vec::new(), Vec::new());
    let mut copies = Copies { positions: &obj.positions, first: HashMap::new() };
    let mut end = 0;
    for (number, face) in (1..).zip(&obj.faces) {
        let range = end..end + face.arity as usize;
        end = range.end;
        if face.arity < 3 {
            continue;
        }
        let corners = &obj.corners.positions[range.clone()];
        // A copy of a polygon is cut as the first one was, so that their triangles coincide too.
        let ring = copies.first_like(corners);
        polygon.clear();
        polygon.extend(ring.iter().map(|corner| obj.positions[*corner as usize - 1]));
        cuts.clear();
        if triangulator.triangulate(&polygon, &mut cuts) {
            crossing.add(number);
        }
        if !std::ptr::eq(ring, corners) {
            copies.translate(&mut cuts, ring, corners);
        }
        let run = &obj.runs[face.run as usize];
        for cut in &cuts {
            model.triangles.push(cut.map(|k| corners[k] - 1));
            model.material_of.push(of_runs[face.run as usize]);
            model.mesh.origins.push(Origin { face: number, part: run.part });
        }
        add_numbers(&mut texture, obj.corners.texture.get(range.clone()), &cuts);
        add_numbers(&mut normals, obj.corners.normals.get(range), &cuts);
    }
    let colored = !obj.colors.is_empty();
    let numbers = |corners: &[u32; 3]| corners.map(|k| k + 1);
    model.mesh.colors = colored.then(|| PerCorner {
        values: obj.colors,
        numbers: model.triangles.iter().map(numbers).collect(),
    });
    model.warnings.extend(crossing.warning(path));
    model.mesh.parts = obj.parts;
    model.mesh.texture = PerCorner::new(obj.texture, texture);
    model.mesh.normals = PerCorner::new(obj.normals, normals);
    Model { positions: obj.positions, ..model }
}

/// Adds the numbers that the corners of the cuts have. There are none where no corner of the file has any.
fn add_numbers(list: &mut Vec<[u32; 3]>, of_face: Option<&[u32]>, cuts: &[[usize; 3]]) {
    if let Some(numbers) = of_face {
        list.extend(cuts.iter().map(|cut| cut.map(|k| numbers[k])));
    }
}

/// Polygons by the places of their corners, to find those that are there twice, as the two sides of a sheet are.
/// Either side may have vertices of its own.
struct Copies<'o> {
    positions: &'o [DVec3],
    first: HashMap<u64, &'o [u32]>,
}

impl<'o> Copies<'o> {
    /// The first polygon with the corners of this one: itself if there was none.
    fn first_like(&mut self, corners: &'o [u32]) -> &'o [u32] {
        if corners.len() == 3 {
            return corners;
        }
        let places = self.places(corners);
        let mut hasher = DefaultHasher::new();
        places.hash(&mut hasher);
        let first = *self.first.entry(hasher.finish()).or_insert(corners);
        if self.places(first) == places { first } else { corners }
    }

    /// In an order of their own.
    fn places(&self, corners: &[u32]) -> Vec<[u64; 3]> {
        let mut places: Vec<[u64; 3]> = corners.iter().map(|corner| self.place(*corner)).collect();
        places.sort_unstable();
        places
    }

    /// The bits of a corner's position; adding zero makes -0 a 0.
    fn place(&self, corner: u32) -> [u64; 3] {
        let position = self.positions[corner as usize - 1] + DVec3::ZERO;
        position.to_array().map(f64::to_bits)
    }

    /// Makes of cuts of the ring `from` cuts of the ring `to`, which has the same places.
    fn translate(&self, cuts: &mut [[usize; 3]], from: &[u32], to: &[u32]) {
        let found = |place| to.iter().position(|corner| self.place(*corner) == place);
        let counterpart = |k: usize| found(self.place(from[k])).expect("a place of both");
        let next = (counterpart(0) + 1) % to.len();
        let is_reversed = self.place(to[next]) != self.place(from[1]);
        for cut in cuts {
            *cut = cut.map(counterpart);
            if is_reversed {
                cut.swap(1, 2);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::color::Rgb;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    /// Writes the files into an empty folder and loads `a.obj` from there. Messages name the files
    /// without the folder.
    fn load_files(files: &[(&str, &[u8])]) -> std::result::Result<(Model, Vec<String>), String> {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        let prefix = format!("{}/", folder.path().display());
        let without_folder = |message: String| message.replace(&prefix, "");
        let model = load(&folder.path().join("a.obj"), |_| false)
            .map_err(|error| without_folder(error.to_string()))?;
        let warnings =
            model.warnings.iter().map(|warning| without_folder(warning.to_string())).collect();
        Ok((model, warnings))
    }

    fn load_obj(text: &str) -> std::result::Result<(Model, Vec<String>), String> {
        load_files(&[("a.obj", text.as_bytes())])
    }

    fn with_mtl(obj: &str, mtl: &str) -> std::result::Result<(Model, Vec<String>), String> {
        let obj = format!("mtllib a.mtl\n{obj}");
        load_files(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl.as_bytes())])
    }

    fn corners(model: &Model, triangle: usize) -> [DVec3; 3] {
        model.triangles[triangle].map(|corner| model.positions[corner as usize])
    }

    fn names(model: &Model) -> Vec<&str> {
        model.materials.iter().map(|material| material.name.as_str()).collect()
    }

    #[test]
    fn materials_follow_the_faces_through_groups_in_file_order() {
        let obj = format!("{TRIANGLE}usemtl b\ng x\nf 1 2 3\nf 2 3 1\no y\nusemtl a\nf 3 2 1\n");
        let (model, warnings) =
            with_mtl(&obj, "newmtl a\nKd 0.1\nnewmtl b\nKd 0.2\nKe 3\n").unwrap();
        assert_eq!(model.material_of, [2, 1, 1, 0].map(MaterialId));
        assert_eq!(names(&model), ["a", "b", "default"]);
        assert_eq!(model.materials[1].radiance, Rgb::splat(3.0));
        assert_eq!(corners(&model, 2), [DVec3::X, DVec3::Y, DVec3::ZERO]);
        assert_eq!(corners(&model, 3), [DVec3::Y, DVec3::X, DVec3::ZERO]);
        assert_eq!(warnings.len(), 1, "{warnings:?}");
    }

    #[test]
    fn materials_and_vertices_may_come_after_the_faces_that_use_them() {
        let obj = "o x\nusemtl a\nf 1 2 3\no y\nf 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\nmtllib a.mtl\n";
        let files: [(&str, &[u8]); 2] = [("a.obj", obj.as_bytes()), ("a.mtl", b"newmtl a\nKd 0.1")];
        let (model, warnings) = load_files(&files).unwrap();
        assert_eq!(model.triangles.len(), 2);
        assert_eq!(corners(&model, 1), [DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert_eq!(model.materials[0].reflectance, Rgb::splat(0.1));
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn windows_lines_weights_colours_and_foreign_comments_are_read() {
        let obj = b"\xef\xbb\xbf# caf\xe9\r\nv 0 0 0 1 1 1\r\nv 2 0 0 2\r\nv 0 1 0\r\nf 1// 2/1 \\\r\n3\r\n";
        let (model, _) = load_files(&[("a.obj", obj)]).unwrap();
        assert_eq!(corners(&model, 0), [DVec3::ZERO, DVec3::X, DVec3::Y]);
    }

    #[test]
    fn polygons_become_triangles_of_the_same_material() {
        let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl a\nf 1 2 3 4\nf 1 2 3\n";
        let (model, _) = with_mtl(obj, "newmtl a\nKd 0.1").unwrap();
        assert_eq!(model.triangles.len(), 3);
        assert_eq!(model.material_of, [MaterialId(0); 3]);
    }

    #[test]
    fn both_sides_of_a_sheet_are_cut_along_one_diagonal() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
        for back in ["4 3 2 1", "3 2 1 4", "2 1 4 3", "1 4 3 2"] {
            let (model, _) = load_obj(&format!("{vertices}f 1 2 3 4\nf {back}\n")).unwrap();
            let sorted = |t: &[u32; 3]| {
                let mut t = *t;
                t.sort_unstable();
                t
            };
            let mut sets: Vec<[u32; 3]> = model.triangles.iter().map(sorted).collect();
            sets.sort_unstable();
            assert!(sets[0] == sets[1] && sets[2] == sets[3], "{back}: {:?}", model.triangles);
            let normal = |k: usize| {
                let [a, b, c] = corners(&model, k);
                (b - a).cross(c - a).z
            };
            assert!((0..2).all(|k| normal(k) > 0.0) && (2..4).all(|k| normal(k) < 0.0));
        }
    }

    #[test]
    fn so_are_sides_that_have_vertices_of_their_own() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n".repeat(2);
        for back in ["8 7 6 5", "7 6 5 8", "6 5 8 7", "5 8 7 6"] {
            let (model, _) = load_obj(&format!("{vertices}f 1 2 3 4\nf {back}\n")).unwrap();
            let places = |k: usize| corners(&model, k).map(|p| (p.x as u8, p.y as u8));
            let mut sets = [0, 1, 2, 3].map(places);
            sets.iter_mut().for_each(|set| set.sort_unstable());
            sets.sort_unstable();
            assert!(sets[0] == sets[1] && sets[2] == sets[3], "{back}: {:?}", model.triangles);
            assert!(model.triangles[2..].as_flattened().iter().all(|corner| *corner >= 4));
        }
    }

    #[test]
    fn the_triangles_of_a_polygon_know_their_face_and_their_corners() {
        let obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\no box\nf 1 2 2\n\
                   g lid\nf 1//1 2//1 3//2 4//2\n";
        let (Model { mesh, .. }, _) = load_obj(obj).unwrap();
        let faces: Vec<u32> = mesh.origins.iter().map(|origin| origin.face).collect();
        assert_eq!(faces, [1, 2, 2]);
        let part = mesh.part_of(crate::geometry::TriangleId(2)).unwrap();
        assert_eq!((part.object.as_deref(), part.group.as_deref()), (Some("box"), Some("lid")));
        assert_eq!(mesh.normals.unwrap().numbers, [[0; 3], [1, 1, 2], [1, 2, 2]]);
        assert_eq!(mesh.texture, None);
    }

    #[test]
    fn several_libraries_and_names_with_blanks_are_found() {
        let obj = format!(
            "mtllib b.mtl c.mtl\nmtllib my lib.mtl\nmtllib .\\d.mtl b.mtl\n\
                     mtllib an\\ e.mtl b.mtl\nmtllib its\\ f.mtl\n{TRIANGLE}"
        );
        let (model, warnings) = load_files(&[
            ("a.obj", obj.as_bytes()),
            ("b.mtl", b"newmtl b"),
            ("c.mtl", b"newmtl c"),
            ("d.mtl", b"newmtl d"),
            ("my lib.mtl", b"newmtl my material"),
            ("an e.mtl", b"newmtl e"),
            ("its f.mtl", b"newmtl f"),
        ])
        .unwrap();
        assert_eq!(names(&model), ["b", "c", "my material", "d", "e", "f", "default"]);
        assert_eq!(warnings.len(), 1, "b.mtl is not read twice: {warnings:?}");
    }

    #[test]
    fn a_missing_library_and_its_materials_are_warnings() {
        let obj = "mtllib no such.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\nusemtl red\nf 1 2 3\n";
        let (model, warnings) = load_obj(obj).unwrap();
        assert_eq!(model.materials, [Material { name: "red".into(), ..Material::fallback() }]);
        assert_eq!(
            warnings,
            [
                "a.obj:1: cannot read the material file `no such.mtl`: No such file or directory \
                 (os error 2); faces with its materials get the default material, reflectance 0.5",
                "a.obj:5: no MTL file defines the material `red`: its faces get the default \
                 material, reflectance 0.5",
            ]
        );
    }

    #[test]
    fn a_reflectance_above_one_is_scaled_with_a_warning_unless_it_is_unused_or_overridden() {
        let mtl = "newmtl white\nKd 2 1 1\n";
        let obj = format!("usemtl white\n{TRIANGLE}");
        let (model, warnings) = with_mtl(&obj, mtl).unwrap();
        assert_eq!(model.materials[0].reflectance, Rgb::new(1.0, 0.5, 0.5));
        assert!(warnings[0].starts_with("a.mtl:2: Kd above 1") && warnings.len() == 1);
        let (_, warnings) = with_mtl(TRIANGLE, mtl).unwrap();
        assert!(!warnings.iter().any(|warning| warning.contains("Kd")), "{warnings:?}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        fs::write(&path, format!("mtllib a.mtl\n{obj}")).unwrap();
        fs::write(folder.path().join("a.mtl"), mtl).unwrap();
        assert!(load(&path, |name| name == "white").unwrap().warnings.is_empty());
    }

    #[test]
    fn textures_and_vertex_colours_reach_the_model() {
        let mut picture = std::io::Cursor::new(Vec::new());
        let pixels = image::RgbaImage::from_pixel(2, 2, image::Rgba([9, 9, 9, 255]));
        pixels.write_to(&mut picture, image::ImageFormat::Png).unwrap();
        let obj =
            "mtllib a.mtl\nv 0 0 0\nv 1 0 0 0 1 1\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl\nf 3 2 1\n";
        let mtl = "newmtl a\nKd 0 0 0\nmap_Kd my picture.png\nnewmtl b\nmap_Kd none.png\n";
        let (model, warnings) = load_files(&[
            ("a.obj", obj.as_bytes()),
            ("a.mtl", mtl.as_bytes()),
            ("my picture.png", picture.get_ref()),
        ])
        .unwrap();
        assert_eq!((model.textures.len(), model.files.len()), (1, 2));
        assert!(model.materials[0].reflectance_map.is_some());
        assert_eq!(model.materials[2].reflectance, Rgb::ONE);
        let colors = model.mesh.colors.unwrap();
        let red = colors.at(crate::geometry::TriangleId(1), 1);
        assert_eq!(red, Some(Rgb::new(0.0, 1.0, 1.0)));
        assert_eq!(warnings.len(), 1, "{warnings:?}");
    }

    #[test]
    fn names_in_windows_1252_are_those_that_a_user_reads() {
        let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl W\xe4nde\nf 1 2 3\n";
        let (model, warnings) =
            load_files(&[("a.obj", obj), ("a.mtl", b"newmtl W\xe4nde\nKd 0.3\n")]).unwrap();
        assert_eq!((names(&model), warnings.len()), (vec!["W\u{e4}nde"], 0));
    }

    #[test]
    fn a_file_that_cannot_be_a_model_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| load(path, |_| false).unwrap_err().to_string();
        assert!(message(Path::new("")).starts_with("the path of the model is empty"));
        assert!(message(folder.path()).contains("it is a directory"));
        assert!(message(&folder.path().join("none.obj")).contains("No such file"));
        assert!(load_obj("").unwrap_err().starts_with("a.obj: the file contains no faces"));
        assert!(load_obj("glTF\0\0").unwrap_err().contains("not look like a Wavefront OBJ file"));
        let (_, warnings) = with_mtl(TRIANGLE, "\0").unwrap();
        assert!(warnings[1].contains("does not look like a Wavefront MTL file"), "{warnings:?}");
    }

    /// Marsaglia's xorshift64: enough disorder for a test, the same in every run.
    fn random(state: &mut u64, below: usize) -> usize {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        (*state % below as u64) as usize
    }

    /// Overwrites, doubles or deletes a few stretches, with bytes that mean something to a reader.
    fn mutate(bytes: &mut Vec<u8>, state: &mut u64) {
        const TELLING: &[u8] = b"\0\n\r\t \\/#-+.019eEnvfmKl\xff\xe9naninf";
        for _ in 0..=random(state, 6) {
            let start = random(state, bytes.len());
            let end = (start + random(state, 12)).min(bytes.len());
            match random(state, 3) {
                0 => bytes[start] = TELLING[random(state, TELLING.len())],
                1 => drop(bytes.splice(start..start, bytes[start..end].to_vec())),
                _ if end - start < bytes.len() => drop(bytes.drain(start..end)),
                _ => {}
            }
        }
    }

    #[test]
    fn no_mutation_of_a_model_makes_the_loader_panic() {
        let obj =
            b"mtllib a.mtl\no x\nv 0 0 0\nv 3 0 0 1\nv 3 1 0 1 1 1\nv 1 1 0\nv 1 4 0\nv 0 4 .1\n\
                    vt 0 0\nvn 0 0 1\nusemtl a b\nf 1/1/1 2//1 3 4 \\\n 5 6\nf -1 -2 -3 # x\n\
                    usemtl c\nl 1 2\ng y\nf 2 3 1 4\nf 3 4 1 6 2\n";
        let mtl = b"# m\nnewmtl a b\nKd 0.5\nKe 1 2 3\nmap_Kd x.png\nnewmtl c\nKd .1 .2 .3\nd 1\n";
        let folder = tempfile::tempdir().unwrap();
        let (path, mtl_path) = (folder.path().join("a.obj"), folder.path().join("a.mtl"));
        let (mut state, mut loaded, rounds) = (0x9e37_79b9_7f4a_7c15, 0, 4000);
        for _ in 0..rounds {
            let (mut obj, mut mtl) = (obj.to_vec(), mtl.to_vec());
            mutate(&mut obj, &mut state);
            mutate(&mut mtl, &mut state);
            fs::write(&path, obj).unwrap();
            fs::write(&mtl_path, mtl).unwrap();
            let Ok(model) = load(&path, |_| false) else { continue };
            loaded += 1;
            let exists = |corner: &u32| (*corner as usize) < model.positions.len();
            assert!(model.positions.iter().all(|position| position.is_finite()));
            assert!(model.triangles.as_flattened().iter().all(exists));
            assert_eq!(model.triangles.len(), model.material_of.len());
            assert!(model.material_of.iter().all(|id| (id.0 as usize) < model.materials.len()));
        }
        assert!((rounds / 20..rounds * 19 / 20).contains(&loaded), "{loaded} of {rounds} loaded");
    }
}
