//! The centre line of a tract: a curve in the torso frame by its arc length.
//!
//! A C² cubic spline through points (`spline.rs`) is cut into *cells* of about half a millimetre, none across a knot.
//! A cell keeps the spline's parameter `u` at its two ends together with `du/ds = 1/|dx/du|`, and the cubic Hermite
//! polynomial between them is `u(s)`; while the line is built, each cell is halved until that polynomial puts its middle
//! where the quadrature of the arc length puts it to 1e-11 m. Cells are found through a table that is uniform in `s`, so
//! [`CentreLine::station`] is O(1). Everything geometric (position, tangent, curvature) is then the spline's own.
//!
//! The frame is rotation minimising: `normal` turns about the tangent as little as a frame can, which unlike Frenet's
//! exists on straight parts and does not flip at inflections. It is transported from the start to every cell, and from
//! there to the station asked for, by the double reflection of Wang, Jüttler, Zheng and Liu, "Computation of rotation
//! minimizing frames", ACM Trans. Graph. 27(1), 2008, whose error is of the fourth order in the cell.
//! `(tangent, normal, binormal)` is right-handed. The normal at the start is the least-turned choice of
//! [`lumenav_core::pose::attitude_from_axis`].
//!
//! Projection finds stationary points of the distance: with `e(s) = x(s) - p`, `f = e·T` and `f' = 1 + e·κN`, a minimum has
//! `f = 0`, `f' > 0` (or lies at an end). Newton's steps are kept inside the bracket known so far.
//!
//! Neglected: a second pair of local extrema inside one cell of half a millimetre.

use crate::error::AnatomyError;
use crate::spline::{Piece, pieces_through};
use lumenav_core::pose::attitude_from_axis;
use nalgebra::{Point3, Vector3};
use std::fmt;

/// Coordinates above this are a mistake of units, m.
const COORDINATE_LIMIT_M: f64 = 100.0;
/// Longest line allowed, m: ten times the longest gut, with room for scaled phantoms.
const LENGTH_LIMIT_M: f64 = 100.0;
/// Most points allowed.
const POINT_LIMIT: usize = 100_000;
/// Neighbours closer than this are the same point, m.
const REPEATED_M: f64 = 1e-6;
/// Length of a cell, m, before the halving that accuracy may ask for.
const CELL_M: f64 = 0.5e-3;
/// Error allowed in the arc length at the middle of a cell, m.
const CELL_ERROR_M: f64 = 1e-11;
/// Halvings of a cell at most.
const DEPTH_LIMIT: u32 = 12;
/// A tangent that turns by more than this (its cosine) within a cell is a cusp.
const CUSP_COSINE: f64 = 0.5;
/// `|dx/du|` below this is a cusp; on a curve that does not turn back it is near 1.
const CUSP_SPEED: f64 = 1e-3;
/// Longest step of a projection, m: keeps it in the basin of its hint.
const STEP_LIMIT_M: f64 = 0.02;
/// Newton's last step in a projection, m. It converges quadratically: what is left is below 1e-12 m, unless f' is tiny.
const LAST_STEP_M: f64 = 1e-8;
/// The same for a quick foot.
const LAST_QUICK_STEP_M: f64 = 2e-6;
/// Cells in one bounding ball of the global search.
const BALL_CELLS: usize = 16;

/// A place on the centre line, torso frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Station {
    /// Arc length from the oral end, m.
    pub arc_length_m: f64,
    /// Position, m.
    pub position_m: Point3<f64>,
    /// Unit tangent, towards the anal end.
    pub tangent: Vector3<f64>,
    /// Unit normal of the rotation-minimising frame.
    pub normal: Vector3<f64>,
    /// `tangent x normal`.
    pub binormal: Vector3<f64>,
    /// Curvature, 1/m.
    pub curvature_per_m: f64,
}

/// A point projected onto the centre line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Arc length of the foot, m.
    pub arc_length_m: f64,
    /// Distance from the point to the foot, m.
    pub distance_m: f64,
    /// The foot.
    pub station: Station,
}

/// The foot of a point in short, torso frame: what changes with the foot's arc length to first order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuickFoot {
    /// Arc length of the foot, m.
    pub arc_length_m: f64,
    /// Position of the foot, m.
    pub position_m: Point3<f64>,
    /// Unit tangent there, towards the anal end.
    pub tangent: Vector3<f64>,
}

