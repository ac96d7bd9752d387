//! The plugin as the framework sees it: built from tables, asked by truth, answered by front ends.

#![expect(clippy::disallowed_types, reason = "world side: these tests drive the sensor with a truth")]

use lumenav_core::config::quantity::{Fraction, NonNegative, Positive};
use lumenav_core::laws::{check_front_end_is_deterministic, check_sensor_is_deterministic, check_units};
use lumenav_core::pose::{exp_so3, ominus};
use lumenav_core::{
    CapsuleBody, CapsuleTruth, FixKind, FrontEnd, Modality as _, ModelFolder, Name, Node, Outcome,
    PoseEstimate, PosePrior, PriorUse, RandomStreams, Reading, Schedule, Sensor, Setup, SimTime, TruthView,
};
use lumenav_pet::{Pet, payload};
use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
use std::ops::Range;
use std::path::{Path, PathBuf};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models")
}

fn node(text: &str) -> Node {
    Node::parse_text(text, "test.toml", Path::new(""), &[]).unwrap()
}

fn setup(capsule: &str) -> Setup {
    Setup {
        sensor: Name::from("scanner"),
        schedule: Some(Schedule {
            rate_hz: Positive(20.0),
            start_s: NonNegative(0.0),
            latency_ms: NonNegative(0.0),
            loss: Fraction(0.0),
        }),
        capsule: CapsuleBody { radius_m: 6e-3, length_m: 26e-3, mass_kg: 3.3e-3 },
        capsule_model: Node::open(&models().join("capsules").join(format!("{capsule}.toml"))).unwrap(),
        models: ModelFolder::new(models()),
        map: None,
    }
}

const INSTALLED: &str = "scanner = \"reduced\"\nphantom = \"water-20\"\n";

fn sensor(capsule: &str, reality: &str) -> Box<dyn Sensor> {
    Pet::default().sensor(&node(INSTALLED), &node(reality), &setup(capsule)).unwrap()
}

fn front_end(capsule: &str, options: &str) -> Box<dyn FrontEnd> {
    Pet::default().estimator(&node(INSTALLED), &node(options), &setup(capsule)).unwrap().front_end.unwrap()
}

/// A capsule that moves at 10 mm/s along z and turns slowly.
struct Moving;

fn pose_at(at: SimTime) -> Isometry3<f64> {
    let t = at.seconds();
    let turn = exp_so3(&Vector3::new(0.3, -0.2, 0.9 + 0.1 * t));
    Isometry3::from_parts(Translation3::new(0.02, -0.01, -0.02 + 0.01 * t), turn)
}

impl TruthView for Moving {
    fn interval(&self) -> Range<SimTime> {
        SimTime::ZERO..SimTime(i64::MAX)
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        CapsuleTruth {
            at,
            world_from_capsule: pose_at(at),
            velocity_world_m_s: Vector3::z() * 0.01,
            angular_rate_capsule_rad_s: Vector3::zeros(),
            specific_force_capsule_m_s2: Vector3::y() * 9.81,
            arc_length_m: None,
            segment: None,
            wall_force_n: None,
        }
    }

    fn frame(&self, _name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        None
    }
}

fn readings(capsule: &str, reality: &str, count: usize) -> Vec<Reading> {
    let mut sensor = sensor(capsule, reality);
    let streams = RandomStreams::new(7, 0, "scanner");
    (0..count)
        .map(|_| {
            let at = sensor.next_due();
            sensor.observe(&Moving, at, &streams).unwrap().unwrap().reading
        })
        .collect()
}

#[test]
fn law_the_sensor_is_deterministic_in_every_mode() {
    for mode in ["forced", "tabulated"] {
        let build = || sensor("pet-scalene", &format!("mode = \"{mode}\""));
        check_sensor_is_deterministic(&build, &Moving, "scanner", 3).unwrap();
    }
    check_units(&payload::schema()).unwrap();
}

