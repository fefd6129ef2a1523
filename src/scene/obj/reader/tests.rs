//! Tests of the reader, the words of its lines included.

use super::*;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

fn read(text: &str) -> Result<ObjFile> {
    read_obj(Path::new("a.obj"), text)
}

fn of_faces<T>(file: &ObjFile, what: impl Fn(&Run) -> T) -> Vec<T> {
    file.faces.iter().map(|face| what(&file.runs[face.run as usize])).collect()
}

/// The first line of the message, for `line` after the three vertices.
fn error_of(line: &str) -> String {
    let faces = format!("{line}\nf 1 2 -1\n");
    let error = read(&format!("{TRIANGLE}{faces}")).expect_err(line).to_string();
    error.lines().next().unwrap_or_default().to_owned()
}

#[test]
fn a_face_with_two_vertices_is_left_out_and_keeps_its_number() {
    let file = read(&format!("{TRIANGLE}f 1 2\nf\nf 1 2 3\n")).unwrap();
    assert_eq!(file.faces.iter().map(|face| face.arity).collect::<Vec<_>>(), [2, 0, 3]);
    assert_eq!(
        file.warnings[1].to_string(),
        "a.obj:4: a face with fewer than 3 vertices has no area and is ignored (2 in all)"
    );
    assert!(read(&format!("{TRIANGLE}f 1 2\n")).unwrap_err().cause().contains("no faces"));
}

#[test]
fn each_bad_index_is_told_with_its_range() {
    assert_eq!(error_of("f 1 2 0"), "a.obj:4: vertex index 0 does not exist");
    let range = "a.obj:4: vertex index 4 is out of range: the file has 3 vertices";
    assert_eq!(error_of("f 1 2 4\nf 1 2 9"), range);
    let range = "a.obj:4: vertex index -4 is out of range: 3 vertices precede this line";
    assert_eq!(error_of("f 1 2 -4\nv 1 1 1"), range);
    assert!(error_of(&format!("f 1 2 {}", i64::MAX)).contains("out of range"));
    assert!(error_of(&format!("f 1 2 {}", i64::MIN)).contains("out of range"));
    for word in ["99999999999999999999", "1.0", "/1", "1/x/1", "a\u{7}"] {
        assert!(error_of(&format!("f 1 2 {word}")).contains("is not a vertex index"), "{word}");
    }
}

#[test]
fn each_bad_vertex_names_its_line_and_word() {
    assert_eq!(error_of("v 1 2"), "a.obj:4: a vertex has 3 coordinates, this line has 2 numbers");
    assert!(error_of("v 1 2 3 4 5").contains("has 5 numbers"));
    assert!(error_of("v 1 2 3 4 5 6 7 8 9").contains("has 9 numbers"));
    assert_eq!(error_of("v 1 x 3"), "a.obj:4: `x` is not a number");
    assert_eq!(error_of("v 1 nan 3"), "a.obj:4: `nan` is not a finite number");
    assert_eq!(error_of("v 1 2 1.#QNAN"), "a.obj:4: `1.#QNAN` is not a number");
    assert!(error_of("v 1 2 3 0").contains("weight w is 0"));
    assert_eq!(error_of("v 1 -2e12 3"), "a.obj:4: coordinate -2e12 is larger than 1e12");
    assert!(error_of("v 1 1 1 1e-20").contains("larger than 1e12"));
}

#[test]
fn indices_count_from_the_beginning_or_backwards() {
    let text = "f 1/1/1 2//2 \\\n -1 # corner\nv 1 1 1 1 0 0\nf 5 -1 1\nv 2 2 2 2\n";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!(file.positions[3..], [DVec3::ONE; 2]);
    assert_eq!(file.corners.positions, [1, 2, 3, 5, 4, 1]);
}

#[test]
fn texture_coordinates_and_normals_are_kept_where_they_exist() {
    let text = "vt .5\nvt 1 x\nvn 0 0 1\nf 1/-1/1 2/1 3/9/-2\n";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!(file.texture, [Vec2::new(0.5, 0.0), Vec2::new(1.0, 0.0)]);
    assert_eq!(file.normals, [Vec3::Z]);
    assert_eq!(file.corners.texture, [2, 1, 0]);
    assert_eq!(file.corners.normals, [1, 0, 0]);
}