/// A stretch of the line inside one piece of the spline.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cell {
    /// Arc length at the start, m.
    start_m: f64,
    /// Length, m.
    length_m: f64,
    /// Index of the spline's piece.
    piece: u32,
    /// Parameter in the piece at the start, and by how much it grows over the cell.
    parameter: [f64; 2],
    /// `du/ds` at start and end.
    rate: [f64; 2],
    /// Position, tangent and normal at the start.
    position: Vector3<f64>,
    tangent: Vector3<f64>,
    normal: Vector3<f64>,
}

impl Cell {
    /// Parameter in the piece at `ahead_m` behind the cell's start.
    #[inline]
    fn parameter_at(&self, ahead_m: f64) -> f64 {
        let x = ahead_m / self.length_m;
        let (m0, m1) = (self.rate[0] * self.length_m, self.rate[1] * self.length_m);
        let rise = self.parameter[1];
        self.parameter[0] + x * (m0 + x * ((3.0 * rise - 2.0 * m0 - m1) + x * (m0 + m1 - 2.0 * rise)))
    }
}

/// Position, tangent and curvature vector (1/m) by arc length.
#[derive(Debug, Clone, Copy)]
struct Local {
    position: Vector3<f64>,
    tangent: Vector3<f64>,
    curvature: Vector3<f64>,
}

/// A ball around consecutive cells.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ball {
    centre: Vector3<f64>,
    radius_m: f64,
    first: usize,
    last: usize,
}

/// A curve by its arc length, with a rotation-minimising frame. Torso frame.
#[derive(Clone, PartialEq)]
pub struct CentreLine {
    pieces: Vec<Piece>,
    cells: Vec<Cell>,
    /// Cell that holds the start of each bucket of equal arc length.
    buckets: Vec<u32>,
    buckets_per_m: f64,
    balls: Vec<Ball>,
    length_m: f64,
    knots_m: Vec<f64>,
}

impl fmt::Debug for CentreLine {
    /// In short: thousands of cells tell nobody anything.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let points = self.knots_m.len();
        formatter
            .debug_struct("CentreLine")
            .field("length_m", &self.length_m)
            .field("points", &points)
            .finish_non_exhaustive()
    }
}

impl CentreLine {
    /// The C² curve through the points (torso frame, m), in order.
    ///
    /// # Errors
    /// [`AnatomyError`]: fewer than two points, points that are not finite, lie more than 100 m away or repeat their
    /// neighbour, a line of more than 100 m, or one that turns back on the spot.
    pub fn through(points_m: &[Point3<f64>]) -> Result<Self, AnatomyError> {
        check(points_m)?;
        let pieces = pieces_through(points_m);
        let cell_m = CELL_M.max(pieces.iter().map(|p| p.width).sum::<f64>() / 100_000.0);
        let mut cells = Vec::new();
        let mut length_m = 0.0;
        let mut knots_m = vec![0.0];
        for (index, piece) in pieces.iter().enumerate() {
            let count = (piece.width / cell_m).ceil().max(1.0);
            let mut builder = CellBuilder { piece, index, length_m, cells: &mut cells };
            for i in 0..count as u32 {
                let at = |i: u32| piece.width * f64::from(i) / count;
                builder.push(at(i), at(i + 1), 0)?;
            }
            length_m = builder.length_m;
            knots_m.push(length_m);
        }
        transport_frames(&pieces, &mut cells);
        let balls = balls(&pieces, &cells);
        let buckets_per_m = cells.len() as f64 / length_m;
        let buckets = buckets(&cells, buckets_per_m);
        Ok(Self { pieces, cells, buckets, buckets_per_m, balls, length_m, knots_m })
    }

    /// Length, m.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Arc lengths of the points the line was drawn through, m: the first is 0, the last the length.
    pub fn knots_m(&self) -> &[f64] {
        &self.knots_m
    }

    /// The place at an arc length, clamped to `[0, length]` (NaN counts as 0).
    #[inline]
    pub fn station(&self, arc_length_m: f64) -> Station {
        let s = self.clamp(arc_length_m);
        let cell = &self.cells[self.cell_at(s)];
        let local = self.local_in(cell, s);
        let normal = transport(&cell.position, &cell.tangent, &cell.normal, &local.position, &local.tangent);
        Station {
            arc_length_m: s,
            position_m: Point3::from(local.position),
            tangent: local.tangent,
            normal,
            binormal: local.tangent.cross(&normal),
            curvature_per_m: local.curvature.norm(),
        }
    }

