//! Triangles that overlap in one plane: a carpet in a floor, a lamp in a ceiling, a decal on a wall.

use crate::scenes::{Piece, askew, cube, grey, inside_out, scene, square};
use glam::{Affine2, Vec2, Vec3};
use isolux::geometry::{Ray, Triangle, TriangleId};
use isolux::scene::mesh::{Mesh, PerCorner};
use isolux::scene::texture::{Map, Texture, TextureId, Wrap};
use isolux::scene::{Material, Scene};
use isolux::settings::{PatchSettings, Settings};
use isolux::{Document, RayCaster, Solution, Tracer};
use std::f64::consts::PI;

/// A closed room, 4 wide, its floor at y = 0; the pieces lie in its planes.
fn room(pieces: Vec<Piece>, place: fn(Vec<Triangle>) -> Vec<Triangle>) -> Scene {
    let walls = Piece::new(inside_out(cube(Vec3::new(-2.0, 0.0, -2.0), 4.0))).reflecting(grey(0.5));
    scene([walls].into_iter().chain(pieces).map(|piece| {
        Piece { triangles: place(piece.triangles), material: piece.material }.two_sided()
    }))
}

fn carpet() -> Piece {
    Piece::new(square(Vec3::new(-1.1, 0.0, -0.7), Vec3::Z * 1.3, Vec3::X * 1.7))
        .reflecting(grey(0.1))
}

/// In the ceiling, facing down.
fn lamp() -> Piece {
    let triangles = square(Vec3::new(-0.6, 4.0, -0.3), Vec3::X, Vec3::Z);
    Piece::new(triangles).reflecting(Vec3::ZERO).emitting(grey(3.0))
}

fn as_it_is(triangles: Vec<Triangle>) -> Vec<Triangle> {
    triangles
}

fn solved(scene: &Scene) -> Solution {
    let document = Document::open("made-in-memory.obj").expect("a name is enough");
    let patches = PatchSettings { levels: Some(3), max_edge: None };
    let settings = Settings { patches, ..Settings::default() };
    Solution::solve(&document, scene, &Tracer::build(scene), &settings, &()).expect("light")
}

#[test]
fn one_surface_is_seen_all_over_an_overlap() {
    for place in [as_it_is, askew] {
        let scene = room(vec![carpet(), lamp()], place);
        let tracer = Tracer::build(&scene);
        let frame = place(vec![Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Z)])[0];
        let [origin, x, z] = [frame.p[0], frame.p[1] - frame.p[0], frame.p[2] - frame.p[0]];
        let up = z.cross(x);
        let eye = origin + up * 1.5 + x * 0.2;
        let mut counts = [0; 2];
        for k in 0..10_000 {
            // No point lies on the rim of the carpet.
            let (u, v) = ((k % 100) as f32 / 25.0 - 1.987, (k / 100) as f32 / 25.0 - 1.987);
            let on_carpet = -1.1 < u && u < 0.6 && -0.7 < v && v < 0.6;
            let ray = Ray::new(eye, origin + x * u + z * v - eye);
            let hit = tracer.nearest(&ray).expect("the room is closed").triangle;
            let is_carpet = scene.material_of[hit.index()].0 == 1;
            assert_eq!(is_carpet, on_carpet, "at {u}, {v}");
            counts[is_carpet as usize] += 1;
        }
        assert!(counts.iter().all(|&count| count > 1000), "{counts:?}");
    }
}

#[test]
fn power_balances_where_surfaces_overlap() {
    for place in [as_it_is, askew] {
        let scene = room(vec![carpet(), lamp()], place);
        let energy = solved(&scene).figures.energy;
        // π · radiance · area: all of the lamp shines, and nothing of it is behind the ceiling.
        assert!((energy.emitted.x / (3.0 * PI) - 1.0).abs() < 1e-5, "{energy:?}");
        // As in a room without overlaps: `a_room_that_is_wound_outwards_has_the_light_…`.
        assert!(energy.imbalance().abs() < 2e-3, "{energy:?}");
    }
}

