//! Fixtures of this project's own study of the set-up of taddese2018 (permanent magnet, coil, wrench), computed by other programs,
//! and closed forms.

use approx::assert_relative_eq;
use lumenav_fields::{Cylinder, FieldSource, elliptic, multipole, wrench};
use nalgebra::Vector3;

fn close(actual: f64, expected: f64, relative: f64) {
    assert!((actual - expected).abs() <= relative * expected.abs(), "{actual:e} is not {expected:e}");
}

#[test]
fn cross_strengths_of_magnet_and_coil() {
    // taddese2018: N52 cylinder 101.6 x 101.6 mm; 160 turns, 0.71 A. Study: 970.114 and 2.890768 A m^2.
    close(crate::permanent_magnet().strength_t_m3(), 9.701142e-5, 1e-6);
    close(crate::coil().strength_t_m3(), 2.890768e-7, 1e-6);
    close(crate::coil().remanence_tesla(), 3.568849254e-3, 1e-9);
    // 5 x 6 mm magnet of 1.2938 T: the strength that moussakhani2012's figure 2 implies.
    close(crate::capsule_magnet().strength_t_m3(), 1.2129375e-8, 1e-12);
}

#[test]
fn cross_multipole_coefficients() {
    let magnet = [(1, 9.70114189e-5), (3, 6.25878870e-8), (5, -5.65308817e-10)];
    let coil = [(1, 2.89076790e-7), (3, -1.64051078e-9), (5, 9.55868539e-12)];
    for (cylinder, coefficients) in [(crate::permanent_magnet(), magnet), (crate::coil(), coil)] {
        let (a, b, br) = (cylinder.radius_m(), cylinder.half_length_m(), cylinder.remanence_tesla());
        for (degree, expected) in coefficients {
            close(multipole::coefficient(a, b, br, degree), expected, 2e-9);
            assert_eq!(multipole::coefficient(a, b, br, degree + 1), 0.0);
        }
    }
}

#[test]
fn cross_flux_of_magnet_and_coil() {
    let points =
        [[0.15, 0.0, 0.0], [0.0, 0.0, 0.15], [0.1, 0.05, 0.12], [0.12, -0.09, -0.1]].map(Vector3::from);
    let magnet = [
        [0.0, 0.0, -2.694582864516e-2],
        [0.0, 0.0, 5.873986250386e-2],
        [3.021833502144e-2, 1.510916751072e-2, 1.275544612643e-2],
        [-1.817458982733e-2, 1.363094237049e-2, -1.902808362135e-3],
    ];
    let coil = [
        [0.0, 0.0, -1.323699307003e-4],
        [0.0, 0.0, 1.099129280932e-4],
        [7.168210779071e-5, 3.584105389536e-5, 5.560281178553e-5],
        [-5.920353237712e-5, 4.440264928284e-5, 1.091712705419e-5],
    ];
    for (cylinder, expected) in [(crate::permanent_magnet(), magnet), (crate::coil(), coil)] {
        for (point, expected) in points.iter().zip(expected.map(Vector3::from)) {
            let flux = cylinder.flux_tesla(point);
            assert!((flux - expected).norm() < 2e-12 * expected.norm(), "{flux:?} is not {expected:?}");
        }
    }
}

#[test]
fn cross_dipole_is_wrong_by_percents_near_the_magnet() {
    // Study of taddese2018, table of section C: largest relative error of the dipole on a sphere.
    let table = [(0.15, 0.0676, 0.558), (0.2, 0.0321, 0.301), (0.3, 0.0124, 0.130)];
    for (radius_m, magnet_error, coil_error) in table {
        for (cylinder, expected) in [(crate::permanent_magnet(), magnet_error), (crate::coil(), coil_error)] {
            let dipole = FieldSource::Dipole { strength_t_m3: cylinder.strength_t_m3() };
            let worst = crate::directions(4000)
                .into_iter()
                .map(|direction| {
                    let point = direction * radius_m;
                    let exact = cylinder.flux_tesla(&point);
                    (dipole.flux_tesla(&Vector3::z(), &point) - exact).norm() / exact.norm()
                })
                .fold(0.0, f64::max);
            assert_relative_eq!(worst, expected, max_relative = 0.01);
        }
    }
}

