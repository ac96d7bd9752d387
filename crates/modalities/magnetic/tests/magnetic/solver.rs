//! Right basin from two starts, error at the bound.

use super::support::*;
use lumenav_core::Node;
use lumenav_fields::FieldSource;
use lumenav_magnetic::array::SensorArray;
use lumenav_magnetic::bound::bound;
use lumenav_magnetic::channels::{Channels, MagnetPose};
use lumenav_magnetic::solver::{LinearPrior, Readings, Search, Unknown, Workspace, solve, solve_from_all};
use nalgebra::{Isometry3, Vector3};

fn both_ways(position_world_m: Vector3<f64>) -> [MagnetPose; 2] {
    [Vector3::z(), -Vector3::z()].map(|axis_world| MagnetPose { position_world_m, axis_world })
}

fn search(channels: &Channels, source: &FieldSource, flux: &[f64], starts: &[MagnetPose]) -> Search {
    let (valid, variance) = (vec![true; flux.len()], vec![SIGMA_TESLA.powi(2); flux.len()]);
    let readings = Readings {
        flux_tesla: flux,
        valid: &valid,
        variance_tesla2: &variance,
        unknown: Unknown::default(),
        prior: LinearPrior::NONE,
    };
    solve_from_all(channels, source, readings, starts, &mut Workspace::default()).unwrap()
}

/// Counts the poses whose best solution is converged and within six standard deviations (5 degrees of freedom) of the truth.
fn right_basins(
    array: &SensorArray,
    poses: impl Iterator<Item = Isometry3<f64>>,
    purpose: &str,
) -> (usize, usize) {
    let channels = array.channels(&Isometry3::identity());
    let starts: Vec<MagnetPose> =
        array.start_positions_m(&channels, &Isometry3::identity()).into_iter().flat_map(both_ways).collect();
    let mut right = 0;
    let mut all = 0;
    for (i, pose) in poses.enumerate() {
        let truth = magnet_of(&pose);
        let flux = noisy(&channels, &dipole(), &truth, SIGMA_TESLA, &mut stream(purpose, i as u64));
        let found = search(&channels, &dipole(), &flux, &starts);
        let expected = bound(&channels, &dipole(), &truth, SIGMA_TESLA, true).unwrap().position_norm_m();
        let error = (found.best.magnet.position_world_m - truth.position_world_m).norm();
        let upright = found.best.magnet.axis_world.dot(&truth.axis_world) > 0.5;
        let is_right = found.best.converged && found.rival.is_none() && error < 6.0 * expected && upright;
        right += usize::from(is_right);
        all += 1;
    }
    (right, all)
}

#[test]
fn cross_two_starts_reach_the_right_basin_from_2000_poses_of_the_reference_workspace() {
    let file = Node::open(&models().join("sensor-arrays/plane-4x4.toml")).unwrap();
    let array = SensorArray::from_node(&file).unwrap();
    let mut random = stream("poses", 0);
    let poses = (0..2000).map(|_| workspace_pose(&mut random));
    let (right, all) = right_basins(&array, poses, "basin");
    println!("figure: right basin from two starts: {right} of {all} poses");
    assert_eq!((right, all), (2000, 2000));
}

/// Root mean square of the position error over the bound, over `trials` noise draws; and the mean χ² per degree of freedom.
fn error_over_bound(side: u32, truth: &MagnetPose, trials: u64) -> (f64, f64) {
    let channels = grid(side).channels(&Isometry3::identity());
    let (mut squared, mut chi_square) = (0.0, 0.0);
    for trial in 0..trials {
        let flux = noisy(&channels, &dipole(), truth, SIGMA_TESLA, &mut stream("efficiency", trial));
        let found = search(&channels, &dipole(), &flux, &both_ways(Vector3::new(0.0, 0.0, 0.2)));
        squared += (found.best.magnet.position_world_m - truth.position_world_m).norm_squared();
        chi_square += found.best.chi_square / (flux.len() - 5) as f64;
    }
    let expected = bound(&channels, &dipole(), truth, SIGMA_TESLA, true).unwrap().position_norm_m();
    ((squared / trials as f64).sqrt() / expected, chi_square / trials as f64)
}

/// The reference study ran 4,000 trials; `LUMENAV_FULL=1` does, otherwise 1,000 within seconds.
fn trials() -> u64 {
    if std::env::var("LUMENAV_FULL").is_ok_and(|v| v == "1") { 4000 } else { 1000 }
}

