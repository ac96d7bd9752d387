//! Whatever moves it, the capsule stays inside the lumen.

use super::*;

/// Both ends of what a bowel does: the small bowel in phase III, a mass movement somewhere every few seconds.
fn frantic() -> MotilityConfig {
    let mut motility = busy();
    motility.wave.clear();
    motility.colon.mass_rate_per_day = NonNegative(40_000.0);
    motility
}

/// `LUMENAV_FULL=1`: each run of the fuzzing as long as the acceptance asks.
fn full() -> bool {
    std::env::var("LUMENAV_FULL").is_ok_and(|v| v == "1")
}

/// The engine of a seed with the capsule at an arc length.
fn fuzzed(
    tract: Arc<Tract>,
    motility: MotilityConfig,
    config: EngineConfig,
) -> impl Fn(u64, f64) -> Result<Engine, EngineError> {
    move |seed, start_m| {
        let streams = RandomStreams::new(seed, 0, "motility");
        let config = EngineConfig { start_arc_length_m: NonNegative(start_m), ..config.clone() };
        Engine::new(config, tract.clone(), Motility::new(&motility, &tract, &streams).unwrap(), CAPSULE)
    }
}

fn stays_inside(test: &str, tract: &Arc<Tract>, runs: u64, short_s: f64) {
    let duration_s = if full() { 60.0 } else { short_s };
    let build = fuzzed(tract.clone(), frantic(), EngineConfig::default());
    let report = fuzz_inside_lumen(0..runs, duration_s, tract, &CAPSULE, build).unwrap();
    println!(
        "figure: {test}: {} runs of {duration_s} s, {} steps, worst excess {:.3} mm (seed {}, {:.3} m, {:.2} s), fastest {:.1} mm/s, \
         {} not finite",
        report.runs,
        report.steps,
        1e3 * report.worst_excess_m,
        report.worst_seed,
        report.worst_arc_length_m,
        report.worst_at.seconds(),
        1e3 * report.fastest_m_s,
        report.not_finite
    );
    assert_eq!(report.runs, runs);
    assert!(report.inside(), "{report:?}, tolerance {TOLERANCE_M}");
}

#[test]
fn law_a_capsule_in_a_whole_gut_stays_inside_and_its_stalls_are_told() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/tracts");
    let tract = tract_of(&models.join("whole-gut-average-man.toml"), &[]);
    // Stalls within the half minute that this lasts.
    let config = EngineConfig { stalled_after_s: Positive(10.0), ..EngineConfig::default() };
    let build = fuzzed(tract.clone(), MotilityConfig::default(), config);
    let report = fuzz_inside_lumen(0..24, 30.0, &tract, &CAPSULE, build).unwrap();
    assert!(report.inside() && report.untold_stalls == 0, "{report:?}");
    assert!(report.stalls > 3, "{report:?}");
}

#[test]
fn law_the_capsule_stays_inside_the_shipped_colon() {
    stays_inside("law_the_capsule_stays_inside_the_shipped_colon", &shipped_colon(), 200, 5.0);
}

#[test]
fn law_the_capsule_stays_inside_a_measured_colon() {
    if let Some(tract) = measured("law_the_capsule_stays_inside_a_measured_colon", &MEASURED_COLON) {
        stays_inside("law_the_capsule_stays_inside_a_measured_colon", &tract, 200, 5.0);
    }
}

#[test]
fn law_the_capsule_stays_inside_a_measured_tract() {
    // With kinks that a rigid capsule does not fit.
    if let Some(tract) = measured("law_the_capsule_stays_inside_a_measured_tract", &[]) {
        stays_inside("law_the_capsule_stays_inside_a_measured_tract", &tract, 200, 5.0);
    }
}

#[test]
fn law_the_capsule_stays_inside_a_coil_of_small_bowel() {
    stays_inside("law_the_capsule_stays_inside_a_coil_of_small_bowel", &coil(), 20, 10.0);
}

#[test]
fn law_taut_tissue_holds_what_presses_into_the_wall() {
    // Several times what a magnet does: sideways, aslant, and with a torque that turns the capsule across.
    let straight = closed(SegmentKey::Ileum, 0.0085);
    for (force, torque) in [
        (Vector3::new(0.0, -4.0, 0.0), Vector3::zeros()),
        (Vector3::new(2.0, 2.0, 1.0), Vector3::zeros()),
        (Vector3::new(0.0, -2.0, 0.0), Vector3::new(0.005, 0.0, 0.0)),
    ] {
        let mut engine = engine_of(&straight, &still(), at(0.5), 1);
        engine.apply_wrench(&force, &torque);
        for _ in 0..1200 {
            engine.step();
            let offset_m = engine.state().offset_m;
            assert!(offset_m <= 0.003 + TOLERANCE_M, "{force:?}: {offset_m} m off the centre line");
        }
        assert!(engine.state().offset_m > 0.005, "the force never pressed it into the wall");
    }
}

#[test]
fn law_a_capsule_passes_a_kink_tighter_than_itself() {
    // A bend of 90 degrees and 4 mm in a lumen of 7 mm, pulled through by 0.25 N: the tissue gives way, the capsule turns with it.
    let bend_m = 0.004;
    let mut points: Vec<_> = (0..40).map(|i| Point3::new(0.0, 0.0, 2e-3 * f64::from(i))).collect();
    let turn = (0..=8).map(|i| std::f64::consts::FRAC_PI_2 * f64::from(i) / 8.0);
    points.extend(turn.map(|a| Point3::new(bend_m * (1.0 - a.cos()), 0.0, 0.08 + bend_m * a.sin())));
    points.extend((1..40).map(|i| Point3::new(bend_m + 2e-3 * f64::from(i), 0.0, 0.08 + bend_m)));
    let tract = tract_through(points, SegmentKey::Ileum, 0.007, (End::Closed, End::Closed));
    let mut engine = engine_of(&tract, &still(), at(0.03), 1);
    for _ in 0..240 * 30 {
        let along = tract.station(engine.state().arc_length_m).tangent * 0.25;
        engine.apply_wrench(&along, &Vector3::zeros());
        engine.step();
        let state = engine.state();
        assert!(
            state.offset_m <= 0.0015 + TOLERANCE_M,
            "{} m off at {} m",
            state.offset_m,
            state.arc_length_m
        );
    }
    let state = engine.state();
    assert!(state.arc_length_m > 0.13, "stuck at {} m", state.arc_length_m);
    let axis = state.world_from_capsule.rotation * Vector3::x();
    assert!(axis.x > 0.9, "it did not turn: {axis}");
}
