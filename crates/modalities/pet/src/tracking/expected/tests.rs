use super::*;
use nalgebra::{Matrix2, Vector2, Vector3, Vector6};

/// Four lines along different directions, with a core and a tail `wider` times as wide in standard deviation.
fn shapes(tail_share: f64, wider: f64) -> Shapes {
    let axes = [
        Vector3::new(0.3, -0.8, 0.2),
        Vector3::x(),
        Vector3::new(0.1, 0.2, -0.9),
        Vector3::new(1.0, 1.0, 0.1),
    ];
    let mut shape = Shapes { filled: Four([1.0, 1.0, 1.0, 0.0]), ..Shapes::default() };
    let shares = [(1.0 - tail_share).powi(2), 2.0 * tail_share * (1.0 - tail_share), tail_share.powi(2)];
    for (lane, axis) in axes.iter().enumerate() {
        let e1 = axis.cross(&Vector3::new(0.2, 0.5, 0.7)).normalize();
        let e2 = axis.normalize().cross(&e1);
        for i in 0..3 {
            shape.e1[i].0[lane] = e1[i];
            shape.e2[i].0[lane] = e2[i];
        }
        let core = Matrix2::new(1.1e-6, 0.3e-6 * (lane as f64 - 1.0), 0.3e-6 * (lane as f64 - 1.0), 2.3e-6);
        let scales = [1.0, 0.5 * (1.0 + wider * wider), wider * wider];
        for k in 0..COMPONENTS {
            let precision = (core * scales[k]).try_inverse().unwrap();
            for (to, from) in
                shape.precision[k].iter_mut().zip([precision[(0, 0)], precision[(0, 1)], precision[(1, 1)]])
            {
                to.0[lane] = from;
            }
            shape.peak[k].0[lane] =
                shares[k] * precision.determinant().sqrt() / std::f64::consts::TAU * shape.filled.0[lane];
        }
    }
    shape.background = Four::splat(1.0 / (std::f64::consts::PI * 0.03 * 0.03));
    shape
}

fn marker(at_m: [f64; 3], weight: f64) -> Placed {
    let at_m = Vector3::from(at_m);
    Placed { at_m, arm_m: at_m + Vector3::new(2e-3, 1e-3, 0.0), weight }
}

fn triangle(weight: f64) -> [Placed; 3] {
    [[-8e-3, 0.0, 1e-3], [4e-3, 5e-3, 0.0], [4e-3, -5e-3, -2e-3]].map(|at| marker(at, weight / 3.0))
}

/// One marker, a single normal law, no background: the information is the precision itself, in force and torque.
#[test]
fn closed_form_a_normal_law_says_its_precision() {
    let (shape, one) = (shapes(0.0, 3.0), [marker([3e-3, -2e-3, 5e-3], 1.0)]);
    let found = of_pack(&shape, &one, 0.0);
    for (lane, found) in found.iter().enumerate().take(3) {
        let axis = |v: &Three| Vector3::new(v[0].0[lane], v[1].0[lane], v[2].0[lane]);
        let p = shape.precision[0];
        let precision = Matrix2::new(p[0].0[lane], p[1].0[lane], p[1].0[lane], p[2].0[lane]);
        let mut by = nalgebra::Matrix6x2::zeros();
        for (k, e) in [axis(&shape.e1), axis(&shape.e2)].iter().enumerate() {
            by.fixed_view_mut::<3, 1>(0, k).copy_from(e);
            by.fixed_view_mut::<3, 1>(3, k).copy_from(&one[0].arm_m.cross(e));
        }
        let wanted = by * precision * by.transpose();
        assert!((found - wanted).norm() < 1e-6 * wanted.norm(), "{lane}");
    }
    assert_eq!(found[3], Matrix6::zeros(), "an empty place");
}

/// Half the step: what is left of the sum's error.
#[test]
fn law_the_grid_has_converged() {
    for (tail_share, wider, background) in [(0.25, 11.0_f64.sqrt(), 0.1), (0.4, 6.0, 0.0), (0.0, 1.0, 0.5)] {
        let (shape, markers) = (shapes(tail_share, wider), triangle(1.0 - background));
        let sums = |step: f64| dispatch(Grid { shape: &shape, placed: &markers, background, step });
        let (coarse, fine) = (sums(STEP), sums(0.5 * STEP));
        for lane in 0..3 {
            let (coarse, fine) = (expand(&shape, lane, &coarse), expand(&shape, lane, &fine));
            let off = (coarse - fine).fixed_view::<3, 3>(0, 0).norm() / fine.fixed_view::<3, 3>(0, 0).norm();
            println!("{tail_share} {lane}: {off:.1e}");
            assert!(off < 3e-3, "{tail_share} {lane}: {off}");
        }
    }
}

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
fn of_line(shape: &Shapes, lane: usize, placed: &[Placed], background: f64) -> Matrix6<f64> {
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

/// Another rule for the same integral: Gauss-Hermite under q, component by component, with the weight `p/q`. Equal where the law is narrow;
/// where its tail is wide that rule is too small.
#[test]
fn cross_a_gauss_rule_agrees_on_laws_without_a_tail() {
    for (tail_share, smallest, largest) in [(0.0, 0.98, 1.02), (0.25, 0.75, 1.0)] {
        let (shape, markers) = (shapes(tail_share, 11.0_f64.sqrt()), triangle(0.9));
        for (lane, fine) in of_pack(&shape, &markers, 0.1).iter().enumerate().take(3) {
            let ratio = of_line(&shape, lane, &markers, 0.1).trace() / fine.trace();
            println!("{tail_share} {lane}: {ratio:.3}");
            assert!((smallest..largest).contains(&ratio), "{tail_share} {lane}: {ratio}");
        }
    }
}

/// A pack's other lines do not show: the same line in every lane says the same.
#[test]
fn law_lines_do_not_see_each_other() {
    let (shape, markers) = (shapes(0.25, 3.0), triangle(0.9));
    let all = of_pack(&shape, &markers, 0.1);
    let copy = |four: &mut Four| *four = Four::splat(four.0[1]);
    let mut alone = shape;
    alone.e1.iter_mut().chain(&mut alone.e2).for_each(copy);
    alone.precision.iter_mut().flatten().chain(&mut alone.peak).for_each(copy);
    alone.filled = Four::splat(1.0);
    for one in of_pack(&alone, &markers, 0.1) {
        assert!((one - all[1]).norm() < 1e-12 * one.norm());
    }
}