#[test]
fn published_maximum_likelihood_reaches_the_bound_from_nine_sensors_on() {
    let upright = MagnetPose { position_world_m: Vector3::new(0.0, 0.0, 0.25), axis_world: Vector3::z() };
    let slanted = MagnetPose {
        position_world_m: Vector3::new(0.1, -0.15, 0.3),
        axis_world: Vector3::new(1.0, 1.0, 1.0).normalize(),
    };
    let trials = trials();
    // The norm has at least two degrees of freedom (a = b carry it): standard error of an RMS ratio 1/√(2·2·trials).
    let allowed = 0.03 + 2.0 / (4.0 * trials as f64).sqrt();
    for (side, truth) in [(3, &upright), (4, &upright), (4, &slanted), (6, &upright), (10, &upright)] {
        let (ratio, chi_square) = error_over_bound(side, truth, trials);
        println!(
            "figure: maximum likelihood, N = {:3}, {trials} trials: RMSE over bound {ratio:.4}, chi-square {chi_square:.4}",
            side * side
        );
        assert!((ratio - 1.0).abs() < allowed, "N = {}: {ratio}", side * side);
        // Standard error of the mean: √(2/(dof·trials)) below 0.01 here.
        assert!((chi_square - 1.0).abs() < 0.03, "chi-square {chi_square}");
    }
}

#[test]
fn closed_form_without_noise_the_pose_is_found_to_rounding() {
    let channels = grid(4).channels(&Isometry3::identity());
    for i in 0..200 {
        let truth = magnet_of(&workspace_pose(&mut stream("exact", i)));
        let mut flux = Vec::new();
        channels.flux(&dipole(), &truth, &mut flux);
        let found = search(&channels, &dipole(), &flux, &both_ways(Vector3::new(0.0, 0.0, 0.2))).best;
        // The search stops a thousandth of a standard deviation from the end; the bound is below 7 mm here.
        assert!((found.magnet.position_world_m - truth.position_world_m).norm() < 7e-6, "pose {i}");
        assert!(found.chi_square < 1e-6);
    }
}

#[test]
fn cross_cylinder_and_dipole_agree_far_away() {
    let magnet = installed("array = \"plane-4x4\"", [0.0; 3]).magnet;
    let (dipole, cylinder) = (
        magnet.source(lumenav_magnetic::config::Law::Dipole),
        magnet.source(lumenav_magnetic::config::Law::Cylinder),
    );
    let channels = grid(4).channels(&Isometry3::identity());
    let truth =
        |height| MagnetPose { position_world_m: Vector3::new(0.03, -0.02, height), axis_world: Vector3::z() };
    let difference = |height: f64| {
        let (mut a, mut b) = (Vec::new(), Vec::new());
        channels.flux(&dipole, &truth(height), &mut a);
        channels.flux(&cylinder, &truth(height), &mut b);
        let largest = a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        a.iter().zip(&b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs())) / largest
    };
    // The first term they differ by falls with the square of the distance.
    let (near, far) = (difference(1.0), difference(10.0));
    assert!(near < 1e-4 && (far / near - 1e-2).abs() < 2e-3, "{near:e} {far:e}");
    // And the pose that the dipole finds from the cylinder's readings is a tenth of a millimetre away at 0.25 m.
    let mut flux = Vec::new();
    channels.flux(&cylinder, &truth(0.25), &mut flux);
    let found = search(&channels, &dipole, &flux, &[truth(0.24)]).best;
    assert!((found.magnet.position_world_m - truth(0.25).position_world_m).norm() < 1e-4);
}

#[test]
fn regress_a_stiff_start_is_not_taken_for_the_end() {
    // A start 5 m away: the first steps are strongly damped and gain almost nothing; that is not convergence.
    let channels = grid(4).channels(&Isometry3::identity());
    let truth = MagnetPose { position_world_m: Vector3::new(0.05, 0.0, 0.15), axis_world: Vector3::x() };
    let mut flux = Vec::new();
    channels.flux(&dipole(), &truth, &mut flux);
    let (valid, variance) = (vec![true; 48], vec![SIGMA_TESLA.powi(2); 48]);
    let readings = Readings {
        flux_tesla: &flux,
        valid: &valid,
        variance_tesla2: &variance,
        unknown: Unknown::default(),
        prior: LinearPrior::NONE,
    };
    let mut random = stream("far", 0);
    for _ in 0..300 {
        let start =
            MagnetPose { position_world_m: direction(&mut random) * 5.0, axis_world: direction(&mut random) };
        let found = solve(&channels, &dipole(), readings, &start, &mut Workspace::default());
        if found.converged {
            let gradient_left = found.chi_square.min(1.0);
            let near = (found.magnet.position_world_m - truth.position_world_m).norm() < 1e-4;
            // Either the truth, or a true local minimum whose χ² says that it is none.
            assert!(near || found.chi_square > 1e3, "{gradient_left} {found:?}");
        }
    }
}

