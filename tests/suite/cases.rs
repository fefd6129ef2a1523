//! Files as people have them: each of these once gave no picture, a black one or a wrong one.

use assert_cmd::Command;
use image::Rgb32FImage;
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

/// A room of 4 × 3 × 4 that is open at z = 4, under whose ceiling hangs a lamp of 1 m².
const CORNERS: [[f64; 3]; 12] = [
    [0.0, 0.0, 0.0],
    [4.0, 0.0, 0.0],
    [4.0, 0.0, 4.0],
    [0.0, 0.0, 4.0],
    [0.0, 3.0, 0.0],
    [4.0, 3.0, 0.0],
    [4.0, 3.0, 4.0],
    [0.0, 3.0, 4.0],
    [1.5, 2.75, 1.5],
    [2.5, 2.75, 1.5],
    [2.5, 2.75, 2.5],
    [1.5, 2.75, 2.5],
];

const WALLS: [(&str, [usize; 4]); 5] = [
    ("floor", [1, 4, 3, 2]),
    ("white", [5, 6, 7, 8]),
    ("white", [1, 2, 6, 5]),
    ("red", [1, 5, 8, 4]),
    ("green", [2, 3, 7, 6]),
];

/// The wall that closes the room.
const FRONT: (&str, [usize; 4]) = ("white", [3, 4, 8, 7]);

const LAMP: (&str, [usize; 4]) = ("lamp", [9, 10, 11, 12]);

const MATERIALS: &str = "newmtl floor\nKd 0.5 0.5 0.5\nnewmtl white\nKd 0.7 0.7 0.7\nnewmtl red\nKd 0.6 0.1 0.1\n\
                         newmtl green\nKd 0.1 0.5 0.1\nnewmtl lamp\nKd 0 0 0\nKe 15 15 15\n";

fn model(corners: impl IntoIterator<Item = [f64; 3]>, faces: &[(&str, [usize; 4])]) -> String {
    let corners = corners.into_iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let faces =
        faces.iter().map(|(name, [a, b, c, d])| format!("usemtl {name}\nf {a} {b} {c} {d}\n"));
    corners.chain(faces).collect()
}

fn walls_and_lamp() -> Vec<(&'static str, [usize; 4])> {
    [&WALLS[..], &[LAMP]].concat()
}

/// The room, and `more` after it.
fn room(more: &str) -> String {
    format!("mtllib a.mtl\n{}{more}", model(CORNERS, &walls_and_lamp()))
}

/// A pane in the middle of the room. Its vertices follow those of the room.
fn pane(material: &str) -> String {
    format!("v 1 0.25 2\nv 3 0.25 2\nv 3 2.25 2\nv 1 2.25 2\nusemtl {material}\nf 13 14 15 16\n")
}

/// A carpet exactly in the floor, with the floor's winding.
const CARPET: &str = "v 1 0 1\nv 1 0 3\nv 3 0 3\nv 3 0 1\nusemtl red\nf 13 14 15 16\n";

/// A folder with a model in it.
struct Case(TempDir);

/// What came of a run that succeeded.
struct Drawn {
    stats: Value,
    warnings: String,
    /// The bytes of the EXR file.
    file: Vec<u8>,
    picture: Rgb32FImage,
}

impl Case {
    /// With `a.obj` and `a.mtl`.
    fn new(obj: &str, materials: &str) -> Case {
        let case = Case(tempfile::tempdir().expect("a temporary folder"));
        case.write("a.obj", obj);
        case.write("a.mtl", materials);
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).expect("a file");
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("isolux").expect("the program is built");
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    /// A small picture of coarse patches.
    fn draw(&self, scene: &str, more: &[&str]) -> Drawn {
        self.run(scene, &[&["--levels", "3"], more].concat())
    }

    fn run(&self, scene: &str, more: &[&str]) -> Drawn {
        let mut command = self.command(&["render", scene, "-o", "a.exr", "--stats", "a.json"]);
        command.args(["--size", "64x48", "--spp", "4"]).args(more);
        let warnings = command.assert().success().get_output().stderr.clone();
        let stats = fs::read(self.path("a.json")).expect("a file");
        Drawn {
            stats: serde_json::from_slice(&stats).expect("JSON"),
            warnings: String::from_utf8(warnings).expect("UTF-8"),
            file: fs::read(self.path("a.exr")).expect("a file"),
            picture: image::open(self.path("a.exr")).expect("a picture").into_rgb32f(),
        }
    }

