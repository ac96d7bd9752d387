//! What real surfaces have, and what is done about it. Every change is a [`Repair`] with place and size.
//!
//! In order: corners closer than 10 um become one (this also takes needles and triangles without area), triangles that are there
//! twice go; normals are made to agree; a shell inside another of similar size is a wall drawn double, and the inner face is the
//! lumen's, a small one is content or a stretch drawn twice; rims that face each other are joined by a strip; other rims up to a lumen's
//! width are closed by the triangulation of least area (Barequet and Sharir, Comput. Aided Geom. Design 12, 1995), which spans a hole and
//! zips a slit; loose specks go. A closure with lumen on both sides is taken out again by [`super`]. A handle is not cut here: where lumina are fused, [`super::contacts`] says so.

use super::bvh::Bvh;
use super::error::place;
use super::surface::{Rim, Surface, Unions};
use super::walls;
use nalgebra::Point3;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::ops::Range;

/// Corners closer than this are one, m: half the last digit of a file in millimetres with two decimals is 5 um.
const WELD_M: f64 = 10e-6;
/// A component with less of the total area is a speck.
const SPECK: f64 = 0.01;
/// A shell inside another with at least this part of its volume is the inner face of a wall drawn double; with less it is content.
const INNER_FACE: f64 = 0.4;
/// Part of a shell's corners that have to lie inside another: the two may cut each other at their rims.
const NESTED: f64 = 0.8;
/// Corners looked at for that.
const SAMPLES: usize = 64;
/// Rims face each other if their middles are closer than this part of the smaller width, and the widths differ by less than this factor.
const FACING_DISTANCE: f64 = 0.6;
const FACING_RATIO: f64 = 1.6;
/// … and their outward directions are opposite within about 60 degrees.
const FACING_COSINE: f64 = -0.5;
/// Rims at about the same place and of about the same size are joined whichever way they look: within this part of their width.
const SAME_RIM: f64 = 0.15;
/// The triangulation of least area costs the cube of the edges; longer rims are closed by a fan.
const LEAST_AREA_EDGES: usize = 300;
/// A shell's corner this part of its mean radius from another shell counts as within it.
const ALONG: f64 = 0.1;
/// A rim up to so many mean radii wide is closed unasked: a cross section is 2 wide, an oblique one of a haustrated colon 4.
const CLOSED_RADII: f64 = 5.0;

/// What was done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum RepairKind {
    /// Corners at almost the same place became one.
    Welded,
    /// Triangles without area went.
    Degenerate,
    /// Triangles that were there twice went.
    Duplicate,
    /// Single triangles were turned.
    Turned,
    /// A component's normals pointed inwards.
    Inverted,
    /// The outer face of a wall drawn double went.
    OuterWall,
    /// The outer face of a wall with a thickness went, where it is no shell of its own.
    ThickWall,
    /// A shell within the lumen went.
    Content,
    /// Two rims were joined by a strip.
    Joined,
    /// A rim was closed.
    Closed,
    /// A rim stays open: on both its sides is lumen.
    LeftOpen,
    /// A rim wider than a lumen was closed because waypoints were given.
    ClosedWide,
    /// A loose speck went.
    Speck,
    /// Two parts of the lumen whose ends face each other were joined.
    Parts,
    /// The inner face of a wall ends before the outer one, and the line goes on within that.
    OuterFace,
    /// The line was led through a wall between two waypoints.
    Passage,
}

/// One change.
#[derive(Debug, Clone, PartialEq)]
pub struct Repair {
    /// What was done.
    pub kind: RepairKind,
    /// Where, surface frame, m.
    pub at_m: Point3<f64>,
    /// How large, m: width of the rim, gap joined, size of the box.
    pub size_m: f64,
    /// Corners, triangles or edges concerned.
    pub count: usize,
}

