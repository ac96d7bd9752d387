//! The simulated array: deterministic, independent of its neighbours, and what its equation says.

use super::support::*;
use lumenav_core::laws::check_sensor_is_deterministic;
use lumenav_core::{Modality as _, RandomStreams, Sensor, SimTime};
use lumenav_magnetic::Magnetic;
use lumenav_magnetic::channels::MagnetPose;
use nalgebra::{Isometry3, Vector3};

const ALL_FLAWS: &str = "bias_sigma_tesla = 1e-8\ngain_sigma = 0.01\naxis_sigma_deg = 1.0\nplacement_sigma_mm = 1.0\n\
    ambient_tesla = [2e-5, 0, -4e-5]\nstrength_error = 0.02\n[[disturbance]]\nstart_s = 0.1\nend_s = 0.3\n\
    position_mm = [300, 0, 100]\nmoment_a_m2 = [0, 0, 1]\n";

fn sensor(installed: &str, reality: &str, offset_mm: [f64; 3]) -> Box<dyn Sensor> {
    Magnetic.sensor(&node(installed), &node(reality), &setup(offset_mm)).unwrap()
}

fn pose() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(0.05, -0.03, 0.2), Vector3::new(0.3, 1.2, -0.4))
}

fn readings(sensor: &mut dyn Sensor, streams: &RandomStreams, count: usize) -> Vec<Vec<f64>> {
    let one = |sensor: &mut dyn Sensor| {
        let at = sensor.next_due();
        let observation = sensor.observe(&AtRest(pose()), at, streams).unwrap().unwrap();
        observation.reading.payload.f64("flux_tesla").unwrap().to_vec()
    };
    (0..count).map(|_| one(sensor)).collect()
}

#[test]
fn law_the_sensor_is_deterministic() {
    for installed in ["array = \"plane-4x4\"", "array = \"belt-16\"\nworn_on = \"torso\""] {
        let build = || sensor(installed, ALL_FLAWS, [6.0, 0.0, 0.0]);
        check_sensor_is_deterministic(&build, &AtRest(pose()), "array", 5).unwrap();
    }
}

#[test]
fn law_a_second_sensor_changes_no_draw_of_the_first() {
    let alone = readings(
        &mut *sensor("array = \"plane-4x4\"", ALL_FLAWS, [0.0; 3]),
        &RandomStreams::new(5, 0, "first"),
        4,
    );
    let (mut first, mut second) = (
        sensor("array = \"plane-4x4\"", ALL_FLAWS, [0.0; 3]),
        sensor("array = \"belt-16\"", ALL_FLAWS, [0.0; 3]),
    );
    let (ours, theirs) = (RandomStreams::new(5, 0, "first"), RandomStreams::new(5, 0, "second"));
    let mut beside = Vec::new();
    for _ in 0..4 {
        readings(&mut *second, &theirs, 1);
        beside.extend(readings(&mut *first, &ours, 1));
    }
    assert_eq!(alone, beside);
}

#[test]
fn law_a_lost_reading_shifts_no_other() {
    let streams = RandomStreams::new(5, 0, "first");
    let all = readings(&mut *sensor("array = \"plane-4x4\"", "", [0.0; 3]), &streams, 200);
    let mut lossy_setup = setup([0.0; 3]);
    lossy_setup.schedule.as_mut().unwrap().loss.0 = 0.3;
    let mut lossy = Magnetic.sensor(&node("array = \"plane-4x4\""), &node(""), &lossy_setup).unwrap();
    let mut lost = 0;
    let mut last = None;
    for (n, lossless) in all.iter().enumerate() {
        let at = lossy.next_due();
        assert!(last.is_none_or(|last| at > last));
        last = Some(at);
        match lossy.observe(&AtRest(pose()), at, &streams).unwrap() {
            None => lost += 1,
            Some(seen) => {
                assert_eq!(seen.reading.sequence, n as u64);
                assert_eq!(seen.reading.arrival, at + 5_000_000);
                assert_eq!(seen.reading.payload.f64("flux_tesla").unwrap(), lossless, "reading {n}");
            }
        }
    }
    // 200 draws at 0.3: 60 with a standard deviation of 6.5.
    assert!((40..=80).contains(&lost), "{lost} lost");
}

