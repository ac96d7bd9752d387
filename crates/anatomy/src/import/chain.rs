//! Parts of a lumen that do not meet, joined where their ends face each other: a bowel that is drawn blind over a stretch (a contraction,
//! content, a wall whose inner face is missing there).
//!
//! The ends of a part are its two places furthest apart. Of an end count the place 1.5 mean radii `r` before it, where the line is in the
//! middle again, and the direction from three radii before it to there. Two ends face each other if these places are at most 5 `r` apart
//! (the ends themselves then 2 `r`, a lumen's width) and both directions point to the other within 60 degrees; the nearest are joined first, each end
//! once. Tubes that lie side by side have their ends side by side too, but these do not look at each other.
//!
//! Where outer faces of walls were removed ([`super::walls`]), a stretch without an inner face stays as a *plug*: a small part, solid tissue in
//! the file. A plug with exactly two ends at it (their counted places within 2.5 `r`) joins these, whichever way they look: the bowel may bend
//! just there.

use super::path::{Part, Pay, furthest_pair, members, search};
use super::surface::unit_or_zero;
use super::voxels::Voxels;
use nalgebra::{Point3, Vector3};

/// Plugs looked at, the largest: smaller parts are bubbles.
const MOST_PLUGS: usize = 16;
/// The counted places of ends at a plug are at most so many radii from it.
const PLUG_RADII: f64 = 2.5;
/// Counted places of two ends may be so many radii apart.
const APART_RADII: f64 = 5.0;
/// The direction of an end is taken between these distances from it, radii.
const BACK_RADII: (f64, f64) = (1.5, 3.0);
/// Directions and the line between the ends agree within 60 degrees.
const FACING_COSINE: f64 = 0.5;

/// Where two parts were joined: straight pieces from the place before the end of the one, by way of the middle of a plug where there is one,
/// to the place behind the beginning of the other.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Joint {
    /// Both ends of each piece, m.
    pub(super) pieces_m: Vec<[Point3<f64>; 2]>,
}

impl Joint {
    /// Length of the pieces together, m.
    pub(super) fn length_m(&self) -> f64 {
        self.pieces_m.iter().map(|[a, b]| (b - a).norm()).sum()
    }

    /// The middle of the plug, or of the one piece, m.
    pub(super) fn middle_m(&self) -> Point3<f64> {
        match self.pieces_m[..] {
            [[a, b]] => nalgebra::center(&a, &b),
            [[_, via], ..] => via,
            [] => Point3::origin(),
        }
    }
}

/// A part with the way between its ends, and what looks out of its beginning and its end.
struct Leg {
    way: Vec<Point3<f64>>,
    /// For the beginning and the end: how many places of the way lie beyond the counted one, the place, the direction.
    ends: [(usize, Point3<f64>, Vector3<f64>); 2],
}

impl Leg {
    fn of(voxels: &Voxels, part: &Part, radius_m: f64) -> Self {
        let (from, to) = furthest_pair(voxels, part.seed, radius_m);
        let reach = search(voxels, from, Some(to), Pay::Middle { radius_m });
        let way: Vec<Point3<f64>> =
            reach.way_to(voxels, to).into_iter().map(|index| voxels.place_m(index)).collect();
        let backwards: Vec<Point3<f64>> = way.iter().rev().copied().collect();
        let ends = [end(&way, radius_m), end(&backwards, radius_m)];
        Self { way, ends }
    }
}

/// The counted place of the beginning of a row, and the direction out of it.
fn end(way: &[Point3<f64>], radius_m: f64) -> (usize, Point3<f64>, Vector3<f64>) {
    let middle = way.len() / 2;
    let at = |distance_m: f64| {
        let (mut walked, mut i) = (0.0, 0);
        while i < middle && walked < distance_m {
            walked += (way[i + 1] - way[i]).norm();
            i += 1;
        }
        i
    };
    let (near, far) = (at(BACK_RADII.0 * radius_m), at(BACK_RADII.1 * radius_m));
    (near, way[near], unit_or_zero(way[near] - way[far]))
}

/// An end: the leg, and 0 for its beginning, 1 for its end.
type End = (usize, usize);

/// What an end is joined to, and by way of which place.
type Partner = Option<(End, Option<Point3<f64>>)>;