impl fmt::Display for Repair {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (n, mm) = (self.count, 1e3 * self.size_m);
        let words = match self.kind {
            RepairKind::Welded => format!("{n} corners less than 10 um apart became one"),
            RepairKind::Degenerate => format!("{n} triangles without area removed"),
            RepairKind::Duplicate => format!("{n} triangles that were there twice removed"),
            RepairKind::Turned => format!("{n} triangles turned to agree with their neighbours"),
            RepairKind::Inverted => format!("normals of {n} triangles pointed inwards: all turned"),
            RepairKind::OuterWall => {
                format!("outer face of a double wall removed ({n} triangles, {mm:.1} mm)")
            }
            RepairKind::ThickWall => {
                format!("outer face of a wall {mm:.1} mm thick removed ({n} triangles)")
            }
            RepairKind::Content => {
                format!("shell within or along the lumen removed ({n} triangles, {mm:.1} mm)")
            }
            RepairKind::Joined => format!("two rims facing each other joined over {mm:.2} mm ({n} edges)"),
            RepairKind::Closed => format!("rim of {n} edges, {mm:.1} mm wide, closed"),
            RepairKind::LeftOpen => {
                format!("rim of {n} edges, {mm:.1} mm wide, left open into the lumen around it")
            }
            RepairKind::ClosedWide => format!("wide rim of {n} edges, {mm:.1} mm, closed by a flat fan"),
            RepairKind::Speck => format!("loose speck removed ({n} triangles, {mm:.1} mm)"),
            RepairKind::Parts => {
                format!("the lumen is blind here: two ends facing each other joined over {mm:.1} mm")
            }
            RepairKind::OuterFace => {
                format!(
                    "the inner face of the wall ends here: the line goes on {mm:.1} mm within the outer one"
                )
            }
            RepairKind::Passage => format!("the line was led {mm:.1} mm outside the lumen, through walls"),
        };
        write!(f, "{words}, at {} mm", place(&self.at_m))
    }
}

/// A rim that is too wide to be closed unasked.
pub(super) struct OpenRim {
    pub(super) at_m: Point3<f64>,
    pub(super) edges: usize,
    pub(super) diameter_m: f64,
    pub(super) limit_m: f64,
}

/// What was done to a surface, and what of it is of use later.
pub(super) struct Repaired {
    pub(super) repairs: Vec<Repair>,
    pub(super) closures: Vec<Closure>,
    /// The outer faces of walls drawn double, closed. Without triangles where there were none.
    pub(super) outline: Surface,
}

/// Repairs a surface; `is_guided` closes rims of any width. The rim that stays open is the error.
pub(super) fn repair(surface: &mut Surface, is_guided: bool) -> Result<Repaired, OpenRim> {
    let mut repairs = weld(surface);
    repairs.extend(orient(surface));
    let (nested, mut outline) = unnest(surface);
    repairs.extend(nested);
    let radius_m = mean_radius_m(surface);
    let walls = walls::take_inner_faces(surface, radius_m);
    let wall_m = walls.iter().map(|wall| wall.size_m).fold(0.0, f64::max);
    repairs.extend(walls);
    repairs.extend(join_rims(surface, wall_m));
    repairs.extend(drop_specks(surface));
    let (closed, mut closures) = close_rims(surface, is_guided)?;
    closures.iter_mut().for_each(|closure| closure.repair += repairs.len());
    repairs.extend(closed);
    // Strips and closures may not agree with their neighbours where a rim was twisted; nothing but the volume looks at it.
    surface.orient();
    // The outline is only looked at, so what closes it is told to nobody.
    join_rims(&mut outline, 0.0);
    drop_specks(&mut outline);
    close_rims(&mut outline, true)?;
    outline.orient();
    Ok(Repaired { repairs, closures, outline })
}

/// The triangles that close a rim.
pub(super) struct Closure {
    pub(super) triangles: Range<usize>,
    /// Which repair it is.
    pub(super) repair: usize,
}

/// Mean radius of the lumen as a long tube's, 2 V / A, rims spanned, m.
pub(super) fn mean_radius_m(surface: &Surface) -> f64 {
    let closed = surface.spanned();
    let area = closed.area_m2();
    if area > 0.0 { 2.0 * closed.volume_m3().abs() / area } else { 0.0 }
}

/// Makes one corner of those at the same place. Equal corners of an STL are no repair, almost equal ones are.
pub(super) fn weld(surface: &mut Surface) -> Vec<Repair> {
    merge_equal(surface);
    let mut repairs = Vec::new();
    let near = near_corners(surface);
    let mut sets = Unions::new(surface.vertices.len());
    near.iter().for_each(|(a, b)| sets.join(*a, *b));
    for triangle in &mut surface.triangles {
        *triangle = triangle.map(|v| sets.find(v));
    }
    if let Some((first, _)) = near.first() {
        let at_m = surface.vertices[*first as usize];
        repairs.push(Repair { kind: RepairKind::Welded, at_m, size_m: WELD_M, count: near.len() });
    }
    let has_area = |s: &Surface, t: usize| {
        let [a, b, c] = s.triangles[t];
        a != b && b != c && c != a
    };
    repairs.extend(drop_triangles(surface, RepairKind::Degenerate, has_area));
    let mut seen = BTreeMap::new();
    for (t, corners) in surface.triangles.iter().enumerate() {
        let mut sorted = *corners;
        sorted.sort_unstable();
        seen.entry(sorted).or_insert(t);
    }
    let is_first = |s: &Surface, t: usize| {
        let mut sorted = s.triangles[t];
        sorted.sort_unstable();
        seen.get(&sorted) == Some(&t)
    };
    repairs.extend(drop_triangles(surface, RepairKind::Duplicate, is_first));
    repairs
}