/// A magnet 3 % stronger than the model says, in half the Earth's field: solved for with the pose, its error is that of the bound with
/// as much unknown; taken for known, it is not. 150 readings at each of three poses.
#[test]
fn law_an_unknown_strength_and_field_are_solved_for_at_their_bound() {
    let channels = grid(4).channels(&Isometry3::identity());
    let ambient = Vector3::new(1.2e-5, -2.0e-5, 0.8e-5);
    let FieldSource::Dipole { strength_t_m3 } = dipole() else { panic!("a dipole") };
    let stronger = FieldSource::Dipole { strength_t_m3: 1.03 * strength_t_m3 };
    let unknown = Unknown { strength: true, ambient: true };
    // Opposite axes are one start where the strength's sign is solved for; and a far, strong magnet is a valley of its own.
    let places = [[0.0, 0.0], [0.15, 0.15], [0.15, -0.15], [-0.15, 0.15], [-0.15, -0.15]];
    let starts: Vec<MagnetPose> = places
        .into_iter()
        .flat_map(|[x, y]| {
            [Vector3::x(), Vector3::y(), Vector3::z()]
                .map(|axis_world| MagnetPose { position_world_m: Vector3::new(x, y, 0.2), axis_world })
        })
        .collect();
    let mut squared = 0.0;
    let mut trials = 0.0;
    for pose in 0..3 {
        let truth = magnet_of(&workspace_pose(&mut stream("unknown-pose", pose)));
        for trial in 0..150 {
            let mut flux =
                noisy(&channels, &stronger, &truth, SIGMA_TESLA, &mut stream("unknown", 1000 * pose + trial));
            for (z, channel) in flux.iter_mut().zip(&channels.channels) {
                *z += ambient.dot(&channel.axis_world);
            }
            let (valid, variance) = (vec![true; flux.len()], vec![SIGMA_TESLA.powi(2); flux.len()]);
            let readings = Readings {
                flux_tesla: &flux,
                valid: &valid,
                variance_tesla2: &variance,
                unknown,
                prior: LinearPrior::NONE,
            };
            let found = solve_from_all(&channels, &dipole(), readings, &starts, &mut Workspace::default())
                .unwrap()
                .best;
            assert!(found.converged, "pose {pose}, trial {trial}");
            assert_eq!(found.freedom, 9);
            let error = found.magnet.position_world_m - truth.position_world_m;
            let turn = found.magnet.axis_world - truth.axis_world;
            let (e1, e2) = lumenav_core::pose::tangent_basis(&found.magnet.axis_world);
            let error =
                nalgebra::SVector::<f64, 5>::from([error.x, error.y, error.z, turn.dot(&e1), turn.dot(&e2)]);
            squared += error.dot(&(found.information * error)) / 5.0;
            trials += 1.0;
            assert!((found.strength / 1.03 - 1.0).abs() < 0.2, "{}", found.strength);
            assert!((found.ambient_tesla - ambient).norm() < 3e-7, "{:?}", found.ambient_tesla);
            if trial == 0 {
                let blind = Readings { unknown: Unknown::default(), ..readings };
                let fooled =
                    solve_from_all(&channels, &dipole(), blind, &starts, &mut Workspace::default()).unwrap();
                assert!(fooled.best.reduced_chi_square() > 100.0);
            }
        }
    }
    let nees = squared / trials;
    println!("figure: NEES/dof with strength and field unknown {nees:.3}");
    // Standard error √(2/5/450) = 3 %.
    assert!((nees - 1.0).abs() < 0.09, "{nees}");
}

/// The information with a strength that is unknown is that of the bound.
#[test]
fn law_the_information_is_that_of_the_bound_with_as_much_unknown() {
    let channels = grid(4).channels(&Isometry3::identity());
    for pose in 0..20 {
        let truth = magnet_of(&workspace_pose(&mut stream("unknown-bound", pose)));
        let mut flux = Vec::new();
        channels.flux(&dipole(), &truth, &mut flux);
        let (valid, variance) = (vec![true; flux.len()], vec![SIGMA_TESLA.powi(2); flux.len()]);
        let unknown = Unknown { strength: true, ambient: false };
        let readings = Readings {
            flux_tesla: &flux,
            valid: &valid,
            variance_tesla2: &variance,
            unknown,
            prior: LinearPrior::NONE,
        };
        let found = solve(&channels, &dipole(), readings, &truth, &mut Workspace::default());
        let covariance = found.information.cholesky().unwrap().inverse();
        let ours = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let wanted = bound(&channels, &dipole(), &truth, SIGMA_TESLA, false).unwrap().position_m2;
        assert!((ours - wanted).norm() < 1e-6 * wanted.norm(), "pose {pose}");
        assert!((found.strength - 1.0).abs() < 1e-9);
    }
}