#[test]
fn corners_before_the_first_texture_coordinate_and_after_the_last_have_none() {
    let text = "vt 1 1\nvn 0 0 1\nf 1 2 3\nf 1/1 2/1 3\nf 3//1 2 1\n";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!(file.corners.texture, [0, 0, 0, 1, 1, 0, 0, 0, 0]);
    assert_eq!(file.corners.normals, [0, 0, 0, 0, 0, 0, 1, 0, 0]);
}

#[test]
fn each_pair_of_object_and_group_is_one_part() {
    let face = "f 1 2 3\n";
    let text = format!("{face}o a b\n{face}g x\n{face}g\n{face}o c\ng x\ng\no a b\n{face}");
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!(of_faces(&file, |run| run.part), [0, 1, 2, 1, 1]);
    let named = |object: &str, group: &str| {
        let name = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        Part { model: 0, object: name(object), group: name(group) }
    };
    assert_eq!(file.parts, [named("", ""), named("a b", ""), named("a b", "x")]);
}

#[test]
fn only_materials_of_faces_are_kept_and_each_once() {
    let text = "usemtl a\nusemtl b c\nf 1 2 3\nusemtl d\nf 1 2 3\nusemtl b c\nf 1 2 3\nusemtl e";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    let named = |name: &str, line| Named { name: name.into(), line };
    assert_eq!(file.materials, [named("b c", 5), named("d", 7)]);
    assert_eq!(of_faces(&file, |run| run.material), [Some(0), Some(1), Some(0)]);
    assert_eq!(file.warnings, []);
}

#[test]
fn a_file_without_faces_is_refused_without_a_line() {
    let error = read(&format!("{TRIANGLE}l 1 2")).unwrap_err().to_string();
    assert!(error.starts_with("a.obj: the file contains no faces"));
}

#[test]
fn all_malformed_lines_are_told_at_once_in_order() {
    let text = "f 1 2 y\nv 1 x 3\nf 1 2 9\nf 1 2 4\nf 1 0 2\n";
    let error = read(&format!("{TRIANGLE}{text}")).unwrap_err().to_string();
    let lines: Vec<&str> = error.lines().collect();
    assert_eq!(lines.len(), 5, "{error}");
    assert!(lines[0].starts_with("a.obj:4:") && lines[1].starts_with("  help:"), "{error}");
    assert_eq!(lines[2], "a.obj:5: `x` is not a number");
    assert!(lines[3].starts_with("a.obj:6:") && lines[4].starts_with("a.obj:8:"), "{error}");
}

#[test]
fn numbers_that_nobody_uses_may_be_malformed() {
    let text = "v nan 0 0\nvt inf 0\nvn nan nan nan\nf 1/1/1 2 3\nv 1 2\n";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!((file.texture[0], file.normals[0]), (Vec2::ZERO, Vec3::ZERO));
    assert!(file.positions.len() == 5 && file.positions.iter().all(|p| p.is_finite()));
    let said: Vec<String> = file.warnings.iter().map(Warning::to_string).collect();
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(said[1].starts_with("a.obj:4: a vertex that no face uses"), "{said:?}");
    assert!(said[1].ends_with("(2 in all)") && said[2].ends_with("(2 in all)"), "{said:?}");
}

#[test]
fn a_blank_usemtl_stands_for_the_default_material() {
    let text = "usemtl a\nf 1 2 3\nusemtl\nf 1 2 3\nf 3 2 1\nusemtl a\nf 1 2 3\n";
    let file = read(&format!("{TRIANGLE}{text}")).unwrap();
    assert_eq!(of_faces(&file, |run| run.material), [Some(0), None, None, Some(0)]);
    assert_eq!(file.warnings.len(), 1);
    assert!(file.warnings[0].to_string().starts_with("a.obj:6: `usemtl` without a name"));
}

#[test]
fn vertex_colours_are_decoded_from_srgb_and_white_ones_are_dropped() {
    let colors = |text: &str| read(&format!("{text}f 1 2 3\n")).unwrap().colors;
    let text = "v 0 0 0\nv 1 0 0 1 0 0.5\nv 0 1 0 1 x 1\n";
    let grey = srgb_decode(0.5);
    assert_eq!(colors(text), [Rgb::ONE, Rgb::new(1.0, 0.0, grey), Rgb::ONE]);
    let text = "v 0 0 0 255 0 51 255\nv 1 0 0\nv 0 1 0\n";
    assert_eq!(colors(text)[0], Rgb::new(1.0, 0.0, srgb_decode(0.2)));
    assert!(colors("v 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0 1 1 1 1\n").is_empty());
}
