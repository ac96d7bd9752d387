//! The laws of the seam: derivatives, information, units; and core's model of a fix, which this plugin's fixes use.

use super::support::*;
use lumenav_core::fix::FixModel;
use lumenav_core::laws::{check_information, check_model, check_units};
use lumenav_core::pose::{exp_so3, oplus};
use lumenav_core::{
    FixKind, Frame, Linearization, Measurement, MeasurementModel, Name, Noise, NominalState, PoseEstimate,
    PriorUse, SimTime,
};
use lumenav_fields::FieldSource;
use lumenav_magnetic::channels::MagnetPose;
use lumenav_magnetic::config::Law;
use lumenav_magnetic::model::{FixOfFlux, FluxModel};
use lumenav_magnetic::sensor::flux_schema;
use nalgebra::{DMatrix, Isometry3, Matrix6, Vector3, Vector6};
use std::f64::consts::PI;
use std::sync::Arc;

fn measurement(value: Frame, model: Arc<dyn MeasurementModel>) -> Measurement {
    Measurement {
        sensor: Name::from("array"),
        sequence: 0,
        at: SimTime::ZERO,
        arrival: SimTime::ZERO,
        since: None,
        value: Arc::new(value),
        model,
        prior_use: PriorUse::None,
        fix: None,
        motion: None,
    }
}

/// Attitudes near no turn and near half a turn beside random ones.
fn state(index: u64) -> Isometry3<f64> {
    let mut random = stream("state", index);
    let pose = workspace_pose(&mut random);
    let angle = match index % 5 {
        0 => 1e-9,
        1 => 1e-4,
        2 => PI - 1e-4,
        3 => PI - 1e-9,
        _ => return pose,
    };
    Isometry3::from_parts(pose.translation, exp_so3(&(direction(&mut random) * angle)))
}

fn flux_model(source: FieldSource, offset_capsule_m: Vector3<f64>) -> FluxModel {
    FluxModel {
        channels: Arc::new(grid(4).channels(&Isometry3::identity())),
        source,
        offset_capsule_m,
        noise_tesla: SIGMA_TESLA,
        relative_error: 0.01,
        unknown: lumenav_magnetic::solver::Unknown::default(),
        prior: lumenav_magnetic::solver::LinearPrior::NONE,
        nuisance: Arc::default(),
    }
}

fn sources() -> [FieldSource; 2] {
    let magnet = installed("array = \"plane-4x4\"", [0.0; 3]).magnet;
    [magnet.source(Law::Dipole), magnet.source(Law::Cylinder)]
}

/// A reading at a pose near the state, every third channel lost where asked.
fn flux_measurement(model: &FluxModel, pose: &Isometry3<f64>, masked: bool, index: u64) -> Measurement {
    let magnet = MagnetPose::of_capsule(pose, &model.offset_capsule_m);
    let mut flux =
        noisy(&model.channels, &model.source, &magnet, SIGMA_TESLA, &mut stream("law noise", index));
    if masked {
        flux.iter_mut().step_by(3).for_each(|z| *z = f64::NAN);
    }
    let frame = Frame::of_values(flux_schema(grid(4).labels()), flux).unwrap();
    measurement(frame, Arc::new(model.clone()))
}

#[test]
fn law_flux_derivatives_are_those_of_central_differences() {
    for source in sources() {
        for offset_mm in [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [3.0, -2.0, 1.5]] {
            let model = flux_model(source, Vector3::from(offset_mm) * 1e-3);
            for index in 0..100 {
                let pose = state(index);
                let measurement = flux_measurement(&model, &pose, index % 2 == 1, index);
                check_model(&model, &measurement, &NominalState::at_rest(pose), 1e-6).unwrap();
            }
        }
    }
}

/// A pose that a fix with this error would come from.
fn fix(kind: FixKind, pose: &Isometry3<f64>, largest_rad: f64, index: u64) -> PoseEstimate {
    let mut random = stream("fix", index);
    let (shift, turn) =
        (direction(&mut random) * 5e-3, direction(&mut random) * uniform(&mut random, 0.0..largest_rad));
    let error = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
    let mut covariance = Matrix6::from_diagonal(&Vector6::new(1e-6, 2e-6, 3e-6, 1e-4, 2e-4, 3e-4));
    let unknown = match kind {
        FixKind::Position => vec![3, 4, 5],
        FixKind::Pointing => vec![3],
        FixKind::Full => vec![],
    };
    for i in unknown {
        covariance.row_mut(i).fill(0.0);
        covariance.column_mut(i).fill(0.0);
    }
    PoseEstimate { world_from_capsule: oplus(pose, &error), covariance, kind }
}