    /// The local minimum of the distance downhill from the station at `hint_m`. Does not allocate.
    pub fn project_near(&self, point: &Point3<f64>, hint_m: f64) -> Projection {
        let s = self.descend(&point.coords, self.clamp(hint_m), [0.0, self.length_m], LAST_STEP_M).s;
        self.projection(point, s)
    }

    /// The same to some 10 nm, without a frame, and quick where the hint is good: one evaluation of the line where it is off by less than
    /// 2 um.
    pub fn quick_foot(&self, point: &Point3<f64>, hint_m: f64) -> QuickFoot {
        let found = self.descend(&point.coords, self.clamp(hint_m), [0.0, self.length_m], LAST_QUICK_STEP_M);
        // From where the line was evaluated last the rest is within the accuracy promised (x' = T, T' = κN).
        let rest_m = found.s - found.seen_s;
        let seen = if rest_m.abs() <= LAST_QUICK_STEP_M { found.seen } else { self.local(found.s) };
        let rest_m = if rest_m.abs() <= LAST_QUICK_STEP_M { rest_m } else { 0.0 };
        QuickFoot {
            arc_length_m: found.s,
            position_m: Point3::from(seen.position + seen.tangent * rest_m),
            tangent: seen.tangent + seen.curvature * rest_m,
        }
    }

    /// The nearest `count` local minima of the distance over the whole line, nearest first. A minimum at an end of the line
    /// counts.
    pub fn nearest(&self, point: &Point3<f64>, count: usize) -> Vec<Projection> {
        let mut best: Vec<Projection> = Vec::with_capacity(count + 1);
        if count == 0 || !point.coords.iter().all(|c| c.is_finite()) {
            return best;
        }
        let mut order: Vec<(f64, usize)> = self
            .balls
            .iter()
            .enumerate()
            .map(|(i, ball)| (((ball.centre - point.coords).norm() - ball.radius_m).max(0.0), i))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (bound_m, index) in order {
            if best.len() == count && best.last().is_some_and(|last| bound_m > last.distance_m) {
                break;
            }
            self.minima_in(&self.balls[index], point, count, &mut best);
        }
        best
    }

    /// Adds the local minima in a ball's cells to the sorted `best`.
    fn minima_in(&self, ball: &Ball, point: &Point3<f64>, count: usize, best: &mut Vec<Projection>) {
        let slope_at = |s: f64| {
            let local = self.local(s);
            (local.position - point.coords).dot(&local.tangent)
        };
        let mut before = slope_at(self.cells[ball.first].start_m);
        for index in ball.first..=ball.last {
            let cell = &self.cells[index];
            let (low, high) = (cell.start_m, self.end_of(index));
            let after = slope_at(high);
            let foot = if before < 0.0 && after >= 0.0 {
                Some(self.descend(&point.coords, 0.5 * (low + high), [low, high], LAST_STEP_M).s)
            } else if index == 0 && before >= 0.0 {
                Some(0.0)
            } else if index + 1 == self.cells.len() && after < 0.0 {
                Some(self.length_m)
            } else {
                None
            };
            if let Some(s) = foot {
                let found = self.projection(point, s);
                let place = best.partition_point(|other| {
                    (other.distance_m, other.arc_length_m) < (found.distance_m, found.arc_length_m)
                });
                best.insert(place, found);
                best.truncate(count);
            }
            before = after;
        }
    }

    /// The local minimum downhill from `start_m` within `[low_m, high_m]`, once a step is below `last_step_m`.
    #[inline]
    fn descend(
        &self,
        point: &Vector3<f64>,
        start_m: f64,
        [low_m, high_m]: [f64; 2],
        last_step_m: f64,
    ) -> Descent {
        // The minimum lies between `low` (where the distance falls with s, or the end) and `high`.
        let (mut low, mut high) = (low_m, high_m);
        let mut at = Descent { s: start_m, seen_s: start_m, seen: self.local(start_m) };
        let limit = 100 + (self.length_m / STEP_LIMIT_M) as usize;
        for _ in 0..limit {
            let s = at.s;
            if s != at.seen_s {
                (at.seen_s, at.seen) = (s, self.local(s));
            }
            let error = at.seen.position - point;
            let (slope, bend) = (error.dot(&at.seen.tangent), 1.0 + error.dot(&at.seen.curvature));
            if slope > 0.0 {
                high = s;
            } else if slope < 0.0 {
                low = s;
            } else {
                return at;
            }
            let newton = if bend > 1e-3 { -slope / bend } else { -slope.signum() * STEP_LIMIT_M };
            let mut next = s + newton.clamp(-STEP_LIMIT_M, STEP_LIMIT_M);
            if !(low..=high).contains(&next) {
                // Towards an end of the search the end itself is tried, between two slopes of known sign the middle.
                next = if next > high && high == high_m && s != high_m {
                    high_m
                } else if next < low && low == low_m && s != low_m {
                    low_m
                } else {
                    0.5 * (low + high)
                };
            }
            let step = (next - s).abs();
            at.s = next;
            if step < 1e-12 || (step < last_step_m && bend > 0.1) || high - low < 1e-13 {
                break;
            }
        }
        at
    }

