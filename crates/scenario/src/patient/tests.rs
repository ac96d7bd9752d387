//! The patient against closed forms and finite differences.

use super::*;
use lumenav_core::config::quantity::{Finite, NonNegative, Positive};
use lumenav_core::pose::log_so3;

fn turn(at_s: f64, to: Posture, duration_s: f64) -> PatientEvent {
    PatientEvent::Posture(Turn { at_s: NonNegative(at_s), to, duration_s: Positive(duration_s) })
}

fn cough(at_s: f64, direction: [f64; 3]) -> PatientEvent {
    PatientEvent::Cough(Cough {
        at_s: NonNegative(at_s),
        acceleration_m_s2: NonNegative(8.0),
        duration_s: Positive(0.4),
        direction: direction.map(Finite),
    })
}

/// Everything at once: turns by two axes, a cough, a ride, a walk, breaths.
fn restless() -> Patient {
    let event = vec![
        turn(2.0, Posture::LeftLateral, 3.0),
        cough(3.0, [0.3, -0.4, 1.0]),
        PatientEvent::Table(Ride {
            at_s: NonNegative(1.0),
            by_mm: [100.0, -50.0, 300.0].map(Finite),
            duration_s: Positive(6.0),
        }),
        turn(6.0, Posture::Upright, 2.5),
        PatientEvent::Walk(Walk {
            from_s: NonNegative(9.0),
            to_s: Positive(14.0),
            step_frequency_hz: Positive(1.85),
            amplitude_mm: NonNegative(22.0),
            speed_m_s: NonNegative(1.2),
        }),
        turn(15.0, Posture::Prone, 2.0),
    ];
    Patient::new(PatientConfig { event, organ_shift_s: NonNegative(3.0), ..PatientConfig::default() })
}

/// The motion of a frame at a time.
type Course = fn(&Patient, f64) -> FrameMotion;

const COURSES: [(&str, Course); 3] =
    [("torso", Patient::torso), ("abdomen", Patient::abdomen), ("gut", Patient::gut)];

#[test]
fn closed_form_derivatives_are_those_of_central_differences() {
    let patient = restless();
    let h = 1e-5;
    for (name, course) in COURSES {
        for i in 0..2000 {
            let t = 0.0093 * f64::from(i);
            let [before, now, after] = [-h, 0.0, h].map(|off| course(&patient, t + off));
            let place = |m: &FrameMotion| m.world_from_frame.translation.vector;
            let velocity = (place(&after) - place(&before)) / (2.0 * h);
            let acceleration = (after.velocity_world_m_s - before.velocity_world_m_s) / (2.0 * h);
            let turned = before.world_from_frame.rotation.inverse() * after.world_from_frame.rotation;
            let rate = log_so3(&turned) / (2.0 * h);
            let rate_change = (after.rate_frame_rad_s - before.rate_frame_rad_s) / (2.0 * h);
            for (what, found, expected, within) in [
                ("velocity", now.velocity_world_m_s, velocity, 1e-7),
                ("acceleration", now.acceleration_world_m_s2, acceleration, 1e-5),
                ("rate", now.rate_frame_rad_s, rate, 1e-7),
                ("rate change", now.rate_change_frame_rad_s2, rate_change, 1e-5),
            ] {
                assert!((found - expected).norm() < within, "{name}, {t} s: {what} {found} {expected}");
            }
        }
    }
}

#[test]
fn closed_form_what_is_felt_is_gravity_minus_the_acceleration_of_the_place() {
    // A place that stands still in the gut is somewhere in the world: its second difference there against what is felt.
    let patient = restless();
    let gravity = Vector3::new(0.0, -9.81, 0.0);
    let h = 1e-4;
    let x = Vector3::new(0.12, 0.05, -0.2);
    let mut largest = 0.0_f64;
    for i in 0..1500 {
        let t = 0.0123 * f64::from(i);
        let place = |off: f64| (patient.gut(t + off).world_from_frame * nalgebra::Point3::from(x)).coords;
        let acceleration = (place(h) - place(0.0) * 2.0 + place(-h)) / (h * h);
        let gut = patient.gut(t);
        let felt = gut.felt(&gravity, &x, &Vector3::zeros()).total_m_s2();
        let expected = gut.world_from_frame.rotation.inverse() * (gravity - acceleration);
        assert!((felt - expected).norm() < 2e-4, "{t} s: {felt} {expected}");
        largest = largest.max((felt.norm() - 9.81).abs());
    }
    assert!(largest > 3.0, "{largest}: nothing was shown");
}

#[test]
fn closed_form_what_moves_freely_in_the_world_obeys_what_is_felt() {
    // p = c t in the world without gravity: in the gut's frame it moves by centrifugal, Euler and Coriolis terms alone.
    let patient = restless();
    let (start, velocity) = (Vector3::new(0.1, -0.05, 0.1), Vector3::new(0.3, -0.2, 0.5));
    let inside = |t: f64| {
        let point = nalgebra::Point3::from(start + velocity * (t - 4.0));
        patient.gut(t).world_from_frame.inverse_transform_point(&point).coords
    };
    let h = 1e-4;
    for i in 0..400 {
        let t = 2.0 + 0.013 * f64::from(i);
        let v = (inside(t + h) - inside(t - h)) / (2.0 * h);
        let a = (inside(t + h) - inside(t) * 2.0 + inside(t - h)) / (h * h);
        let felt = patient.gut(t).felt(&Vector3::zeros(), &inside(t), &v).total_m_s2();
        assert!((a - felt).norm() < 2e-4, "{t} s: {a} {felt}");
    }
}

