//! Published claims and bounds at the level of whole runs, seconds-sized.

use crate::support::{Run, root, scratch};
use lumenav::report::{Metrics, Trials, read_json};

fn helix(seed: u64) -> Metrics {
    let folder = scratch();
    let out = folder.path().join("run");
    let scenario = root().join("scenarios/helix-magnetic.toml");
    Run::new(&scenario).out(&out).arg("--record").arg("none").arg("--seed").arg(seed.to_string()).ok();
    read_json(&out.join("metrics.json")).expect("the contract")
}

/// The cold two-start maximum-likelihood tracker reaches its bound: rms of error over root of the trace at the true pose
/// within 0.95 to 1.1 for each of the seeds 1 to 5.
#[test]
fn cross_tracker_reaches_the_bound_on_the_helix() {
    for seed in 1..=5 {
        let metrics = helix(seed);
        let track = &metrics.tracks["magnetic"];
        let ratio = track.rmse_over_bound.expect("the model has a bound");
        println!("seed {seed}: rmse over bound {ratio:.3}");
        assert!((0.95..=1.1).contains(&ratio), "seed {seed}: {ratio}");
        let each = track.rms_of_error_over_bound.expect("the model has a bound");
        assert!((0.95..=1.1).contains(&each), "seed {seed}: each estimate against its own bound: {each}");
        assert_eq!(track.failed_updates, 0);
    }
}

/// The filter is better than the tracker alone on the same readings, and says how wrong it is without boasting.
#[test]
fn regress_filter_beats_tracker_on_the_helix() {
    let metrics = helix(1);
    let mean = |name: &str| metrics.tracks[name].position_error_mm.as_ref().expect("truth").mean;
    assert!(
        mean("magnetic-eskf") < 0.7 * mean("magnetic"),
        "{} vs {}",
        mean("magnetic-eskf"),
        mean("magnetic")
    );
    let nees = metrics.tracks["magnetic-eskf"].nees.as_ref().expect("truth");
    assert!(nees.mean / nees.dof as f64 <= 1.5, "{nees:?}");
}

/// 200 trials of `matched-magnetic`, five seconds each.
fn matched(overrides: &[&str]) -> Trials {
    let folder = scratch();
    let out = folder.path().join("run");
    let mut run = Run::new(&root().join("scenarios/matched-magnetic.toml")).out(&out);
    for setting in ["scenario.duration_s=5"].iter().chain(overrides) {
        run = run.arg("--set").arg(setting);
    }
    run.arg("--trials").arg("200").arg("--seed").arg("21").ok();
    read_json(&out.join("trials.json")).expect("the trials' figures")
}

/// Truth drawn from the filter's own model: the mean NEES over 200 trials per degree of freedom lies within 0.85 to 1.25 at
/// 90 % of the instants, and the 90 % region holds the truth in 85 to 95 % of all updates.
#[test]
fn law_a_matched_nonlinear_filter_knows_how_wrong_it_is() {
    let trials = matched(&[]);
    assert_eq!((trials.trials, trials.failed), (200, 0));
    for (name, track) in &trials.tracks {
        let nees = track.nees.expect("there is a truth");
        println!("{name}: {nees:?}");
        assert!(nees.share_within_085_125 >= 0.9, "{name}: {nees:?}");
        assert!((0.85..=0.95).contains(&nees.across.coverage_90), "{name}: {nees:?}");
    }
}

/// The same filter told three quarters or four thirds of the noise fails on its side. (Told half of it, the gate refuses so much
/// that what remains is prediction, and only the innovations show what is wrong.)
#[test]
fn law_a_filter_told_a_wrong_noise_fails_the_same_test() {
    for (told, word) in [("9e-9", "overconfident: "), ("1.6e-8", "cautious: ")] {
        let setting = format!("track.flux.sensor.plane.noise_tesla={told}");
        let trials = matched(&[&setting]);
        let flux = &trials.tracks["flux"];
        let verdict = flux.verdict.as_ref().expect("there is a truth").to_string();
        assert!(verdict.starts_with(word), "told {told}: {verdict}");
        assert!(flux.nees.expect("there is a truth").across.share_inside_95 < 0.8, "told {told}");
    }
}