    fn projection(&self, point: &Point3<f64>, s: f64) -> Projection {
        let station = self.station(s);
        Projection { arc_length_m: s, distance_m: (station.position_m - point).norm(), station }
    }

    #[inline]
    fn clamp(&self, arc_length_m: f64) -> f64 {
        // `max` and `min` return the other operand for NaN.
        arc_length_m.max(0.0).min(self.length_m)
    }

    /// Index of the cell that holds `s` (clamped).
    #[inline]
    fn cell_at(&self, s: f64) -> usize {
        let bucket = ((s * self.buckets_per_m) as usize).min(self.buckets.len() - 1);
        let mut index = self.buckets[bucket] as usize;
        while index + 1 < self.cells.len() && self.cells[index + 1].start_m <= s {
            index += 1;
        }
        index
    }

    fn end_of(&self, index: usize) -> f64 {
        self.cells.get(index + 1).map_or(self.length_m, |next| next.start_m)
    }

    #[inline]
    fn local(&self, s: f64) -> Local {
        self.local_in(&self.cells[self.cell_at(s)], s)
    }

    #[inline]
    fn local_in(&self, cell: &Cell, s: f64) -> Local {
        local_of(&self.pieces[cell.piece as usize], cell.parameter_at(s - cell.start_m))
    }
}

/// Where a descent has come to.
struct Descent {
    s: f64,
    /// Where the line was evaluated last, and what it was there.
    seen_s: f64,
    seen: Local,
}

#[inline]
fn local_of(piece: &Piece, parameter: f64) -> Local {
    let jet = piece.jet(parameter);
    // The builder has refused lines whose speed comes near zero.
    let inverse = 1.0 / jet.first.norm();
    let tangent = jet.first * inverse;
    let curvature = (jet.second - tangent * tangent.dot(&jet.second)) * (inverse * inverse);
    Local { position: jet.value, tangent, curvature }
}

/// One step of the double reflection: `normal` at `(from, tangent_from)` carried to `(to, tangent_to)`.
#[inline]
fn transport(
    from: &Vector3<f64>,
    tangent_from: &Vector3<f64>,
    normal: &Vector3<f64>,
    to: &Vector3<f64>,
    tangent_to: &Vector3<f64>,
) -> Vector3<f64> {
    let reflect =
        |v: &Vector3<f64>, axis: &Vector3<f64>, squared: f64| v - axis * (2.0 / squared * axis.dot(v));
    let chord = to - from;
    let squared = chord.norm_squared();
    let mut moved = *normal;
    // Below 1e-12 m the two places are one, and the reflections would divide rounding by rounding.
    if squared > 1e-24 {
        let normal_mirrored = reflect(normal, &chord, squared);
        let tangent_mirrored = reflect(tangent_from, &chord, squared);
        let second = tangent_to - tangent_mirrored;
        // Both tangents are near the chord, so the mirrored one is near the reverse: the difference is about 2 long.
        moved = reflect(&normal_mirrored, &second, second.norm_squared());
    }
    let moved = moved - tangent_to * tangent_to.dot(&moved);
    moved / moved.norm()
}

