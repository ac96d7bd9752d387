//! What is unknown beside the pose: carried by the filter, or taken out of each reading.

use super::support::*;
use lumenav_core::laws::check_model;
use lumenav_core::{
    FrontEnd, Instant, Linearization, Measurement, MeasurementModel, Name, Noise, NominalState, Outcome, Part,
};
use lumenav_magnetic::channels::MagnetPose;
use lumenav_magnetic::config::OptionsTable;
use lumenav_magnetic::front_end::MagneticFrontEnd;
use lumenav_magnetic::model::FluxModel;
use lumenav_magnetic::nuisance::{Nuisance, Spread, Unknowns};
use lumenav_magnetic::solver::{AmbientPrior, Unknown};
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

fn model(unknowns: &Unknowns, unknown: Unknown, ambient: AmbientPrior) -> FluxModel {
    let channels = Arc::new(grid(3).channels(&Isometry3::identity()));
    FluxModel {
        nuisance: Arc::new(Nuisance::new("array", channels.len(), unknowns)),
        channels,
        source: dipole(),
        offset_capsule_m: Vector3::new(2e-3, -1e-3, 0.5e-3),
        noise_tesla: SIGMA_TESLA,
        relative_error: 0.0,
        unknown,
        ambient,
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
    let told = AmbientPrior { mean_tesla: Vector3::new(1e-6, 2e-6, -1e-6), information: known };
    let free = Unknown { strength: false, ambient: true };
    let carried = Unknowns { ambient_tesla: None, ..all_unknown() };
    for (unknowns, unknown, ambient) in [
        (all_unknown(), Unknown::default(), AmbientPrior::NONE),
        (carried, free, AmbientPrior::NONE),
        (carried, free, told),
        (Unknowns::default(), free, AmbientPrior::NONE),
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

/// Differences between channels see no uniform field, and lose of the information what a free field costs; a field that reference sensors
/// tell costs less, and one told to a picotesla nothing.
#[test]
fn law_an_ambient_field_taken_out_costs_what_its_information_says() {
    let free = Unknown { strength: false, ambient: true };
    for index in 0..20 {
        let pose = workspace_pose(&mut stream("ambient-pose", index));
        let state = NominalState::at_rest(pose);
        let of = |information: f64| {
            let prior = AmbientPrior { information: Matrix3::identity() * information, ..AmbientPrior::NONE };
            model(&Unknowns::default(), free, prior)
        };
        let differences = of(0.0);
        let quiet = measured(&differences, &pose, &Vector3::zeros(), index);
        let noisy = measured(&differences, &pose, &Vector3::new(4e-5, -2e-5, 3e-5), index);
        let (without, by_pose) = residual(&differences, &quiet, &state);
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
        let known = model(&Unknowns::default(), Unknown::default(), AmbientPrior::NONE);
        let known = residual(&known, &quiet, &state).1.norm_squared();
        assert!(traces[0] < traces[1] && traces[1] < known * (1.0 + 1e-12), "{traces:?} {known}");
        assert!((traces[2] / known - 1.0).abs() < 1e-6, "{traces:?} {known}");
        drop(by_pose);
    }
}

/// A reference sensor 0.6 m away tells a field of half the Earth's: the pose is that of the quiet reading within its covariance, where
/// without it there is no pose or a wrong one.
#[test]
fn law_reference_sensors_take_the_ambient_field_away() {
    let text = std::fs::read_to_string(models().join("sensor-arrays/belt-16-reference.toml")).unwrap();
    let array = lumenav_magnetic::array::SensorArray::from_node(&node(&text)).unwrap();
    let installed =
        installed("array = \"belt-16-reference\"\nsaturation = false\nquantization = false\n", [0.0; 3]);
    let channels = array.channels(&Isometry3::identity());
    let ambient = Vector3::new(1.5e-5, -2.0e-5, 0.5e-5);
    let mut worst: f64 = 0.0;
    for index in 0..20 {
        let mut random = stream("reference", index);
        let pose = Isometry3::from_parts(
            Vector3::new(
                uniform(&mut random, -0.1..0.1),
                uniform(&mut random, -0.06..0.06),
                uniform(&mut random, -0.1..0.02),
            )
            .into(),
            attitude(&mut random),
        );
        let magnet = magnet_of(&pose);
        let mut flux = noisy(
            &channels,
            &installed.magnet.source(lumenav_magnetic::config::Law::Cylinder),
            &magnet,
            SIGMA_TESLA,
            &mut random,
        );
        for (z, channel) in flux.iter_mut().zip(&channels.channels) {
            *z += channel.axis_world.dot(&ambient);
        }
        for cancel in ["reference", "differences"] {
            let options = OptionsTable::from_node(&node(&format!("ambient = \"{cancel}\""))).unwrap();
            let mut front_end = MagneticFrontEnd::new(Name::from("array"), &installed, &options);
            let outcome = front_end.process(&reading(&array, flux.clone()), None).unwrap();
            let Outcome::Measured(found) = outcome else { panic!("{cancel}, reading {index}: {outcome:?}") };
            let fix = found[0].fix.as_ref().unwrap();
            let error = fix.world_from_capsule.translation.vector - pose.translation.vector;
            let covariance: Matrix3<f64> = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
            worst = worst.max(error.dot(&(covariance.cholesky().unwrap().solve(&error))));
        }
        let options = OptionsTable::from_node(&node("")).unwrap();
        let mut blind = MagneticFrontEnd::new(Name::from("array"), &installed, &options);
        let outcome = blind.process(&reading(&array, flux), None).unwrap();
        assert!(matches!(outcome, Outcome::Refused { .. }), "{outcome:?}");
    }
    println!("figure: largest squared normalised position error of 40 {worst:.2}");
    // 3 degrees of freedom, 40 draws: beyond 25 once in 1,500.
    assert!(worst < 25.0, "{worst}");
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
    assert!(error.to_string().contains("has no reference sensors"), "{error}");
}
