use super::*;

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
        let sums =
            |step: f64| Arch::new().dispatch(Grid { shape: &shape, placed: &markers, background, step });
        let (coarse, fine) = (sums(STEP), sums(0.5 * STEP));
        for lane in 0..3 {
            let (coarse, fine) = (expand(&shape, lane, &coarse), expand(&shape, lane, &fine));
            let off = (coarse - fine).fixed_view::<3, 3>(0, 0).norm() / fine.fixed_view::<3, 3>(0, 0).norm();
            println!("{tail_share} {lane}: {off:.1e}");
            assert!(off < 3e-3, "{tail_share} {lane}: {off}");
        }
    }
}

/// The trackers' rule of five points is the same integral: equal where the law is narrow, too small where its tail is wide.
#[test]
fn cross_both_rules_agree_on_laws_without_a_tail() {
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
