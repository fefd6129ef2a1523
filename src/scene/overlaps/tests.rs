use super::*;
use crate::geometry::shapes;
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::{Material, MaterialId, Scene};
use glam::{DQuat, DVec3};

/// A parallelogram from `at` along `u` and `v`, facing u × v.
fn sheet(at: DVec3, u: DVec3, v: DVec3) -> [Triangle; 2] {
    let p = [at, at + u, at + u + v, at + v].map(|p| p.as_vec3());
    [Triangle::new(p[0], p[1], p[2]), Triangle::new(p[0], p[2], p[3])]
}

/// A floor of 4 × 4 and a carpet of 2 × 1 in it, both facing up before `turn`, with materials 0 and 1.
fn floor_and_carpet(turn: DQuat) -> Scene {
    let place = |x, z, width, depth| {
        let at = turn * DVec3::new(x, 0.3, z) + DVec3::new(0.7, -1.1, 0.4);
        sheet(at, turn * (DVec3::Z * depth), turn * (DVec3::X * width))
    };
    scene(&[place(0.0, 0.0, 4.0, 4.0), place(1.0, 1.5, 2.0, 1.0)])
}

/// One material per sheet.
fn scene(sheets: &[[Triangle; 2]]) -> Scene {
    let material_of = (0..sheets.len() as u32).flat_map(|m| [MaterialId(m); 2]).collect();
    Scene::new(sheets.concat(), material_of, vec![Material::fallback(); sheets.len()])
}

fn askew() -> DQuat {
    DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.77)
}

#[test]
fn a_carpet_comes_before_the_floor_whatever_its_place_in_space() {
    for turn in [DQuat::IDENTITY, askew()] {
        let scene = floor_and_carpet(turn);
        let overlaps = scene.overlaps();
        let t = [0, 1, 2, 3].map(TriangleId);
        assert_eq!(
            overlaps.with(t[2]),
            [t[0], t[1]],
            "the carpet lies across the floor's diagonal"
        );
        for (floor, carpet) in [(t[0], t[2]), (t[1], t[2]), (t[0], t[3]), (t[1], t[3])] {
            assert!(overlaps.with(floor).contains(&carpet));
            assert!(overlaps.comes_first((carpet, true), (floor, true)));
            assert!(overlaps.comes_first((floor, true), (carpet, false)), "a front before a back");
        }
        let shown = |t: TriangleId| scene.shown_share(t, false, &scene.triangles[t.index()]);
        assert_eq!([shown(t[2]), shown(t[3])], [1.0, 1.0]);
        let floor = 8.0 * (shown(t[0]) + shown(t[1]));
        assert!((floor - 14.0).abs() < 1e-5, "16 - 2 are left of the floor: {floor}");
        let warnings = scene.overlap_warnings();
        assert!(warnings.len() == 1 && warnings[0].text.contains("the smaller surface is seen"));
    }
}