/// The capsule is seen where it is in the middle of the window, by poses of its own and with no prior.
#[test]
fn law_each_front_end_finds_the_capsule() {
    for (options, within_mm) in [
        ("front_end = \"mixture\"", 2.5),
        ("front_end = \"rigid\"", 3.5),
        ("front_end = \"fcm\"", 3.5),
        ("front_end = \"lines\"", 2.5),
    ] {
        let mut front_end = front_end("pet-scalene", options);
        assert_eq!(front_end.resolves(), FixKind::Full);
        let (mut worst_mm, mut refusals): (f64, Vec<String>) = (0.0, Vec::new());
        for reading in readings("pet-scalene", "", 12) {
            let measured = match front_end.process(&reading, None).unwrap() {
                Outcome::Measured(measured) => measured,
                other => {
                    refusals.push(format!("{other:?}"));
                    continue;
                }
            };
            let fix = measured[0].fix.clone().unwrap();
            let error = ominus(&fix.world_from_capsule, &pose_at(reading.at()));
            worst_mm = worst_mm.max(1e3 * error.fixed_rows::<3>(0).norm());
        }
        assert!(worst_mm < within_mm, "{options}: {worst_mm} mm");
        // A first window may leave two poses open; the windows after it do not.
        assert!(refusals.len() <= 4, "{options}: {refusals:?}");
    }
}

/// Roll of an isosceles triangle is not claimed.
#[test]
fn law_an_ambiguous_triangle_claims_no_roll() {
    let mut front_end = front_end("pet-triangle", "front_end = \"mixture\"");
    assert_eq!(front_end.resolves(), FixKind::Pointing);
    let mut found = 0;
    for reading in readings("pet-triangle", "", 8) {
        if let Outcome::Measured(measured) = front_end.process(&reading, None).unwrap() {
            assert_eq!(measured[0].fix.as_ref().unwrap().kind, FixKind::Pointing);
            found += 1;
        }
    }
    // The first windows may leave apex and base open.
    assert!(found >= 4, "{found} of 8 windows have a pose");
}

/// A start from five windows hands the filter the motion, and the roll of a set of which the fix claims none.
#[test]
fn law_a_start_from_several_windows_hands_over_the_motion() {
    let mut front_end = front_end("pet-triangle", "front_end = \"lines\"\nstart_windows = 5");
    let readings = readings("pet-triangle", "", 5);
    let (last, before) = readings.split_last().unwrap();
    for reading in before {
        assert!(matches!(front_end.process(reading, None).unwrap(), Outcome::Refused { .. }));
    }
    let Outcome::Measured(measured) = front_end.process(last, None).unwrap() else { panic!("no start") };
    assert_eq!(measured[0].fix.as_ref().unwrap().kind, FixKind::Pointing);
    let motion = measured[0].motion.as_ref().expect("a motion");
    let ahead = SimTime(last.at().0 + 10_000_000);
    let way = pose_at(ahead).translation.vector - pose_at(last.at()).translation.vector;
    let off = motion.velocity_world_m_s - way / 0.01;
    let velocity = motion.covariance.fixed_view::<3, 3>(6, 6).into_owned();
    // 99.9 % quantile of chi-square with 3 degrees of freedom.
    assert!(off.dot(&velocity.cholesky().unwrap().solve(&off)) < 16.27, "{off}");
    let roll = motion.covariance[(3, 3)].sqrt();
    assert!(roll > 0.0 && roll < 0.5, "{roll}");
}

fn prior(pose: Isometry3<f64>, at: SimTime) -> PosePrior {
    PosePrior {
        at,
        pose: PoseEstimate {
            world_from_capsule: pose,
            covariance: Matrix6::identity() * 1e-6,
            kind: FixKind::Full,
        },
        velocity_world_m_s: Some(Vector3::z() * 0.01),
    }
}