/// The way through the first `count` parts, joined end to end, and the joints; `None` where they make no chain. `has_walls`: whether plugs are
/// looked for among the other parts.
pub(super) fn chain(
    voxels: &Voxels,
    parts: &[Part],
    count: usize,
    radius_m: f64,
    has_walls: bool,
) -> Option<(Vec<Point3<f64>>, Vec<Joint>)> {
    let legs: Vec<Leg> = parts[..count].iter().map(|part| Leg::of(voxels, part, radius_m)).collect();
    let mut pairs = facing(&legs, radius_m);
    if has_walls {
        // What holds no ball of the mean radius is a bubble.
        let least = 4.0 / 3.0 * std::f64::consts::PI * (radius_m / voxels.edge_m).powi(3);
        let plugs = parts[count..].iter().take(MOST_PLUGS).take_while(|part| part.voxels as f64 > least);
        pairs.extend(plugs.filter_map(|plug| plugged(voxels, plug, &legs, radius_m)));
    }
    let partner = partners(count, pairs);
    // From the first leg back to a free end, then on to the other.
    let mut first: End = (0, 0);
    while let Some(((leg, side), _)) = partner[first.0][first.1] {
        first = (leg, 1 - side);
    }
    let (mut way, mut joints) = (Vec::new(), Vec::<Joint>::new());
    let mut entered = Some(first);
    while let Some((leg, side)) = entered {
        let leg_way = &legs[leg].way;
        let mut places = leg_way.clone();
        if side == 1 {
            places.reverse();
        }
        let next = partner[leg][1 - side];
        let to = places.len() - if next.is_some() { legs[leg].ends[1 - side].0 } else { 0 };
        let from = if joints.is_empty() { 0 } else { legs[leg].ends[side].0 + 1 };
        way.extend(&places[from..to.max(from)]);
        entered = next.map(|((other, other_side), via_m)| {
            let (from_m, to_m) = (legs[leg].ends[1 - side].1, legs[other].ends[other_side].1);
            let pieces_m = match via_m {
                Some(via_m) => vec![[from_m, via_m], [via_m, to_m]],
                None => vec![[from_m, to_m]],
            };
            let joint = Joint { pieces_m };
            cross(&mut way, &joint, voxels.edge_m);
            joints.push(joint);
            (other, other_side)
        });
    }
    (joints.len() + 1 == count).then_some((way, joints))
}

/// Places on the straight lines of a joint.
fn cross(way: &mut Vec<Point3<f64>>, joint: &Joint, step_m: f64) {
    for pair in &joint.pieces_m {
        let count = ((pair[1] - pair[0]).norm() / step_m).ceil() as usize;
        way.extend((1..=count).map(|i| pair[0] + (pair[1] - pair[0]) * (i as f64 / count as f64)));
    }
}

/// Two ends that may be joined: how far apart, which, by way of what.
type Pair = (f64, End, End, Option<Point3<f64>>);

fn ends(count: usize) -> impl Iterator<Item = End> {
    (0..count).flat_map(|leg| [(leg, 0), (leg, 1)])
}

fn facing(legs: &[Leg], radius_m: f64) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for a in ends(legs.len()) {
        for b in ends(legs.len()).filter(|b| b.0 > a.0) {
            let ((_, p, out), (_, q, back)) = (legs[a.0].ends[a.1], legs[b.0].ends[b.1]);
            let apart_m = (q - p).norm();
            let across = unit_or_zero(q - p);
            let faces = out.dot(&across) > FACING_COSINE && back.dot(&across) < -FACING_COSINE;
            if faces && apart_m <= APART_RADII * radius_m {
                pairs.push((apart_m, a, b, None));
            }
        }
    }
    pairs
}

/// The two ends at a plug, where there are exactly two, of different parts.
fn plugged(voxels: &Voxels, plug: &Part, legs: &[Leg], radius_m: f64) -> Option<Pair> {
    let members = members(voxels, plug.seed);
    let away_m = |end: End| {
        let place = legs[end.0].ends[end.1].1;
        members.iter().map(|index| (voxels.place_m(*index) - place).norm()).fold(f64::INFINITY, f64::min)
    };
    let near: Vec<(End, f64)> = ends(legs.len())
        .map(|end| (end, away_m(end)))
        .filter(|(_, away_m)| *away_m <= PLUG_RADII * radius_m)
        .collect();
    match near[..] {
        [(a, x), (b, y)] if a.0 != b.0 => Some((x + y, a, b, Some(plug.middle_m))),
        _ => None,
    }
}

/// What each end is joined to, the nearest first. No leg is joined to itself, also not by way of others.
fn partners(count: usize, mut pairs: Vec<Pair>) -> Vec<[Partner; 2]> {
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut partner: Vec<[Partner; 2]> = vec![[None; 2]; count];
    let mut row: Vec<usize> = (0..count).collect();
    for (_, a, b, via) in pairs {
        if partner[a.0][a.1].is_some() || partner[b.0][b.1].is_some() || row[a.0] == row[b.0] {
            continue;
        }
        (partner[a.0][a.1], partner[b.0][b.1]) = (Some((b, via)), Some((a, via)));
        let (kept, gone) = (row[a.0], row[b.0]);
        row.iter_mut().filter(|name| **name == gone).for_each(|name| *name = kept);
    }
    partner
}
