//! From a row of voxels to a smooth centre line with its radii.
//!
//! 1. *Ends* that were found, not given. The row begins in a corner of the lumen. It is cut where it last is within 1.5 clearances of its beginning, which in a
//!    tube with a flat end is about one radius before it, in the middle; at the end the line goes on straight to the wall.
//! 2. *Middle.* At every station rays of 24 directions in the plane across the line measure the wall, and the station moves towards the
//!    centroid of the section `Σ A_k c_k / Σ A_k` over the triangles between neighbouring rays. Rays longer than 1.5 times the
//!    section's median count as that long: in a sharp bend the plane cuts the lumen lengthwise.
//!    Where the wall was drawn double, the section is that of its outer face (`import/outline.rs`), and the station stays in the lumen.
//! 3. *Smoothing.* Each station becomes the value of a parabola fitted to its neighbourhood by least squares with Gaussian
//!    weights of the arc length. Unlike a moving average a parabola does not cut bends short (the error is of fourth order).
//! 4. Stations are set anew every 2 mm in between.
//!
//! The radius is the median of the rays.

use super::bvh::Bvh;
use super::outline::Outline;
use super::surface::unit_or_zero;
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Directions in which the wall is measured.
pub const DIRECTIONS: usize = 24;
/// Distance of stations, m.
pub const STATION_M: f64 = 0.002;
/// Least width of the smoothing's weights, m: surfaces from CT are noisy below about 5 mm.
const SMOOTHING_M: f64 = 0.005;
/// Their width in clearances: a wiggle shorter than the lumen is wide is no bend of it. Between 1 and 1.5 the length of a measured
/// small bowel changes by 1.5 %, its distance from the centre line given by 0.05 mm.
const SMOOTHING_RADII: f64 = 1.5;
/// Rounds of centring and smoothing. The way is on the ridge of the clearance already, so one is enough; where a colon is wider than
/// its bends, sections of many rounds drift along it.
const ROUNDS: usize = 1;
/// Rays count at most as so many medians.
const LONGEST_RAY: f64 = 1.5;
/// A ray goes on so far behind a wall, m: half the distance of corners that are one.
const BEHIND_M: f64 = 5e-6;
/// No lumen is wider, m.
const FURTHEST_WALL_M: f64 = 0.2;

/// A station of the line.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportStation {
    /// Where, surface frame, m.
    pub point_m: Point3<f64>,
    /// Median distance to the wall across the line, m.
    pub radius_m: f64,
    /// Distance to the wall in each of [`DIRECTIONS`] directions across the line, m, from `normal` towards `tangent x normal`.
    pub rays_m: [f64; DIRECTIONS],
    /// The first direction, carried along the line without turning about it.
    pub normal: Vector3<f64>,
}

/// Straight pieces of a way that lie in no lumen: there the line is not centred, and has the section of the last place in a lumen.
#[derive(Debug, Clone, Default)]
pub(super) struct Bridges {
    /// Both ends of each, m.
    pub(super) pieces_m: Vec<[Point3<f64>; 2]>,
    /// The line may run so far beside them, m.
    pub(super) reach_m: f64,
}

