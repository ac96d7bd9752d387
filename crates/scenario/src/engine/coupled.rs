//! The linear system of several bodies in one implicit step: what [`super::system`] is for one.
//!
//! ```text
//! A u⁺ = b        A = diag(A_i) + Σ w J Jᵀ        J = [j_one, -j_other]: the row of one relative velocity
//! ```
//!
//! `A_i` holds a body with its drag and its wall. A is symmetric and positive definite. It is kept as blocks of six by six, each row of blocks from its
//! first that is not empty on: elimination (A = L Lᵀ, block by block) fills nothing to the left of it. In a chain a row has two blocks.

use super::system::{Row, System, Twist};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// A velocity of one body relative to another, or to the gut.
#[derive(Debug, Clone, Copy)]
pub(super) struct Relative {
    pub(super) one: (usize, Row),
    pub(super) other: Option<(usize, Row)>,
}

impl Relative {
    pub(super) fn velocity(&self, twists: &[Twist]) -> f64 {
        let (one, row) = &self.one;
        let velocity = row.velocity(&twists[*one]);
        match &self.other {
            Some((other, row)) => velocity - row.velocity(&twists[*other]),
            None => velocity,
        }
    }

    fn bodies(&self) -> (usize, usize) {
        let one = self.one.0;
        let other = self.other.map_or(one, |other| other.0);
        (one.max(other), one.min(other))
    }
}

/// See the module's text; kept between steps to allocate nothing.
#[derive(Default)]
pub(super) struct Coupled {
    /// First column of blocks of each row, and where it lies in `blocks`.
    first: Vec<usize>,
    start: Vec<usize>,
    blocks: Vec<Matrix6<f64>>,
    right: Vec<Vector6<f64>>,
}

