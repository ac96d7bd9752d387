//! Does the mixture know how wrong it is? Truth drawn from the motion model that its prior is taken from, lines from the law that it
//! is told: then the squared error in claimed standard deviations must average to its degrees of freedom.

use super::support::{Ends, Generator, MotionFilter, WINDOW_S, capsule, noise_of_law, scanner};
use lumenav_core::pose::{ominus, oplus};
use lumenav_core::{RandomStream, RandomStreams};
use lumenav_pet::Line;
use lumenav_pet::tracking::{BlockNoise, Mixture, MixtureOptions, Tracker};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand_distr::{Distribution as _, StandardNormal};

const ACCELERATION: [f64; 2] = [0.03, 1.0];
const WINDOWS: usize = 40;
/// Windows that are not judged: the velocity is not known yet.
const SETTLING: usize = 10;

/// Poses in the middle of each window, of a body whose acceleration is white from window to window.
fn random_path(seed: u64) -> Vec<(Isometry3<f64>, Vector6<f64>)> {
    let mut random: RandomStream = RandomStreams::new(seed, 0, "path").stream("acceleration", 0);
    let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.1 * seed as f64);
    let mut pose = Isometry3::from_parts(Translation3::new(0.02, -0.01, 0.0), turn);
    let mut rate = Vector6::zeros();
    let mut path = Vec::with_capacity(WINDOWS);
    for _ in 0..WINDOWS {
        path.push((pose, rate));
        let acceleration = Vector6::from_fn(|i, _| {
            let z: f64 = StandardNormal.sample(&mut random);
            z * ACCELERATION[i / 3]
        });
        let step = rate * WINDOW_S + acceleration * (0.5 * WINDOW_S * WINDOW_S);
        pose = oplus(&pose, &step);
        rate += acceleration * WINDOW_S;
    }
    path
}

/// Squared errors in claimed standard deviations over 6, flips (more than 3 mm or 40 degrees off) apart.
fn nees(lines: f64, true_share: f64, seed: u64) -> (Vec<f64>, usize) {
    let (set, law) = (capsule("pet-scalene"), BlockNoise::reference());
    let scanner = scanner("reduced");
    let mut tracker = Mixture::new(&set, noise_of_law(&scanner, &law), MixtureOptions::default());
    let mut generator = Generator::new(scanner, Ends::Law(law), set, seed);
    let mut filter = MotionFilter::new(ACCELERATION[0], ACCELERATION[1]);
    let (mut values, mut flips) = (Vec::new(), 0);
    for (w, (middle, rate)) in random_path(seed).into_iter().enumerate() {
        let start_s = w as f64 * WINDOW_S;
        let motion = |t: f64| oplus(&middle, &(rate * (t - start_s - 0.5 * WINDOW_S)));
        let window = generator.poisson_window(&motion, start_s, lines, true_share);
        let Ok(tracked) = filter.step(&mut tracker, &window, WINDOW_S) else { continue };
        if w < SETTLING {
            continue;
        }
        let error = ominus(&tracked.world_from_capsule, &middle);
        if error.fixed_rows::<3>(0).norm() > 3e-3 || error.fixed_rows::<3>(3).norm() > 0.7 {
            flips += 1;
        }
        let factor = tracked.covariance.cholesky().expect("a covariance");
        values.push(error.dot(&factor.solve(&error)) / 6.0);
    }
    (values, flips)
}

fn judged(lines: f64, true_share: f64, seeds: std::ops::RangeInclusive<u64>) -> (f64, f64, usize, usize) {
    let (mut all, mut flips) = (Vec::new(), 0);
    for seed in seeds {
        let (values, flipped) = nees(lines, true_share, seed);
        all.extend(values);
        flips += flipped;
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    // 90 % quantile of chi-square with 6 degrees of freedom: 10.645.
    let inside = all.iter().filter(|v| **v <= 10.645 / 6.0).count() as f64 / all.len() as f64;
    (mean, inside, flips, all.len())
}

#[test]
fn law_covariance_of_the_mixture_is_that_of_its_errors() {
    // 24 seeds of 30 windows: 720 values, correlated over some windows; a mean of 1 has a standard deviation of about 0.05.
    let (mean, inside, flips, count) = judged(284.0, 0.819, 101..=124);
    println!(
        "figure: 284 lines: NEES/dof {mean:.3}, {:.1} % inside, {flips} flips of {count}",
        100.0 * inside
    );
    assert!(count > 700 && flips == 0, "{count} {flips}");
    assert!((0.8..=1.25).contains(&mean), "{mean}");
    assert!((0.85..=0.95).contains(&inside), "{inside}");
}

#[test]
fn law_covariance_of_thin_windows_is_that_of_their_errors() {
    let (mean, inside, flips, count) = judged(80.0, 0.708, 101..=124);
    println!(
        "figure: 80 lines: NEES/dof {mean:.3}, {:.1} % inside, {flips} flips of {count}",
        100.0 * inside
    );
    assert!(count > 700 && flips == 0, "{count} {flips}");
    assert!((0.8..=1.25).contains(&mean), "{mean}");
    assert!((0.85..=0.95).contains(&inside), "{inside}");
}

#[test]
fn law_translations_of_the_world_do_not_change_the_errors() {
    // The same lines carried along give the same pose carried along.
    let (set, law) = (capsule("pet-five"), BlockNoise::reference());
    let scanner = scanner("reduced");
    let mut generator = Generator::new(scanner.clone(), Ends::Law(law), set.clone(), 5);
    let still = |_: f64| Isometry3::translation(0.02, 0.0, 0.01);
    let lines = generator.poisson_window(&still, 0.0, 284.0, 0.819);
    let here = Mixture::new(&set, noise_of_law(&scanner, &law), MixtureOptions::default());
    let by = Vector3::new(1e-4, -2e-4, 3e-4);
    let moved: Vec<_> =
        lines.iter().map(|l| Line { ends_world_m: l.ends_world_m.map(|e| e + by), ..*l }).collect();
    let pose = |lines: &[Line]| here.clone().track(lines, None).expect("a pose").world_from_capsule;
    let (a, b) = (pose(&lines), pose(&moved));
    assert!((b.translation.vector - a.translation.vector - by).norm() < 2e-6);
}
