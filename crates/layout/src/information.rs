//! From an information matrix to the Cramér-Rao bound.
//!
//! ```text
//! C = I⁻¹        C = D⁻¹ (L Lᵀ)⁻¹ D⁻¹     with D = diag(√I_ii) and L the Cholesky root of D⁻¹ I D⁻¹
//! ```
//!
//! Parameters are scaled to a unit diagonal first: metres, radians and teslas differ by orders of magnitude. What is unknown beside
//! the pose is inverted with it and then left out, which is the Schur complement; where nothing tells all of it, a generalised inverse
//! takes the place of its block ([`lumenav_core::linear`]).

use lumenav_core::LayoutParameters;
use lumenav_core::layout::packed_len;
use lumenav_core::linear::generalised_inverse;
use nalgebra::{DMatrix, Matrix3};

/// Largest number of parameters.
pub const MOST_PARAMETERS: usize = 12;
/// Of a scaled information, a pivot below this is rounding: some direction is not seen.
const LEAST_PIVOT: f64 = 1e-12;

/// How many parameters there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Position and angles: without them there is no bound.
    pub pose: usize,
    /// With what else is unknown.
    pub all: usize,
}

impl From<&LayoutParameters> for Size {
    fn from(parameters: &LayoutParameters) -> Self {
        Self { pose: 3 + parameters.angles, all: parameters.len() }
    }
}

/// All of them have to be seen.
impl From<usize> for Size {
    fn from(all: usize) -> Self {
        Self { pose: all, all }
    }
}

/// The inverse of one information.
#[derive(Clone, Debug)]
pub struct Inverse {
    dimension: usize,
    /// Full symmetric matrix, row by row.
    values: [f64; MOST_PARAMETERS * MOST_PARAMETERS],
}

impl Inverse {
    /// Of a packed lower triangle; `None` where some of position and angles is not seen.
    pub fn of(information: &[f64], size: impl Into<Size>) -> Option<Self> {
        let size = size.into();
        let beside = || (size.all > size.pose).then(|| Self::beside_unseen(information, size)).flatten();
        Self::of_regular(information, size.all).or_else(beside)
    }

    /// Where nothing tells all of what is unknown beside the pose: with `I_pp' = I_pp - I_pn G I_np`
    ///
    /// ```text
    /// C_pp = I_pp'⁻¹      C_pn = -C_pp I_pn G      C_nn = G + G I_np C_pp I_pn G
    /// ```
    fn beside_unseen(information: &[f64], size: Size) -> Option<Self> {
        const N: usize = MOST_PARAMETERS;
        let (p, n) = (size.pose, size.all - size.pose);
        let at = |i: usize, j: usize| information[packed_len(i.max(j)) + i.min(j)];
        let (g, _) = generalised_inverse(&DMatrix::from_fn(n, n, |i, j| at(p + i, p + j)));
        let mixed = DMatrix::from_fn(p, n, |i, j| at(i, p + j));
        let taken = &mixed * &g;
        let left: Vec<f64> = (0..p)
            .flat_map(|i| (0..=i).map(move |j| (i, j)))
            .map(|(i, j)| at(i, j) - taken.row(i).dot(&mixed.row(j)))
            .collect();
        let mut found = Self::of_regular(&left, p)?;
        let own = DMatrix::from_fn(p, p, |i, j| found.at(i, j));
        let cross = -(&own * &taken);
        let others = &g - taken.tr_mul(&cross);
        found.dimension = size.all;
        for i in 0..n {
            for j in 0..p {
                found.values[(p + i) * N + j] = cross[(j, i)];
                found.values[j * N + p + i] = cross[(j, i)];
            }
            for j in 0..n {
                found.values[(p + i) * N + p + j] = others[(i, j)];
            }
        }
        Some(found)
    }

    /// `None` where it is singular.
    fn of_regular(information: &[f64], dimension: usize) -> Option<Self> {
        const N: usize = MOST_PARAMETERS;
        let mut scale = [0.0; N];
        for i in 0..dimension {
            let diagonal = information[packed_len(i) + i];
            if !(diagonal > 0.0 && diagonal.is_finite()) {
                return None;
            }
            scale[i] = diagonal.sqrt().recip();
        }
        // Row i of the root, then row i of its inverse, in place.
        let mut root = [0.0; N * N];
        for i in 0..dimension {
            for j in 0..=i {
                let mut sum = information[packed_len(i) + j] * scale[i] * scale[j];
                for k in 0..j {
                    sum -= root[i * N + k] * root[j * N + k];
                }
                if i == j {
                    if sum.is_nan() || sum <= LEAST_PIVOT {
                        return None;
                    }
                    root[i * N + i] = sum.sqrt();
                } else {
                    root[i * N + j] = sum / root[j * N + j];
                }
            }
        }
        for i in 0..dimension {
            root[i * N + i] = root[i * N + i].recip();
            for j in 0..i {
                let mut sum = 0.0;
                for k in j..i {
                    sum += root[i * N + k] * root[k * N + j];
                }
                root[i * N + j] = -sum * root[i * N + i];
            }
        }
        let mut values = [0.0; N * N];
        for i in 0..dimension {
            for j in 0..=i {
                let mut sum = 0.0;
                for k in i..dimension {
                    sum += root[k * N + i] * root[k * N + j];
                }
                values[i * N + j] = sum * scale[i] * scale[j];
                values[j * N + i] = values[i * N + j];
            }
        }
        Some(Self { dimension, values })
    }

