//! A path that grows in pieces.
//!
//! Each row of a path's entity is one piece of a few points that begins where the last one ended; the blueprint shows all
//! rows up to the time cursor. A path of n points thus costs n points, not the n²/2 of a strip that is written anew.

use lumenav_core::SimTime;

/// Points of a piece.
const POINTS_PER_PIECE: usize = 16;
/// A piece is written after this long even if it is short, ns.
const LONGEST_PIECE_NS: i64 = 1_000_000_000;
/// A point nearer than this to the last one is below what a picture shows, m.
const SMALLEST_STEP_M: f32 = 1e-4;

/// The piece that is being collected.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trail {
    points_m: Vec<[f32; 3]>,
    since: SimTime,
}

impl Trail {
    /// Adds a point; a piece that is now complete, with the time at which it is.
    pub(crate) fn push(&mut self, at: SimTime, point_m: [f32; 3], keep_all: bool) -> Option<Vec<[f32; 3]>> {
        if point_m.iter().any(|x| !x.is_finite()) {
            return None;
        }
        if let Some(last) = self.points_m.last() {
            let square: f32 = last.iter().zip(point_m).map(|(a, b)| (a - b).powi(2)).sum();
            if !keep_all && square < SMALLEST_STEP_M.powi(2) {
                return None;
            }
        } else {
            self.since = at;
        }
        self.points_m.push(point_m);
        let full = self.points_m.len() > POINTS_PER_PIECE;
        let old = self.points_m.len() >= 2 && at - self.since >= LONGEST_PIECE_NS;
        if full || old { self.take(at) } else { None }
    }

    /// The piece so far; the next one begins at its end.
    pub(crate) fn take(&mut self, at: SimTime) -> Option<Vec<[f32; 3]>> {
        if self.points_m.len() < 2 {
            return None;
        }
        let last = self.points_m[self.points_m.len() - 1];
        self.since = at;
        Some(std::mem::replace(&mut self.points_m, vec![last]))
    }

    /// Ends the path: the next point is not joined to the last one (the track was lost and started anew).
    pub(crate) fn lift(&mut self) -> Option<Vec<[f32; 3]>> {
        let points = std::mem::take(&mut self.points_m);
        (points.len() >= 2).then_some(points)
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
        let points: usize = pieces.iter().map(Vec::len).sum();
        assert_eq!(points, 1000 + pieces.len() - 1);
        assert!(pieces.len() <= 64);
        assert!(pieces.windows(2).all(|pair| pair[0].last() == pair[1].first()));
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
