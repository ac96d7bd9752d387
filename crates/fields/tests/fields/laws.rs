//! What every static field obeys; batch against scalar; limits; inputs that make no sense.

use lumenav_fields::{Cylinder, FieldError, FieldSource, FluxJacobian, GradientSlices, dipole};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

fn cylinders() -> [Cylinder; 3] {
    [crate::permanent_magnet(), crate::coil(), crate::capsule_magnet()]
}

/// Points inside, near and far, also on the axis, on mantle, end face and edge.
fn points(cylinder: &Cylinder) -> Vec<Vector3<f64>> {
    let (a, b) = (cylinder.radius_m(), cylinder.half_length_m());
    let mut points = vec![
        Vector3::zeros(),
        Vector3::new(0.0, 0.0, 3.0 * b),
        Vector3::new(a, 0.0, 0.3 * b),
        Vector3::new(0.0, 0.4 * a, b),
        Vector3::new(a, 0.0, b),
        Vector3::new(a * (1.0 + 1e-9), 0.0, b),
        Vector3::new(1e-12 * a, 0.0, 2.0 * b),
    ];
    for (index, direction) in crate::directions(403).into_iter().enumerate() {
        // Neighbours in a register lie near and far: the batch must not mix them up.
        let ratio = [0.2, 1.01, 2.0, 5.0, 11.0, 12.0, 40.0, 3000.0][index % 8];
        points.push(direction * (ratio * a));
    }
    points
}

#[test]
fn law_curl_and_divergence_are_zero() {
    for cylinder in cylinders() {
        for point in points(&cylinder) {
            let (flux, gradient) = cylinder.flux_and_gradient(&point);
            assert_eq!(gradient, gradient.transpose());
            assert!(gradient.trace().abs() <= 1e-14 * gradient.norm(), "{gradient} at {point:?}");
            assert_eq!(flux, cylinder.flux_tesla(&point));
        }
    }
    for (axis, direction) in crate::directions(50).into_iter().zip(crate::directions(51)) {
        let gradient = dipole::flux_and_jacobian(1e-8, &axis, &(direction * 0.1)).d_flux_d_offset;
        assert!((gradient - gradient.transpose()).norm() <= 1e-15 * gradient.norm());
        assert!(gradient.trace().abs() <= 1e-14 * gradient.norm());
    }
}

#[test]
fn law_batch_has_the_bytes_of_the_scalar() {
    for cylinder in cylinders() {
        let points = points(&cylinder);
        // Several lengths: full registers and every remainder.
        for count in [1, 2, 3, 4, 7, 64, points.len()] {
            batch_equals_scalar(&cylinder, &points[points.len() - count..]);
            batch_equals_scalar(&cylinder, &points[..count]);
        }
    }
}

fn batch_equals_scalar(cylinder: &Cylinder, points: &[Vector3<f64>]) {
    let count = points.len();
    let [x, y, z] = [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<f64>>());
    let mut flux = [vec![0.0; count], vec![0.0; count], vec![0.0; count]];
    let [fx, fy, fz] = &mut flux;
    cylinder.flux_batch(&x, &y, &z, fx, fy, fz).unwrap();
    let mut flux_again = flux.clone();
    let mut g: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; count]);
    let [xx, xy, xz, yy, yz, zz] = &mut g;
    let out = GradientSlices { xx, xy, xz, yy, yz, zz };
    let [fx, fy, fz] = &mut flux_again;
    cylinder.gradient_batch(&x, &y, &z, [fx, fy, fz], out).unwrap();
    assert_eq!(flux, flux_again);
    for (index, point) in points.iter().enumerate() {
        let (scalar_flux, scalar_gradient) = cylinder.flux_and_gradient(point);
        let from_batch = Vector3::new(flux[0][index], flux[1][index], flux[2][index]);
        assert_eq!(from_batch, scalar_flux, "flux at {point:?}");
        let [xx, xy, xz, yy, yz, zz] = [0, 1, 2, 3, 4, 5].map(|element: usize| g[element][index]);
        let from_batch = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        assert_eq!(from_batch, scalar_gradient, "gradient at {point:?}");
    }
}