impl Coupled {
    /// Empty, with room for these bodies and relative velocities between them.
    pub(super) fn shape<'a>(&mut self, bodies: usize, rows: impl Iterator<Item = &'a Relative>) {
        self.first.clear();
        self.first.extend(0..bodies);
        for row in rows {
            let (high, low) = row.bodies();
            self.first[high] = self.first[high].min(low);
        }
        self.start.clear();
        let mut count = 0;
        for (row, first) in self.first.iter().enumerate() {
            self.start.push(count);
            count += row + 1 - first;
        }
        self.blocks.clear();
        self.blocks.resize(count, Matrix6::zeros());
        self.right.clear();
        self.right.resize(bodies, Vector6::zeros());
    }

    /// Empties it, in its shape.
    pub(super) fn clear(&mut self) {
        self.blocks.fill(Matrix6::zeros());
        self.right.fill(Vector6::zeros());
    }

    fn at(&self, row: usize, column: usize) -> usize {
        self.start[row] + column - self.first[row]
    }

    /// Adds what one body brings along.
    pub(super) fn add_body(&mut self, body: usize, system: &System) {
        let (matrix, right) = system.whole();
        let at = self.at(body, body);
        self.blocks[at] += matrix;
        self.right[body] += right;
    }

    /// Of a body that takes no part: it stays at rest.
    pub(super) fn add_absent(&mut self, body: usize) {
        let at = self.at(body, body);
        self.blocks[at] = Matrix6::identity();
    }

    /// Adds `weight J Jᵀ` to the matrix and `impulse J` to the right-hand side.
    pub(super) fn add_row(&mut self, relative: &Relative, weight: f64, impulse: f64) {
        let (one, j) = (relative.one.0, relative.one.1.vector());
        let at = self.at(one, one);
        self.blocks[at] += weight * j * j.transpose();
        self.right[one] += impulse * j;
        let Some((other, row)) = &relative.other else { return };
        let k = row.vector();
        let at = self.at(*other, *other);
        self.blocks[at] += weight * k * k.transpose();
        self.right[*other] -= impulse * k;
        let (low, high, low_j, high_j) = if *other < one { (*other, one, k, j) } else { (one, *other, j, k) };
        let at = self.at(high, low);
        self.blocks[at] -= weight * high_j * low_j.transpose();
    }

    /// Adds `stiffness (1 - r̂ r̂ᵀ)` for the angular velocities of a body, if it is above 0; r along `lever`.
    pub(super) fn add_turning(&mut self, body: usize, lever: &Vector3<f64>, stiffness: f64) {
        if stiffness <= 0.0 {
            return;
        }
        let across = Matrix3::identity() - lever * lever.transpose() / lever.norm_squared();
        let at = self.at(body, body);
        let mut turning = self.blocks[at].fixed_view_mut::<3, 3>(3, 3);
        turning += stiffness * across;
    }

    /// Replaces A by L and b by the velocities, which go to `twists`. Whether A was positive definite; otherwise `twists` stay.
    pub(super) fn solve(&mut self, twists: &mut [Twist]) -> bool {
        for row in 0..self.first.len() {
            if !self.eliminate(row) {
                return false;
            }
        }
        for row in 0..self.first.len() {
            for column in self.first[row]..row {
                let known = self.blocks[self.at(row, column)] * self.right[column];
                self.right[row] -= known;
            }
            self.blocks[self.at(row, row)].solve_lower_triangular_mut(&mut self.right[row]);
        }
        for row in (0..self.first.len()).rev() {
            self.blocks[self.at(row, row)].tr_solve_lower_triangular_mut(&mut self.right[row]);
            for column in self.first[row]..row {
                let known = self.blocks[self.at(row, column)].tr_mul(&self.right[row]);
                self.right[column] -= known;
            }
        }
        for (twist, u) in twists.iter_mut().zip(&self.right) {
            *twist = Twist { linear: u.fixed_rows::<3>(0).into(), angular: u.fixed_rows::<3>(3).into() };
        }
        true
    }

    /// L of one row of blocks, those above being done.
    fn eliminate(&mut self, row: usize) -> bool {
        for column in self.first[row]..row {
            let at = self.at(row, column);
            let mut block = self.blocks[at];
            for k in self.first[row].max(self.first[column])..column {
                block -= self.blocks[self.at(row, k)] * self.blocks[self.at(column, k)].transpose();
            }
            let mut turned = block.transpose();
            self.blocks[self.at(column, column)].solve_lower_triangular_mut(&mut turned);
            self.blocks[at] = turned.transpose();
        }
        let at = self.at(row, row);
        let mut pivot = self.blocks[at];
        for column in self.first[row]..row {
            let block = self.blocks[self.at(row, column)];
            pivot -= block * block.transpose();
        }
        pivot.cholesky().map(|found| self.blocks[at] = found.unpack()).is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn cross_solve_equals_nalgebra_on_the_whole_matrix() {
        // Five bodies: a chain, one pair across it, one row to the gut.
        let bodies = 5;
        let row = |t: f64| {
            let direction = Vector3::new(t.sin(), (1.7 * t).cos(), 0.3 - 0.1 * t);
            Row::new(&direction, &Vector3::new(0.01 * t.cos(), -0.008, 0.005 * t))
        };
        let pairs = [(0, Some(1)), (2, Some(1)), (2, Some(3)), (3, Some(4)), (0, Some(3)), (4, None)];
        let rows: Vec<Relative> = pairs
            .iter()
            .enumerate()
            .map(|(k, (one, other))| {
                let t = k as f64;
                Relative { one: (*one, row(t)), other: other.map(|other| (other, row(0.4 + t))) }
            })
            .collect();
        let mut coupled = Coupled::default();
        coupled.shape(bodies, rows.iter());
        let mut whole = DMatrix::<f64>::zeros(6 * bodies, 6 * bodies);
        let mut right = DVector::<f64>::zeros(6 * bodies);
        for body in 0..bodies {
            let t = body as f64;
            let twist =
                Twist { linear: Vector3::new(0.1, -0.2, 0.1 * t), angular: Vector3::new(4.0, -t, 2.0) };
            let mut system = System::new(3.3e-3, 5e-8, 1.6e-7, &Vector3::new(0.6, -0.64, 0.48), &twist);
            system.add_row(&row(7.0 + t), 0.4, 1e-3);
            let (a, b) = system.whole();
            whole.view_mut((6 * body, 6 * body), (6, 6)).copy_from(&a);
            right.rows_mut(6 * body, 6).copy_from(&b);
            coupled.add_body(body, &system);
        }
        for (k, relative) in rows.iter().enumerate() {
            let (weight, impulse) = (0.1 + k as f64, 1e-3 * k as f64);
            let mut j = DVector::<f64>::zeros(6 * bodies);
            j.rows_mut(6 * relative.one.0, 6).copy_from(&relative.one.1.vector());
            if let Some((other, row)) = relative.other {
                j.rows_mut(6 * other, 6).copy_from(&-row.vector());
            }
            whole += weight * &j * j.transpose();
            right += impulse * j;
            coupled.add_row(relative, weight, impulse);
        }
        let expected = whole.lu().solve(&right).unwrap();
        let mut twists = vec![Twist { linear: Vector3::zeros(), angular: Vector3::zeros() }; bodies];
        assert!(coupled.solve(&mut twists));
        for (body, twist) in twists.iter().enumerate() {
            let linear: Vector3<f64> = expected.fixed_rows::<3>(6 * body).into();
            let angular: Vector3<f64> = expected.fixed_rows::<3>(6 * body + 3).into();
            let off = (twist.linear - linear).norm() + (twist.angular - angular).norm();
            assert!(off < 1e-9 * expected.norm(), "{body}: {twist:?} {linear} {angular}");
        }
    }
}