#[test]
fn closed_form_postures_turn_gravity_in_the_torso() {
    // Down is: the back, the belly, the left, the right, the feet.
    for (posture, down) in [
        (Posture::Supine, Vector3::new(0.0, -1.0, 0.0)),
        (Posture::Prone, Vector3::new(0.0, 1.0, 0.0)),
        (Posture::LeftLateral, Vector3::new(-1.0, 0.0, 0.0)),
        (Posture::RightLateral, Vector3::new(1.0, 0.0, 0.0)),
        (Posture::Upright, Vector3::new(0.0, 0.0, -1.0)),
    ] {
        let event = vec![turn(1.0, posture, 2.0)];
        let patient = Patient::new(PatientConfig { event, ..PatientConfig::default() });
        let started = Patient::new(PatientConfig { posture, ..PatientConfig::default() });
        for (who, at_s) in [(&patient, 3.0), (&started, 0.0)] {
            let felt = who.torso(at_s).felt(&(UP * -9.81), &Vector3::zeros(), &Vector3::zeros());
            assert!((felt.gravity_m_s2 - down * 9.81).norm() < 1e-9, "{posture:?}: {}", felt.gravity_m_s2);
        }
        // The gut hangs 10 mm towards it, after the turn and its settling, breath at rest (15 s: three breaths).
        let hung = patient.gut_in_torso(15.0).value - (down + UP) * 0.01;
        assert!(hung.norm() < 1e-12, "{posture:?}: {hung}");
        assert!(started.gut_in_torso(0.0).value.norm() < 1e-15);
    }
}

#[test]
fn closed_form_turns_go_by_the_shorter_way() {
    use Posture::{LeftLateral, Prone, RightLateral, Supine};
    let largest = |from: Posture, to: Posture| {
        let patient = Patient::new(PatientConfig {
            posture: from,
            event: vec![turn(0.0, to, 2.0)],
            ..PatientConfig::default()
        });
        // 15/8 of the mean rate in the middle of a step.
        patient.torso(1.0).rate_frame_rad_s.z / (15.0 / 8.0 / 2.0) / PI
    };
    for (from, to, half_turns) in [
        (Supine, LeftLateral, 0.5),
        (Supine, Prone, 1.0),
        (Prone, Supine, 1.0),
        (RightLateral, Prone, -0.5),
        (Prone, RightLateral, 0.5),
        (LeftLateral, RightLateral, 1.0),
        (Prone, LeftLateral, -0.5),
    ] {
        assert!((largest(from, to) - half_turns).abs() < 1e-9, "{from:?} to {to:?}: {}", largest(from, to));
    }
}

#[test]
fn closed_form_breath_and_cough_have_the_size_that_is_asked_for() {
    let patient = Patient::new(PatientConfig {
        event: vec![cough(10.0, [0.0, 3.0, 0.0])],
        breathing_amplitude_mm: NonNegative(0.0),
        ..PatientConfig::default()
    });
    let course = |i: i32| patient.gut_in_torso(9.9 + 1e-4 * f64::from(i));
    let strongest = (0..6000).map(|i| course(i).acceleration.norm()).fold(0.0, f64::max);
    assert!((strongest - 8.0).abs() < 1e-4, "{strongest}");
    assert!((patient.gut_in_torso(10.2).value.y - 8.0 * 0.16 / 24.0).abs() < 1e-12);
    let breathing = Patient::new(PatientConfig::default());
    for (at_s, caudal_m, lift_m) in
        [(0.0, 0.0, 0.0), (2.5, 0.013, 0.005), (5.0, 0.0, 0.0), (28_802.5, 0.013, 0.005)]
    {
        let gut = breathing.gut(at_s).world_from_frame.translation.vector;
        let belly = breathing.abdomen(at_s).world_from_frame.translation.vector;
        assert!((gut + Vector3::z() * caudal_m).norm() < 1e-12, "{at_s} s: {gut}");
        assert!((belly - Vector3::y() * lift_m).norm() < 1e-12, "{at_s} s: {belly}");
        assert_eq!(breathing.torso(at_s).world_from_frame, Isometry3::identity());
    }
}

#[test]
fn closed_form_a_walk_goes_as_far_as_its_speed_says() {
    let patient = restless();
    let before = patient.torso(8.9).world_from_frame.translation.vector;
    let after = patient.torso(14.5).world_from_frame.translation.vector;
    // The ramps of one second at both ends count half.
    assert!((after - before - FORWARDS * (1.2 * 4.0)).norm() < 1e-12, "{}", after - before);
}

#[test]
fn law_stillness_is_told_and_true() {
    let still = |patient: &Patient, t: f64| patient.still_until_s(t) > t;
    assert!(!still(&restless(), 100.0), "breath never rests");
    let mut config = restless().config().clone();
    config.breathing_amplitude_mm = NonNegative(0.0);
    let patient = Patient::new(config);
    let mut quiet = 0;
    for i in 0..2500 {
        let t = 0.01 * f64::from(i);
        let until_s = patient.still_until_s(t);
        assert!(until_s >= t);
        if until_s > t {
            quiet += 1;
            let later = until_s.min(t + 5.0);
            assert_eq!(patient.gut(t), patient.gut(later), "{t} to {later} s");
        }
    }
    // Until 1 s, between walk and turn from 14 to 15 s, and from 20 s on (the last turn and its settling).
    assert!((650..750).contains(&quiet), "{quiet}");
    assert_eq!(patient.still_until_s(20.0), f64::INFINITY);
}