fn merge_equal(surface: &mut Surface) {
    let mut index_of: HashMap<[u64; 3], u32> = HashMap::with_capacity(surface.vertices.len());
    let mut vertices = Vec::new();
    for triangle in &mut surface.triangles {
        *triangle = triangle.map(|v| {
            let point = surface.vertices[v as usize];
            // Adding zero makes -0 and 0 the same.
            *index_of.entry([point.x, point.y, point.z].map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                vertices.push(point);
                vertices.len() as u32 - 1
            })
        });
    }
    surface.vertices = vertices;
}

/// Pairs closer than the welding distance: ends of one edge, or corners of rims.
fn near_corners(surface: &Surface) -> Vec<(u32, u32)> {
    let at = |v: u32| surface.vertices[v as usize];
    let mut near = Vec::new();
    let mut rim: Vec<u32> = Vec::new();
    for edge in surface.edge_uses().chunk_by(|a, b| (a.low, a.high) == (b.low, b.high)) {
        let (low, high) = (edge[0].low, edge[0].high);
        if low != high && (at(low) - at(high)).norm() < WELD_M {
            near.push((low, high));
        }
        if edge.len() % 2 == 1 {
            rim.extend([low, high]);
        }
    }
    rim.sort_unstable_by(|a, b| at(*a).x.total_cmp(&at(*b).x).then(a.cmp(b)));
    rim.dedup();
    for (i, a) in rim.iter().enumerate() {
        for b in rim[i + 1..].iter().take_while(|b| at(**b).x - at(*a).x < WELD_M) {
            if (at(*a) - at(*b)).norm() < WELD_M {
                near.push((*a, *b));
            }
        }
    }
    near
}

/// Keeps the triangles that `keep` says, and tells of the others.
fn drop_triangles(
    surface: &mut Surface,
    kind: RepairKind,
    keep: impl Fn(&Surface, usize) -> bool,
) -> Option<Repair> {
    let gone: Vec<usize> = (0..surface.triangles.len()).filter(|t| !keep(surface, *t)).collect();
    let first = *gone.first()?;
    let repair = Repair { kind, at_m: surface.centroid(first), size_m: WELD_M, count: gone.len() };
    let mut gone = gone.into_iter().peekable();
    let mut t = 0;
    surface.triangles.retain(|_| {
        let is_gone = gone.next_if_eq(&t).is_some();
        t += 1;
        !is_gone
    });
    Some(repair)
}

fn orient(surface: &mut Surface) -> Vec<Repair> {
    let (turned, whole) = surface.orient();
    let mut repairs = Vec::new();
    if let Some(first) = turned.first() {
        let at_m = surface.centroid(*first as usize);
        repairs.push(Repair { kind: RepairKind::Turned, at_m, size_m: 0.0, count: turned.len() });
    }
    for (first, count) in whole {
        let at_m = surface.centroid(first as usize);
        repairs.push(Repair { kind: RepairKind::Inverted, at_m, size_m: 0.0, count });
    }
    repairs
}

/// A component on its own.
struct Shell {
    closed: Surface,
    volume_m3: f64,
    tree: Bvh,
    samples: Vec<Point3<f64>>,
    triangles: usize,
}

fn shells(surface: &Surface) -> (Vec<Shell>, Vec<u32>) {
    let (count, labels) = surface.components();
    let shell = |label: usize| {
        let part = surface.part(|t| labels[t] as usize == label);
        let step = part.triangles.len().div_ceil(SAMPLES);
        let samples = (0..part.triangles.len()).step_by(step).map(|t| part.centroid(t)).collect();
        let closed = part.spanned();
        let volume_m3 = closed.volume_m3();
        Shell { tree: Bvh::new(&closed), closed, volume_m3, samples, triangles: part.triangles.len() }
    };
    ((0..count).map(shell).collect(), labels)
}

fn repair_of(kind: RepairKind, shell: &Shell) -> Repair {
    let (low, high) = shell.closed.bounds();
    let at_m = nalgebra::center(&low, &high);
    Repair { kind, at_m, size_m: (high - low).max(), count: shell.triangles }
}

