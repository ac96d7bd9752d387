use super::agreement::{Summary, kolmogorov_smirnov};
use super::*;
use lumenav_core::Node;
use nalgebra::{Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

fn open(folder: &str, name: &str) -> Node {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../models");
    Node::open(&models.join(folder).join(format!("{name}.toml"))).unwrap()
}

fn scanner(name: &str) -> Scanner {
    Scanner::from_node(&open("scanners", name)).unwrap()
}

fn triangle(isotope: &str) -> Vec<SourceMarker> {
    [[-12e-3, 0.0, 0.0], [0.0, 5e-3, 0.0], [0.0, -5e-3, 0.0]]
        .map(|p| SourceMarker {
            position_capsule_m: Vector3::from(p),
            activity_bq: 1.85e6,
            isotope: isotope::tests::model(isotope),
            core_diameter_m: 5e-4,
            shell: None,
        })
        .to_vec()
}

fn simulator(scanner: Scanner, water_cm: Option<u32>, mode: Mode) -> Simulator {
    let phantom = water_cm.map(|cm| Phantom::from_node(&open("phantoms", &format!("water-{cm}"))).unwrap());
    let crystal = scintillator::tests::model("gso");
    Simulator::new(scanner, crystal, phantom, triangle("na-22"), Settings { mode, ..Settings::default() })
}

fn motion(t_s: f64) -> Isometry3<f64> {
    Isometry3::translation(0.03 - 0.005 * t_s, 0.02, -0.015 + 0.01 * t_s)
}

/// Windows of 50 ms, six places in turn: all modes see the same places.
fn summary(simulator: &mut Simulator, windows: u64, seed: u64) -> Summary {
    let random = RandomStreams::new(seed, 0, "agreement");
    let (mut summary, mut lines) = (Summary::default(), Vec::new());
    for window in 0..windows {
        let start_s = 0.05 * (window % 6) as f64;
        simulator.window(&motion, start_s, 0.05, &random, window, &mut lines);
        assert!(lines.is_sorted_by(|a, b| a.line.t_s <= b.line.t_s));
        assert!(lines.iter().all(|l| (start_s..start_s + 0.05).contains(&l.line.t_s)));
        let pose = motion(start_s + 0.025);
        let markers: Vec<Vector3<f64>> = simulator
            .physics
            .markers
            .iter()
            .map(|m| (pose * Point3::from(m.position_capsule_m)).coords)
            .collect();
        summary.add(&lines, &markers, &pose.translation.vector);
    }
    summary
}

/// Rates within 4 standard errors, true fraction within 4, offsets with p above 0.01, on fixed seeds.
fn assert_alike(a: &Summary, b: &Summary) {
    let all = a.rate_deviation(b, |c| c.iter().sum());
    assert!(all.abs() < 4.0, "lines per window {} and {}", a.lines_per_window(), b.lines_per_window());
    for (slot, name) in ["true", "scattered", "prompt", "random"].iter().enumerate() {
        let one = a.rate_deviation(b, |c| c[slot]);
        assert!(one.abs() < 4.0, "{name}: {:?} and {:?}", a.counts, b.counts);
    }
    let fraction = a.fraction_deviation(b);
    assert!(fraction.abs() < 4.0, "true fraction {} and {}", a.true_fraction(), b.true_fraction());
    let p = kolmogorov_smirnov(&a.true_offsets_m, &b.true_offsets_m);
    assert!(p > 0.01, "offsets of true lines: p {p}");
    let p = kolmogorov_smirnov(&a.other_offsets_m, &b.other_offsets_m);
    assert!(p > 0.01, "offsets of other lines: p {p}");
}

#[test]
fn cross_modes_agree_on_the_reduced_scanner() {
    let analog = summary(&mut simulator(scanner("reduced"), Some(20), Mode::Analog), 45, 31);
    let forced = summary(&mut simulator(scanner("reduced"), Some(20), Mode::Forced), 45, 32);
    let tabulated = summary(&mut simulator(scanner("reduced"), Some(20), Mode::Tabulated), 45, 33);
    assert_alike(&analog, &forced);
    assert_alike(&forced, &tabulated);
}

#[test]
fn cross_modes_agree_on_the_full_ring() {
    let analog = summary(&mut simulator(scanner("allegro"), Some(30), Mode::Analog), 3, 4);
    let forced = summary(&mut simulator(scanner("allegro"), Some(30), Mode::Forced), 6, 5);
    assert_alike(&analog, &forced);
}

#[test]
fn law_same_seed_same_lines_whatever_came_before() {
    for mode in [Mode::Forced, Mode::Analog] {
        let random = RandomStreams::new(9, 1, "sensor");
        let mut first = simulator(scanner("reduced"), Some(40), mode);
        let mut second = simulator(scanner("reduced"), Some(40), mode);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        first.window(&motion, 0.1, 0.01, &random, 2, &mut a);
        second.window(&motion, 0.0, 0.01, &random, 0, &mut b);
        second.window(&motion, 0.1, 0.01, &random, 2, &mut b);
        assert!(!a.is_empty());
        assert_eq!(a, b);
        first.window(&motion, 0.1, 0.01, &random, 3, &mut b);
        assert_ne!(a, b);
    }
}

#[test]
fn law_shared_tables_give_the_lines_of_tables_of_ones_own() {
    let simulator = |store: &TableStore, trial: u64, acollinearity_fwhm_deg: f64| {
        let settings = Settings { mode: Mode::Tabulated, acollinearity_fwhm_deg, ..Settings::default() };
        let mut markers = triangle("na-22")[..1].to_vec();
        // On the line between two nodes: no more than these are made.
        markers[0].position_capsule_m = Vector3::new(0.0, 0.0, 5e-3 * trial as f64);
        markers[0].activity_bq *= 3.0 + trial as f64;
        let crystal = scintillator::tests::model("gso");
        Simulator::sharing(store, scanner("reduced"), crystal, None, markers, settings)
    };
    let lines_of = |store: &TableStore, trial: u64| {
        let (random, mut lines) = (RandomStreams::new(9, trial, "sensor"), Vec::new());
        let rest = |_: f64| Isometry3::translation(0.0, 0.0, 0.01);
        simulator(store, trial, 0.5).window(&rest, 0.0, 0.05, &random, 0, &mut lines);
        lines
    };
    let alone = [0, 1].map(|trial| lines_of(&TableStore::default(), trial));
    assert!(alone.iter().all(|lines| lines.len() > 100));
    let store = TableStore::default();
    let shared = std::thread::scope(|scope| {
        [0, 1]
            .map(|trial| {
                scope.spawn({
                    let (store, lines_of) = (&store, &lines_of);
                    move || lines_of(store, trial)
                })
            })
            .map(|job| job.join().unwrap())
    });
    assert_eq!(alone, shared);
    let of = |simulator: Simulator| Arc::as_ptr(&store.of(&simulator.physics));
    assert_eq!(of(simulator(&store, 0, 0.5)), of(simulator(&store, 1, 0.5)));
    assert_ne!(of(simulator(&store, 0, 0.5)), of(simulator(&store, 0, 0.4)), "another physics, other tables");
}

#[test]
fn closed_form_solid_angle_of_a_block_seen_from_the_middle() {
    // 4 asin(a b / sqrt((a² + d²)(b² + d²))) for a rectangle of half sides a, b at distance d.
    let physics = simulator(scanner("reduced"), None, Mode::Analog).physics;
    let g = physics.detectors.scanner().grid;
    let (a, b, d) = (g.half_width_m(), g.half_length_m(), 0.43205_f64);
    let angle = 4.0 * (a * b / ((a * a + d * d) * (b * b + d * d)).sqrt()).asin();
    let expected = 4.0 * angle / (4.0 * std::f64::consts::PI);
    let mut random = RandomStreams::new(1, 0, "solid-angle").stream("rays", 0);
    let n = 200_000;
    let hits = (0..n)
        .filter(|_| {
            let photon = Photon::emitted(Vector3::zeros(), compton::isotropic(&mut random), 511e3);
            physics.detectors.first_block(&photon, &[]).is_some()
        })
        .count() as f64;
    let error = (expected / f64::from(n)).sqrt();
    assert!((hits / f64::from(n) - expected).abs() < 4.0 * error, "{hits} {expected}");
    // Aimed draws, each kept with its weight, are the same share.
    let mut paths = MarkerPaths::default();
    paths.rest(&Vector3::zeros());
    let mut aim = aim::Aim::default();
    assert!(aim.set(&physics, &paths, 0, 1, |_, _| aim::Shares::ALL));
    let kept = (0..n)
        .filter(|_| {
            let aimed = aim.draw(&physics, &mut random);
            aim::Aim::keep(&aimed, &physics, &Vector3::zeros()).is_some_and(|direction| {
                let photon = Photon::emitted(Vector3::zeros(), direction, 511e3);
                physics.detectors.first_block(&photon, &[]).is_some_and(|(block, _)| block == aimed.block)
            })
        })
        .count() as f64;
    let share = kept / f64::from(n) * aim.draws_per_photon();
    assert!((share / expected - 1.0).abs() < 0.01, "{share} {expected}");
}

#[test]
fn law_lines_scale_with_the_square_of_efficiency() {
    let with = |efficiency: f64| {
        let mut scanner = scanner("reduced");
        scanner.detection.efficiency = efficiency;
        summary(&mut simulator(scanner, Some(20), Mode::Forced), 20, 6).counts
    };
    let base = with(1.0);
    for efficiency in [0.7, 1.2_f64] {
        let here = with(efficiency);
        let (a, b) = ((here[0] + here[1]) as f64, (base[0] + base[1]) as f64 * efficiency * efficiency);
        assert!((a - b).abs() < 4.0 * (a + b * efficiency * efficiency).sqrt(), "{efficiency}: {a} {b}");
    }
}

#[test]
fn law_prompt_gammas_make_lines_and_pure_emitters_none() {
    let mut f18 = simulator(scanner("allegro"), Some(20), Mode::Forced);
    f18.physics.markers = triangle("f-18");
    f18.physics.positrons_per_decay = vec![0.969; 3];
    let counts = summary(&mut f18, 1, 7).counts;
    assert!(counts[2] == 0 && counts[0] > 1000, "{counts:?}");
    let counts = summary(&mut simulator(scanner("allegro"), Some(20), Mode::Forced), 1, 7).counts;
    assert!(counts[2] > 100, "{counts:?}");
}

#[test]
fn law_sensitivity_falls_with_axial_distance() {
    // Roughly linear towards the end of the field of view, from geometry alone.
    let mut simulator = simulator(scanner("reduced"), None, Mode::Forced);
    let random = RandomStreams::new(8, 0, "axial");
    let mut count = |z_m: f64| {
        let mut lines = Vec::new();
        simulator.window(&|_| Isometry3::translation(0.0, 0.0, z_m), 0.0, 0.2, &random, 0, &mut lines);
        lines.iter().filter(|l| l.label.origin == Origin::True).count() as f64
    };
    let (middle, half, end) = (count(0.0), count(0.045), count(0.085));
    assert!(half > 0.35 * middle && half < 0.65 * middle, "{half} of {middle}");
    assert!(end < 0.12 * middle, "{end} of {middle}");
}

#[test]
fn law_dead_time_costs_lines_alike_in_analog_and_forced() {
    let with = |mode: Mode, windows: u64, seed: u64| {
        let mut scanner = scanner("reduced");
        scanner.detection.block_dead_time_s = 30e-6;
        summary(&mut simulator(scanner, Some(20), mode), windows, seed)
    };
    let (analog, forced) = (with(Mode::Analog, 4, 10), with(Mode::Forced, 20, 11));
    let free = summary(&mut simulator(scanner("reduced"), Some(20), Mode::Forced), 20, 11);
    assert!(forced.lines() < free.lines() * 9 / 10);
    let deviation = analog.rate_deviation(&forced, |c| c.iter().sum());
    assert!(deviation.abs() < 4.0, "{} {}", analog.lines_per_window(), forced.lines_per_window());
}