    /// What `info` says on standard output.
    fn info(&self, scene: &str) -> String {
        let output = self.command(&["info", scene]).assert().success().get_output().clone();
        String::from_utf8(output.stdout).expect("UTF-8")
    }
}

impl Drawn {
    fn exposure(&self) -> f64 {
        self.stats["exposure"].as_f64().expect("a number")
    }

    /// Mean power of the channels in watts; 0 for what is not stated.
    fn power(&self, kind: &str) -> f64 {
        let channels = self.stats["energy"][kind].as_array();
        channels.map_or(0.0, |c| c.iter().map(|x| x.as_f64().expect("a number")).sum::<f64>() / 3.0)
    }

    fn is_like(&self, other: &Drawn) -> bool {
        let ratio = self.exposure() / other.exposure();
        // The exposure follows from one percentile of the pixels. Other patches, seeds and directions give it
        // other noise: about 1 % with 256 rays per patch.
        (ratio - 1.0).abs() < 0.05
    }

    fn share_of_pixels(&self, is: impl Fn([f32; 3]) -> bool) -> f64 {
        let count = self.picture.pixels().filter(|pixel| is(pixel.0)).count();
        count as f64 / (self.picture.width() * self.picture.height()) as f64
    }
}

fn baseline() -> Drawn {
    Case::new(&room(""), MATERIALS).draw("a.obj", &[])
}

#[test]
fn a_plain_room_is_lit_by_its_lamp() {
    let drawn = baseline();
    assert_eq!(drawn.warnings, "");
    let emitted = 15.0 * std::f64::consts::PI;
    assert!((drawn.power("emitted") / emitted - 1.0).abs() < 1e-6, "{}", drawn.stats);
    // From outside, past the dark backs of its walls.
    assert!(drawn.share_of_pixels(|p| p != [0.0; 3]) > 0.15);
}

#[test]
fn a_library_with_blanks_in_its_name_is_found() {
    let case = Case::new(&room("").replace("a.mtl", "my room.mtl"), "");
    case.write("my room.mtl", MATERIALS);
    let drawn = case.draw("a.obj", &[]);
    assert!(drawn.warnings.is_empty() && drawn.file == baseline().file, "{}", drawn.warnings);
}

#[test]
fn a_name_in_latin_1_can_be_named_in_a_description() {
    let latin_1 = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
    let case = Case::new("", "");
    case.write("a.obj", latin_1(&room("").replace("red", "Wände")));
    case.write("a.mtl", latin_1(&MATERIALS.replace("red", "Wände")));
    case.write(
        "a.toml",
        "models = ['a.obj']\n[materials.'Wände']\nreflectance = [0.1, 0.1, 0.6]\n",
    );
    assert!(case.info("a.toml").contains("Wände"));
    // It was red; with nothing red in the room, blue is never behind red.
    let drawn = case.draw("a.toml", &[]);
    assert_eq!(drawn.share_of_pixels(|[r, _, b]| r > b * 1.01), 0.0);
    assert!(baseline().share_of_pixels(|[r, _, b]| r > b * 1.01) > 0.1);
}

#[test]
fn a_dim_light_does_not_change_the_exposure() {
    let led =
        "v 0.01 1 1\nv 0.01 1 1.25\nv 0.01 1.25 1.25\nv 0.01 1.25 1\nusemtl led\nf 16 15 14 13\n";
    let materials = format!("{MATERIALS}newmtl led\nKd 0.1 0.1 0.1\nKe 0.05 0.2 0.05\n");
    let drawn = Case::new(&room(led), &materials).draw("a.obj", &[]);
    assert!(drawn.is_like(&baseline()), "{}", drawn.exposure());
}

