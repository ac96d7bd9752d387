//! Published claims and bounds at the level of whole runs, seconds-sized.

use crate::support::{Run, root, scratch};
use lumenav::report::{Metrics, read_json};

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
fn closed_form_tracker_reaches_the_bound_on_the_helix() {
    for seed in 1..=5 {
        let metrics = helix(seed);
        let track = &metrics.tracks["magnetic"];
        let ratio = track.rmse_over_bound.expect("the model has a bound");
        println!("seed {seed}: rmse over bound {ratio:.3}");
        assert!((0.95..=1.1).contains(&ratio), "seed {seed}: {ratio}");
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
