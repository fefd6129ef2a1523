use super::*;
use crate::geometry::TriangleId;
use crate::scene::mutation::{self, Loaded};

fn load_bytes(bytes: &[u8]) -> Loaded {
    mutation::load("a.ply", bytes, load)
}

/// A square of red, green, blue and white corners, and a triangle on it.
const HEADER: &str = "Created by Blender3D 247\ncomment caf\u{e9}\nobj_info x\n element vertex 4\nproperty double x\nproperty float y\n\
    property short z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    property float s\nproperty float t\nelement edge 1\nproperty int vertex1\n\
    element face 2\nproperty list uchar int vertex_indices\nproperty uchar flags\nend_header\n";

const BODY: &str = "0 0 0 255 0 0 0 0\n1 0. 0 0 255 0 1 0\n\n1.5 1 0 0 0 255 1 1\n\
    0 1e0 0 255 255 255 0 .5\n7\n4 0 1 2 3 9\n3 2 1 0 9\n";

fn text() -> Vec<u8> {
    format!("ply\nformat ascii 1.0\n{HEADER}{BODY}").into_bytes()
}

/// The same elements in binary.
fn binary(big: bool) -> Vec<u8> {
    let name = if big { "big" } else { "little" };
    let mut bytes = format!("ply\r\nformat binary_{name}_endian 1.0\r\n{HEADER}").into_bytes();
    let mut put = |little: &[u8]| {
        let mut number = little.to_vec();
        if big {
            number.reverse();
        }
        bytes.extend(number);
    };
    let mut lines = BODY.lines().filter(|line| !line.is_empty());
    for line in lines.by_ref().take(4) {
        let numbers: Vec<f64> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        put(&numbers[0].to_le_bytes());
        put(&(numbers[1] as f32).to_le_bytes());
        put(&(numbers[2] as i16).to_le_bytes());
        numbers[3..6].iter().for_each(|color| put(&[*color as u8]));
        numbers[6..].iter().for_each(|uv| put(&(*uv as f32).to_le_bytes()));
    }
    put(&7i32.to_le_bytes());
    for line in lines.skip(1) {
        let numbers: Vec<i32> = line.split(' ').map(|word| word.parse().unwrap()).collect();
        put(&[numbers[0] as u8]);
        numbers[1..numbers.len() - 1].iter().for_each(|index| put(&index.to_le_bytes()));
        put(&[numbers[numbers.len() - 1] as u8]);
    }
    bytes
}