#[test]
fn law_source_batch_has_the_bytes_of_the_scalar() {
    let axis = Vector3::new(0.6, -0.48, 0.64);
    let mut sources: Vec<FieldSource> = cylinders().map(FieldSource::Cylinder).to_vec();
    sources.push(FieldSource::Dipole { strength_t_m3: 1e-8 });
    for source in sources {
        for count in [0, 1, 3, 15, 16, 17, 48, 200] {
            let offsets: Vec<_> = crate::directions(200).into_iter().take(count).map(|d| d * 0.21).collect();
            let mut out = vec![FluxJacobian::default(); count];
            source.flux_and_jacobian_batch(&axis, &offsets, &mut out).unwrap();
            for (offset, out) in offsets.iter().zip(out) {
                assert_eq!(out, source.flux_and_jacobian(&axis, offset));
            }
        }
    }
}

#[test]
fn law_field_turns_with_its_source() {
    let rotation = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
    for cylinder in cylinders() {
        let source = FieldSource::Cylinder(cylinder);
        for direction in crate::directions(60) {
            let point = direction * (2.2 * cylinder.radius_m());
            let (flux, gradient) = cylinder.flux_and_gradient(&point);
            let turned = source.flux_and_jacobian(&(rotation * Vector3::z()), &(rotation * point));
            assert!((turned.flux_tesla - rotation * flux).norm() < 1e-13 * flux.norm());
            let matrix = rotation.to_rotation_matrix();
            let expected = matrix.matrix() * gradient * matrix.matrix().transpose();
            assert!((turned.d_flux_d_offset - expected).norm() < 1e-13 * gradient.norm());
        }
    }
}

#[test]
fn law_field_is_odd_in_the_axis_and_even_in_the_point() {
    for cylinder in cylinders() {
        let source = FieldSource::Cylinder(cylinder);
        for (axis, direction) in crate::directions(40).into_iter().zip(crate::directions(41)) {
            let offset = direction * (2.5 * cylinder.radius_m());
            let flux = source.flux_tesla(&axis, &offset);
            assert!((source.flux_tesla(&axis, &(-offset)) - flux).norm() <= 1e-14 * flux.norm());
            assert!((source.flux_tesla(&(-axis), &offset) + flux).norm() <= 1e-14 * flux.norm());
        }
    }
}

#[test]
fn law_cylinder_becomes_a_dipole_far_away() {
    for cylinder in cylinders() {
        let source = FieldSource::Cylinder(cylinder);
        let dipole = FieldSource::Dipole { strength_t_m3: cylinder.strength_t_m3() };
        for direction in crate::directions(40) {
            let mut previous = f64::INFINITY;
            for ratio in [20.0, 200.0, 2000.0] {
                let offset = direction * (ratio * cylinder.radius_m());
                let exact = source.flux_and_jacobian(&Vector3::z(), &offset);
                let limit = dipole.flux_and_jacobian(&Vector3::z(), &offset);
                let error = (exact.flux_tesla - limit.flux_tesla).norm() / limit.flux_tesla.norm();
                assert!(error < 6.0 / (ratio * ratio), "{error:e} at {ratio} radii");
                // The next term of the series falls with the square of the distance.
                assert!(error < previous / 80.0 || error < 1e-14);
                previous = error;
                for (exact, limit) in [
                    (exact.d_flux_d_offset, limit.d_flux_d_offset),
                    (exact.d_flux_d_axis, limit.d_flux_d_axis),
                ] {
                    assert!((exact - limit).norm() < 30.0 / (ratio * ratio) * limit.norm());
                }
            }
        }
    }
}

#[test]
fn law_closed_form_and_series_meet_at_the_switch() {
    for cylinder in cylinders() {
        let switch_m = 8.0 * cylinder.radius_m().hypot(cylinder.half_length_m());
        for direction in crate::directions(200) {
            // The field itself changes by 3e-13 between the two points.
            let [near, far] = [1.0 - 1e-13, 1.0 + 1e-13].map(|f| direction * (switch_m * f));
            let (near, far) = (cylinder.flux_and_gradient(&near), cylinder.flux_and_gradient(&far));
            let error = (near.0 - far.0).norm() / far.0.norm();
            assert!(error < 3e-12, "flux jumps by {error:e}");
            assert!((near.1 - far.1).norm() / far.1.norm() < 3e-12);
        }
    }
}

