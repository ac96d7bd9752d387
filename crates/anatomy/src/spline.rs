//! Cubic splines: a curve in space through points, twice continuously differentiable.
//!
//! On the interval `[u_i, u_i+1]` of width `h_i` the curve is `a + b t + c t² + d t³` with `t = u - u_i`. The slopes `m_i` at
//! the knots follow from the continuity of the second derivative (de Boor, *A Practical Guide to Splines*, chapter IV):
//!
//! ```text
//! h_i m_i-1 + 2 (h_i-1 + h_i) m_i + h_i-1 m_i+1 = 3 (h_i δ_i-1 + h_i-1 δ_i),   δ_i = (x_i+1 - x_i) / h_i
//! ```
//!
//! with *not-a-knot* ends (the third derivative is continuous across the second and the last but one knot), which keep the
//! fourth order of accuracy up to the ends: a natural end would force the curvature of a circle to zero. Three points give
//! the parabola, two the straight line.
//!
//! Knots are chords: `u_i+1 - u_i = |x_i+1 - x_i|`, so that `|dx/du|` is near 1 and the parameter near the arc length.

use nalgebra::{Point3, Vector3};

/// One cubic piece: position from `u = 0` to `u = width`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Piece {
    /// Coefficients of 1, t, t², t³.
    pub(crate) coefficients: [Vector3<f64>; 4],
    /// Width in the spline's parameter (m).
    pub(crate) width: f64,
}

/// Value and first two derivatives by the spline's parameter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Jet {
    pub(crate) value: Vector3<f64>,
    pub(crate) first: Vector3<f64>,
    pub(crate) second: Vector3<f64>,
}

impl Piece {
    /// Position and derivatives at `t` in `[0, width]`.
    #[inline]
    pub(crate) fn jet(&self, t: f64) -> Jet {
        let [a, b, c, d] = &self.coefficients;
        Jet {
            value: a + (b + (c + d * t) * t) * t,
            first: b + (c * 2.0 + d * (3.0 * t)) * t,
            second: c * 2.0 + d * (6.0 * t),
        }
    }

    /// `|dx/du|` at `t`.
    pub(crate) fn speed(&self, t: f64) -> f64 {
        let [_, b, c, d] = &self.coefficients;
        (b + (c * 2.0 + d * (3.0 * t)) * t).norm()
    }

    /// Arc length from `from` to `to` by the Gauss-Legendre rule of five points (exact for polynomials of degree 9).
    pub(crate) fn arc(&self, from: f64, to: f64) -> f64 {
        /// Nodes and weights on [-1, 1] (Abramowitz and Stegun, table 25.4).
        const RULE: [(f64, f64); 5] = [
            (-0.9061798459386640, 0.2369268850561891),
            (-0.5384693101056831, 0.4786286704993665),
            (0.0, 0.5688888888888889),
            (0.5384693101056831, 0.4786286704993665),
            (0.9061798459386640, 0.2369268850561891),
        ];
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        half * RULE.iter().map(|(node, weight)| weight * self.speed(middle + half * node)).sum::<f64>()
    }
}

/// The pieces of the spline through `points` (at least 2, neighbours apart: the caller has checked).
pub(crate) fn pieces_through(points: &[Point3<f64>]) -> Vec<Piece> {
    let widths: Vec<f64> = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).collect();
    let chords: Vec<Vector3<f64>> =
        points.windows(2).zip(&widths).map(|(pair, width)| (pair[1] - pair[0]) / *width).collect();
    let slopes = match points.len() {
        2 => vec![chords[0]; 2],
        3 => parabola_slopes(&widths, &chords),
        _ => not_a_knot_slopes(&widths, &chords),
    };
    (0..widths.len())
        .map(|i| {
            let (h, chord) = (widths[i], chords[i]);
            let (m0, m1) = (slopes[i], slopes[i + 1]);
            let c = (chord * 3.0 - m0 * 2.0 - m1) / h;
            let d = (m0 + m1 - chord * 2.0) / (h * h);
            Piece { coefficients: [points[i].coords, m0, c, d], width: h }
        })
        .collect()
}

