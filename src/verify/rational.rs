//! A second referee, in fractions and by other formulas, to test the first.
//!
//! Gauss's elimination instead of Cramer's rule, clipping of the line instead of signs of areas, and
//! another library's numbers.

use super::contact::{Contact, Miss, Touch};
use crate::geometry::{Ray, Triangle};
use glam::Vec3;
use num_rational::BigRational;
use num_traits::{One, Zero};
use std::cmp::Ordering;

type Vector = [BigRational; 3];

fn vector(v: Vec3) -> Vector {
    v.to_array().map(|x| BigRational::from_float(x).expect("a finite coordinate"))
}

fn minus(a: &Vector, b: &Vector) -> Vector {
    [0, 1, 2].map(|i| &a[i] - &b[i])
}

/// Where the line of the ray meets the triangle's plane.
pub(super) struct Meeting {
    pub t: BigRational,
    pub u: BigRational,
    pub v: BigRational,
}

/// Solves t·d − u·e₁ − v·e₂ = p₀ − o; `None` if it has no or many solutions.
pub(super) fn meeting(ray: &Ray, triangle: &Triangle) -> Option<Meeting> {
    let [p0, p1, p2] = triangle.p.map(vector);
    let (d, e1, e2) = (vector(ray.direction), minus(&p0, &p1), minus(&p0, &p2));
    let right = minus(&p0, &vector(ray.origin));
    let [t, u, v] = solve(&[d, e1, e2], &right)?;
    Some(Meeting { t, u, v })
}

/// x with Σ xᵢ·columnᵢ = right.
fn solve(columns: &[Vector; 3], right: &Vector) -> Option<Vector> {
    let mut rows: Vec<Vec<BigRational>> = (0..3)
        .map(|i| columns.iter().map(|column| &column[i]).chain([&right[i]]).cloned().collect())
        .collect();
    if eliminate(&mut rows, 3) < 3 {
        return None;
    }
    Some([0, 1, 2].map(|i| rows[i][3].clone()))
}

/// Gauss and Jordan: brings the first `columns` columns to reduced echelon form, returns their rank.
fn eliminate(rows: &mut [Vec<BigRational>], columns: usize) -> usize {
    let mut rank = 0;
    for column in 0..columns {
        let Some(pivot) = (rank..rows.len()).find(|&row| !rows[row][column].is_zero()) else {
            continue;
        };
        rows.swap(rank, pivot);
        let scale = rows[rank][column].clone();
        rows[rank].iter_mut().for_each(|x| *x = &*x / &scale);
        let pivot = rows[rank].clone();
        for (_, row) in rows.iter_mut().enumerate().filter(|(row, _)| *row != rank) {
            let factor = row[column].clone();
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x = &*x - &factor * p);
        }
        rank += 1;
    }
    rank
}

fn rank(vectors: &[&Vector]) -> usize {
    let mut rows: Vec<Vec<BigRational>> = vectors.iter().map(|v| v.to_vec()).collect();
    eliminate(&mut rows, 3)
}

/// The contact that [`examine`](super::contact::examine) must find. All numbers but `t_max` must be
/// finite.
pub(super) fn contact(ray: &Ray, triangle: &Triangle) -> Contact {
    let Some(Meeting { t, u, v }) = meeting(ray, triangle) else { return parallel(ray, triangle) };
    let barycentrics = [BigRational::one() - &u - &v, u, v];
    if barycentrics.iter().any(|x| *x < BigRational::zero()) {
        return Contact::Miss(Miss::Beside);
    }
    match compare(&t, ray.t_min) {
        Ordering::Less => return Contact::Miss(Miss::Before),
        Ordering::Equal => return Contact::Miss(Miss::AtStart),
        Ordering::Greater => {}
    }
    let end = compare(&t, ray.t_max);
    match (end, barycentrics.iter().filter(|x| x.is_zero()).count()) {
        (Ordering::Greater, _) => Contact::Miss(Miss::After),
        (_, 0) => Contact::Hit { at_end: end.is_eq() },
        (_, 1) => Contact::Touching(Touch::Edge),
        _ => Contact::Touching(Touch::Vertex),
    }
}

pub(super) fn compare(t: &BigRational, bound: f32) -> Ordering {
    match BigRational::from_float(bound) {
        Some(bound) => t.cmp(&bound),
        None if bound > 0.0 => Ordering::Less,
        None => Ordering::Greater,
    }
}

fn parallel(ray: &Ray, triangle: &Triangle) -> Contact {
    let [p0, p1, p2] = triangle.p.map(vector);
    let (d, o) = (vector(ray.direction), vector(ray.origin));
    let (e1, e2, s) = (minus(&p1, &p0), minus(&p2, &p0), minus(&o, &p0));
    if rank(&[&d]) == 0 || rank(&[&d, &e1, &e2, &s]) == 3 {
        return Contact::Miss(Miss::Beside);
    }
    if rank(&[&e1, &e2]) < 2 {
        return Contact::Touching(Touch::Degenerate);
    }
    // In the plane: s = a·e₁ + b·e₂ and d = c·e₁ + f·e₂; the normal completes the three columns.
    let normal = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| &e1[i] * &e2[j] - &e1[j] * &e2[i]);
    let columns = [e1, e2, normal];
    let [a, b, _] = solve(&columns, &s).expect("a triangle with area spans its plane");
    let [c, f, _] = solve(&columns, &d).expect("a triangle with area spans its plane");
    let halves = [(BigRational::one() - &a - &b, -(&c + &f)), (a, c), (b, f)];
    if clip(&halves) { Contact::Touching(Touch::Coplanar) } else { Contact::Miss(Miss::Beside) }
}

/// Whether some t satisfies start + t·slope ≥ 0 for all (start, slope).
fn clip(halves: &[(BigRational, BigRational)]) -> bool {
    let (mut from, mut to): (Option<BigRational>, Option<BigRational>) = (None, None);
    for (start, slope) in halves {
        if slope.is_zero() {
            if *start < BigRational::zero() {
                return false;
            }
            continue;
        }
        let t = -start / slope;
        if *slope > BigRational::zero() {
            from = Some(from.map_or(t.clone(), |from| from.max(t)));
        } else {
            to = Some(to.map_or(t.clone(), |to| to.min(t)));
        }
    }
    from.is_none() || to.is_none() || from <= to
}