/// Most components looked at: a surface with more of them is dust.
const MAX_SHELLS: usize = 200;

/// Removes the outer of two nested shells of similar size, which it returns, and small shells inside others.
fn unnest(surface: &mut Surface) -> (Vec<Repair>, Surface) {
    let (count, _) = surface.components();
    if !(2..=MAX_SHELLS).contains(&count) {
        return (Vec::new(), surface.part(|_| false));
    }
    let (shells, labels) = shells(surface);
    let mut repairs = Vec::new();
    let mut is_gone = vec![false; shells.len()];
    let mut is_outer = vec![false; shells.len()];
    // Content first, while the outer faces are there to tell it.
    for kind in [RepairKind::Content, RepairKind::OuterWall] {
        for (outer, inner) in
            (0..shells.len()).flat_map(|outer| (0..shells.len()).map(move |inner| (outer, inner)))
        {
            let is_face = shells[inner].volume_m3 >= INNER_FACE * shells[outer].volume_m3;
            let is_asked = is_face == (kind == RepairKind::OuterWall);
            let is_there = outer != inner && !is_gone[outer] && !is_gone[inner];
            if !(is_asked && is_there && contains(&shells[outer], &shells[inner])) {
                continue;
            }
            let gone = if is_face { outer } else { inner };
            is_gone[gone] = true;
            is_outer[gone] = is_face;
            repairs.push(repair_of(kind, &shells[gone]));
        }
    }
    let outline = surface.part(|t| is_outer[labels[t] as usize]);
    *surface = surface.part(|t| !is_gone[labels[t] as usize]);
    (repairs, outline)
}

fn contains(outer: &Shell, inner: &Shell) -> bool {
    if inner.volume_m3 >= outer.volume_m3 {
        return false;
    }
    let along_m = ALONG * 2.0 * inner.volume_m3 / inner.closed.area_m2();
    let (low, high) = outer.closed.bounds();
    let is_in_box = |p: &Point3<f64>| (0..3).all(|i| p[i] >= low[i] - along_m && p[i] <= high[i] + along_m);
    let needed = (NESTED * inner.samples.len() as f64).ceil() as usize;
    if inner.samples.iter().filter(|p| is_in_box(p)).count() < needed {
        return false;
    }
    let is_within = |p: &&Point3<f64>| {
        outer.tree.distance_m(p, along_m) < along_m || winding_number(&outer.closed, p).abs() > 0.5
    };
    inner.samples.iter().filter(is_within).count() >= needed
}