fn check(points: &[Point3<f64>]) -> Result<(), AnatomyError> {
    if points.len() < 2 {
        return Err(AnatomyError::TooFewPoints { count: points.len() });
    }
    if points.len() > POINT_LIMIT {
        return Err(AnatomyError::TooManyPoints { count: points.len(), limit: POINT_LIMIT });
    }
    for (index, point) in points.iter().enumerate() {
        if !point.iter().all(|c| c.is_finite()) {
            return Err(AnatomyError::PointNotFinite { index });
        }
        if point.iter().any(|c| c.abs() > COORDINATE_LIMIT_M) {
            return Err(AnatomyError::PointTooFar { index, limit_m: COORDINATE_LIMIT_M });
        }
    }
    let mut length_m = 0.0;
    for (index, pair) in points.windows(2).enumerate() {
        let distance_m = (pair[1] - pair[0]).norm();
        if distance_m < REPEATED_M {
            return Err(AnatomyError::RepeatedPoint { index: index + 1, distance_m });
        }
        length_m += distance_m;
    }
    if length_m > LENGTH_LIMIT_M {
        return Err(AnatomyError::TooLong { length_m, limit_m: LENGTH_LIMIT_M });
    }
    Ok(())
}

/// Cuts one piece into cells.
struct CellBuilder<'a> {
    piece: &'a Piece,
    index: usize,
    length_m: f64,
    cells: &'a mut Vec<Cell>,
}

impl CellBuilder<'_> {
    /// Adds the stretch of parameters `[from, to]`, halved until its Hermite polynomial is accurate.
    fn push(&mut self, from: f64, to: f64, depth: u32) -> Result<(), AnatomyError> {
        let middle = 0.5 * (from + to);
        let halves = [self.piece.arc(from, middle), self.piece.arc(middle, to)];
        let speeds = [self.piece.speed(from), self.piece.speed(middle), self.piece.speed(to)];
        if speeds.iter().any(|speed| *speed < CUSP_SPEED) {
            return Err(AnatomyError::Cusp { index: self.index + 1 });
        }
        let (start, end) = (local_of(self.piece, from), local_of(self.piece, to));
        let cell = Cell {
            start_m: self.length_m,
            length_m: halves[0] + halves[1],
            piece: self.index as u32,
            parameter: [from, to - from],
            rate: [1.0 / speeds[0], 1.0 / speeds[2]],
            position: start.position,
            tangent: start.tangent,
            normal: Vector3::zeros(),
        };
        let turns_back = start.tangent.dot(&end.tangent) < CUSP_COSINE;
        let error_m = (cell.parameter_at(halves[0]) - middle).abs() * speeds[1];
        if (turns_back || error_m > CELL_ERROR_M) && depth < DEPTH_LIMIT {
            self.push(from, middle, depth + 1)?;
            return self.push(middle, to, depth + 1);
        }
        if turns_back {
            return Err(AnatomyError::Cusp { index: self.index + 1 });
        }
        self.length_m += cell.length_m;
        self.cells.push(cell);
        Ok(())
    }
}

/// Carries the frame from the start of the line to the start of every cell.
fn transport_frames(pieces: &[Piece], cells: &mut [Cell]) {
    let Some(first) = cells.first_mut() else { return };
    first.normal = attitude_from_axis(&first.tangent) * Vector3::y();
    let mut last = *first;
    for cell in cells.iter_mut().skip(1) {
        // The tangent at a knot is taken from the piece before, as `station` would: it is the same to rounding.
        let end = local_of(&pieces[last.piece as usize], last.parameter[0] + last.parameter[1]);
        cell.normal = transport(&last.position, &last.tangent, &last.normal, &end.position, &end.tangent);
        last = *cell;
    }
}

fn balls(pieces: &[Piece], cells: &[Cell]) -> Vec<Ball> {
    (0..cells.len())
        .step_by(BALL_CELLS)
        .map(|first| {
            let last = (first + BALL_CELLS).min(cells.len()) - 1;
            let length_m: f64 = cells[first..=last].iter().map(|cell| cell.length_m).sum();
            let cell = &cells[usize::midpoint(first, last)];
            let centre = pieces[cell.piece as usize].jet(cell.parameter[0]).value;
            // No point of the stretch is further along it than its length.
            Ball { centre, radius_m: length_m, first, last }
        })
        .collect()
}

fn buckets(cells: &[Cell], buckets_per_m: f64) -> Vec<u32> {
    let mut index = 0;
    (0..cells.len())
        .map(|bucket| {
            let s = bucket as f64 / buckets_per_m;
            while index + 1 < cells.len() && cells[index + 1].start_m <= s {
                index += 1;
            }
            // `cell_at` only walks forward: one cell back covers the rounding of s * buckets_per_m.
            index.saturating_sub(1) as u32
        })
        .collect()
}

#[cfg(test)]
mod tests;