#[test]
fn closed_form_without_flaws_the_mean_is_the_field_and_the_spread_the_noise() {
    let text = "array = \"plane-4x4\"\nquantization = false\nsaturation = false\nnoise_tesla = 2e-8\n";
    let count = 2000;
    let all = readings(&mut *sensor(text, "", [6.0, 0.0, 0.0]), &RandomStreams::new(1, 0, "array"), count);
    let installed = installed(text, [6.0, 0.0, 0.0]);
    let magnet = MagnetPose::of_capsule(&pose(), &Vector3::new(6e-3, 0.0, 0.0));
    let mut field = Vec::new();
    let source = installed.magnet.source(lumenav_magnetic::config::Law::Cylinder);
    installed.array.channels(&Isometry3::identity()).flux(&source, &magnet, &mut field);
    let mut squares = 0.0;
    for (k, expected) in field.iter().enumerate() {
        let mean = all.iter().map(|z| z[k]).sum::<f64>() / count as f64;
        assert!((mean - expected).abs() < 4.5 * 2e-8 / (count as f64).sqrt(), "channel {k}");
        squares += all.iter().map(|z| ((z[k] - expected) / 2e-8).powi(2)).sum::<f64>();
    }
    let variance = squares / (48.0 * count as f64);
    // Standard error √(2/96000) = 0.0046.
    assert!((variance - 1.0).abs() < 0.02, "{variance}");
}

#[test]
fn closed_form_readings_are_multiples_of_the_step_within_the_limit() {
    let installed = installed("array = \"plane-4x4\"", [0.0; 3]);
    let (step, limit) =
        (installed.array.resolution_tesla.unwrap(), installed.array.saturation_tesla.unwrap());
    // 10 mm from a sensor: 12 mT, far beyond 0.6 mT.
    let close = Isometry3::new(Vector3::new(0.25, 0.25, 0.01), Vector3::zeros());
    let mut sensor = sensor("array = \"plane-4x4\"", "", [0.0; 3]);
    let seen =
        sensor.observe(&AtRest(close), SimTime::ZERO, &RandomStreams::new(1, 0, "array")).unwrap().unwrap();
    let flux = seen.reading.payload.f64("flux_tesla").unwrap();
    let mut at_limit = 0;
    for z in flux {
        let steps = z / step;
        let is_clipped = z.abs() == limit;
        at_limit += usize::from(is_clipped);
        assert!(z.abs() <= limit && (is_clipped || (steps - steps.round()).abs() < 1e-6), "{z}");
    }
    assert!(at_limit >= 1, "a clipped reading is the limit itself, so that the estimator can know it");
}

#[test]
fn closed_form_ambient_disturbance_and_strength_add_up() {
    let quiet = "array = \"plane-4x4\"\nquantization = false\nsaturation = false\nnoise_tesla = 1e-20\n";
    let streams = RandomStreams::new(1, 0, "array");
    let base = readings(&mut *sensor(quiet, "", [0.0; 3]), &streams, 4);
    let stronger = readings(&mut *sensor(quiet, "strength_error = 0.05", [0.0; 3]), &streams, 1);
    let ambient = readings(&mut *sensor(quiet, "ambient_tesla = [1e-5, 2e-5, 3e-5]", [0.0; 3]), &streams, 1);
    let disturbance =
        "[[disturbance]]\nstart_s = 0.1\nend_s = 0.3\nposition_mm = [0, 0, 1000]\nmoment_a_m2 = [0, 0, 10]\n";
    let disturbed = readings(&mut *sensor(quiet, disturbance, [0.0; 3]), &streams, 4);
    for k in 0..48 {
        assert!((stronger[0][k] - 1.05 * base[0][k]).abs() < 1e-12 * 1e-5);
        let around = [1e-5, 2e-5, 3e-5][k % 3];
        assert!((ambient[0][k] - base[0][k] - around).abs() < 1e-18);
        // It is there from 0.1 s to before 0.3 s: readings 1 and 2 of 0 to 3.
        for n in [0, 3] {
            assert!((disturbed[n][k] - base[n][k]).abs() < 1e-18);
        }
        assert!((disturbed[1][k] - base[1][k]).abs() > 1e-8 || k % 3 != 2);
    }
    // A dipole of 10 A m² on the axis: B = 2 μ0 m/(4π r³) below it; the nearest sensors are 0.118 m off the axis.
    let (z, rho2): (f64, f64) = (1.0, 2.0 * (0.5_f64 / 6.0).powi(2));
    let r2 = z * z + rho2;
    let expected = 1e-7 * 10.0 * (3.0 * z * z / r2 - 1.0) / r2.powf(1.5);
    let k = 3 * 5 + 2;
    assert!(((disturbed[1][k] - base[1][k]) / expected - 1.0).abs() < 1e-9);
}