/// A filter that holds the pose of another order of the markers is contradicted: the front end hands over its own pose.
#[test]
fn law_the_front_end_insists_where_the_filter_has_two_markers_exchanged() {
    let mut front_end = front_end("pet-scalene", "front_end = \"lines\"");
    let mut insisted = 0;
    for reading in readings("pet-scalene", "", 40) {
        // Base and apex exchanged, as far as the triangle allows.
        let wrong = pose_at(reading.at())
            * Isometry3::from_parts(
                Translation3::new(-9.0e-3, 0.0, 0.0),
                exp_so3(&Vector3::new(0.0, 0.0, 3.1)),
            );
        let outcome = front_end.process(&reading, Some(&prior(wrong, reading.at()))).unwrap();
        if let Outcome::Measured(measured) = outcome {
            insisted += usize::from(measured[0].fix.is_some());
        }
    }
    assert!(insisted > 0);
}

/// With a sound prediction the filter is given lines and no pose.
#[test]
fn law_with_a_prediction_the_lines_are_the_measurement() {
    let mut front_end = front_end("pet-scalene", "front_end = \"lines\"");
    for reading in readings("pet-scalene", "", 25) {
        let here = pose_at(reading.at());
        let Outcome::Measured(measured) =
            front_end.process(&reading, Some(&prior(here, reading.at()))).unwrap()
        else {
            panic!("window {} is refused", reading.sequence)
        };
        assert!(measured[0].fix.is_none(), "window {}", reading.sequence);
        assert_eq!(measured[0].prior_use, PriorUse::StartOnly);
        assert_eq!(measured[0].value.rows(), reading.payload.rows());
    }
}

#[test]
fn law_front_ends_are_deterministic_and_go_on_from_a_snapshot() {
    let readings = readings("pet-scalene", "mode = \"tabulated\"", 24);
    for options in ["mixture", "rigid", "fcm", "lines"] {
        let build = || front_end("pet-scalene", &format!("front_end = \"{options}\""));
        let start = prior(pose_at(SimTime::ZERO), SimTime::ZERO);
        for prior in [None, Some(&start)] {
            check_front_end_is_deterministic(&build, &readings, prior).unwrap();
        }
    }
}

