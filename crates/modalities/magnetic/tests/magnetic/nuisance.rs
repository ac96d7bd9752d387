//! What is unknown beside the pose: carried by the filter, or taken out of each reading.

use super::support::*;
use lumenav_core::laws::check_model;
use lumenav_core::{
    FrontEnd, Instant, Linearization, Measurement, MeasurementModel, Name, Noise, NominalState, Outcome, Part,
};
use lumenav_magnetic::array::{Axes, Magnetometer};
use lumenav_magnetic::channels::MagnetPose;
use lumenav_magnetic::config::OptionsTable;
use lumenav_magnetic::front_end::MagneticFrontEnd;
use lumenav_magnetic::model::FluxModel;
use lumenav_magnetic::nuisance::{Nuisance, Spread, Unknowns};
use lumenav_magnetic::solver::{LinearPrior, Unknown};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};
use std::sync::Arc;

fn all_unknown() -> Unknowns {
    let spread = |sigma: f64| Some(Spread { sigma, walk: 0.0 });
    Unknowns {
        strength: spread(0.1),
        ambient_tesla: spread(5e-5),
        bias_tesla: spread(1e-7),
        gain: spread(0.01),
        axis_rad: spread(0.017),
    }
}

fn model(unknowns: &Unknowns, unknown: Unknown, prior: LinearPrior) -> FluxModel {
    let channels = Arc::new(grid(3).channels(&Isometry3::identity()));
    FluxModel {
        nuisance: Arc::new(Nuisance::new("array", channels.len(), unknowns)),
        channels,
        source: dipole(),
        offset_capsule_m: Vector3::new(2e-3, -1e-3, 0.5e-3),
        noise_tesla: SIGMA_TESLA,
        relative_error: 0.0,
        unknown,
        prior,
    }
}

fn measured(model: &FluxModel, pose: &Isometry3<f64>, ambient: &Vector3<f64>, index: u64) -> Measurement {
    let magnet = MagnetPose::of_capsule(pose, &model.offset_capsule_m);
    let mut flux =
        noisy(&model.channels, &model.source, &magnet, SIGMA_TESLA, &mut stream("nuisance", index));
    for (z, channel) in flux.iter_mut().zip(&model.channels.channels) {
        *z += channel.axis_world.dot(ambient);
    }
    Measurement::of_reading(&reading(&grid(3), flux), Arc::new(model.clone()))
}

/// A state with every block somewhere within its prior.
fn state(model: &FluxModel, pose: Isometry3<f64>, index: u64) -> NominalState {
    let mut random = stream("blocks", index);
    let mut state = NominalState::at_rest(pose);
    for spec in model.blocks() {
        let values = DVector::from_fn(spec.initial.len(), |i, _| {
            spec.initial[i] + spec.initial_sigma[i] * normal(&mut random)
        });
        state.blocks.insert(spec.name.clone(), values);
    }
    state
}

#[test]
fn law_derivatives_by_what_is_carried_are_those_of_central_differences() {
    let known = Matrix3::from_diagonal(&Vector3::new(1e16, 2e15, 3e14));
    let told = LinearPrior { ambient: known, ..LinearPrior::NONE };
    let free = Unknown { strength: false, ambient: true };
    let carried = Unknowns { ambient_tesla: None, ..all_unknown() };
    for (unknowns, unknown, ambient) in [
        (all_unknown(), Unknown::default(), LinearPrior::NONE),
        (carried, free, LinearPrior::NONE),
        (carried, free, told),
        (Unknowns::default(), free, LinearPrior::NONE),
    ] {
        let model = model(&unknowns, unknown, ambient);
        for index in 0..20 {
            let pose = workspace_pose(&mut stream("nuisance-pose", index));
            let measurement = measured(&model, &pose, &Vector3::new(3e-6, 0.0, 1e-6), index);
            check_model(&model, &measurement, &state(&model, pose, index), 1e-6)
                .unwrap_or_else(|error| panic!("{unknowns:?}: {error}"));
        }
    }
}

fn residual(
    model: &FluxModel,
    measurement: &Measurement,
    state: &NominalState,
) -> (DVector<f64>, DMatrix<f64>) {
    let Linearization::Residual { residual, jacobian, noise: Noise::Diagonal(variance) } =
        model.linearize(measurement, state).unwrap()
    else {
        panic!("a residual with independent noise")
    };
    let (part, mut by_pose) = jacobian.into_iter().next().unwrap();
    assert_eq!(part, Part::Pose(Instant::Now));
    for (row, v) in variance.iter().enumerate() {
        by_pose.row_mut(row).scale_mut(1.0 / v.sqrt());
    }
    (residual.component_div(&variance.map(f64::sqrt)), by_pose)
}