#[test]
fn law_bad_tables_are_refused_with_file_line_and_key() {
    let refuse = |installed: &str, reality: &str| {
        let Err(error) = Magnetic.sensor(&node(installed), &node(reality), &setup([0.0; 3])) else {
            panic!("{installed} / {reality} is accepted");
        };
        error.to_string()
    };
    let plane = "array = \"plane-4x4\"";
    for (installed, reality, wanted) in [
        ("array = \"plane-4x5\"", "", "test.toml:1:9: `array`: no model `plane-4x5`"),
        ("array = \"plane-4x4\"\narrai = 1", "", "test.toml:2:1: `arrai`: unknown field"),
        ("array = \"plane-4x4\"\nnoise_tesla = nan", "", "test.toml:2:15: `noise_tesla`"),
        (plane, "law = \"quadrupole\"", "test.toml:1:7: `law`"),
        (plane, "strength_error = -1", "test.toml:1:18: `strength_error`"),
        (plane, "gain_sigma = -0.1", "test.toml:1:14: `gain_sigma`"),
        (plane, "ambient_tesla = [0, inf, 0]", "`ambient_tesla"),
        (
            plane,
            "[[disturbance]]\nstart_s = 2\nend_s = 1\nposition_mm = [0,0,0]\nmoment_a_m2 = [0,0,1]",
            "`disturbance",
        ),
        (plane, "[[disturbance]]\nstart_s = 1\nend_s = 2\nposition_mm = [0,0,0]", "give one of them"),
        (plane, "[[turn]]\nstart_s = 1\nend_s = 2\naxis = [0,0,0]\nangle_deg = 90", "axis of length 0"),
        (plane, "[[turn]]\nstart_s = 1\nend_s = 2\naxis = [1e-200,0,0]\nangle_deg = 90", "allowed: 1e-9"),
        (plane, "[[turn]]\nstart_s = 1\nend_s = 2\naxis = [0,0,1e200]\nangle_deg = 90", "allowed: 1e-9"),
        (plane, "[[turn]]\nstart_s = 1\nend_s = 2\naxis = [0,0,1]\nangle_deg = 1e300", "at most ten turns"),
        (
            plane,
            "[[turn]]\nstart_s = 0\nend_s = 2\naxis = [0,0,1]\nangle_deg = 90\n[[turn]]\nstart_s = 1\nend_s = 3\naxis = [0,0,1]\nangle_deg = 90",
            "starts before the last one ends",
        ),
    ] {
        let error = refuse(installed, reality);
        assert!(error.contains(wanted), "{error}, wanted: {wanted}");
    }
    let mut bare = setup([0.0; 3]);
    bare.capsule_model = node("[capsule]\nname = \"no magnet\"\n");
    let Err(error) = Magnetic.sensor(&node(plane), &node(""), &bare) else { panic!("no magnet is accepted") };
    assert!(error.to_string().contains("no [magnet]"), "{error}");
    let mut sensor = sensor("array = \"plane-4x4\"\nworn_on = \"knee\"", "", [0.0; 3]);
    let error = sensor.observe(&AtRest(pose()), SimTime::ZERO, &RandomStreams::new(1, 0, "a")).unwrap_err();
    assert!(error.to_string().contains("knee"), "{error}");
}

/// An array zeroed in the Earth's field sees it as far as the patient has turned: by 90 degrees about z, `(E, 0, 0)` has become
/// `(0, -E, 0)`. A sphere of iron in a field E has the field `r³ (3 (E·d)d/d⁵ - E/d³)` of its own.
#[test]
fn closed_form_the_earths_field_turns_and_magnetises_iron() {
    let quiet = "array = \"plane-4x4\"\nquantization = false\nsaturation = false\nnoise_tesla = 1e-20\n";
    let streams = RandomStreams::new(1, 0, "array");
    let base = readings(&mut *sensor(quiet, "", [0.0; 3]), &streams, 5);
    let turn = "earth_tesla = [5e-5, 0, 0]\n[[turn]]\nstart_s = 0.1\nend_s = 0.3\naxis = [0, 0, 2]\nangle_deg = 90\n";
    let turned = readings(&mut *sensor(quiet, turn, [0.0; 3]), &streams, 5);
    let half = 5e-5 * 0.5_f64.sqrt();
    let wanted = [[0.0; 3], [0.0; 3], [half - 5e-5, -half, 0.0], [-5e-5, -5e-5, 0.0], [-5e-5, -5e-5, 0.0]];
    for (n, wanted) in wanted.iter().enumerate() {
        for k in 0..48 {
            assert!((turned[n][k] - base[n][k] - wanted[k % 3]).abs() < 1e-17, "reading {n}, channel {k}");
        }
    }
    let iron = "earth_tesla = [0, 0, 5e-5]\n[[disturbance]]\nstart_s = 0\nend_s = 0.05\nposition_mm = [0, 0, 10000]\nsphere_radius_mm = 500\n";
    let near = readings(&mut *sensor(quiet, iron, [0.0; 3]), &streams, 2);
    let (z, rho2): (f64, f64) = (10.0, 2.0 * (0.5_f64 / 6.0).powi(2));
    let r2 = z * z + rho2;
    let expected = 0.5_f64.powi(3) * 5e-5 * (3.0 * z * z / r2 - 1.0) / r2.powf(1.5);
    // The capsule's magnet, ten metres away, magnetises it by a millionth of what the Earth does.
    let k = 3 * 5 + 2;
    assert!(((near[0][k] - base[0][k]) / expected - 1.0).abs() < 1e-4);
    assert!((near[1][k] - base[1][k]).abs() < 1e-18);
}
