//! Relaxation of a chain of points: an elastic rod of given length that keeps clear of itself and of what is fixed.
//!
//! Position-based dynamics (Müller, Heidelberger, Hennix and Ratcliff, J. Vis. Commun. Image R. 18, 2007), one sweep over
//!
//! ```text
//! bending    x_i  += k (x_i-1 + x_i+1 - 2 x_i) / 2
//! length     |x_i+1 - x_i| = l_i                            (both ends move by half the error)
//! clearance  |x_i - x_j|  >= R_i + R_j + gap                (pairs apart along the chain)
//! box        x_i inside the cavity
//! ```
//!
//! No point moves further than a quarter of the clearance between two sweeps, so no stretch passes through another: what was not
//! knotted stays so. Which pairs are apart: more than twice the sum of the radii along the chain, the inner side of a bend
//! that just closes (half a circle of radius `R_i + R_j` over 2 is π/2 of the sum long).

use nalgebra::{Point3, Vector3};

/// Pairs nearer along the chain than this multiple of the sum of their radii are one bend.
const BEND_MULTIPLE: f64 = 2.0;
/// Sweeps between two searches for neighbours, and how much further than contact they are searched, m.
const SEARCH_EVERY: usize = 5;
const SEARCH_MARGIN_M: f64 = 0.012;
/// Longest move of a point in one sweep, m.
const MOVE_LIMIT_M: f64 = 0.002;

/// A chain of points.
pub(super) struct Chain {
    pub(super) points_m: Vec<Point3<f64>>,
    pub(super) radii_m: Vec<f64>,
    /// Whether a point stays where it is.
    pub(super) fixed: Vec<bool>,
    /// Distance that each point keeps to the next, m.
    pub(super) rest_m: Vec<f64>,
    /// Distance between lumina, m.
    pub(super) gap_m: f64,
    /// Bending stiffness, 0 to 1.
    pub(super) stiffness: f64,
}

impl Chain {
    /// Sweeps the chain; `cavity` gives the place inside the cavity for a point (by index and position).
    pub(super) fn relax(&mut self, sweeps: usize, cavity: &dyn Fn(usize, Point3<f64>) -> Point3<f64>) {
        let mut pairs = Vec::new();
        for sweep in 0..sweeps {
            if sweep % SEARCH_EVERY == 0 {
                pairs = self.near_pairs(SEARCH_MARGIN_M);
            }
            let before = self.points_m.clone();
            self.bend();
            self.stretch();
            self.part(&pairs);
            for (i, before) in before.iter().enumerate() {
                if !self.fixed[i] {
                    let moved = cavity(i, self.points_m[i]) - before;
                    let limited = moved * (MOVE_LIMIT_M / moved.norm().max(MOVE_LIMIT_M));
                    self.points_m[i] = before + limited;
                }
            }
        }
    }

    fn bend(&mut self) {
        for i in 1..self.points_m.len() - 1 {
            if !self.fixed[i] {
                let middle = nalgebra::center(&self.points_m[i - 1], &self.points_m[i + 1]);
                let towards = (middle - self.points_m[i]) * self.stiffness;
                self.points_m[i] += towards;
            }
        }
    }

    fn stretch(&mut self) {
        for i in 0..self.rest_m.len() {
            let along = self.points_m[i + 1] - self.points_m[i];
            let length = along.norm().max(f64::MIN_POSITIVE);
            self.correct(i, i + 1, along * (1.0 - self.rest_m[i] / length));
        }
    }

    fn part(&mut self, pairs: &[(usize, usize)]) {
        for &(i, j) in pairs {
            let between = self.points_m[j] - self.points_m[i];
            let distance = between.norm().max(f64::MIN_POSITIVE);
            let short = self.radii_m[i] + self.radii_m[j] + self.gap_m - distance;
            if short > 0.0 {
                self.correct(i, j, between * (-short / distance));
            }
        }
    }

    /// Moves two points towards each other by `error` in all.
    fn correct(&mut self, i: usize, j: usize, error: Vector3<f64>) {
        let (first, second) = match (self.fixed[i], self.fixed[j]) {
            (false, false) => (0.5, 0.5),
            (false, true) => (1.0, 0.0),
            (true, false) => (0.0, 1.0),
            (true, true) => return,
        };
        self.points_m[i] += error * first;
        self.points_m[j] -= error * second;
    }

    /// Pairs apart along the chain whose lumina are less than the gap and this margin from each other.
    fn near_pairs(&self, margin_m: f64) -> Vec<(usize, usize)> {
        let along = self.arc_lengths_m();
        let mut pairs = Vec::new();
        for i in 0..self.points_m.len() {
            for j in i + 1..self.points_m.len() {
                let sum = self.radii_m[i] + self.radii_m[j];
                let reach = sum + self.gap_m + margin_m;
                let near = (self.points_m[j] - self.points_m[i]).norm_squared() < reach * reach;
                if near && !(self.fixed[i] && self.fixed[j]) && along[j] - along[i] > BEND_MULTIPLE * sum {
                    pairs.push((i, j));
                }
            }
        }
        pairs
    }

    fn arc_lengths_m(&self) -> Vec<f64> {
        let mut along = vec![0.0];
        for rest in &self.rest_m {
            along.push(along[along.len() - 1] + rest);
        }
        along
    }
}
