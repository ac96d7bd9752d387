//! The laws every plugin obeys, and this one's own physics.

#![expect(clippy::disallowed_types, reason = "world side: the determinism law drives a sensor with a truth")]

use lumenav_beacons::physics::{SOUND_M_S, locate, time_of_flight_s};
use lumenav_beacons::{Beacons, Installed};
use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use lumenav_core::laws::{check_model, check_sensor_is_deterministic, check_units};
use lumenav_core::{
    CapsuleBody, CapsuleTruth, FixKind, Linearization, Measurement, Modality as _, ModelFolder, Name, Node,
    NominalState, Outcome, RandomStreams, Schedule, Setup, SimTime, TruthView,
};
use nalgebra::{DVector, Isometry3, Vector3};
use std::ops::Range;
use std::path::Path;

struct Still(Isometry3<f64>);

impl TruthView for Still {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..SimTime::from_seconds(100.0)
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        CapsuleTruth {
            at,
            world_from_capsule: self.0,
            velocity_world_m_s: Vector3::zeros(),
            angular_rate_capsule_rad_s: Vector3::zeros(),
            specific_force_capsule_m_s2: Vector3::new(0.0, 9.81, 0.0),
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        }
    }

    fn frame(&self, _name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        None
    }
}

fn node(text: &str) -> Node {
    Node::parse_text(text, "test.toml", Path::new("."), &[]).unwrap()
}

fn installed() -> Node {
    node(
        "beacons_world_mm = [[150, 0, 0], [-150, 20, 0], [0, 160, 30], [10, -150, 80], [0, 0, -170]]\nsigma_us = 1.0",
    )
}

fn setup() -> Setup {
    Setup {
        sensor: "pingers".into(),
        schedule: Some(Schedule {
            rate_hz: Positive(20.0),
            start_s: NonNegative(0.0),
            latency_ms: NonNegative(5.0),
            loss: Fraction(0.1),
        }),
        capsule: CapsuleBody { radius_m: 5.5e-3, length_m: 26e-3, mass_kg: 4e-3 },
        capsule_model: node(""),
        models: ModelFolder::new("models"),
        map: None,
    }
}

const TRUE_POSITION_M: Vector3<f64> = Vector3::new(0.02, -0.03, 0.05);

/// The first measurement of the plugin's own sensor through its own front end.
fn measurement(reality: &str) -> Measurement {
    let mut sensor = Beacons.sensor(&installed(), &node(reality), &setup()).unwrap();
    let truth = Still(Isometry3::new(TRUE_POSITION_M, Vector3::new(0.1, 0.2, 0.3)));
    let streams = RandomStreams::new(1, 0, "pingers");
    let observed = loop {
        let at = sensor.next_due();
        if let Some(observation) = sensor.observe(&truth, at, &streams).unwrap() {
            break observation;
        }
    };
    assert_eq!(observed.reading.arrival, observed.reading.interval.1 + 5_000_000);
    let mut front_end = Beacons.estimator(&installed(), &node(""), &setup()).unwrap().front_end.unwrap();
    assert_eq!(front_end.blocks()[0].name, Name::from("pingers.speed_unit"));
    match front_end.process(&observed.reading, None).unwrap() {
        Outcome::Measured(mut all) => all.remove(0),
        other => panic!("{other:?}"),
    }
}

#[test]
fn law_model_derivatives_are_central_differences() {
    let mut m = measurement("");
    for turn in [0.0, 1e-9, 1.0, std::f64::consts::PI - 1e-7] {
        let mut state =
            NominalState::at_rest(Isometry3::new(TRUE_POSITION_M * 1.1, Vector3::new(turn, 0.0, 0.0)));
        state.blocks.insert("pingers.speed_unit".into(), DVector::from_element(1, 0.03));
        check_model(m.model.as_ref(), &m, &state, 1e-6).unwrap();
        // Known nuisance: the information about the pose is Hᵀ R⁻¹ H.
        let expected = m.model.expected_information(&m, &state).unwrap().unwrap();
        let Linearization::Residual { jacobian, .. } = m.model.linearize(&m, &state).unwrap() else {
            panic!("times of flight have a residual")
        };
        let h = &jacobian[0].1 / 1e-6;
        assert!((h.transpose() * h - &expected).amax() < 1e-9 * expected.amax());
    }
    // A lost beacon is left out, never a zero.
    let state = NominalState {
        blocks: [(Name::from("pingers.speed_unit"), DVector::zeros(1))].into(),
        ..NominalState::at_rest(Isometry3::identity())
    };
    std::sync::Arc::make_mut(&mut m.value).mask_row(2);
    let Linearization::Residual { residual, .. } = m.model.linearize(&m, &state).unwrap() else {
        panic!("times of flight have a residual")
    };
    assert_eq!(residual.len(), 4);
    assert!(m.model.linearize(&m, &NominalState::at_rest(Isometry3::identity())).is_err());
}

#[test]
fn law_sensor_is_deterministic_and_its_columns_have_units() {
    let truth = Still(Isometry3::new(TRUE_POSITION_M, Vector3::zeros()));
    let build = || Beacons.sensor(&installed(), &node(""), &setup()).unwrap();
    check_sensor_is_deterministic(&build, &truth, "pingers", 30).unwrap();
    check_units(&Installed::from_node(&installed()).unwrap().schema).unwrap();
}

#[test]
fn closed_form_a_pulse_needs_650_nanoseconds_per_millimetre() {
    let time_s = time_of_flight_s(&Vector3::new(0.1, 0.0, 0.0), &Vector3::zeros(), 0.0);
    assert!((time_s - 0.1 / SOUND_M_S).abs() < 1e-18);
    assert!((time_s * 1e9 / 100.0 - 649.35).abs() < 0.01);
}

#[test]
fn law_exact_times_give_the_position_and_noisy_ones_a_fix_that_knows_its_error() {
    let beacons = Installed::from_node(&installed()).unwrap().beacons_world_m;
    let exact: Vec<_> = beacons.iter().map(|b| (*b, time_of_flight_s(&TRUE_POSITION_M, b, 0.0))).collect();
    let (position, _) = locate(&exact, 1e-6).unwrap();
    assert!((position - TRUE_POSITION_M).norm() < 1e-12);
    assert!(locate(&exact[..3], 1e-6).is_none());
    let flat: Vec<_> = exact.iter().map(|(b, t)| (Vector3::new(b.x, b.y, 0.0), *t)).collect();
    assert!(locate(&flat, 1e-6).is_none());
    let fix = measurement("").fix.unwrap();
    assert_eq!(fix.kind, FixKind::Position);
    let error = fix.world_from_capsule.translation.vector - TRUE_POSITION_M;
    let covariance = fix.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    // Chi-square with 3 degrees of freedom at 0.9999.
    assert!(error.dot(&covariance.cholesky().unwrap().solve(&error)) < 21.1);
}

#[test]
fn law_a_users_mistake_is_named_with_its_line() {
    let refused = |installed: &str, reality: &str| {
        Beacons.sensor(&node(installed), &node(reality), &setup()).err().unwrap().to_string()
    };
    let message = refused("beacons_world_mm = []\nsigma_us = 1.0", "");
    assert!(message.contains("test.toml:1") && message.contains("at least one beacon"), "{message}");
    assert!(refused("beacons_world_mm = [[0, 0, 0]]\nsigma_us = -1.0", "").contains("test.toml:2"));
    assert!(
        refused("beacons_world_mm = [[0, 0, 0]]\nsigma_us = 1.0", "speed_ratio = -1.5").contains("above -1")
    );
}
