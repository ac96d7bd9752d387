//! The linear system of one implicit step: six velocities under forces that are linear in them.
//!
//! ```text
//! (M + dt Σ γ_i j_i j_iᵀ) u⁺ = M u + dt f + Σ impulses       u = [v_world, ω_world],  j = [e, r x e]
//! ```
//!
//! `j` is the row that takes `u` to the velocity of a point at lever `r` along the direction `e`. The matrix is symmetric and
//! positive definite as long as every γ is 0 or above, whatever the stiffness: that is what makes the step stable.

use nalgebra::{Matrix6, Vector3, Vector6};

/// Linear and angular velocity in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Twist {
    /// m/s.
    pub(crate) linear: Vector3<f64>,
    /// rad/s.
    pub(crate) angular: Vector3<f64>,
}

impl Twist {
    pub(crate) const REST: Self =
        Self { linear: Vector3::new(0.0, 0.0, 0.0), angular: Vector3::new(0.0, 0.0, 0.0) };
}

/// A row that takes the twist to one velocity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row([f64; 6]);

impl Row {
    #[inline]
    pub(crate) fn new(direction: &Vector3<f64>, lever: &Vector3<f64>) -> Self {
        let t = lever.cross(direction);
        Self([direction.x, direction.y, direction.z, t.x, t.y, t.z])
    }

    pub(crate) fn vector(&self) -> Vector6<f64> {
        Vector6::from(self.0)
    }

    #[inline]
    pub(crate) fn velocity(&self, twist: &Twist) -> f64 {
        let [a, b, c, d, e, f] = self.0;
        let (v, w) = (&twist.linear, &twist.angular);
        a * v.x + b * v.y + c * v.z + d * w.x + e * w.y + f * w.z
    }
}

/// Lower triangle and right-hand side.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct System {
    a: [[f64; 6]; 6],
    b: [f64; 6],
}

impl System {
    /// Mass, inertia `transverse·1 + (axial - transverse) axis axisᵀ` and the momentum of `twist`.
    pub(crate) fn new(
        mass_kg: f64,
        axial_kg_m2: f64,
        transverse_kg_m2: f64,
        axis: &Vector3<f64>,
        twist: &Twist,
    ) -> Self {
        let mut a = [[0.0; 6]; 6];
        let difference = axial_kg_m2 - transverse_kg_m2;
        for i in 0..3 {
            a[i][i] = mass_kg;
            for j in 0..=i {
                a[3 + i][3 + j] = difference * axis[i] * axis[j];
            }
            a[3 + i][3 + i] += transverse_kg_m2;
        }
        let v = twist.linear * mass_kg;
        let w = twist.angular * transverse_kg_m2 + axis * (difference * axis.dot(&twist.angular));
        Self { a, b: [v.x, v.y, v.z, w.x, w.y, w.z] }
    }

    /// Adds a force that does not depend on the velocities.
    pub(crate) fn add_impulse(&mut self, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        for i in 0..3 {
            self.b[i] += linear[i];
            self.b[3 + i] += angular[i];
        }
    }

    /// Adds isotropic damping, times the step: N s/m times s, N m s times s.
    pub(crate) fn add_damping(&mut self, linear: f64, angular: f64) {
        for i in 0..3 {
            self.a[i][i] += linear;
            self.a[3 + i][3 + i] += angular;
        }
    }

    /// Adds `weight·j jᵀ` to the matrix and `impulse·j` to the right-hand side.
    #[inline]
    pub(crate) fn add_row(&mut self, row: &Row, weight: f64, impulse: f64) {
        let j = &row.0;
        for i in 0..6 {
            let scaled = weight * j[i];
            for (a, j) in self.a[i][..=i].iter_mut().zip(j) {
                *a += scaled * j;
            }
            self.b[i] += impulse * j[i];
        }
    }

    /// The whole matrix and the right-hand side.
    pub(crate) fn whole(&self) -> (Matrix6<f64>, Vector6<f64>) {
        (Matrix6::from_fn(|i, k| self.a[i.max(k)][i.min(k)]), Vector6::from(self.b))
    }

    /// The new velocities (LDLᵀ without pivots, which a positive definite matrix does not need).
    #[inline]
    pub(crate) fn solve(mut self) -> Twist {
        for i in 0..6 {
            for k in 0..i {
                let mut sum = self.a[i][k];
                for n in 0..k {
                    sum -= self.a[i][n] * self.a[k][n];
                }
                // Row i holds L·D until its own pivot is made.
                self.a[i][k] = sum;
            }
            let mut pivot = self.a[i][i];
            for k in 0..i {
                let scaled = self.a[i][k];
                self.a[i][k] = scaled / self.a[k][k];
                pivot -= scaled * self.a[i][k];
            }
            self.a[i][i] = pivot;
        }
        for i in 0..6 {
            for k in 0..i {
                self.b[i] -= self.a[i][k] * self.b[k];
            }
        }
        for i in 0..6 {
            self.b[i] /= self.a[i][i];
        }
        for i in (0..6).rev() {
            for k in i + 1..6 {
                self.b[i] -= self.a[k][i] * self.b[k];
            }
        }
        let [a, b, c, d, e, f] = self.b;
        Twist { linear: Vector3::new(a, b, c), angular: Vector3::new(d, e, f) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cross_solve_equals_nalgebra_lu() {
        let axis = Vector3::new(0.6, -0.64, 0.48).normalize();
        let twist = Twist { linear: Vector3::new(0.1, -0.2, 0.3), angular: Vector3::new(4.0, -1.0, 2.0) };
        let mut system = System::new(3.3e-3, 5e-8, 1.6e-7, &axis, &twist);
        for i in 0..6 {
            let t = f64::from(i);
            let direction = Vector3::new(t.sin(), (1.7 * t).cos(), 0.3 - 0.1 * t);
            let row = Row::new(&direction, &(axis * (0.004 * t - 0.01)));
            system.add_row(&row, 0.01 + 0.1 * t, 1e-3 * t);
        }
        system.add_damping(1e-3, 1e-9);
        let (full, right) = system.whole();
        let expected = full.lu().solve(&right).unwrap();
        let got = system.solve();
        let got = [got.linear, got.angular].map(|v| [v.x, v.y, v.z]).concat();
        for i in 0..6 {
            assert!((got[i] - expected[i]).abs() < 1e-9 * expected.norm(), "{i}: {} {}", got[i], expected[i]);
        }
    }
}