fn refused(capsule: &str, installed: &str, options: &str) -> String {
    match Pet::default().estimator(&node(installed), &node(options), &setup(capsule)) {
        Ok(_) => panic!("{installed} {options} is accepted"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn law_bad_tables_are_refused_by_key() {
    for (capsule, installed, options, wanted) in [
        ("pillcam-magnet", INSTALLED, "", "[[marker]]"),
        ("pet-scalene", "scanner = \"no\"", "", "allegro"),
        ("pet-scalene", "scanner = \"reduced\"\nphantom = \"no\"", "", "water-20"),
        ("pet-scalene", "scanner = \"reduced\"\nwindow_ms = 60.0", "", "window_ms"),
        ("pet-scalene", "scanner = \"reduced\"\ncolour = 1", "", "colour"),
        ("pet-scalene", INSTALLED, "front_end = \"magic\"", "magic"),
        ("pet-scalene", INSTALLED, "front_end = \"fcm\"\nstart_windows = 5", "allowed with: mixture, lines"),
        ("pet-scalene", INSTALLED, "front_end = \"rigid\"\nestimate_markers = true", "allowed with: mixture"),
        (
            "pet-scalene",
            INSTALLED,
            "point = 1",
            "front end `mixture` does not look at this; allowed with: points",
        ),
        (
            "pet-scalene",
            INSTALLED,
            "front_end = \"points\"\nmost_lines = 9",
            "`points` does not look at this",
        ),
        ("pet-scalene", INSTALLED, "start_sigma_mm = 0.6", "a start from one window waits for no window"),
        ("pet-scalene", INSTALLED, "start_rate_sigma_rad_s = 0.6", "a start from one window tells no motion"),
        ("pet-scalene", INSTALLED, "most_lines = 0", "`most_lines`: allowed: 3 or more"),
        (
            "pet-scalene",
            "scanner = \"reduced\"\nscanner_changes.radius_mm = 90\nphantom = \"water-40\"",
            "",
            "block 0 of scanner `reduced` stands inside this body",
        ),
    ] {
        let message = refused(capsule, installed, options);
        assert!(message.contains(wanted), "{message}");
    }
}

/// A prediction that does not know the roll is no place for lines: near it every order of the markers is a peak.
#[test]
fn law_a_vague_prediction_gets_a_pose_and_a_far_one_too() {
    for (sigma_m, sigma_rad, off_m) in [(1e-3, 1.8, 0.0), (0.05, 0.05, 0.0), (1e-3, 0.05, 0.1)] {
        let mut front_end = front_end("pet-scalene", "front_end = \"lines\"");
        for reading in readings("pet-scalene", "", 3) {
            let truth = pose_at(reading.at());
            let mut told = prior(truth, reading.at());
            // The roll is wrong by half a turn where it is said not to be known.
            if sigma_rad > 1.0 {
                told.pose.world_from_capsule =
                    truth * nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 3.0);
            }
            told.pose.world_from_capsule.translation.vector.z += off_m;
            told.pose.covariance = Matrix6::from_diagonal(
                &nalgebra::Vector6::new(sigma_m, sigma_m, sigma_m, sigma_rad, sigma_rad, sigma_rad)
                    .map(|s| s * s),
            );
            let Outcome::Measured(measured) = front_end.process(&reading, Some(&told)).unwrap() else {
                panic!("window {} is refused", reading.sequence)
            };
            let fix = measured[0].fix.as_ref().expect("a pose");
            let error = ominus(&fix.world_from_capsule, &truth);
            assert!(
                error.fixed_rows::<3>(0).norm() < 2e-3 && error.fixed_rows::<3>(3).norm() < 0.4,
                "{error}"
            );
        }
    }
}

#[test]
fn law_a_start_from_more_windows_than_are_kept_is_refused() {
    let message = refused("pet-scalene", INSTALLED, "front_end = \"lines\"\nstart_windows = 25");
    assert!(message.contains("start_windows") && message.contains("1 to 24"), "{message}");
}

/// The capsule of [`Moving`] in a patient whom somebody has carried and turned.
struct Carried(Isometry3<f64>);

impl TruthView for Carried {
    fn interval(&self) -> Range<SimTime> {
        Moving.interval()
    }

    fn capsule(&self, at: SimTime) -> CapsuleTruth {
        Moving.capsule(at)
    }

    fn frame(&self, name: &str, _at: SimTime) -> Option<Isometry3<f64>> {
        (name == "torso").then_some(self.0)
    }
}

#[test]
fn law_a_patient_carries_the_body_and_must_not_turn_it() {
    let lines = |installed: &str, mode: &str, torso: Isometry3<f64>| {
        let reality = node(&format!("mode = \"{mode}\""));
        let mut sensor = Pet::default()
            .sensor(&node(installed), &reality, &setup("pet-scalene"))
            .map_err(|e| e.to_string())?;
        let streams = RandomStreams::new(7, 0, "scanner");
        let mut count = 0;
        for _ in 0..10 {
            let at = sensor.next_due();
            let seen = sensor.observe(&Carried(torso), at, &streams).map_err(|e| e.to_string())?;
            count += seen.unwrap().reading.payload.rows();
        }
        Ok::<usize, String>(count)
    };
    let air = "scanner = \"reduced\"\n";
    let away = Isometry3::translation(3.0, 0.0, 0.0);
    let [here, gone, nothing] = [(INSTALLED, Isometry3::identity()), (INSTALLED, away), (air, away)]
        .map(|(i, t)| lines(i, "forced", t).unwrap());
    println!(
        "figure: {here} lines through the body, {gone} with the body carried away, {nothing} without one"
    );
    // 20 cm of water hold back most of the pairs.
    assert!(3 * here < gone, "{here} {gone}");
    assert!((gone as f64 / nothing as f64 - 1.0).abs() < 0.1, "{gone} {nothing}");
    let turned = Isometry3::rotation(Vector3::z() * 0.1);
    let message = lines(INSTALLED, "forced", turned).unwrap_err();
    assert!(message.contains("no body that turns; allowed with a `phantom`"), "{message}");
    lines(air, "forced", turned).unwrap();
    let message = lines(INSTALLED, "tabulated", away).unwrap_err();
    assert!(
        message.contains("mode `tabulated`") && message.contains("allowed: `analog`, `forced`"),
        "{message}"
    );
}
