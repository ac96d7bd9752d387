//! A first pose from several windows together, and answers that go back in time from it.

use super::support::{
    Ends, Generator, WINDOW_S, capsule, helix, marker_errors, noise_of_drawn, scanner, triangle,
};
use lumenav_pet::Line;
use lumenav_pet::tracking::mixture::STACK;
use lumenav_pet::tracking::{Failure, Mixture, MixtureOptions, Tracker, rewind};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

const LINES: f64 = 120.0;
const TRUE_SHARE: f64 = 0.702;
/// Three times the helix: 17 mm/s, 3.4 mm from the first to the fifth window.
const FAST: f64 = 3.0;

fn windows(seed: u64, count: usize) -> Vec<Vec<Line>> {
    let scanner = scanner("reduced");
    let mut generator = Generator::new(scanner.clone(), Ends::physics(&scanner), triangle(), seed);
    let motion = |t: f64| helix(t, FAST);
    (0..count).map(|w| generator.poisson_window(&motion, w as f64 * WINDOW_S, LINES, TRUE_SHARE)).collect()
}

fn tracker(start_windows: usize) -> Mixture {
    let options = MixtureOptions { start_windows, ..MixtureOptions::default() };
    Mixture::new(&triangle(), noise_of_drawn(&scanner("reduced")), options)
}

fn middle_s(window: usize) -> f64 {
    (window as f64 + 0.5) * WINDOW_S
}

/// Worst marker, m, of the start from five windows and of the fifth window by itself from the true pose: the best that it can say.
#[test]
fn law_five_windows_start_better_than_the_best_of_one() {
    let (mut of_five, mut of_one, mut off_s) = (0.0, 0.0, Vector3::zeros());
    let seeds = 61..=72;
    let count = seeds.clone().count() as f64;
    for seed in seeds {
        let windows = windows(seed, STACK);
        let mut five = tracker(STACK);
        for (w, lines) in windows.iter().enumerate().take(STACK - 1) {
            let refused = five.track(lines, None).unwrap_err();
            assert_eq!(refused, Failure::Gathering { have: w + 1, needed: STACK });
        }
        let started = five.track(&windows[STACK - 1], None).unwrap();
        let truth = helix(middle_s(STACK - 1), FAST);
        let set = triangle();
        of_five += marker_errors(&started.markers_world_m, &truth, &set).1 / count;
        let mut one = tracker(1);
        let memory = lumenav_pet::tracking::Memory { world_from_capsule: Some(truth), ..one.memory() };
        one.recall(memory);
        let alone = one.track(&windows[STACK - 1], None).unwrap();
        of_one += marker_errors(&alone.markers_world_m, &truth, &set).1 / count;
        let velocity = started.motion.unwrap().velocity_world_m_s;
        let true_velocity =
            (helix(0.25, FAST).translation.vector - helix(0.0, FAST).translation.vector) / 0.25;
        off_s += (velocity - true_velocity) / count;
    }
    println!(
        "figure: worst marker {:.2} mm from five windows, {:.2} mm from one",
        1e3 * of_five,
        1e3 * of_one
    );
    assert!(of_five < 0.8 * of_one, "{of_five} {of_one}");
    // The slope of five places of half a millimetre each has a deviation of 3 mm/s; a mean over twelve starts of 1 mm/s per axis.
    assert!(off_s.norm() < 5e-3, "{off_s}");
}

/// The way within the stack, the velocity and a turn meanwhile: the start must know how uncertain it is.
#[test]
fn law_the_starts_covariance_covers_its_errors() {
    let mut inside = 0;
    for seed in 81..=100 {
        let windows = windows(seed, STACK);
        let mut five = tracker(STACK);
        let started = windows.iter().map(|lines| five.track(lines, None)).last().unwrap().unwrap();
        let factor = started.covariance.cholesky().unwrap();
        let truth = helix(middle_s(STACK - 1), FAST);
        // The base markers look alike: half a turn about the axis is the same pose.
        let half = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let squared = |truth: Isometry3<f64>| {
            let error = lumenav_core::pose::ominus(&started.world_from_capsule, &truth);
            error.dot(&factor.solve(&error))
        };
        // 99 % quantile of chi-square with 6 degrees of freedom.
        inside += usize::from(squared(truth).min(squared(truth * half)) < 16.81);
    }
    assert!(inside >= 18, "{inside} of 20");
}