#[test]
fn a_smaller_sheet_that_faces_away_hides_no_front() {
    // The bottom of a block that stands on the floor.
    let bottom = square(Vec3::new(-1.0, 0.0, -1.0), Vec3::X, Vec3::Z);
    let scene = room(vec![Piece::new(bottom)], as_it_is);
    let tracer = Tracer::build(&scene);
    let down = Ray::new(Vec3::new(-0.3, 1.0, -0.6), Vec3::NEG_Y);
    let up = Ray::new(Vec3::new(-0.3, -1.0, -0.6), Vec3::Y);
    let material = |ray| scene.material_of[tracer.nearest(ray).unwrap().triangle.index()].0;
    assert_eq!((material(&down), material(&up)), (0, 1));
}

#[test]
fn through_the_clear_part_of_a_decal_the_wall_is_seen() {
    let wall = Piece::new(square(Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0));
    let texels = [[255, 255, 255, 0], [255, 255, 255, 255]];
    let texture = Texture::new("half".into(), [2, 1], texels.into(), [Wrap::Clamp; 2]);
    let map = Map { texture: TextureId(0), transform: Affine2::IDENTITY };
    let material =
        Material { opacity_map: Some(map), opacity_cutoff: Some(0.5), ..Material::fallback() };
    let decal = Piece { triangles: square(Vec3::ONE.with_z(0.0), Vec3::X, Vec3::Y), material };
    let scene = scene([wall, decal]);
    let texture_of = PerCorner::new(
        vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        vec![[0; 3], [0; 3], [1, 2, 3], [1, 3, 4]],
    );
    let mesh = Mesh { texture: texture_of, ..Mesh::default() };
    let scene = Scene { mesh: mesh.into(), textures: [texture].into(), ..scene };
    let tracer = Tracer::build(&scene);
    let seen = |x: f32| {
        let ray = Ray::new(Vec3::new(x, 1.4, 2.0), Vec3::NEG_Z);
        assert!(tracer.occluded(&ray), "there is no hole in the wall");
        tracer.nearest(&ray).expect("the wall").triangle
    };
    for x in [1.1, 1.2, 1.45] {
        assert!(seen(x) < TriangleId(2), "clear at {x}");
        assert!(seen(x + 0.5) >= TriangleId(2), "solid at {}", x + 0.5);
    }
}

#[test]
fn a_decal_in_a_large_fan_is_found_and_neighbours_in_the_fan_do_not_overlap() {
    const COUNT: usize = 50_000;
    for place in [as_it_is, askew] {
        let at = |k: usize| {
            let angle = 2.0 * PI * (k % COUNT) as f64 / COUNT as f64;
            Vec3::new(angle.cos() as f32, 0.0, -angle.sin() as f32)
        };
        let fan = (0..COUNT).map(|k| Triangle::new(Vec3::ZERO, at(k), at(k + 1))).collect();
        let decal = square(Vec3::new(0.31, 0.0, 0.2), Vec3::Z * 0.1, Vec3::X * 0.1);
        let scene = scene([fan, decal].map(|triangles| Piece::new(place(triangles))));
        let overlaps = scene.overlaps();
        let id = |k: usize| TriangleId(k as u32);
        let decal = [id(COUNT), id(COUNT + 1)];
        let mut count = 0;
        for k in 0..COUNT {
            let with = overlaps.with(id(k));
            assert!(with.iter().all(|other| decal.contains(other)), "{k}: {with:?}");
            count += usize::from(!with.is_empty());
        }
        // From the apex the decal is seen between the directions to (0.41, 0.2) and (0.31, 0.3).
        let angle = (0.3f64 / 0.31).atan() - (0.2f64 / 0.41).atan();
        let share = count as f64 / (angle / (2.0 * PI) * COUNT as f64);
        assert!((0.99..1.01).contains(&share), "{count} triangles, {share} of what the angle has");
    }
}