#[test]
fn law_nothing_panics_and_only_nonsense_is_not_a_number() {
    for cylinder in cylinders() {
        for point in points(&cylinder) {
            let (flux, gradient) = cylinder.flux_and_gradient(&point);
            assert!(flux.iter().chain(gradient.iter()).all(|value| value.is_finite()), "{point:?}");
        }
        for bad in [f64::NAN, f64::INFINITY] {
            let (flux, _) = cylinder.flux_and_gradient(&Vector3::new(bad, 0.1, 0.2));
            assert!(flux.iter().any(|value| value.is_nan()));
        }
    }
    // Extreme shapes and sizes stay finite.
    for (radius_m, half_length_m) in [(1e-9, 1e-9), (1e3, 1e3), (1e-3, 1.0), (1.0, 1e-3), (1e-6, 1e3)] {
        let cylinder = Cylinder::new(radius_m, half_length_m, 1.0).unwrap();
        for point in points(&cylinder) {
            let (flux, gradient) = cylinder.flux_and_gradient(&point);
            assert!(flux.iter().chain(gradient.iter()).all(|v| v.is_finite()), "{cylinder:?} {point:?}");
        }
    }
    let flux = dipole::flux_tesla(1e-8, &Vector3::z(), &Vector3::zeros());
    assert!(flux.iter().any(|value| value.is_nan()));
}

#[test]
fn law_mantle_value_is_the_mean_of_its_limits() {
    let magnet = crate::permanent_magnet();
    let (a, z) = (magnet.radius_m(), 0.3 * magnet.half_length_m());
    let at = |rho: f64| magnet.flux_tesla(&Vector3::new(rho, 0.0, z)).z;
    let (inside, outside) = (at(a * (1.0 - 1e-12)), at(a * (1.0 + 1e-12)));
    // B_z jumps by the remanence.
    assert!((inside - outside - magnet.remanence_tesla()).abs() < 1e-9);
    assert!((at(a) - 0.5 * (inside + outside)).abs() < 1e-9);
}

#[test]
fn law_sizes_without_sense_are_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        for result in [
            Cylinder::magnet(bad, 0.01, 1.2),
            Cylinder::magnet(0.01, bad, 1.2),
            Cylinder::coil(bad, 0.01, 10.0, 1.0),
            Cylinder::coil(0.01, bad, 10.0, 1.0),
            Cylinder::coil(0.01, 0.01, bad, 1.0),
        ] {
            assert!(matches!(result, Err(FieldError::NotPositive { .. })), "{bad}");
        }
    }
    let error = Cylinder::magnet(0.01, 0.01, f64::NAN).unwrap_err();
    assert!(matches!(error, FieldError::NotFinite { name: "remanence_tesla", .. }));
    assert_eq!(
        Cylinder::magnet(-0.01, 0.01, 1.2).unwrap_err().to_string(),
        "radius_m has to be positive and finite, it is -0.01"
    );
    // Reversed magnetisation and current are fine.
    assert!(Cylinder::coil(0.01, 0.01, 10.0, -1.0).is_ok());

    let mut out = [FluxJacobian::default(); 2];
    let source = FieldSource::Dipole { strength_t_m3: 1.0 };
    let result = source.flux_and_jacobian_batch(&Vector3::z(), &[Vector3::x()], &mut out);
    assert_eq!(result, Err(FieldError::LengthMismatch { name: "out", expected: 1, actual: 2 }));
}

/// FNV-1a over the bytes of numbers.
fn fingerprint(numbers: impl Iterator<Item = f64>) -> u64 {
    numbers.flat_map(f64::to_le_bytes).fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[test]
fn regress_same_bytes_on_every_processor() {
    // Only exactly rounded operations are used, so the fingerprint holds for every processor and register width;
    // it changes with any change of the arithmetic (then: check the accuracy tests, write the new number here).
    let magnet = crate::permanent_magnet();
    let coordinate = |index: usize, factor: usize| ((index * factor) % 101) as f64 / 101.0 - 0.5;
    let [x, y, z] = [37, 53, 71].map(|f| (0..101).map(|i| coordinate(i + 1, f)).collect::<Vec<f64>>());
    let mut out: [Vec<f64>; 9] = std::array::from_fn(|_| vec![0.0; x.len()]);
    let [bx, by, bz, xx, xy, xz, yy, yz, zz] = &mut out;
    let gradient = GradientSlices { xx, xy, xz, yy, yz, zz };
    magnet.gradient_batch(&x, &y, &z, [bx, by, bz], gradient).unwrap();
    assert_eq!(fingerprint(out.into_iter().flatten()), 0xfbd1_bf57_cc17_ca54);
}