/// Windows of a stream of windows, each of which begins a part of their length behind the last.
fn overlapping(windows: &[Vec<Line>], parts: usize) -> Vec<Vec<Line>> {
    let stream = windows.concat();
    let step_s = WINDOW_S / parts as f64;
    let window = |k: usize| {
        let from_s = k as f64 * step_s;
        let is_in = |line: &&Line| (from_s..from_s + WINDOW_S).contains(&line.t_s);
        stream.iter().filter(is_in).copied().collect()
    };
    (0..=parts * (windows.len() - 1)).map(window).collect()
}

/// What windows share they tell once: a start from several that overlap is that from those of them that do not.
#[test]
fn law_a_start_counts_once_what_windows_share() {
    let windows = windows(62, STACK);
    let (mut apart, mut sharing) = (tracker(STACK), tracker(STACK));
    let expected = windows.iter().map(|lines| apart.track(lines, None)).last().unwrap().unwrap();
    let all = overlapping(&windows, 2);
    assert_eq!(all.last(), windows.last());
    for lines in &all[..all.len() - 1] {
        assert!(matches!(sharing.track(lines, None), Err(Failure::Gathering { .. })));
    }
    let found = sharing.track(&all[all.len() - 1], None).unwrap();
    assert_eq!(found.world_from_capsule, expected.world_from_capsule);
    assert_eq!(found.covariance, expected.covariance);
}

/// And so do the windows from which the markers' places are estimated.
#[test]
fn law_an_estimate_of_the_markers_counts_once_what_windows_share() {
    let windows = windows(63, 9);
    let mut drawn = triangle();
    drawn.markers[0].position_capsule_m.x += 1e-3;
    let estimate = |windows: &[Vec<Line>]| {
        let options = MixtureOptions { estimate_markers: true, ..MixtureOptions::default() };
        let mut tracker = Mixture::new(&drawn, noise_of_drawn(&scanner("reduced")), options);
        windows.iter().for_each(|lines| drop(tracker.track(lines, None)));
        tracker.memory().marker_estimate.unwrap().markers_m()[0].x - drawn.markers[0].position_capsule_m.x
    };
    let (apart_m, sharing_m) = (estimate(&windows), estimate(&overlapping(&windows, 5)));
    println!("figure: moved {:.4} mm, with windows that overlap {:.4} mm", 1e3 * apart_m, 1e3 * sharing_m);
    // Counted five times the windows would move it by a sixth more.
    let ratio = sharing_m / apart_m;
    assert!(apart_m < -3e-4 && (0.9..1.08).contains(&ratio), "{apart_m} {sharing_m}");
}

/// Windows until a start that waits only until its markers are told: few with many lines, more with few, and each time it is as good as it says.
#[test]
fn law_a_start_waits_for_what_it_needs() {
    waits_for_what_it_needs(1.0);
}

/// Of a capsule as well that leaves an even motion by 1 mm within eight windows, while a start with few lines takes eleven.
#[test]
fn law_a_start_of_a_fast_capsule_is_as_good_as_it_says() {
    waits_for_what_it_needs(8.0);
}

fn waits_for_what_it_needs(times_faster: f64) {
    const SIGMA_M: f64 = 0.8e-3;
    let options =
        || MixtureOptions { start_windows: 24, start_sigma_m: SIGMA_M, ..MixtureOptions::default() };
    let waited = [(284.0, 0.819), (54.0, 0.592)].map(|(mean_lines, true_share)| {
        let (mut windows, mut started, mut squares) = (0, 0, 0.0);
        for seed in 131..=142 {
            let scanner = scanner("reduced");
            let mut generator = Generator::new(scanner.clone(), Ends::physics(&scanner), triangle(), seed);
            let mut tracker = Mixture::new(&triangle(), noise_of_drawn(&scanner), options());
            let motion = |t: f64| helix(t, times_faster);
            for w in 0..24 {
                let lines = generator.poisson_window(&motion, w as f64 * WINDOW_S, mean_lines, true_share);
                windows += 1;
                if let Ok(first) = tracker.track(&lines, None) {
                    let worst = marker_errors(&first.markers_world_m, &motion(middle_s(w)), &triangle()).1;
                    started += 1;
                    squares += worst * worst / 12.0;
                    break;
                }
            }
        }
        assert_eq!(started, 12, "of 12 seeds with {mean_lines} lines");
        (f64::from(windows) / 12.0, squares.sqrt())
    });
    println!("figure: windows and worst marker, m, with 284 and 54 lines: {waited:?}");
    let [(many, many_m), (few, few_m)] = waited;
    assert!(many < 5.0 && few > 2.0 * many && few < 22.0, "{waited:?}");
    // The worst of three markers is off by more than the one that is told worst.
    assert!(many_m < 1.5 * SIGMA_M && few_m < 1.5 * SIGMA_M, "{waited:?}");
}