/// Differences between channels see no uniform field, and lose of the information what a free field costs; a field that is known
/// beforehand costs less, and one told to a picotesla nothing.
#[test]
fn law_an_ambient_field_taken_out_costs_what_its_information_says() {
    let free = Unknown { strength: false, ambient: true };
    for index in 0..20 {
        let pose = workspace_pose(&mut stream("ambient-pose", index));
        let state = NominalState::at_rest(pose);
        let of = |information: f64| {
            let prior = LinearPrior { ambient: Matrix3::identity() * information, ..LinearPrior::NONE };
            model(&Unknowns::default(), free, prior)
        };
        let differences = of(0.0);
        let quiet = measured(&differences, &pose, &Vector3::zeros(), index);
        let noisy = measured(&differences, &pose, &Vector3::new(4e-5, -2e-5, 3e-5), index);
        let (without, _) = residual(&differences, &quiet, &state);
        let (with, _) = residual(&differences, &noisy, &state);
        assert_eq!(without.len(), 27 - 3);
        assert!((&without - &with).amax() < 1e-6, "{}", (&without - &with).amax());
        let mut traces = Vec::new();
        for model in [&differences, &of(1e15), &of(1e24)] {
            let (_, by_pose) = residual(model, &quiet, &state);
            let seen = by_pose.tr_mul(&by_pose);
            let expected = model.expected_information(&quiet, &state).unwrap().unwrap();
            let scale = DMatrix::from_diagonal(&seen.diagonal().map(|v| v.max(1.0).sqrt().recip()));
            let apart = (&scale * (seen - expected) * &scale).amax();
            assert!(apart < 1e-6, "{apart}");
            traces.push(by_pose.norm_squared());
        }
        let known = model(&Unknowns::default(), Unknown::default(), LinearPrior::NONE);
        let known = residual(&known, &quiet, &state).1.norm_squared();
        assert!(traces[0] < traces[1] && traces[1] < known * (1.0 + 1e-12), "{traces:?} {known}");
        assert!((traces[2] / known - 1.0).abs() < 1e-6, "{traces:?} {known}");
    }
}

fn front_end(installed: &lumenav_magnetic::config::Installed, options: &str) -> MagneticFrontEnd {
    let options = OptionsTable::from_node(&node(options)).unwrap();
    MagneticFrontEnd::new(Name::from("array"), installed, &options)
}

/// Two triads near the magnet and two far from it, in half the Earth's field. The near ones alone have too few channels for pose and field;
/// with the far ones there is a pose, as wrong as it claims. Taken for known, the field leaves no pose at all.
#[test]
fn law_reference_sensors_take_the_ambient_field_away() {
    let place = |p: [f64; 3], reference: bool| {
        let pose = nalgebra::Translation3::from(Vector3::from(p)).into();
        Magnetometer { pose, axes: Axes::Xyz, reference }
    };
    let mut installed =
        installed("array = \"plane-4x4\"\nsaturation = false\nquantization = false\n", [0.0; 3]);
    let near = [[0.1, 0.0, 0.0], [-0.05, 0.09, 0.02], [-0.05, -0.09, -0.02]];
    installed.array.sensors = near.iter().map(|p| place(*p, false)).collect();
    let few = installed.clone();
    installed.array.sensors.extend([[0.5, 0.1, 0.2], [-0.5, 0.2, 0.3]].map(|p| place(p, true)));
    assert!(installed.array.reference_tells_all() && !few.array.reference_tells_all());
    let source = installed.magnet.source(lumenav_magnetic::config::Law::Cylinder);
    let ambient = Vector3::new(1.5e-5, -2.0e-5, 0.5e-5);
    let (mut squared, mut found, mut alone) = (0.0, 0, 0.0_f64);
    for index in 0..60 {
        let mut random = stream("reference", index);
        let at = Vector3::from_fn(|_, _| uniform(&mut random, -0.02..0.02));
        let pose = Isometry3::from_parts(at.into(), attitude(&mut random));
        let reading_of = |installed: &lumenav_magnetic::config::Installed, random: &mut _| {
            let channels = installed.array.channels(&Isometry3::identity());
            let mut flux = noisy(&channels, &source, &magnet_of(&pose), SIGMA_TESLA, random);
            for (z, channel) in flux.iter_mut().zip(&channels.channels) {
                *z += channel.axis_world.dot(&ambient);
            }
            reading(&installed.array, flux)
        };
        let with = reading_of(&installed, &mut random);
        match front_end(&installed, "ambient = \"reference\"").process(&with, None).unwrap() {
            Outcome::Measured(all) => {
                let fix = all[0].fix.as_ref().unwrap();
                let error = fix.world_from_capsule.translation.vector - at;
                let covariance: Matrix3<f64> = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
                squared += error.dot(&covariance.cholesky().unwrap().solve(&error)) / 3.0;
                found += 1;
                // The same channels without the far ones know the place several times worse, where they know it.
                let without = reading_of(&few, &mut random);
                if let Outcome::Measured(all) =
                    front_end(&few, "ambient = \"differences\"").process(&without, None).unwrap()
                {
                    let fix = all[0].fix.as_ref().unwrap();
                    alone += fix.covariance.fixed_view::<3, 3>(0, 0).trace() / covariance.trace();
                } else {
                    alone += 1e3;
                }
            }
            Outcome::Refused { why } => println!("{index}: {why}"),
            Outcome::Nothing => panic!("a reading of a magnet says something"),
        }
        let blind = front_end(&installed, "").process(&with, None).unwrap();
        assert!(matches!(blind, Outcome::Refused { .. }), "{blind:?}");
    }
    let (nees, gain) = (squared / f64::from(found), alone / f64::from(found));
    println!(
        "figure: {found} of 60 with a pose, NEES/dof {nees:.2}; variance without the far sensors {gain:.1} times"
    );
    // Standard error √(2/3/60) = 0.105.
    assert!(found > 50 && (nees - 1.0).abs() < 0.4 && gain > 2.0, "{found} {nees} {gain}");
}

