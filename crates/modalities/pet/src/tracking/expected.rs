//! Expected information of one line: `∫ p(u) g gᵀ du` over its offset, by Gauss-Hermite quadrature.
//!
//! p = (1-β) q + β b with q the markers' own density. The integral is taken under q, component by component (5 x 5 points), with the
//! weight `p/q`: the background has no score of its own, and far from the markers, where q vanishes, neither has the mixture.

use super::lanes::Three;
use super::likelihood::Placed;
use super::noise::COMPONENTS;
use super::window::Shapes;
use nalgebra::{Matrix2, Matrix6, Vector2, Vector3, Vector6};

/// Abscissae for the weight `exp(-x²/2)/√2π` (Abramowitz and Stegun, table 25.10, five points, scaled by √2) and weights.
const POINTS: [(f64, f64); 5] = [
    (-2.856970013872806, 0.011257411327720691),
    (-1.355626179974266, 0.222075922005612644),
    (0.0, 0.533333333333333333),
    (1.355626179974266, 0.222075922005612644),
    (2.856970013872806, 0.011257411327720691),
];

/// The line's frame and noise, one lane of a pack.
struct One {
    e1: Vector3<f64>,
    e2: Vector3<f64>,
    precision: [Matrix2<f64>; COMPONENTS],
    peak: [f64; COMPONENTS],
    background: f64,
}

fn one(shape: &Shapes, lane: usize) -> One {
    let vector = |v: &Three| Vector3::new(v[0].0[lane], v[1].0[lane], v[2].0[lane]);
    One {
        e1: vector(&shape.e1),
        e2: vector(&shape.e2),
        precision: shape
            .precision
            .map(|p| Matrix2::new(p[0].0[lane], p[1].0[lane], p[1].0[lane], p[2].0[lane])),
        peak: shape.peak.map(|p| p.0[lane]),
        background: shape.background.0[lane],
    }
}

/// Force and torque about the capsule's origin, world axes.
pub(super) fn of_line(shape: &Shapes, lane: usize, placed: &[Placed], background: f64) -> Matrix6<f64> {
    if shape.filled.0[lane] == 0.0 {
        return Matrix6::zeros();
    }
    let line = one(shape, lane);
    let flat = |v: &Vector3<f64>| Vector2::new(line.e1.dot(v), line.e2.dot(v));
    let places: Vec<Vector2<f64>> = placed.iter().map(|p| flat(&p.at_m)).collect();
    let mut information = Matrix6::zeros();
    for (place, marker) in places.iter().zip(placed) {
        for (precision, peak) in line.precision.iter().zip(line.peak) {
            let Some(root) = precision.try_inverse().and_then(nalgebra::Matrix::cholesky) else { continue };
            // The component's share: its peak over that of a normal law of this covariance.
            let share = marker.weight * peak * std::f64::consts::TAU / precision.determinant().sqrt();
            for (x, wx) in POINTS {
                for (y, wy) in POINTS {
                    let at = place + root.l() * Vector2::new(x, y);
                    let (score, over) = score_at(&line, &at, &places, placed, background);
                    information += score * score.transpose() * (share * wx * wy * over);
                }
            }
        }
    }
    information
}

/// Score of a line through `at`, and `p/q` there.
fn score_at(
    line: &One,
    at: &Vector2<f64>,
    places: &[Vector2<f64>],
    placed: &[Placed],
    background: f64,
) -> (Vector6<f64>, f64) {
    let mut markers = 0.0;
    let mut score = Vector6::zeros();
    for (place, marker) in places.iter().zip(placed) {
        let u = at - place;
        for (precision, peak) in line.precision.iter().zip(line.peak) {
            let pull = precision * u;
            let density = marker.weight * peak * (-0.5 * u.dot(&pull)).exp();
            markers += density;
            let force = (line.e1 * pull.x + line.e2 * pull.y) * density;
            let torque = marker.arm_m.cross(&force);
            score += Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
        }
    }
    let all = markers + background * line.background;
    if markers > 0.0 { (score / all, all / markers) } else { (Vector6::zeros(), 0.0) }
}