#[test]
fn neighbours_and_what_stands_apart_do_not_overlap() {
    let (o, x, y, z) = (DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
    let apart = [sheet(o, z, x), sheet(x, z, x), sheet(o, y, z), sheet(y * 1e-4, z, x)];
    assert!(scene(&apart).overlaps().is_empty());
    // Folded by half a degree and turned, so that corners round.
    let turn = askew();
    let fan: Vec<_> = (0..300)
        .map(|k| {
            let at = |k: i32| {
                turn * DVec3::new(0.0, (k as f64).to_radians().sin(), (k as f64).to_radians().cos())
            };
            sheet(at(k), at(k + 1) - at(k), turn * DVec3::X)
        })
        .collect();
    assert!(scene(&fan).overlaps().is_empty());
    let ball = shapes::icosphere(5);
    let materials = vec![MaterialId(0); ball.len()];
    assert!(Scene::new(ball, materials, vec![Material::fallback()]).overlaps().is_empty());
}

#[test]
fn a_carpet_on_tiles_comes_before_each_of_them() {
    let tile = |k: i32| {
        // Tiles do not meet corner to corner.
        let (row, column) = (k / 4, k % 4);
        sheet(DVec3::new(column as f64 + 0.3 * row as f64, 0.0, row as f64), DVec3::Z, DVec3::X)
    };
    let mut sheets: Vec<_> = (0..16).map(tile).collect();
    sheets.push(sheet(DVec3::new(1.1, 0.0, 0.2), DVec3::Z * 3.0, DVec3::X * 2.5));
    let mut scene = scene(&sheets);
    scene.material_of = (0..34).map(|t| MaterialId((t >= 32) as u32)).collect();
    let overlaps = scene.overlaps();
    let carpet = TriangleId(32);
    assert!(overlaps.with(carpet).len() > 6);
    for &tile in overlaps.with(carpet) {
        assert!(overlaps.comes_first((carpet, true), (tile, true)), "{tile:?}");
    }
}

/// A floor of 4 × 4, facing up, with material 0, and triangles with material 1.
fn on_a_floor(triangles: Vec<Triangle>) -> Scene {
    let floor = sheet(DVec3::ZERO, DVec3::Z * 4.0, DVec3::X * 4.0);
    let material_of = (0..2 + triangles.len()).map(|t| MaterialId((t >= 2) as u32)).collect();
    let triangles = [floor.to_vec(), triangles].concat();
    Scene::new(triangles, material_of, vec![Material::fallback(); 2])
}

#[test]
fn what_stands_on_a_floor_hides_only_backs_and_nobody_is_warned() {
    let block = shapes::cube(Vec3::new(1.0, 0.0, 1.0), 1.0);
    let is_bottom = |t: &Triangle| t.p.iter().all(|p| p.y == 0.0);
    let bottom = TriangleId(2 + block.iter().position(is_bottom).unwrap() as u32);
    let scene = on_a_floor(block);
    let floor = TriangleId(0);
    let shown = |t: TriangleId, is_back| scene.shown_share(t, is_back, &scene.triangles[t.index()]);
    assert_eq!((shown(floor, false), shown(bottom, false)), (1.0, 1.0));
    assert_eq!(shown(bottom, true), 0.0);
    assert!(shown(floor, true) < 1.0);
    assert!(scene.overlap_warnings().is_empty());
}

#[test]
fn a_carpet_that_faces_down_is_hidden_and_reported() {
    let carpet = sheet(DVec3::X + DVec3::Z, DVec3::X, DVec3::Z);
    let scene = on_a_floor(carpet.to_vec());
    assert_eq!(scene.shown_share(TriangleId(2), true, &scene.triangles[2]), 0.0);
    let warnings = scene.overlap_warnings();
    assert_eq!(warnings.len(), 1);
    let text = &warnings[0].text;
    assert!(text.starts_with("2 triangles") && text.ends_with("reverse their winding"), "{text}");
    // What looks like the floor is not missed.
    let scene = Scene { material_of: vec![MaterialId(0); 4].into(), ..scene };
    assert!(scene.overlap_warnings().is_empty());
}

/// Whether two triangles overlap by the rule alone, with nothing that makes the search quick.
fn overlap_by_the_rule(a: &Triangle, b: &Triangle) -> bool {
    let is_parallel = a.normal().dot(b.normal()).abs() > PARALLEL;
    if !is_parallel || !padded(a).touches(&padded(b)) {
        return false;
    }
    let tolerance = a.ray_offset().max(b.ray_offset()) as f64;
    let n = a.double_area_normal().normalize();
    let axis = flat::axis_of(n);
    let [pa, pb] = [a, b].map(|triangle| flat::seen_along(axis, triangle));
    let common = flat::common(&pa, &pb);
    let apart = |p| flat::height_at(axis, a, p) - flat::height_at(axis, b, p);
    flat::area(&common) > tolerance * flat::perimeter(&common)
        && common.iter().all(|&p| (apart(p) * n[axis]).abs() <= tolerance)
}

/// Triangles in four planes with corners on a coarse grid, so that many share corners, edges and lines; of all
/// sizes, some of them slivers; then copies of some, turned round.
fn scattered(seed: u64) -> Vec<Triangle> {
    let stream = Stream::new(seed, Purpose::Pair, 0, PointSet::Random);
    let triangle = |i: u32| {
        let [plane, size, ..] = stream.point(3 * i);
        let [a, b, c, d] = stream.point(3 * i + 1);
        let [e, f, ..] = stream.point(3 * i + 2);
        let turn = if plane < 0.25 { askew() } else { DQuat::IDENTITY };
        let scale = [1.0, 1.0, 0.25, 8.0][(size * 4.0) as usize];
        let place = |u: f32, v: f32| {
            let [u, v] = [u, v].map(|x| (x as f64 * 5.0).floor() * scale + 0.3);
            let p = [DVec3::new(u, v, 1.0), DVec3::new(1.0, u, v), DVec3::new(u, 1.0, v)];
            (turn * p[(plane * 40.0) as usize % 3]).as_vec3()
        };
        Triangle::new(place(a, b), place(c, d), place(e, f))
    };
    let mut triangles: Vec<Triangle> = (0..700).map(triangle).collect();
    triangles.extend_from_within(..60);
    triangles[730..].iter_mut().for_each(|triangle| triangle.p.swap(0, 2));
    triangles
}

/// Sheets one above the other, nearer and farther than rays can tell, shifted and turned a little; tiles; slivers
/// along a diagonal; squares one in another.
fn adversarial(turn: DQuat) -> Vec<Triangle> {
    let (x, z) = (DVec3::X, DVec3::Z);
    let tolerance = 64.0 * f64::powi(2.0, -24) * 3.0;
    let mut sheets = Vec::new();
    for k in 0..60 {
        let t = k as f64;
        let up = DVec3::Y * tolerance * 0.13 * t;
        sheets.push(sheet(x * (0.07 * t % 2.0) + up, z, x + up * ((k % 3) as f64)));
        sheets.push(sheet(
            DVec3::new((k % 8) as f64 * 0.5, 1.0, (k / 8) as f64 * 0.5),
            z * 0.5,
            x * 0.5,
        ));
        sheets.push(sheet(DVec3::new(t / 60.0, 2.0, -t / 60.0), x + z, (x - z) * (0.9 / 60.0)));
        let inset = DVec3::new(t, 0.0, t) / 60.0;
        sheets.push(sheet(DVec3::Y * 3.0 + inset, z * (2.0 - t / 30.0), x * (2.0 - t / 30.0)));
    }
    let turned = |p: Vec3| (turn * p.as_dvec3()).as_vec3();
    sheets.concat().iter().map(|triangle| Triangle { p: triangle.p.map(turned) }).collect()
}

/// Triangles around a point, from `apex` to a circle about it that lies `below` it.
fn fan(count: usize, apex: DVec3, below: f64, turn: DQuat) -> Vec<Triangle> {
    let at = |k: usize| {
        let angle = std::f64::consts::TAU * (k % count) as f64 / count as f64;
        (turn * (apex + DVec3::new(angle.cos(), -below, angle.sin()))).as_vec3()
    };
    (0..count).map(|k| Triangle::new((turn * apex).as_vec3(), at(k + 1), at(k))).collect()
}

/// Slivers side by side along a diagonal, their ends shifted at random.
fn slivers(count: usize, turn: DQuat) -> Vec<Triangle> {
    let stream = Stream::new(9, Purpose::Pair, 0, PointSet::Random);
    let sliver = |k: usize| {
        let [shift, ..] = stream.point(k as u32);
        let at = |along: f64, k: f64| {
            let (along, across) = (along + shift as f64, k / count as f64);
            (turn * DVec3::new(along + across, 0.2, along - across)).as_vec3()
        };
        let k = k as f64;
        Triangle::new(at(0.0, k), at(1.0, k + 0.5), at(0.0, k + 1.0))
    };
    (0..count).map(sliver).collect()
}

fn decal(turn: DQuat) -> [Triangle; 2] {
    sheet(turn * DVec3::new(0.2, 0.2, 0.1), turn * DVec3::Z * 0.11, turn * DVec3::X * 0.13)
}

#[test]
fn both_searches_find_the_pairs_that_the_rule_names() {
    let mut meshes =
        vec![scattered(1), scattered(2), adversarial(DQuat::IDENTITY), adversarial(askew())];
    for turn in [DQuat::IDENTITY, askew()] {
        let apex = DVec3::Y * 0.2;
        meshes.push([fan(700, apex, 0.0, turn), decal(turn).to_vec()].concat());
        let mut backs = fan(600, apex, 0.5, turn);
        backs.iter_mut().for_each(|triangle| triangle.p.swap(0, 1));
        meshes.push([fan(600, apex, 0.5, turn), backs].concat());
        meshes.push([slivers(500, turn), decal(turn).to_vec()].concat());
    }
    for (mesh, triangles) in meshes.into_iter().enumerate() {
        let triangles: Vec<Triangle> = triangles.into_iter().filter(|t| t.area() > 0.0).collect();
        let count = triangles.len() as u32;
        let triangle = |number: u32| &triangles[number as usize];
        let all = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
        let overlaps = |pair: &(u32, u32)| overlap_by_the_rule(triangle(pair.0), triangle(pair.1));
        let expected: Vec<(u32, u32)> = all.filter(overlaps).collect();
        assert!((5..500_000).contains(&expected.len()), "mesh {mesh}: {}", expected.len());
        let flat = |number: u32| flat_of(triangle(number));
        let overlap = |a: u32, b: u32| overlap(triangle(a), triangle(b));
        let no_limit = [u64::MAX; 2];
        let bounds = |number: u32| padded(triangle(number));
        let by_boxes = near::pairs(triangles.len(), bounds, flat, overlap, no_limit).unwrap();
        assert!(by_boxes == expected, "mesh {mesh}: {} of {}", by_boxes.len(), expected.len());
        let divided = divided::pairs(&triangles, flat, overlap, no_limit).unwrap();
        assert!(divided == expected, "mesh {mesh}: {} of {}", divided.len(), expected.len());
    }
}

#[test]
fn what_shares_no_more_than_edges_takes_few_comparisons_whatever_its_boxes_do() {
    let far = DVec3::new(30.0, 0.0, 20.0);
    for turn in [DQuat::IDENTITY, askew()] {
        for triangles in [
            fan(20_000, DVec3::ZERO, 0.0, turn),
            fan(20_000, DVec3::ZERO, 0.7, turn),
            fan(20_000, far, 0.0, turn),
            slivers(20_000, turn),
        ] {
            let overlaps = Overlaps::find(&triangles, &[MaterialId(0); 20_000]);
            assert!(overlaps.is_empty() && !overlaps.is_given_up);
            let flat = |number: u32| flat_of(&triangles[number as usize]);
            let overlap = |a: u32, b: u32| overlap(&triangles[a as usize], &triangles[b as usize]);
            // Ten thousand per triangle would be each with each.
            let most = [30 * 20_000, 0];
            assert_eq!(divided::pairs(&triangles, flat, overlap, most), Some(Vec::new()));
        }
    }
}

#[test]
fn a_plane_between_the_axes_is_searched_once() {
    let nearly = |k: u32| {
        let shift = 1e-6 * f64::from(k);
        [[0.0, shift], [1.0 + shift, 0.0], [shift, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0))
    };
    let flat: Vec<[DVec3; 3]> = (0..300).map(nearly).collect();
    for normal in [DVec3::Z, DVec3::new(1.0, 0.0, 1.0), DVec3::ONE] {
        let turn = DQuat::from_rotation_arc(DVec3::Z, normal.normalize());
        let turned = |p: [DVec3; 3]| Triangle { p: p.map(|p| (turn * p).as_vec3()) };
        let triangles: Vec<Triangle> = flat.iter().copied().map(turned).collect();
        let flat = |number: u32| flat_of(&triangles[number as usize]);
        let overlap = |a: u32, b: u32| overlap(&triangles[a as usize], &triangles[b as usize]);
        // Each with each, and the pieces themselves.
        let all = 300 * 299 / 2;
        let found = divided::pairs(&triangles, flat, overlap, [2 * all, all]);
        assert_eq!(found.map(|pairs| pairs.len() as u64), Some(all), "{normal}");
    }
}

#[test]
fn the_search_is_given_up_where_all_triangles_lie_across_each_other() {
    let stream = Stream::new(3, Purpose::Pair, 0, PointSet::Random);
    let corner = |k: u32| {
        let [x, z, ..] = stream.point(k);
        Vec3::new(x, 0.0, z)
    };
    let triangle = |k: u32| Triangle::new(corner(3 * k), corner(3 * k + 1), corner(3 * k + 2));
    let triangles: Vec<Triangle> = (0..8000).map(triangle).collect();
    let overlaps = Overlaps::find(&triangles, &[MaterialId(0); 8000]);
    assert!(overlaps.is_given_up && overlaps.is_empty());
    let scene = Scene::new(triangles, vec![MaterialId(0); 8000], vec![Material::fallback()]);
    let warnings = scene.overlap_warnings();
    assert!(warnings.len() == 1 && warnings[0].text.starts_with("too many parallel triangles"));
}
