//! A path that grows in pieces.
//!
//! Each row of a path's entity is one piece of a few points that begins where the last one ended; the blueprint shows all
//! rows up to the time cursor. A path of n points thus costs n points, not the n²/2 of a strip that is written anew.
//! The time that is spent at rest belongs to no piece, so that a piece has the speed of what moved.

use lumenav_core::SimTime;

/// Points of a piece.
const POINTS_PER_PIECE: usize = 16;
/// A piece is written after this long even if it is short, ns.
const LONGEST_PIECE_NS: i64 = 1_000_000_000;
/// A point nearer than this to the last one is below what a picture shows, m.
const SMALLEST_STEP_M: f32 = 1e-4;

/// A part of a path.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Piece {
    pub(crate) points_m: Vec<[f32; 3]>,
    /// How long it took from its first to its last point.
    pub(crate) lasts_ns: i64,
}

impl Piece {
    /// Mean speed along it, m/s; 0 where it took no time.
    pub(crate) fn speed_m_s(&self) -> f64 {
        let step = |pair: &[[f32; 3]]| square_m2(pair[0], pair[1]).sqrt();
        let way_m: f32 = self.points_m.windows(2).map(step).sum();
        if self.lasts_ns > 0 { f64::from(way_m) / (1e-9 * self.lasts_ns as f64) } else { 0.0 }
    }
}

fn square_m2(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// The piece that is being collected.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trail {
    points_m: Vec<[f32; 3]>,
    /// When its first point was left, and when its last one was reached.
    since: SimTime,
    reached: SimTime,
}

impl Trail {
    /// Adds a point; a piece that is now complete, with the time at which it is.
    pub(crate) fn push(&mut self, at: SimTime, point_m: [f32; 3], keep_all: bool) -> Option<Piece> {
        if point_m.iter().any(|x| !x.is_finite()) {
            return None;
        }
        if let Some(last) = self.points_m.last() {
            if !keep_all && square_m2(*last, point_m) < SMALLEST_STEP_M.powi(2) {
                if self.points_m.len() == 1 {
                    self.since = at;
                }
                return None;
            }
        } else {
            self.since = at;
        }
        self.points_m.push(point_m);
        self.reached = at;
        let full = self.points_m.len() > POINTS_PER_PIECE;
        let old = self.points_m.len() >= 2 && at - self.since >= LONGEST_PIECE_NS;
        if full || old { self.take(at) } else { None }
    }

    /// The piece so far; the next one begins at its end.
    pub(crate) fn take(&mut self, at: SimTime) -> Option<Piece> {
        if self.points_m.len() < 2 {
            return None;
        }
        let last = self.points_m[self.points_m.len() - 1];
        let lasts_ns = self.reached - self.since;
        self.since = at;
        Some(Piece { points_m: std::mem::replace(&mut self.points_m, vec![last]), lasts_ns })
    }

    /// Ends the path: the next point is not joined to the last one (the track was lost and started anew).
    pub(crate) fn lift(&mut self) -> Option<Piece> {
        let points_m = std::mem::take(&mut self.points_m);
        let lasts_ns = self.reached - self.since;
        (points_m.len() >= 2).then_some(Piece { points_m, lasts_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_form_pieces_join_and_cost_one_point_each_extra() {
        let mut trail = Trail::default();
        let mut pieces = Vec::new();
        for i in 0..1000_i64 {
            pieces.extend(trail.push(SimTime(i * 10_000_000), [i as f32 * 1e-3, 0.0, 0.0], false));
        }
        pieces.extend(trail.lift());
        let points: usize = pieces.iter().map(|piece| piece.points_m.len()).sum();
        assert_eq!(points, 1000 + pieces.len() - 1);
        assert!(pieces.len() <= 64);
        assert!(pieces.windows(2).all(|pair| pair[0].points_m.last() == pair[1].points_m.first()));
    }

    #[test]
    fn closed_form_a_piece_has_the_speed_of_what_moved() {
        let mut trail = Trail::default();
        // A minute at rest, then 2 mm/s in steps of a tenth of a second, in a corner of the room.
        let x_m = |i: i64| 0.3 + 2e-4 * (i - 600).max(0) as f32;
        let pieces: Vec<Piece> = (0..700)
            .filter_map(|i| trail.push(SimTime(i * 100_000_000), [x_m(i), 0.1, 0.2], false))
            .collect();
        assert!(pieces.len() >= 5);
        for piece in pieces {
            assert!((piece.speed_m_s() - 2e-3).abs() < 2e-6, "{piece:?}");
        }
    }

    #[test]
    fn closed_form_a_capsule_at_rest_costs_nothing() {
        let mut trail = Trail::default();
        let pieces =
            (0..1000).filter_map(|i| trail.push(SimTime(i * 100_000_000), [0.1, 0.2, 0.3], false)).count();
        assert_eq!(pieces, 0);
        assert!(trail.lift().is_none());
    }
}
