//! What counts of a line (`LineNoise::information_share`) counts in every covariance, and a prior beside the lines in full.

use super::support::{Ends, Generator, WINDOW_S, helix, noise_of_drawn, scanner, set, triangle};
use lumenav_core::PriorUse;
use lumenav_pet::Line;
use lumenav_pet::tracking::{LineNoise, Mixture, MixtureOptions, Points, Prior, Tracked, Tracker};
use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3};

fn noise(share: f64) -> LineNoise {
    let mut noise = noise_of_drawn(&scanner("reduced"));
    noise.information_share = share;
    noise
}

fn windows(count: usize) -> Vec<Vec<Line>> {
    let mut generator =
        Generator::new(scanner("reduced"), Ends::physics(&scanner("reduced")), triangle(), 77);
    let window = |w: usize| generator.window(&|t| helix(t, 0.5), w as f64 * WINDOW_S, 170, 30).0;
    (0..count).map(window).collect()
}

/// The last answer to some windows, with so much of their information.
fn answer(share: f64, options: &MixtureOptions, windows: &[Vec<Line>], prior: Option<&Prior>) -> Tracked {
    let mut tracker = Mixture::new(&triangle(), noise(share), options.clone());
    let answers: Vec<_> = windows.iter().map(|lines| tracker.track(lines, prior)).collect();
    answers.into_iter().next_back().unwrap().unwrap()
}

fn distance_m(a: &Tracked, b: &Tracked) -> f64 {
    (a.world_from_capsule.translation.vector - b.world_from_capsule.translation.vector).norm()
}

/// Largest difference of `a` from `wanted`, by `wanted`'s own scales.
fn difference(a: &Matrix6<f64>, wanted: &Matrix6<f64>) -> f64 {
    let scale = |i: usize| wanted[(i, i)].sqrt();
    Matrix6::from_fn(|i, j| (a[(i, j)] - wanted[(i, j)]) / (scale(i) * scale(j))).amax()
}

#[test]
fn closed_form_half_of_what_lines_say_is_twice_the_covariance() {
    for (options, count, most) in [
        (MixtureOptions::default(), 1, [1e-12, 1e-9]),
        // A rate that is not known beforehand: what is known of it counts in full, and is not halved with the lines.
        (
            MixtureOptions { start_windows: 3, start_rate_sigma_rad_s: 100.0, ..MixtureOptions::default() },
            3,
            [1e-5, 0.01],
        ),
    ] {
        let windows = windows(count);
        let (full, half) = (answer(1.0, &options, &windows, None), answer(0.5, &options, &windows, None));
        assert!(distance_m(&full, &half) < most[0], "{count}: {}", distance_m(&full, &half));
        let far = difference(&half.covariance, &(full.covariance * 2.0));
        println!("figure: {count} windows: covariance off twice by {far:.1e}");
        assert!(far < most[1], "{count}: {far}");
        if count == 1 {
            continue;
        }
        let [full, half] = [full, half].map(|tracked| tracked.motion.unwrap().covariance);
        for i in 6..9 {
            let ratio = half[(i, i)] / full[(i, i)];
            assert!((ratio / 2.0 - 1.0).abs() < 0.03, "velocity {i}: {ratio}");
        }
    }
}

/// The posterior's information is the prior's, in full, and a share of the lines'.
#[test]
fn closed_form_a_prior_counts_in_full_beside_a_share_of_the_lines() {
    let windows = windows(1);
    let sigma = [1e-4, 1e-4, 1e-4, 2e-2, 2e-2, 2e-2];
    let prior = Prior {
        world_from_capsule: helix(0.5 * WINDOW_S, 0.5),
        covariance: Matrix6::from_diagonal(&sigma.map(|s: f64| s * s).into()),
        velocity_world_m_s: Vector3::zeros(),
        how: PriorUse::Contained,
    };
    let known = prior.covariance.try_inverse().unwrap();
    let of_lines = |share: f64| {
        let options = MixtureOptions::default();
        let told = answer(share, &options, &windows, Some(&prior)).covariance.try_inverse().unwrap();
        told - known
    };
    let (full, half) = (of_lines(1.0), of_lines(0.5));
    let far = difference(&(half * 2.0), &full);
    println!("figure: lines beside a prior off half by {far:.1e}");
    assert!(full.cholesky().is_some() && far < 0.1, "{far}");
}

#[test]
fn closed_form_points_know_the_share() {
    let place = [[10.0, -20.0, 15.0]];
    let mut generator =
        Generator::new(scanner("reduced"), Ends::physics(&scanner("reduced")), set(&place), 78);
    let (lines, _) = generator.window(&|_| Isometry3::identity(), 0.0, 150, 40);
    let of = |share: f64| *Points::new(1, noise(share)).track(&lines).0[0].as_ref().unwrap();
    let (full, half) = (of(1.0), of(0.5));
    assert_eq!(full.position_world_m, half.position_world_m);
    let ratio: Matrix3<f64> = half.covariance_m2.component_div(&full.covariance_m2);
    assert!(ratio.iter().all(|ratio| (ratio / 2.0 - 1.0).abs() < 1e-9), "{ratio}");
}