/// From the fifth window back to the first.
#[test]
fn law_a_tracker_goes_back_in_time_window_by_window() {
    let windows = windows(111, STACK);
    let mut tracker = tracker(1);
    rewind(&mut tracker, &helix(middle_s(STACK - 1), FAST), windows.iter().map(Vec::as_slice));
    let back = tracker.memory().world_from_capsule.unwrap();
    let (first, last) = (helix(middle_s(0), FAST), helix(middle_s(STACK - 1), FAST));
    let off = |to: &Isometry3<f64>| (back.translation.vector - to.translation.vector).norm();
    assert!(off(&first) < 1.5e-3 && off(&last) > 2e-3, "{} {}", off(&first), off(&last));
}

/// A capsule that was lost is looked for at once, in one window.
#[test]
fn law_only_the_first_start_waits() {
    let windows = windows(121, STACK + 2);
    let mut tracker = tracker(STACK);
    for lines in &windows[..STACK - 1] {
        assert!(tracker.track(lines, None).is_err());
    }
    assert!(tracker.track(&windows[STACK - 1], None).is_ok());
    assert!(tracker.track(&windows[STACK][..2], None).is_err());
    let found = tracker.track(&windows[STACK + 1], None).expect("a pose at once");
    let truth = helix(middle_s(STACK + 1), FAST);
    let off_m = (found.world_from_capsule.translation.vector - truth.translation.vector).norm();
    assert!(off_m < 3e-3, "{off_m}");
}

/// Beside one pair of blocks, seen by the other alone: all lines run nearly one way, and markers in another order, or mirrored in depth,
/// are as likely. A search that misses one of these must not be sure of another.
#[test]
fn law_a_first_pose_from_lines_that_run_one_way_is_not_sure_of_one_of_many() {
    let few = first_poses_beside_a_pair(80, 70.0, 0.6);
    let many = first_poses_beside_a_pair(40, 400.0, 0.8);
    println!(
        "figure: first poses, and wrong ones of them: of 80 windows of 70 lines {few:?}, of 40 of 400 {many:?}"
    );
    assert!(few.1 <= 1 && many.1 <= 1, "{few:?} {many:?}");
    // What lines do tell is answered.
    assert!(many.0 >= 10, "{many:?}");
}

/// First poses that so many windows told, and how many of them were wrong.
fn first_poses_beside_a_pair(windows: u64, mean_lines: f64, true_share: f64) -> (usize, usize) {
    let (set, scanner) = (capsule("hybrid"), scanner("reduced"));
    let (mut answered, mut wrong) = (0, 0);
    for seed in 501..501 + windows {
        let mut generator = Generator::new(scanner.clone(), Ends::physics(&scanner), set.clone(), seed);
        let attitude = UnitQuaternion::new(Vector3::new(0.7 * f64::from(seed as u32), 0.3, -0.5));
        let pose = Isometry3::from_parts(Translation3::new(91e-3, -13e-3, -14e-3), attitude);
        let lines = generator.poisson_window(&|_| pose, 0.0, mean_lines, true_share);
        let mut tracker = Mixture::new(&set, noise_of_drawn(&scanner), MixtureOptions::default());
        let Ok(found) = tracker.track(&lines, None) else { continue };
        answered += 1;
        let error = lumenav_core::pose::ominus(&found.world_from_capsule, &pose);
        // Beyond the 99.999 % quantile of chi-square with 6 degrees of freedom.
        wrong += usize::from(error.dot(&found.covariance.cholesky().unwrap().solve(&error)) > 33.1);
    }
    (answered, wrong)
}