#[test]
fn law_fix_derivatives_are_those_of_central_differences_up_to_a_radian() {
    for kind in [FixKind::Position, FixKind::Pointing, FixKind::Full] {
        for index in 0..150 {
            let pose = state(index);
            let measurement = measurement(fix(kind, &pose, 1.0, index).to_frame(), Arc::new(FixModel));
            check_model(&FixModel, &measurement, &NominalState::at_rest(pose), 1e-6)
                .unwrap_or_else(|error| panic!("{kind:?}, state {index}: {error}"));
        }
    }
}

#[test]
fn law_fix_of_flux_has_the_derivatives_of_a_fix_and_the_information_of_the_flux() {
    let model = flux_model(dipole(), Vector3::zeros());
    for index in 0..100 {
        let pose = state(index);
        let raw = flux_measurement(&model, &pose, false, index);
        let of_flux = FixOfFlux { flux: model.clone(), reading: raw.value.clone() };
        let as_fix =
            measurement(fix(FixKind::Pointing, &pose, 0.1, index).to_frame(), Arc::new(of_flux.clone()));
        let state = NominalState::at_rest(pose);
        check_model(&of_flux, &as_fix, &state, 1e-6).unwrap();
        let (ours, theirs) = (
            of_flux.expected_information(&as_fix, &state).unwrap(),
            model.expected_information(&raw, &state).unwrap(),
        );
        assert_eq!(ours, theirs);
    }
}

/// Score times its transpose: its mean over noise is the Fisher information.
fn realised_information(model: &FluxModel, measurement: &Measurement, state: &NominalState) -> DMatrix<f64> {
    let Linearization::Residual { residual, jacobian, noise: Noise::Diagonal(variance) } =
        model.linearize(measurement, state).unwrap()
    else {
        panic!("flux is a residual with independent channels");
    };
    let score = jacobian[0].1.transpose() * residual.component_div(&variance);
    &score * score.transpose()
}

#[test]
fn law_expected_information_is_the_mean_of_the_realised() {
    for source in sources() {
        for masked in [false, true] {
            // Without relative error, whose variance depends on the reading and not on the prediction.
            let model = FluxModel { relative_error: 0.0, ..flux_model(source, Vector3::new(6e-3, 0.0, 0.0)) };
            let pose = state(4);
            let state = NominalState::at_rest(pose);
            let realised: Vec<DMatrix<f64>> = (0..20_000)
                .map(|i| realised_information(&model, &flux_measurement(&model, &pose, masked, i), &state))
                .collect();
            let first = flux_measurement(&model, &pose, masked, 0);
            let expected = model.expected_information(&first, &state).unwrap().unwrap();
            // Units differ between the blocks: compared after scaling to a unit diagonal. Rank 5: nothing is known of the roll.
            let scale: Vec<f64> = (0..6).map(|i| expected[(i, i)].max(1e-30).sqrt().recip()).collect();
            let scaled =
                |m: &DMatrix<f64>| {
                    DMatrix::from_fn(6, 6, |i, j| {
                        if i == 3 || j == 3 { 0.0 } else { m[(i, j)] * scale[i] * scale[j] }
                    })
                };
            assert!(expected[(3, 3)] <= 1e-20 * expected[(4, 4)], "the roll is unobservable");
            let realised: Vec<DMatrix<f64>> = realised.iter().map(scaled).collect();
            // Standard error of an element is about √(2/20000) = 0.01, of the norm's ratio a few times that.
            check_information(&scaled(&expected), &realised, 0.05).unwrap();
        }
    }
}

#[test]
fn law_every_channel_has_a_unit() {
    check_units(&flux_schema(grid(4).labels())).unwrap();
}

#[test]
fn law_a_reading_of_another_array_is_an_error() {
    let model = flux_model(dipole(), Vector3::zeros());
    let frame = Frame::of_values(flux_schema(grid(3).labels()), vec![0.0; 27]).unwrap();
    let measurement = measurement(frame, Arc::new(model.clone()));
    let error = model.linearize(&measurement, &NominalState::at_rest(Isometry3::identity())).unwrap_err();
    assert!(error.to_string().contains("27 flux readings"), "{error}");
}