#[test]
fn text_and_both_binaries_are_the_same_model() {
    let (model, warnings) = load_bytes(&text()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    for big in [false, true] {
        let (other, _) = load_bytes(&binary(big)).unwrap();
        assert_eq!(model.positions, other.positions);
        assert_eq!(model.triangles, other.triangles);
        assert_eq!(model.mesh, other.mesh);
    }
    assert_eq!(model.positions[2], DVec3::new(1.5, 1.0, 0.0));
    assert_eq!(model.triangles, [[0, 1, 2], [0, 2, 3], [2, 1, 0]]);
    assert_eq!(model.mesh.origins.iter().map(|o| o.face).collect::<Vec<_>>(), [1, 1, 2]);
    assert_eq!(model.materials[0].reflectance, Rgb::ONE);
    let (colors, texture) = (model.mesh.colors.unwrap(), model.mesh.texture.unwrap());
    assert_eq!(colors.at(TriangleId(0), 1), Some(Rgb::Y));
    assert_eq!(texture.at(TriangleId(1), 2), Some(Vec2::new(0.0, 0.5)));
}

#[test]
fn strips_turn_every_other_triangle_over() {
    let (model, _) = load_bytes(
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
          property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n\
          0 0 0\n0 1 0\n1 0 0\n1 1 0\n8 0 1 2 3 -1 3 2 1\n",
    )
    .unwrap();
    assert_eq!(model.triangles, [[0, 1, 2], [1, 3, 2], [3, 2, 1]]);
    assert_eq!(model.mesh.origins.iter().map(|o| o.face).collect::<Vec<_>>(), [1, 2, 3]);
    assert_eq!(model.materials[0].reflectance, Material::fallback().reflectance);
}

const POSITIONS: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n\
    property float y\nproperty float z\n";

#[test]
fn faces_may_have_colours_and_texture_coordinates_of_their_own() {
    let text = format!(
        "{POSITIONS}element face 2\nproperty list uchar uint vertex_index\n\
         property list uchar float texcoord\nproperty float red\nproperty float green\n\
         property float blue\nend_header\n0 0 0\n1 0 0\n0 1 0\n2 0 1 0 1 1 1\n\
         3 0 1 2 6 0 0 1 0 0 1 0.25 0.5 1\n"
    );
    let (model, warnings) = load_bytes(text.as_bytes()).unwrap();
    let mesh = model.mesh;
    assert_eq!(mesh.origins[0].face, 2);
    assert_eq!(mesh.texture.unwrap().at(TriangleId(0), 2), Some(Vec2::Y));
    assert_eq!(mesh.colors.unwrap().at(TriangleId(0), 0), Some(Rgb::new(0.25, 0.5, 1.0)));
    assert_eq!(
        warnings,
        [
            "a.ply: faces with fewer than 3 vertices have no area and are ignored (1 in all, first face 1)"
        ]
    );
}

#[test]
fn pictures_that_comments_name_are_on_the_faces_that_number_them() {
    let text = POSITIONS
        .replace("element", "comment TextureFile my a.png\ncomment TextureFile b.png\nelement")
        + "element face 2\nproperty list uchar int vertex_indices\n\
           property list uchar float texcoord\nproperty int texnumber\nend_header\n\
           0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0 1 0 0 1 0\n3 2 1 0 6 0 0 1 0 0 1 1\n";
    let mut png = std::io::Cursor::new(Vec::new());
    let picture = image::RgbaImage::from_pixel(1, 1, image::Rgba([1, 2, 3, 255]));
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let files: [(&str, &[u8]); 2] = [("a.ply", text.as_bytes()), ("my a.png", png.get_ref())];
    let (model, warnings) = mutation::load_files(&files, load).unwrap();
    assert_eq!(model.material_of.iter().map(|id| id.0).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(*model.textures[0].pixels, [[1, 2, 3, 255]]);
    assert!(model.files[0].ends_with("my a.png"));
    let maps: Vec<bool> = model.materials.iter().map(|m| m.reflectance_map.is_some()).collect();
    assert_eq!(maps, [true, false]);
    assert!(
        warnings[0].starts_with("a.ply: the picture `b.png` cannot be used: cannot read `b.png`")
    );
}

#[test]
fn what_has_no_meaning_is_refused_with_its_place() {
    let body = |rest: &str| format!("{POSITIONS}{rest}");
    let face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n";
    for (text, cause) in [
        (body("end_header\n0 0 0\n1 0 0\n0 1 0\n"), "a.ply: this is a point cloud: it has 3 vertices, but no faces"),
        (body(&format!("{face}0 1 0\n3 0 1 3\n")), "a.ply: face 1 names vertex 3, but the vertices are 0 to 2"),
        (body(&format!("{face}0 1 0\n3 0 1 -1\n")), "a.ply: face 1 names vertex -1"),
        (body(&format!("{face}0 1 nan\n3 0 1 2\n")), "a.ply: vertex 3: coordinate NaN is not a finite number"),
        (body(&format!("{face}0 1 x\n3 0 1 2\n")), "a.ply:12: `x` is not a number"),
        (body(&format!("{face}0 1\n3 0 1 2\n")), "a.ply:12: the line ends within an element `vertex`"),
        (body(&format!("{face}0 1 0\n4294967295 0 1 2\n")), "a.ply:13: the line ends within an element `face`"),
        (body(&format!("{face}0 1 0\n-3 0 1 2\n")), "a.ply:13: a list cannot have -3 values"),
        (body(&format!("{face}0 1 0\n")), "a.ply: the header says that there are 1 elements `face`, but the file has no room for them"),
        (body("element face 4294967296\nproperty list uchar int vertex_indices\nend_header\n"), "a.ply: the header says that there are"),
        (body("element x 18446744073709551615\nend_header\n0 0 0\n0 0 0\n0 0 0\n"), "a.ply: this is a point cloud"),
        (body("property vec x\nend_header\n"), "a.ply:7: `property vec x` has no meaning in a PLY header"),
        (body(""), "a.ply: the PLY header has no end"),
        ("ply\nend_header\n".into(), "a.ply: the PLY header is incomplete"),
        ("ply\nformat ascii 1.0\nend_header\n".into(), "a.ply: the vertices have no x, y and z"),
        ("{}".into(), "a.ply: this does not look like a PLY file"),
        ("ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list int float x\nend_header\n\u{7f}\u{7f}\u{7f}\u{7f}".into(),
         "a.ply: the file does not have the 1 elements `vertex`"),
    ] {
        let message = load_bytes(text.as_bytes()).unwrap_err();
        assert!(message.starts_with(cause) && message.contains("\n  help: "), "{message}\n{cause}");
    }
}

#[test]
fn no_mutation_makes_the_reader_panic() {
    for bytes in [text(), binary(false), binary(true)] {
        mutation::try_many(&bytes, 3000, |bytes| read(Path::new("a.ply"), bytes));
    }
}