/// Solid angle of a surface as seen from a place, in whole spheres (van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983).
pub(super) fn winding_number(surface: &Surface, place: &Point3<f64>) -> f64 {
    let angle = |t: usize| {
        let [a, b, c] = surface.corners(t).map(|p| p - place);
        let (x, y, z) = (a.norm(), b.norm(), c.norm());
        let below = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    (0..surface.triangles.len()).map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}

/// How badly two rims fit, m; `None` where they do not face each other. `wall_m`: thickness of walls whose outer face was removed; where
/// a stretch with a wall meets one without, the rims differ by twice that.
fn misfit(a: &Rim, b: &Rim, wall_m: f64) -> Option<f64> {
    let distance = (a.centre - b.centre).norm();
    let (small, large) = (a.diameter_m.min(b.diameter_m), a.diameter_m.max(b.diameter_m));
    let is_same = distance < SAME_RIM * small && large < (1.0 + SAME_RIM) * small;
    let is_facing = is_same || a.outward.dot(&b.outward) < FACING_COSINE;
    let fits = distance < FACING_DISTANCE * small && large - 2.0 * wall_m < FACING_RATIO * small;
    (is_facing && fits).then_some(distance + (large - small))
}

fn join_rims(surface: &mut Surface, wall_m: f64) -> Vec<Repair> {
    let rims = surface.rims();
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for a in 0..rims.len() {
        for b in a + 1..rims.len() {
            pairs.extend(misfit(&rims[a], &rims[b], wall_m).map(|m| (m, a, b)));
        }
    }
    pairs.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut is_joined = vec![false; rims.len()];
    let mut repairs = Vec::new();
    for (_, a, b) in pairs {
        if is_joined[a] || is_joined[b] {
            continue;
        }
        (is_joined[a], is_joined[b]) = (true, true);
        zip(surface, &rims[a], &rims[b]);
        repairs.push(Repair {
            kind: RepairKind::Joined,
            at_m: nalgebra::center(&rims[a].centre, &rims[b].centre),
            size_m: (rims[a].centre - rims[b].centre).norm(),
            count: rims[a].vertices.len() + rims[b].vertices.len(),
        });
    }
    repairs
}

/// A strip of triangles between two rims, both walked at the same fraction of their corners.
fn zip(surface: &mut Surface, a: &Rim, b: &Rim) {
    let p = &a.vertices;
    let mut q = b.vertices.clone();
    if a.normal.dot(&b.normal) < 0.0 {
        q.reverse();
    }
    let at = |v: u32| surface.vertices[v as usize];
    // Relative to the middles, so that a sideways shift of the rims does not twist the strip.
    let apart = |i: &usize| ((at(p[0]) - a.centre) - (at(q[*i]) - b.centre)).norm();
    let start = (0..q.len()).min_by(|x, y| apart(x).total_cmp(&apart(y))).unwrap_or(0);
    q.rotate_left(start);
    let (n, m) = (p.len(), q.len());
    let (mut i, mut j) = (0, 0);
    while i < n || j < m {
        let (here, there) = (p[i % n], q[j % m]);
        if j == m || (i < n && (i + 1) * m <= (j + 1) * n) {
            surface.triangles.push([p[(i + 1) % n], here, there]);
            i += 1;
        } else {
            surface.triangles.push([here, there, q[(j + 1) % m]]);
            j += 1;
        }
    }
}

fn close_rims(surface: &mut Surface, is_guided: bool) -> Result<(Vec<Repair>, Vec<Closure>), OpenRim> {
    let limit_m = CLOSED_RADII * mean_radius_m(surface);
    let (mut repairs, mut closures) = (Vec::new(), Vec::new());
    for rim in surface.rims() {
        let is_wide = rim.diameter_m > limit_m;
        let (at_m, edges, diameter_m) = (rim.centre, rim.vertices.len(), rim.diameter_m);
        if is_wide && !is_guided {
            return Err(OpenRim { at_m, edges, diameter_m, limit_m });
        }
        let before = surface.triangles.len();
        if edges <= LEAST_AREA_EDGES {
            close_by_least_area(surface, &rim);
        } else {
            surface.span(&rim);
        }
        closures.push(Closure { triangles: before..surface.triangles.len(), repair: repairs.len() });
        let kind = if is_wide { RepairKind::ClosedWide } else { RepairKind::Closed };
        repairs.push(Repair { kind, at_m, size_m: diameter_m, count: edges });
    }
    Ok((repairs, closures))
}

/// Least area `W` of the polygon from corner `i` to `j`: `W_ij = min over k of W_ik + W_kj + area(i, k, j)`.
fn close_by_least_area(surface: &mut Surface, rim: &Rim) {
    let n = rim.vertices.len();
    let at = |i: usize| surface.vertices[rim.vertices[i] as usize];
    let (mut least, mut through) = (vec![0.0; n * n], vec![0; n * n]);
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            let area = |k: usize| {
                least[i * n + k] + least[k * n + j] + (at(k) - at(i)).cross(&(at(j) - at(i))).norm()
            };
            let best = (i + 1..j).min_by(|a, b| area(*a).total_cmp(&area(*b))).unwrap_or(i + 1);
            (least[i * n + j], through[i * n + j]) = (area(best), best);
        }
    }
    let mut waiting = vec![(0, n - 1)];
    while let Some((i, j)) = waiting.pop() {
        if j >= i + 2 {
            let k = through[i * n + j];
            surface.triangles.push([j, k, i].map(|c| rim.vertices[c]));
            waiting.extend([(i, k), (k, j)]);
        }
    }
}

fn drop_specks(surface: &mut Surface) -> Vec<Repair> {
    let (count, labels) = surface.components();
    if count < 2 {
        return Vec::new();
    }
    let mut areas = vec![(0.0, 0_usize, 0_usize); count];
    for (t, label) in labels.iter().enumerate() {
        let (area, triangles, first) = &mut areas[*label as usize];
        *area += surface.vector_area(t).norm();
        *first = if *triangles == 0 { t } else { *first };
        *triangles += 1;
    }
    let total: f64 = areas.iter().map(|(area, ..)| area).sum();
    let is_speck = |label: u32| areas[label as usize].0 < SPECK * total;
    let repairs = areas.iter().filter(|(area, ..)| *area < SPECK * total).map(|(area, count, first)| {
        Repair { kind: RepairKind::Speck, at_m: surface.centroid(*first), size_m: area.sqrt(), count: *count }
    });
    let repairs = repairs.collect();
    *surface = surface.part(|t| !is_speck(labels[t]));
    repairs
}