#[test]
fn walls_that_are_wound_outwards_are_a_lit_room() {
    let reversed = |(name, [a, b, c, d]): (&'static str, [usize; 4])| (name, [b, a, d, c]);
    let faces = [WALLS.map(reversed).to_vec(), vec![LAMP]].concat();
    let drawn = Case::new(&format!("mtllib a.mtl\n{}", model(CORNERS, &faces)), MATERIALS)
        .draw("a.obj", &[]);
    assert!(drawn.is_like(&baseline()), "{}", drawn.exposure());
    assert_eq!((drawn.warnings.as_str(), drawn.power("on_backs")), ("", 0.0));
}

#[test]
fn walls_that_are_there_twice_are_sheets_in_whichever_order_and_however_they_are_cut() {
    let expected = baseline();
    // From another corner a face is cut along its other diagonal.
    let reversed = |(name, [a, b, c, d]): (&'static str, [usize; 4])| (name, [b, a, d, c]);
    let turned = |(name, [a, b, c, d]): (&'static str, [usize; 4])| (name, [a, d, c, b]);
    let askew = |[x, y, z]: [f64; 3]| {
        let (x, y) = (0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y);
        [3.1 + x, 0.28 * y - 0.96 * z - 1.7, 0.96 * y + 0.28 * z + 2.3]
    };
    for back in [reversed, turned] {
        let front_first: Vec<_> = WALLS.iter().flat_map(|wall| [*wall, back(*wall)]).collect();
        let back_first: Vec<_> = WALLS.iter().flat_map(|wall| [back(*wall), *wall]).collect();
        for walls in [front_first, back_first] {
            let faces = [walls, vec![LAMP]].concat();
            for corners in [CORNERS, CORNERS.map(askew)] {
                let case =
                    Case::new(&format!("mtllib a.mtl\n{}", model(corners, &faces)), MATERIALS);
                let camera = ["--position", "2,1.5,9", "--look-at", "2,1.5,0"];
                let camera = if corners == CORNERS { &camera[..] } else { &[] };
                let drawn = case.draw("a.obj", camera);
                assert!(drawn.share_of_pixels(|p| p != [0.0; 3]) > 0.25);
                let absorbed = drawn.power("absorbed") / expected.power("absorbed");
                // Noise of 1,300 patches with 256 rays each.
                assert!((absorbed - 1.0).abs() < 0.02, "{faces:?}: {absorbed}");
                assert!(drawn.warnings.lines().count() <= 1, "{}", drawn.warnings);
            }
        }
    }
}

#[test]
fn a_carpet_in_the_floor_is_seen_whole_and_its_power_balances() {
    let camera = ["--position", "2,2.7,2", "--look-at", "2,0,2", "--up", "z", "--fov", "50"];
    let drawn = Case::new(&room(CARPET), MATERIALS).draw("a.obj", &camera);
    // From 2.7 above the floor a carpet 2 wide fills a square of the picture, whose width is 4/3 of its height.
    let red = drawn.share_of_pixels(|[r, g, _]| r > 3.0 * g && g > 0.0);
    let carpet = (2.0 / 2.7 / (2.0 * 25f64.to_radians().tan())).powi(2) * 0.75;
    // A pixel at the rim may count or not: 4 · 38 of them.
    assert!((red - carpet).abs() < 152.0 / (64.0 * 48.0), "{red} of {carpet}");
    assert!(drawn.stats["imbalance"].as_f64().expect("a number").abs() < 0.01, "{}", drawn.stats);
}

#[test]
fn a_room_with_z_up_is_seen_as_the_room_with_y_up() {
    let corners = CORNERS.map(|[x, y, z]| [x, -z, y]);
    let case =
        Case::new(&format!("mtllib a.mtl\n{}", model(corners, &walls_and_lamp())), MATERIALS);
    let (drawn, expected) = (case.draw("a.obj", &[]), baseline());
    assert!(drawn.warnings.contains("z up"), "{}", drawn.warnings);
    assert!(drawn.is_like(&expected), "{}", drawn.exposure());
    let pixels = drawn.picture.iter().zip(expected.picture.iter());
    let difference: f32 = pixels.map(|(a, b)| (a - b).abs()).sum();
    let ratio = difference / expected.picture.iter().sum::<f32>();
    assert!(ratio < 0.05, "{ratio}");
    let told = case.draw("a.obj", &["--up", "z"]);
    assert!(told.file == drawn.file);
}

#[test]
fn an_object_under_a_lamp_is_seen_whole_from_outside() {
    let corner = |k: usize| [(k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2 & 1) as f64];
    let lamp = [[-0.5, 1.25, -0.5], [1.5, 1.25, -0.5], [1.5, 1.25, 1.5], [-0.5, 1.25, 1.5]];
    let faces = [
        ("red", [1, 3, 4, 2]),
        ("red", [5, 6, 8, 7]),
        ("red", [1, 2, 6, 5]),
        ("red", [3, 7, 8, 4]),
        ("red", [1, 5, 7, 3]),
        ("red", [2, 4, 8, 6]),
        LAMP,
    ];
    let corners = (0..8).map(corner).chain(lamp);
    let case = Case::new(&format!("mtllib a.mtl\n{}", model(corners, &faces)), MATERIALS);
    let drawn = case.draw("a.obj", &[]);
    let is_red = |[r, g, _]: [f32; 3]| r > 2.0 * g;
    assert!(drawn.share_of_pixels(is_red) > 0.05, "{}", drawn.share_of_pixels(is_red));
    for (x, y, pixel) in drawn.picture.enumerate_pixels() {
        let on_edge = x == 0 || y == 0 || x == 63 || y == 47;
        assert!(!(on_edge && is_red(pixel.0)), "{x}, {y}");
    }
}

#[test]
fn light_on_backs_does_not_count_as_escaped() {
    let faces = [walls_and_lamp(), vec![FRONT]].concat();
    let panel = pane("white");
    let case = Case::new(&format!("mtllib a.mtl\n{}{panel}", model(CORNERS, &faces)), MATERIALS);
    let drawn = case.draw("a.obj", &["--one-sided"]);
    assert_eq!(drawn.power("escaped"), 0.0, "{}", drawn.stats);
    assert!(drawn.power("on_backs") > 0.05 * drawn.power("emitted"), "{}", drawn.stats);
}

/// The room with a box of two skins in it, 1 mm over the floor. Each skin has vertices of its own, and their
/// faces begin at other corners.
fn with_sealed_box() -> String {
    let corner =
        |k: usize| [1.0 + (k & 1) as f64, [0.001, 1.0][k >> 1 & 1], 1.0 + (k >> 2 & 1) as f64];
    let inward =
        [[1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7], [1, 3, 7, 5], [2, 6, 8, 4]];
    let inner = inward.map(|face| ("white", face.map(|k| k + 12)));
    let outer = inward.map(|[a, b, c, d]| ("white", [b, a, d, c].map(|k| k + 20)));
    let faces = [&walls_and_lamp()[..], &inner, &outer].concat();
    let corners = CORNERS.into_iter().chain((0..8).map(corner)).chain((0..8).map(corner));
    format!("mtllib a.mtl\n{}", model(corners, &faces))
}

#[test]
fn no_light_enters_a_sealed_box() {
    let case = Case::new(&with_sealed_box(), MATERIALS);
    let drawn = case.draw("a.obj", &["--position", "1.5,0.5,1.95", "--look-at", "1.5,0.5,1"]);
    assert!(drawn.picture.pixels().all(|pixel| pixel.0 == [0.0; 3]));
    assert!(drawn.power("absorbed") > 0.3 * drawn.power("emitted"), "the room is lit");
}

#[test]
fn a_triangle_that_loses_its_patches_in_rounding_stops_no_run() {
    let lamp = "v 1000 50 1000\nv 1010 50 1000\nv 1010 50 1010\nv 1000 50 1010\n";
    let floor = "v 1000 0 1000\nv 1000 0 1100\nv 1100 0 1100\nv 1100 0 1000\n";
    let sliver = "v 1050 25 1000\nv 1050 25.00001 1100\nv 1050 25.00001 1000\n";
    let faces = "usemtl lamp\nf 1 2 3 4\nusemtl white\nf 5 6 7 8\nf 9 10 11\n";
    let case = Case::new(&format!("mtllib a.mtl\n{lamp}{floor}{sliver}{faces}"), MATERIALS);
    for more in [&[][..], &["--solver", "southwell"], &["--levels", "6"], &["--direct", "0"]] {
        let mut command = case.command(&["render", "a.obj", "-o", "b.exr", "--size", "64x48"]);
        command.args(["--spp", "4"]).args(more).assert().success();
        let picture = image::open(case.path("b.exr")).expect("a picture").into_rgb32f();
        assert!(
            picture.iter().all(|x| x.is_finite()) && picture.iter().any(|x| *x > 0.0),
            "{more:?}"
        );
    }
}

/// Cases in each of which power went astray, with what a warning must say.
fn power_cases() -> Vec<(&'static str, String, String, &'static str)> {
    let closed = [walls_and_lamp(), vec![FRONT]].concat();
    let glass = |more: &str| format!("{MATERIALS}newmtl glass\n{more}\n");
    let low = CORNERS.map(|[x, y, z]| [x, y / 24.0, z]);
    let void = format!("mtllib a.mtl\n{}", model(low, &closed));
    vec![
        ("room", room(""), MATERIALS.into(), ""),
        (
            "closed",
            format!("mtllib a.mtl\n{}{}", model(CORNERS, &closed), pane("white")),
            MATERIALS.into(),
            "",
        ),
        ("glass", room(&pane("glass")), glass("Kd 0.1 0.1 0.1\nd 0.25"), "straight through"),
        ("mirror", room(&pane("glass")), glass("Kd 0 0 0\nKs 0.95 0.95 0.95\nillum 3"), "mirrors"),
        ("white", room(&pane("glass")), glass("Kd 1 1 1"), ""),
        ("shallow", void, MATERIALS.into(), ""),
        ("carpet", room(CARPET), MATERIALS.into(), "first: face 7 is seen, not face 1"),
        (
            "turned carpet",
            room(&CARPET.replace("13 14 15 16", "16 15 14 13")),
            MATERIALS.into(),
            "first: face 7 behind face 1): to see them there, reverse their winding",
        ),
        ("sealed box", with_sealed_box(), MATERIALS.into(), "where others do"),
    ]
}

#[test]
fn what_is_emitted_is_absorbed_meets_backs_or_escapes() {
    for (name, obj, materials, warning) in power_cases() {
        let case = Case::new(&obj, &materials);
        for more in [&[][..], &["--one-sided"]] {
            let pairs = ["--form-factors", "pairs", "--samples", "16", "--levels", "2"];
            let drawn = case.run("a.obj", &[&pairs, more].concat());
            let count = drawn.warnings.matches("warning: ").count();
            assert!(
                count == usize::from(!warning.is_empty()) && drawn.warnings.contains(warning),
                "{name}: {}",
                drawn.warnings
            );
            let emitted = drawn.power("emitted");
            let lost = emitted
                - drawn.power("absorbed")
                - drawn.power("on_backs")
                - drawn.power("escaped");
            // Form factors of pairs are reciprocal, so that nothing is missing but what the solver's residual
            // stands for, and rounding.
            let residual =
                drawn.stats["residuals"].as_array().and_then(|list| list.last()?.as_f64());
            let bound = (residual.expect("a number") + 1e-9) * emitted;
            assert!(lost.abs() <= bound, "{name} {more:?}: {lost} of {emitted} W, at most {bound}");
        }
    }
}

#[test]
fn many_equal_triangles_are_one() {
    let faces = "f 1 2 3\n".repeat(30_000);
    let case = Case::new(
        &format!("mtllib a.mtl\nv 0 0 0\nv 0 0 1\nv 1 0 0\nusemtl lamp\n{faces}"),
        MATERIALS,
    );
    let drawn = case.draw("a.obj", &[]);
    assert_eq!(drawn.stats["triangles"], 1);
    assert_eq!(drawn.warnings.matches("warning: ").count(), 1, "{}", drawn.warnings);
}

#[test]
fn names_of_files_are_short_and_speak_to_no_terminal() {
    let long = "n".repeat(70_000);
    let materials = format!("newmtl \u{1b}]0;title\u{7}\nKd 0.5\nnewmtl {long}\nKd 0.5\n");
    let case = Case::new(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl \u{1b}]0;title\u{7}\nf 1 2 3\n",
        &materials,
    );
    let said = case.info("a.obj");
    assert!(!said.contains(['\u{1b}', '\u{7}']) && said.contains("title"), "{said:?}");
    assert!(said.lines().all(|line| line.chars().count() < 300));
}