impl Bridges {
    fn hold(&self, place: &Point3<f64>) -> bool {
        let away_m = |[a, b]: &[Point3<f64>; 2]| {
            let along = b - a;
            let part =
                (along.dot(&(place - a)) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            (a + along * part - place).norm()
        };
        self.pieces_m.iter().any(|piece| away_m(piece) < self.reach_m)
    }
}

/// The centre line of a row of places through the lumen, m. `has_ends`: whether the row begins, and whether it ends, where the user says.
pub(super) fn centre_line(
    tree: &Bvh,
    outline: Option<&Outline>,
    way: &[Point3<f64>],
    bridges: &Bridges,
    has_ends: [bool; 2],
    mut progress: impl FnMut(f64),
) -> Vec<ImportStation> {
    let way = cut_ends(tree, way, has_ends);
    let mut points = smooth(tree, &resample(&way));
    for round in 0..ROUNDS {
        let centred = centre(tree, outline, bridges, &points);
        let mut smoothed = smooth(tree, &resample(&centred));
        pin(&mut smoothed, &way, has_ends);
        points = keep_inside(tree, smoothed, &points);
        progress(round as f64 / ROUNDS as f64);
    }
    let full = extend(tree, &mut points, has_ends);
    measure(tree, outline, bridges, &points, full)
}

/// Leads the ends of a line that are given straight to their places.
fn pin(points: &mut Vec<Point3<f64>>, way: &[Point3<f64>], has_ends: [bool; 2]) {
    for (end, is_given) in [way.first(), way.last()].into_iter().zip(has_ends) {
        points.reverse();
        if !is_given {
            continue;
        }
        // The end that is now last is the first of `way` in the first round.
        let (Some(end), Some(last)) = (end, points.last().copied()) else { continue };
        let count = ((end - last).norm() / STATION_M).round() as usize;
        points.extend((1..=count).map(|i| last + (end - last) * (i as f64 / count as f64)));
    }
}

/// Cuts the ends that were found after the last place that is within 1.5 clearances of the row's beginning.
fn cut_ends(tree: &Bvh, way: &[Point3<f64>], has_ends: [bool; 2]) -> Vec<Point3<f64>> {
    let is_near =
        |p: &Point3<f64>, end: &Point3<f64>| (p - end).norm() < 1.5 * tree.distance_m(p, FURTHEST_WALL_M);
    let (Some(first), Some(last)) = (way.first(), way.last()) else { return Vec::new() };
    let from = if has_ends[0] { None } else { way.iter().rposition(|p| is_near(p, first)) };
    let to = if has_ends[1] { None } else { way.iter().position(|p| is_near(p, last)) };
    let (from, to) = (from.unwrap_or(0), to.unwrap_or(way.len() - 1));
    if from < to { way[from..=to].to_vec() } else { way.to_vec() }
}

/// Length of a row of chords, m.
pub(super) fn chords_m(points: &[Point3<f64>]) -> f64 {
    points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

/// Points at equal distances of about 2 mm along the chords.
fn resample(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let length = chords_m(points);
    let count = (length / STATION_M).round().max(1.0);
    let step = length / count;
    let mut result = Vec::with_capacity(count as usize + 1);
    let mut walked = 0.0;
    for pair in points.windows(2) {
        let chord = (pair[1] - pair[0]).norm();
        while (result.len() as f64) * step <= walked + chord && (result.len() as f64) < count {
            let part = if chord > 0.0 { (result.len() as f64 * step - walked) / chord } else { 0.0 };
            result.push(pair[0] + (pair[1] - pair[0]) * part);
        }
        walked += chord;
    }
    result.extend(points.last());
    result
}

/// Unit tangents over `reach` stations to both sides.
fn tangents(points: &[Point3<f64>], reach: usize) -> Vec<Vector3<f64>> {
    let last = points.len().saturating_sub(1);
    (0..points.len())
        .map(|i| unit_or_zero(points[(i + reach).min(last)] - points[i.saturating_sub(reach)]))
        .collect()
}

/// A local parabola at each point, by the number of stations from it.
fn smooth(tree: &Bvh, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let value = |i: usize| {
        let width_m = SMOOTHING_M.max(SMOOTHING_RADII * tree.distance_m(&points[i], FURTHEST_WALL_M));
        let reach = (3.0 * width_m / STATION_M).ceil() as usize;
        let (from, to) = (i.saturating_sub(reach), (i + reach).min(points.len() - 1));
        let (mut matrix, mut sums) = (Matrix3::zeros(), [Vector3::zeros(); 3]);
        for (j, point) in points.iter().enumerate().take(to + 1).skip(from) {
            let t = (j as f64 - i as f64) * STATION_M / width_m;
            let weight = (-0.5 * t * t).exp();
            let powers = Vector3::new(1.0, t, t * t);
            matrix += weight * powers * powers.transpose();
            (0..3).for_each(|k| sums[k] += weight * powers[k] * (point - points[i]));
        }
        // Fewer than three points make no parabola; they stay.
        let Some(inverse) = matrix.try_inverse() else { return points[i] };
        points[i] + inverse[(0, 0)] * sums[0] + inverse[(0, 1)] * sums[1] + inverse[(0, 2)] * sums[2]
    };
    (0..points.len()).map(value).collect()
}

/// Two unit vectors across a tangent.
fn across(tangent: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = Vector3::ith(tangent.iamin(), 1.0);
    let normal = unit_or_zero(axis - tangent * tangent.dot(&axis));
    (normal, tangent.cross(&normal))
}

fn rays(tree: &Bvh, from: &Point3<f64>, normal: &Vector3<f64>, binormal: &Vector3<f64>) -> [f64; DIRECTIONS] {
    std::array::from_fn(|k| {
        let direction = direction(k, normal, binormal);
        tree.hit_m(from, &direction, FURTHEST_WALL_M).unwrap_or(FURTHEST_WALL_M)
    })
}

/// Whether there is no wall in half of all directions and more: outside, where waypoints lead the line over a gap.
fn is_open(rays: &[f64; DIRECTIONS]) -> bool {
    2 * rays.iter().filter(|ray_m| **ray_m >= FURTHEST_WALL_M).count() >= DIRECTIONS
}

fn median(rays: &[f64; DIRECTIONS]) -> f64 {
    let mut sorted = *rays;
    sorted.sort_unstable_by(f64::total_cmp);
    0.5 * (sorted[DIRECTIONS / 2 - 1] + sorted[DIRECTIONS / 2])
}

/// Every point moved to the centroid of its section: of the outline where that is all round it, else of the lumen.
fn centre(
    tree: &Bvh,
    outline: Option<&Outline>,
    bridges: &Bridges,
    points: &[Point3<f64>],
) -> Vec<Point3<f64>> {
    let tangents = tangents(points, 2);
    let moved = |i: usize| {
        let (point, tangent) = (&points[i], &tangents[i]);
        if bridges.hold(point) {
            return *point;
        }
        let (normal, binormal) = across(tangent);
        let exits = outline.and_then(|outline| exits(tree, outline, points, i, (&normal, &binormal)));
        if let Some(rays) = exits {
            return short_of_wall(tree, point, centroid(&rays, &normal, &binormal));
        }
        let rays = rays(tree, point, &normal, &binormal);
        if is_open(&rays) { *point } else { point + centroid(&rays, &normal, &binormal) }
    };
    (0..points.len()).map(moved).collect()
}

/// Where the rays from a point of the line leave the outline, if all do. Where one meets the lumen of another loop before, their walls are fused, and
/// half the tissue between counts.
fn exits(
    tree: &Bvh,
    outline: &Outline,
    points: &[Point3<f64>],
    i: usize,
    (normal, binormal): (&Vector3<f64>, &Vector3<f64>),
) -> Option<[f64; DIRECTIONS]> {
    let from = points[i];
    let mut rays = [0.0; DIRECTIONS];
    for (k, ray) in rays.iter_mut().enumerate() {
        let direction = direction(k, normal, binormal);
        *ray = outline.exit_m(&from, &direction, FURTHEST_WALL_M)?;
        let Some(wall_m) = tree.hit_m(&from, &direction, *ray) else { continue };
        let behind = from + direction * (wall_m + BEHIND_M);
        let Some(tissue_m) = tree.hit_m(&behind, &direction, *ray - wall_m) else { continue };
        // Of its own loop it is what lies behind a fold, or across a bend of up to half a circle.
        let there = behind + direction * tissue_m;
        let away = |j: &usize| (points[*j] - there).norm_squared();
        let nearest = (0..points.len()).min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(i);
        if i.abs_diff(nearest) as f64 * STATION_M > FRAC_PI_2 * (wall_m + tissue_m) {
            *ray = wall_m + 0.5 * tissue_m;
        }
    }
    Some(rays)
}

/// One of [`DIRECTIONS`] across the line.
fn direction(k: usize, normal: &Vector3<f64>, binormal: &Vector3<f64>) -> Vector3<f64> {
    let angle = TAU * (k % DIRECTIONS) as f64 / DIRECTIONS as f64;
    normal * angle.cos() + binormal * angle.sin()
}

/// From a point to the centroid of the section that its rays measure.
fn centroid(rays: &[f64; DIRECTIONS], normal: &Vector3<f64>, binormal: &Vector3<f64>) -> Vector3<f64> {
    let longest = LONGEST_RAY * median(rays);
    let (mut area, mut moment) = (0.0, Vector3::zeros());
    let corner = |k: usize| direction(k, normal, binormal) * rays[k % DIRECTIONS].min(longest);
    for k in 0..DIRECTIONS {
        let (a, b) = (corner(k), corner(k + 1));
        let twice = a.cross(&b).norm();
        area += twice;
        moment += twice * (a + b) / 3.0;
    }
    if area > 0.0 { moment / area } else { Vector3::zeros() }
}

/// The place shifted, or half way to the wall of the lumen where that is before it.
fn short_of_wall(tree: &Bvh, point: &Point3<f64>, shift: Vector3<f64>) -> Point3<f64> {
    let length_m = shift.norm();
    let wall_m = tree.hit_m(point, &unit_or_zero(shift), length_m);
    point + unit_or_zero(shift) * wall_m.map_or(length_m, |wall_m| 0.5 * wall_m)
}

/// Where smoothing led the line through the wall, the line from before stands, three stations to both sides.
fn keep_inside(tree: &Bvh, smoothed: Vec<Point3<f64>>, before: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let crossings: Vec<usize> =
        (1..smoothed.len()).filter(|i| is_walled(tree, &smoothed[i - 1], &smoothed[*i])).collect();
    if crossings.is_empty() || before.len() < 2 {
        return smoothed;
    }
    let mut result = smoothed;
    for i in crossings {
        for j in i.saturating_sub(4)..(i + 4).min(result.len()) {
            let nearest =
                before.iter().min_by(|a, b| (*a - result[j]).norm().total_cmp(&(*b - result[j]).norm()));
            result[j] = nearest.copied().unwrap_or(result[j]);
        }
    }
    resample(&result)
}

/// Whether the wall lies between two places.
pub(super) fn is_walled(tree: &Bvh, a: &Point3<f64>, b: &Point3<f64>) -> bool {
    let length = (b - a).norm();
    length > 0.0 && tree.hit_m(a, &((b - a) / length), length).is_some()
}

/// Leads the ends that were found straight on to the wall; the first and the last of the stations that were there before.
fn extend(tree: &Bvh, points: &mut Vec<Point3<f64>>, has_ends: [bool; 2]) -> (usize, usize) {
    let mut added = [0; 2];
    for (count, is_given) in added.iter_mut().zip(has_ends) {
        points.reverse();
        if is_given {
            continue;
        }
        let Some(last) = points.last().copied() else { break };
        let radius = tree.distance_m(&last, FURTHEST_WALL_M);
        let back = ((radius / STATION_M).ceil() as usize).clamp(1, points.len() - 1);
        let direction = unit_or_zero(last - points[points.len() - 1 - back]);
        // Further than twice the radius lies no end of this lumen but more of it.
        let length = tree.hit_m(&last, &direction, 2.0 * radius).unwrap_or(radius);
        *count = (length / STATION_M).round() as usize;
        points.extend((1..=*count).map(|i| last + direction * (length * i as f64 / *count as f64)));
    }
    // The loop ended in the original direction: first the oral end was led on, then the anal one.
    let from = added[0];
    (from, points.len() - 1 - added[1])
}

fn measure(
    tree: &Bvh,
    outline: Option<&Outline>,
    bridges: &Bridges,
    points: &[Point3<f64>],
    (from, to): (usize, usize),
) -> Vec<ImportStation> {
    let tangents = tangents(points, 2);
    let mut normal = tangents.first().map_or_else(Vector3::zeros, |t| across(t).0);
    let mut stations: Vec<ImportStation> = Vec::with_capacity(points.len());
    let mut in_lumen = from;
    // For each station the last one before it with a section of its own.
    let mut section_of = Vec::with_capacity(points.len());
    for (i, (point, tangent)) in points.iter().zip(&tangents).enumerate() {
        normal = unit_or_zero(normal - tangent * tangent.dot(&normal));
        let binormal = tangent.cross(&normal);
        let mut rays_m = rays(tree, point, &normal, &binormal);
        if let Some(outline) = outline {
            // Where the inner face ends, a ray may pass between it and the outer one.
            for (k, ray_m) in rays_m.iter_mut().enumerate() {
                let exit_m = outline.exit_m(point, &direction(k, &normal, &binormal), *ray_m);
                *ray_m = exit_m.unwrap_or(*ray_m);
            }
        }
        stations.push(ImportStation { point_m: *point, radius_m: median(&rays_m), rays_m, normal });
        if (from..=to).contains(&i) && !bridges.hold(point) && !is_open(&rays_m) {
            in_lumen = i;
        }
        section_of.push(in_lumen);
    }
    // Also between the last full section and the end wall the section is that of the last full one.
    for i in 0..points.len() {
        let (rays_m, radius_m) = (stations[section_of[i]].rays_m, stations[section_of[i]].radius_m);
        (stations[i].rays_m, stations[i].radius_m) = (rays_m, radius_m);
    }
    stations
}