#[test]
fn cross_wrench_between_magnet_and_capsule() {
    // Moments of the permanent magnet and of the 11.11 x 11.11 mm magnet in the capsule, Br 1.48 T.
    let external = 10.0 * crate::permanent_magnet().strength_t_m3() * 1e6;
    let capsule = 10.0 * Cylinder::magnet(0.005555, 0.01111, 1.48).unwrap().strength_t_m3() * 1e6;
    close(external, 970.114189, 1e-8);
    close(capsule, 1.268481, 1e-6);

    let below = Vector3::new(0.0, 0.0, -0.158);
    let facing = wrench::dipole_on_dipole(&(Vector3::x() * external), &(Vector3::x() * -capsule), &below);
    close(facing.force_n.z, 0.5923790256, 1e-9);
    assert!(facing.force_n.xy().norm() < 1e-15 && facing.torque_n_m.norm() < 1e-15);
    let coaxial = wrench::dipole_on_dipole(&(Vector3::z() * external), &(Vector3::z() * capsule), &below);
    close(coaxial.force_n.z, 1.184758051, 1e-9);

    let heading = Vector3::new(-0.98, 0.1, 0.1720465).normalize();
    let offset = Vector3::new(0.03, 0.02, -0.15);
    let general = wrench::dipole_on_dipole(&(Vector3::x() * external), &(heading * capsule), &offset);
    let force = Vector3::new(-0.4306846229, -0.04179497840, 0.4303206764);
    let torque = Vector3::new(-2.337166769e-3, -2.374250895e-2, 4.872372381e-4);
    assert!((general.force_n - force).norm() < 1e-8 * force.norm(), "{:?}", general.force_n);
    assert!((general.torque_n_m - torque).norm() < 1e-8 * torque.norm(), "{:?}", general.torque_n_m);
}

#[test]
fn cross_dipole_law_overstates_the_force_at_158_mm() {
    // Spec 30, section 4: the dipole law overstates the force by 11 per cent at 158 mm (capsule below, facing).
    let magnet = crate::permanent_magnet();
    let moment = Vector3::x() * -1.268481;
    let offset = Vector3::new(0.0, 0.0, -0.158);
    let force = |source: FieldSource| {
        let field = source.flux_and_jacobian(&Vector3::x(), &offset);
        wrench::dipole_in_source_field(&moment, &field).force_n.z
    };
    let exact = force(FieldSource::Cylinder(magnet));
    let dipole = force(FieldSource::Dipole { strength_t_m3: magnet.strength_t_m3() });
    println!("dipole force / exact force = {}", dipole / exact);
    assert_relative_eq!(dipole / exact, 1.11, epsilon = 0.006);
}

#[test]
fn closed_form_field_on_the_axis() {
    for cylinder in [crate::permanent_magnet(), crate::coil(), crate::capsule_magnet()] {
        let (a, b, br) = (cylinder.radius_m(), cylinder.half_length_m(), cylinder.remanence_tesla());
        for ratio in [-7.0, -1.0, -0.3, 0.0, 0.5, 1.0, 1.3, 4.0] {
            let z = ratio * a;
            let flux = cylinder.flux_tesla(&Vector3::new(0.0, 0.0, z));
            let expected = 0.5 * br * ((z + b) / (z + b).hypot(a) - (z - b) / (z - b).hypot(a));
            assert_eq!((flux.x, flux.y), (0.0, 0.0));
            // The difference of the faces itself rounds, at two parts in 1e16 of Br.
            assert!((flux.z - expected).abs() < 4e-16 * br, "{} is not {expected}", flux.z);
        }
    }
}

#[test]
fn closed_form_complete_elliptic_integrals() {
    // Abramowitz and Stegun table 17.1, m = 0.5: K = 1.854074677301372, E = 1.350643881047675.
    let kc = 0.5_f64.sqrt();
    close(elliptic::cel(kc, 1.0, 1.0, 1.0), 1.854074677301372, 1e-15);
    close(elliptic::cel(kc, 1.0, 1.0, 0.5), 1.350643881047675, 1e-15);
    // kc = 1: pi/2 (c + s/sqrt p)/(1 + sqrt p).
    let expected = std::f64::consts::FRAC_PI_2 * (0.7 + 0.3 / 2.0) / 3.0;
    close(elliptic::cel(1.0, 4.0, 0.7, 0.3), expected, 1e-15);
    // Legendre's relation for complementary moduli.
    for kc in [0.01_f64, 0.2, 0.6, 0.99] {
        let k = (1.0 - kc * kc).sqrt();
        let (first, second) = (elliptic::cel(kc, 1.0, 1.0, 1.0), elliptic::cel(kc, 1.0, 1.0, kc * kc));
        let (other_first, other_second) =
            (elliptic::cel(k, 1.0, 1.0, 1.0), elliptic::cel(k, 1.0, 1.0, k * k));
        let legendre = second * other_first + other_second * first - first * other_first;
        close(legendre, std::f64::consts::FRAC_PI_2, 1e-14);
    }
}

#[test]
fn closed_form_principal_value_of_the_third_kind() {
    // DLMF 19.7.9: for n > 1 the principal value of Pi(n, k) is K - Pi(k^2/n, k).
    for (kc, n) in [(0.8_f64, 1.5), (0.3, 2.0), (0.5, 7.0)] {
        let k2 = 1.0 - kc * kc;
        let first = elliptic::cel(kc, 1.0, 1.0, 1.0);
        let expected = first - elliptic::cel(kc, 1.0 - k2 / n, 1.0, 1.0);
        assert_relative_eq!(elliptic::cel(kc, 1.0 - n, 1.0, 1.0), expected, epsilon = 1e-14 * first);
    }
}
