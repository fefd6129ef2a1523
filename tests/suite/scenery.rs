//! What is assumed about scenes that do not say: light from the sky, sides, origin; and triangles so thin that
//! their patches lose their area.

use crate::scenes::{Piece, cube, grey, inside_out, scene, square};
use glam::{Affine2, DVec3, Vec2, Vec3};
use isolux::color::Rgb;
use isolux::geometry::{Ray, Triangle};
use isolux::patches::Sides;
use isolux::scene::mesh::{Mesh, PerCorner};
use isolux::scene::texture::{Map, Texture, TextureId, Wrap};
use isolux::scene::{Material, Scene};
use isolux::settings::{Method, PatchSettings, Settings, Solver};
use isolux::{Document, Frame, Plan, RayCaster, Solution, Tracer, View};
use std::f64::consts::PI;

fn solved(scene: &Scene, settings: &Settings) -> Solution {
    let document = Document::open("made-in-memory.obj").expect("a name is enough");
    Solution::solve(&document, scene, &Tracer::build(scene), settings, &()).expect("light")
}

fn with_levels(levels: u32) -> Settings {
    let patches = PatchSettings { levels: Some(levels), max_edge: None };
    Settings { patches, ..Settings::default() }
}

fn both_sides(pieces: Vec<Piece>) -> Scene {
    scene(pieces.into_iter().map(Piece::two_sided))
}

/// The sides of each triangle that the plan gives patches.
fn lit(scene: &Scene) -> Vec<Sides> {
    let document = Document::open("made-in-memory.obj").expect("a name is enough");
    let plan = Plan::new(&document, scene, &with_levels(0)).expect("a plan");
    plan.patches(&Tracer::build(scene)).expect("patches").sides_of_triangles()
}

const FRONT: Sides = Sides { front: true, back: false };
const BACK: Sides = Sides { front: false, back: true };
const BOTH: Sides = Sides { front: true, back: true };

#[test]
fn a_convex_solid_under_a_uniform_sky_receives_pi_times_its_radiance_everywhere() {
    let sky = Rgb::new(1.0, 2.0, 0.5);
    let cube = both_sides(vec![Piece::new(cube(Vec3::ONE, 2.0)).reflecting(grey(0.25))]);
    let light = solved(&Scene { sky, ..cube }, &with_levels(2));
    let expected = sky.as_dvec3() * PI;
    for (i, irradiance) in light.irradiance().iter().enumerate() {
        let error = (irradiance.as_dvec3() / expected - 1.0).abs().max_element();
        // 256 equal terms: what is left is the rounding of what is kept.
        assert!(error < f32::EPSILON as f64, "patch {i}: {irradiance}");
    }
    let energy = light.figures.energy;
    let balance =
        |power: DVec3, share: f64| (power / (expected * 24.0) - share).abs().max_element();
    assert!(balance(energy.from_sky, 1.0) < 1e-6, "{energy:?}");
    assert!(balance(energy.absorbed, 0.75) < 1e-6, "{energy:?}");
    assert!(balance(energy.escaped, 0.25) < 1e-6, "{energy:?}");
    assert_eq!(energy.emitted, DVec3::ZERO);
}

#[test]
fn half_of_the_sky_is_seen_beside_a_wall_that_hides_the_other_half() {
    // An endless wall hides half of the cosine-weighted sky from what lies at its foot; this one is 400
    // times as wide and high as it is far away.
    let floor = Piece::new(square(Vec3::ZERO, Vec3::Z * 0.1, Vec3::X * 0.1)).reflecting(Vec3::ZERO);
    let wall = square(Vec3::new(-0.05, -40.0, -40.0), Vec3::Y * 80.0, Vec3::Z * 80.0);
    let wall = Piece::new(wall).reflecting(Vec3::ZERO);
    let light = solved(&Scene { sky: Rgb::ONE, ..scene([floor, wall]) }, &with_levels(1));
    let mean = light.irradiance()[..8].iter().map(|h| f64::from(h.x) / PI).sum::<f64>() / 8.0;
    // Shares of 2048 stratified directions: far within five deviations of independent ones.
    assert!((mean - 0.5).abs() < 5.0 * 0.5 / 2048f64.sqrt(), "{mean}");
}