    /// Entry (i, j).
    #[inline]
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.values[i * MOST_PARAMETERS + j]
    }

    /// Number of parameters.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Trace of the position's block, m².
    pub fn position_trace_m2(&self) -> f64 {
        self.at(0, 0) + self.at(1, 1) + self.at(2, 2)
    }

    /// The position's block, m².
    pub fn position_m2(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.at(i, j))
    }

    /// The bound at this pose.
    pub fn bound(&self, parameters: &LayoutParameters) -> PoseBound {
        let angles = (3..3 + parameters.angles).map(|i| self.at(i, i)).sum::<f64>();
        PoseBound { position_m2: self.position_m2(), angle_rad: angles.max(0.0).sqrt() }
    }
}

/// Cramér-Rao bound of one reading at one pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseBound {
    /// Covariance of the position in the world, m².
    pub position_m2: Matrix3<f64>,
    /// Root of the angles' trace, rad.
    pub angle_rad: f64,
}

impl PoseBound {
    /// Root of the position's trace, m.
    pub fn position_m(&self) -> f64 {
        self.position_m2.trace().max(0.0).sqrt()
    }

    /// Largest eigenvalue of the position's covariance, m².
    pub fn largest_m2(&self) -> f64 {
        self.position_m2.symmetric_eigenvalues().max()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn closed_form_inverse_of_matrices_of_every_size() {
        for n in 3..=MOST_PARAMETERS {
            let a = DMatrix::from_fn(n + 2, n, |i, j| {
                ((3 * i * i + 7 * j * j + i * j) as f64).sin() * 10.0_f64.powi(j as i32 % 5)
            });
            let information = a.tr_mul(&a);
            let packed: Vec<f64> =
                (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|(i, j)| information[(i, j)]).collect();
            let inverse = Inverse::of(&packed, n).unwrap();
            let wanted = information.clone().try_inverse().unwrap();
            for i in 0..n {
                for j in 0..n {
                    let scale = (wanted[(i, i)] * wanted[(j, j)]).sqrt();
                    assert!((inverse.at(i, j) - wanted[(i, j)]).abs() < 1e-8 * scale, "{n} {i} {j}");
                }
            }
        }
    }

    /// Of two more unknowns only the sum is told, and a third by nothing: the bound is that with the sum alone beside the pose.
    #[test]
    fn law_what_nothing_tells_beside_the_pose_takes_nothing_away() {
        let rows = DMatrix::from_fn(9, 4, |i, j| ((3 * i * i + 5 * j + i * j) as f64).sin());
        let (pose, sum) = (rows.columns(0, 3).into_owned(), rows.column(3).into_owned());
        let with = |extra: &[nalgebra::DVector<f64>]| -> Vec<f64> {
            let mut all = pose.clone();
            for column in extra {
                let at = all.ncols();
                all = all.insert_column(at, 0.0);
                all.set_column(at, column);
            }
            let information = all.tr_mul(&all);
            let n = information.nrows();
            (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|(i, j)| information[(i, j)]).collect()
        };
        let one = Inverse::of(&with(std::slice::from_ref(&sum)), Size { pose: 3, all: 4 }).unwrap();
        let nothing = nalgebra::DVector::zeros(9);
        let three = Inverse::of(&with(&[&sum * 1e6, &sum * 1e6, nothing]), Size { pose: 3, all: 6 }).unwrap();
        for i in 0..3 {
            for j in 0..3 {
                assert!((one.at(i, j) - three.at(i, j)).abs() < 1e-9 * one.position_trace_m2(), "{i} {j}");
            }
            // What the gradient asks for: the pose's row beside what is told.
            assert!((three.at(i, 3) + three.at(i, 4) - one.at(i, 3) / 1e6).abs() < 1e-9 * one.at(i, 3).abs());
            assert_eq!(three.at(i, 5), 0.0);
        }
        assert_eq!(three.dimension(), 6);
    }

    #[test]
    fn law_what_is_not_seen_has_no_bound() {
        // Two of three directions.
        assert!(Inverse::of(&[1.0, 0.0, 1.0, 1.0, 1.0, 2.0], 3).is_none());
        assert!(Inverse::of(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0], 3).is_none());
        assert!(Inverse::of(&[1.0, 0.0, f64::NAN, 0.0, 0.0, 1.0], 3).is_none());
    }
}