/// Sensors that all read along z see one component of a field, and the other two take nothing away: bound, linearization and fixes are
/// those with that one component unknown.
#[test]
fn law_components_that_nothing_reads_take_nothing_away() {
    let mut installed =
        installed("array = \"plane-4x4\"\nsaturation = false\nquantization = false\n", [0.0; 3]);
    for sensor in &mut installed.array.sensors {
        sensor.axes = Axes::Z;
    }
    let upper: Vec<Magnetometer> = installed
        .array
        .sensors
        .iter()
        .map(|s| Magnetometer { pose: nalgebra::Translation3::new(0.06, 0.03, 0.4) * s.pose, ..s.clone() })
        .collect();
    installed.array.sensors.extend(upper);
    let channels = Arc::new(installed.array.channels(&Isometry3::identity()));
    let free = Unknown { strength: false, ambient: true };
    let model = FluxModel {
        channels: channels.clone(),
        nuisance: Arc::default(),
        source: dipole(),
        offset_capsule_m: Vector3::zeros(),
        noise_tesla: SIGMA_TESLA,
        relative_error: 0.0,
        unknown: free,
        prior: LinearPrior::NONE,
    };
    for index in 0..10 {
        let pose = workspace_pose(&mut stream("z-only", index));
        let flux = noisy(&channels, &dipole(), &magnet_of(&pose), SIGMA_TESLA, &mut stream("z-noise", index));
        let lifted: Vec<f64> = flux.iter().map(|z| z + 3e-5).collect();
        let measurement = Measurement::of_reading(&reading(&installed.array, flux), Arc::new(model.clone()));
        let state = NominalState::at_rest(pose);
        let (left, by_pose) = residual(&model, &measurement, &state);
        assert_eq!(left.len(), 31, "one component of the field, one row");
        let seen = by_pose.tr_mul(&by_pose);
        let expected = model.expected_information(&measurement, &state).unwrap().unwrap();
        let scale = DMatrix::from_diagonal(&seen.diagonal().map(|v| v.max(1.0).sqrt().recip()));
        let apart = (&scale * (&seen - &expected) * &scale).amax();
        assert!(apart < 1e-6 && seen.amax() > 0.0, "{apart}");
        let outcome = front_end(&installed, "ambient = \"differences\"\nlaw = \"dipole\"")
            .process(&reading(&installed.array, lifted), None)
            .unwrap();
        let Outcome::Measured(found) = outcome else { panic!("pose {index}: {outcome:?}") };
        let fix = found[0].fix.as_ref().unwrap();
        let error = fix.world_from_capsule.translation.vector - pose.translation.vector;
        let covariance: Matrix3<f64> = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let squared = error.dot(&covariance.cholesky().unwrap().solve(&error));
        assert!(squared < 25.0, "pose {index}: {squared}");
    }
}

#[test]
fn law_options_that_contradict_themselves_are_refused() {
    for (text, wanted) in [
        ("unknown_gain = true", "`unknown_gain`: `front_end = \"pose\"` keeps nothing"),
        ("ambient = \"estimated\"", "`ambient`: `front_end = \"pose\"` keeps nothing"),
        ("ambient = \"guessed\"", "`ambient`"),
        ("strength_sigma = 0.1", "`strength_sigma`: says how well something is known that is known"),
        ("unknown_strength = true\nstrength_sigma = 0.1", "`strength_sigma`"),
        ("front_end = \"flux\"\naxis_sigma_deg = 1", "set `unknown_axes = true` too"),
        (
            "front_end = \"flux\"\nambient = \"differences\"\nambient_walk_tesla = 1e-6",
            "`ambient = \"estimated\"`",
        ),
        ("front_end = \"flux\"\nunknown_bias = true\nbias_sigma_tesla = 0", "`bias_sigma_tesla`"),
    ] {
        let error = OptionsTable::from_node(&node(text)).unwrap_err().to_string();
        assert!(error.contains(wanted) && error.contains("test.toml:"), "{error}, wanted: {wanted}");
    }
    let error = lumenav_core::Modality::estimator(
        &lumenav_magnetic::Magnetic,
        &node("array = \"plane-4x4\""),
        &node("ambient = \"reference\""),
        &setup([0.0; 3]),
    );
    let Err(error) = error else { panic!("an array without reference sensors is accepted") };
    assert!(error.to_string().contains("do not tell all three components"), "{error}");
}