/// A pane, 80 wide, over a floor, 0.1 wide, at a height of 0.05; both black.
fn under_a_pane(pane: Material) -> Scene {
    let floor = Piece::new(square(Vec3::ZERO, Vec3::Z * 0.1, Vec3::X * 0.1)).reflecting(Vec3::ZERO);
    let above = square(Vec3::new(-40.0, 0.05, -40.0), Vec3::Z * 80.0, Vec3::X * 80.0);
    let pane = Piece { triangles: above, material: Material { two_sided: true, ..pane } };
    Scene { sky: Rgb::ONE, ..scene([floor, pane]) }
}

#[test]
fn a_pane_lets_the_share_of_light_through_that_it_does_not_stop() {
    let pane = Material { opacity: 0.25, reflectance: Vec3::ZERO, ..Material::fallback() };
    let light = solved(&under_a_pane(pane), &with_levels(2));
    let mean = light.irradiance()[..32].iter().map(|h| f64::from(h.x) / PI).sum::<f64>() / 32.0;
    // 8192 independent draws that pass with probability 3/4.
    assert!((mean - 0.75).abs() < 5.0 * (0.75f64 * 0.25 / 8192.0).sqrt(), "{mean}");
}

#[test]
fn a_cut_out_lets_light_through_exactly_where_it_is_transparent() {
    // The left half of the picture is clear, the right half solid; the pane shows it once.
    let texels = [[255, 255, 255, 0], [255, 255, 255, 255]];
    let texture = Texture::new("half".into(), [2, 1], texels.into(), [Wrap::Clamp; 2]);
    let map = Map { texture: TextureId(0), transform: Affine2::IDENTITY };
    let pane =
        Material { opacity_map: Some(map), opacity_cutoff: Some(0.5), ..Material::fallback() };
    let scene = under_a_pane(pane);
    let uv = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    // The floor's corners have no coordinates; of the pane's, u runs along z.
    let numbers = vec![[0; 3], [0; 3], [1, 2, 3], [1, 3, 4]];
    let mesh = Mesh { texture: PerCorner::new(uv, numbers), ..Mesh::default() };
    let scene = Scene { mesh: mesh.into(), textures: [texture].into(), ..scene };
    let tracer = Tracer::build(&scene);
    let up = |z: f32| tracer.nearest(&Ray::new(Vec3::new(3.0, -1.0, z), Vec3::Y));
    for z in [-39.0, -20.0, -1.0] {
        assert_eq!(up(z), None, "z = {z}");
        assert!(up(-z).is_some() && tracer.occluded(&Ray::new(Vec3::new(3.0, -1.0, -z), Vec3::Y)));
    }
    let light = solved(&scene, &with_levels(2));
    let energy = light.figures.energy;
    let (arrives, leaves) = (energy.from_sky, energy.absorbed + energy.escaped);
    let on_backs = energy.on_backs.expect("hemispheres know it");
    let error = ((leaves + on_backs) / arrives - 1.0).abs().max_element();
    assert!(error < 1e-2, "{energy:?}");
}

#[test]
fn sides_that_no_light_reaches_are_left_out() {
    let lamp = || Piece::new(square(Vec3::Y * 9.0, Vec3::X, Vec3::Z)).emitting(grey(5.0));
    // A lamp shines down, and its back sees what the floor sends up, past its edges.
    let floor = || Piece::new(square(Vec3::splat(-4.0), Vec3::Z * 9.0, Vec3::X * 9.0));
    let block = Piece::new(cube(Vec3::new(-1.0, 0.0, -1.0), 2.0));
    let sides = lit(&both_sides(vec![block, floor(), lamp()]));
    assert_eq!(sides[..12], [FRONT; 12], "nobody sees the inside of a solid");

    let walls = |triangles: Vec<Triangle>| vec![Piece::new(triangles), lamp()];
    let room = cube(Vec3::splat(-20.0), 40.0);
    assert_eq!(lit(&both_sides(walls(inside_out(room.clone()))))[..12], [FRONT; 12]);
    assert_eq!(lit(&both_sides(walls(room)))[..12], [BACK; 12], "whichever way a room is wound");

    let sheet = both_sides(vec![Piece::new(square(Vec3::ZERO, Vec3::X, Vec3::Y))]);
    assert_eq!(lit(&Scene { sky: Rgb::ONE, ..sheet }), [BOTH; 2]);
}