/// Slopes of the parabola through three points.
fn parabola_slopes(h: &[f64], chord: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let second = (chord[1] - chord[0]) / (h[0] + h[1]);
    vec![chord[0] - second * h[0], chord[0] + second * h[0], chord[1] + second * h[1]]
}

/// Slopes of the not-a-knot spline through four or more points: one tridiagonal solve (Thomas), stable without pivots
/// since every row but the end ones is diagonally dominant, and the end ones become so after one elimination.
fn not_a_knot_slopes(h: &[f64], chord: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let n = h.len();
    let mut upper = vec![0.0; n + 1];
    let mut slopes = vec![Vector3::zeros(); n + 1];
    let first = h[0] + h[1];
    upper[0] = first / h[1];
    slopes[0] = (chord[0] * ((h[0] + 2.0 * first) * h[1]) + chord[1] * (h[0] * h[0])) / (first * h[1]);
    for i in 1..n {
        let pivot = 2.0 * (h[i - 1] + h[i]) - h[i] * upper[i - 1];
        upper[i] = h[i - 1] / pivot;
        let right = (chord[i - 1] * h[i] + chord[i] * h[i - 1]) * 3.0;
        slopes[i] = (right - slopes[i - 1] * h[i]) / pivot;
    }
    let last = h[n - 2] + h[n - 1];
    let right =
        (chord[n - 2] * (h[n - 1] * h[n - 1]) + chord[n - 1] * ((2.0 * last + h[n - 1]) * h[n - 2])) / last;
    let pivot = h[n - 2] - last * upper[n - 1];
    slopes[n] = (right - slopes[n - 1] * last) / pivot;
    for i in (0..n).rev() {
        let next = slopes[i + 1];
        slopes[i] -= next * upper[i];
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_second_derivative_is_continuous_and_ends_are_not_a_knot() {
        let points: Vec<Point3<f64>> = (0..9)
            .map(|i| f64::from(i) + 0.3 * f64::from(i * i % 5))
            .map(|t| Point3::new(0.01 * t, 0.02 * (0.9 * t).sin(), 0.005 * (1.7 * t).cos()))
            .collect();
        let pieces = pieces_through(&points);
        for (i, pair) in pieces.windows(2).enumerate() {
            let (end, start) = (pair[0].jet(pair[0].width), pair[1].jet(0.0));
            assert!((end.value - points[i + 1].coords).norm() < 1e-15);
            assert!((end.first - start.first).norm() < 1e-12);
            assert!((end.second - start.second).norm() < 1e-9, "knot {i}");
        }
        for (a, b) in [(0, 1), (7, 6)] {
            let jump = pieces[a].coefficients[3] - pieces[b].coefficients[3];
            assert!(jump.norm() < 1e-7 * pieces[a].coefficients[3].norm().max(1.0));
        }
    }

    #[test]
    fn closed_form_cubic_in_chord_parameter_is_reproduced_on_a_line() {
        // On a straight line the chords are the abscissae, so a not-a-knot spline is the line itself.
        let points: Vec<Point3<f64>> =
            [0.0, 0.1, 0.4, 0.45, 0.9].iter().map(|x| Point3::new(*x, 2.0 * x, -x)).collect();
        for piece in pieces_through(&points) {
            assert!((piece.speed(0.3 * piece.width) - 1.0).abs() < 1e-14);
            assert!((piece.arc(0.0, piece.width) - piece.width).abs() < 1e-15);
            assert!(piece.coefficients[2].norm() < 1e-12);
        }
    }

    #[test]
    fn closed_form_three_points_give_the_parabola() {
        let points = [Point3::new(-0.1, 0.01, 0.0), Point3::new(0.0, 0.0, 0.0), Point3::new(0.1, 0.01, 0.0)];
        let pieces = pieces_through(&points);
        assert!((pieces[0].jet(0.0).second - pieces[1].jet(0.5 * pieces[1].width).second).norm() < 1e-12);
        assert!(pieces[0].jet(pieces[0].width).first.y.abs() < 1e-15);
    }
}
