//! Every analytic derivative against central differences (fourth order, relative 1e-8 of its norm).

use lumenav_fields::{FieldSource, dipole, wrench};
use nalgebra::{Matrix3, Unit, UnitQuaternion, Vector3};

const RELATIVE: f64 = 1e-8;

/// Fourth-order central difference of a vector function along `direction`, step `h`.
fn difference(f: impl Fn(f64) -> Vector3<f64>, h: f64) -> Vector3<f64> {
    ((f(h) - f(-h)) * 8.0 - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

fn jacobian(f: impl Fn(&Vector3<f64>) -> Vector3<f64>, at: &Vector3<f64>, h: f64) -> Matrix3<f64> {
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()];
    Matrix3::from_columns(&columns.map(|axis| difference(|step| f(&(at + axis * step)), h)))
}

fn assert_close(analytic: &Matrix3<f64>, numeric: &Matrix3<f64>, what: &str) {
    let error = (analytic - numeric).norm() / numeric.norm();
    assert!(error < RELATIVE, "{what}: relative difference {error:e}\n{analytic}{numeric}");
}

fn sources() -> Vec<(FieldSource, f64)> {
    vec![
        (FieldSource::Dipole { strength_t_m3: 1.2e-8 }, 0.003),
        (FieldSource::Cylinder(crate::capsule_magnet()), 0.0025),
        (FieldSource::Cylinder(crate::permanent_magnet()), 0.0508),
        (FieldSource::Cylinder(crate::coil()), 0.09),
    ]
}

#[test]
fn law_dipole_derivatives_equal_central_differences() {
    for (axis, direction) in crate::directions(20).into_iter().zip(crate::directions(21)) {
        // The axis need not be of unit length.
        let (axis, offset) = (axis * 1.3, direction * 0.12);
        let out = dipole::flux_and_jacobian(1.2e-8, &axis, &offset);
        assert_eq!(out.flux_tesla, dipole::flux_tesla(1.2e-8, &axis, &offset));
        let by_offset = jacobian(|d| dipole::flux_tesla(1.2e-8, &axis, d), &offset, 1e-4);
        assert_close(&out.d_flux_d_offset, &by_offset, "dipole dB/d(offset)");
        let by_axis = jacobian(|h| dipole::flux_tesla(1.2e-8, h, &offset), &axis, 1e-2);
        assert_close(&out.d_flux_d_axis, &by_axis, "dipole dB/d(axis)");
    }
}

#[test]
fn law_cylinder_gradient_equals_central_differences() {
    for cylinder in [crate::permanent_magnet(), crate::coil(), crate::capsule_magnet()] {
        let radius_m = cylinder.radius_m();
        // 20 radii is beyond the switch to the multipole series for all three.
        for ratio in [0.3, 1.9, 3.0, 8.0, 20.0] {
            for direction in crate::directions(24) {
                let point = direction * (ratio * radius_m);
                let h = 2e-4 * radius_m * ratio.max(1.0);
                let numeric = jacobian(|p| cylinder.flux_tesla(p), &point, h);
                assert_close(&cylinder.gradient(&point), &numeric, "cylinder gradient");
            }
        }
    }
}

#[test]
fn law_source_derivatives_equal_central_differences() {
    for (source, size_m) in sources() {
        for (axis, direction) in crate::directions(12).into_iter().zip(crate::directions(13)) {
            for ratio in [1.8, 4.0, 25.0] {
                let offset = direction * (ratio * size_m);
                let out = source.flux_and_jacobian(&axis, &offset);
                assert_eq!(out.flux_tesla, source.flux_tesla(&axis, &offset));
                let h = 2e-4 * size_m * ratio;
                let by_offset = jacobian(|d| source.flux_tesla(&axis, d), &offset, h);
                assert_close(&out.d_flux_d_offset, &by_offset, "dB/d(offset)");
                check_axis(&source, &axis, &offset, &out.d_flux_d_axis);
            }
        }
    }
}

/// dB/d(axis) along two turns of the axis, and zero along the axis.
fn check_axis(source: &FieldSource, axis: &Vector3<f64>, offset: &Vector3<f64>, analytic: &Matrix3<f64>) {
    let across = axis.cross(&Vector3::new(0.3, -0.5, 0.7)).normalize();
    for turn_axis in [across, axis.cross(&across)] {
        let turn_axis = Unit::new_normalize(turn_axis);
        let turned = |angle: f64| {
            let axis = UnitQuaternion::from_axis_angle(&turn_axis, angle) * axis;
            source.flux_tesla(&axis, offset)
        };
        let numeric = difference(turned, 1e-3);
        let along = analytic * turn_axis.cross(axis);
        let scale = analytic.norm();
        assert!((along - numeric).norm() < RELATIVE * scale, "dB/d(axis): {along:?} is not {numeric:?}");
    }
    assert!((analytic * axis).norm() < 1e-14 * analytic.norm());
}

#[test]
fn law_force_is_the_gradient_of_the_energy() {
    let moment = Vector3::new(0.4, -0.8, 0.6);
    for (source, size_m) in sources() {
        for (axis, direction) in crate::directions(8).into_iter().zip(crate::directions(9)) {
            let offset = direction * (3.0 * size_m);
            let field = source.flux_and_jacobian(&axis, &offset);
            let out = wrench::dipole_in_source_field(&moment, &field);
            let energy = |d: &Vector3<f64>| Vector3::repeat(moment.dot(&source.flux_tesla(&axis, d)));
            let numeric = jacobian(energy, &offset, 6e-4 * size_m).row(0).transpose();
            assert!((out.force_n - numeric).norm() < RELATIVE * numeric.norm());
            assert!((out.torque_n_m - moment.cross(&field.flux_tesla)).norm() == 0.0);
        }
    }
}

#[test]
fn cross_dipole_wrench_equals_dipole_in_field() {
    for (axis, direction) in crate::directions(30).into_iter().zip(crate::directions(31)) {
        let (offset, capsule) = (direction * 0.16, Vector3::new(0.7, -0.9, 0.4));
        let external = axis * 970.0;
        let field = dipole::flux_and_jacobian(dipole::MU0_OVER_4PI * 970.0, &axis, &offset);
        let by_field = wrench::dipole_in_source_field(&capsule, &field);
        let direct = wrench::dipole_on_dipole(&external, &capsule, &offset);
        assert!((by_field.force_n - direct.force_n).norm() < 1e-14 * direct.force_n.norm());
        assert!((by_field.torque_n_m - direct.torque_n_m).norm() < 1e-14 * direct.torque_n_m.norm());
        // Action and reaction, forces and moments about one point.
        let back = wrench::dipole_on_dipole(&capsule, &external, &(-offset));
        assert!((back.force_n + direct.force_n).norm() < 1e-14 * direct.force_n.norm());
        let total = back.torque_n_m + direct.torque_n_m + offset.cross(&direct.force_n);
        assert!(total.norm() < 1e-14 * (back.torque_n_m.norm() + direct.torque_n_m.norm()));
    }
}