#[test]
fn a_room_that_is_wound_outwards_has_the_light_of_one_that_is_wound_inwards() {
    let lamp =
        || Piece::new(square(Vec3::new(0.0, 1.5, 0.0), Vec3::X, Vec3::Z)).emitting(grey(3.0));
    let absorbed = |walls: Vec<Triangle>| {
        let room = both_sides(vec![Piece::new(walls).reflecting(grey(0.5)), lamp()]);
        let energy = solved(&room, &with_levels(3)).figures.energy;
        assert!((energy.absorbed / energy.emitted - 1.0).abs().max_element() < 2e-3, "{energy:?}");
        energy.absorbed.x
    };
    let walls = cube(Vec3::splat(-2.0), 4.0);
    let (outwards, inwards) = (absorbed(walls.clone()), absorbed(inside_out(walls)));
    assert!((outwards / inwards - 1.0).abs() < 1e-3, "{outwards} {inwards}");
}

/// Thin strips, needles, fans around a point, and triangles that are nearly a line, from 1 to 10⁻⁹ as wide as
/// long, all over a floor.
fn slivers(count: u32) -> Vec<Triangle> {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    (0..count)
        .map(|k| {
            let place = Vec3::new(random() * 8.0, 0.5 + random(), random() * 8.0);
            let along = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5) * 10.0;
            let aside = Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
            let width = 10f32.powf(-9.0 * random());
            match k % 3 {
                0 => Triangle::new(place, place + along, place + aside * width),
                1 => Triangle::new(place, place + along, place + along * random() + aside * width),
                _ => {
                    let turn = 1e-5 * k as f32;
                    let rim =
                        |angle: f32| Vec3::new(4.0 + 3.0 * angle.cos(), 1.0, 4.0 + angle.sin());
                    Triangle::new(Vec3::new(4.0, 1.0, 4.0), rim(turn), rim(turn + 1e-6 * width))
                }
            }
        })
        .collect()
}

#[test]
fn no_sliver_makes_a_number_that_is_none() {
    let floor = Piece::new(square(Vec3::ZERO, Vec3::Z * 8.0, Vec3::X * 8.0));
    let lamp = Piece::new(square(Vec3::new(3.0, 4.0, 3.0), Vec3::X, Vec3::Z)).emitting(grey(5.0));
    let thin = Piece::new(slivers(3000)).reflecting(grey(0.6));
    let glowing = Piece::new(slivers(30)).emitting(grey(0.1));
    let scene = both_sides(vec![floor, lamp, thin, glowing]);
    for (levels, method, solver) in [
        (0, Method::Hemisphere, Solver::GaussSeidel),
        (2, Method::Hemisphere, Solver::Southwell),
        (0, Method::Pairs, Solver::GaussSeidel),
    ] {
        let mut settings = with_levels(levels);
        settings.light.form_factors = Some(method);
        settings.light.samples = Some(if method == Method::Pairs { 1 } else { 16 });
        settings.light.solver = Some(solver);
        settings.light.direct = Some(4);
        // One sample per pair makes factors of slivers above 1, with which light need not converge.
        settings.light.iterations = (method == Method::Pairs).then_some(3);
        let light = solved(&scene, &settings);
        assert!(light.irradiance().iter().all(|h| h.is_finite()), "{method:?}, {solver:?}");
        let tracer = Tracer::build(light.scene());
        for view in [light.flat(), light.smooth(View::CREASE)] {
            let picture =
                view.draw(&tracer, &light.camera, &Frame::new(64, 48), &()).expect("drawn");
            assert!(picture.pixels.iter().all(|pixel| pixel.is_finite()));
            assert!(picture.pixels.iter().any(|pixel| pixel.x > 0.0));
        }
    }
}
