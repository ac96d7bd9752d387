//! Kinematic truth against closed forms, laws and mistakes.

use super::*;

#[test]
fn published_helix_meets_its_ends_and_speeds() {
    // than2015: start (-57, 0, -45) mm, end (57, 0, 45) mm, 36 s, 5 mm/s around z, 2.5 mm/s along.
    let helix = Helix { speed_factor: 1.0, jump: None };
    let (start, end) = (helix.pose(0.0).translation.vector, helix.pose(36.0).translation.vector);
    assert!((start - Vector3::new(-0.057, 0.0, -0.045)).norm() < 1e-12);
    assert!((end - Vector3::new(0.057, 0.0, 0.045)).norm() < 1e-12);
    let world = PathWorld { path: Box::new(helix), patient: None, now: SimTime::ZERO };
    let truth = world.capsule(SimTime::from_seconds(10.0));
    let v = truth.velocity_world_m_s;
    assert!((v.z - 0.0025).abs() < 1e-9);
    // π · 57 mm / 36 s = 4.974 mm/s: the published 5 mm/s is rounded.
    assert!((v.xy().norm() - 0.004974).abs() < 1e-6);
    let forward = truth.world_from_capsule.rotation * Vector3::x();
    assert!((forward - v.normalize()).norm() < 1e-6);
}

#[test]
fn law_rate_and_specific_force_are_derivatives_of_the_pose() {
    let world = PathWorld {
        path: Box::new(Helix { speed_factor: 8.0, jump: None }),
        patient: None,
        now: SimTime::ZERO,
    };
    let (a, b) = (SimTime::from_seconds(2.0), SimTime::from_seconds(2.001));
    let (ta, tb) = (world.capsule(a), world.capsule(b));
    let turned = ta.world_from_capsule.rotation * exp_so3(&(ta.angular_rate_capsule_rad_s * 1e-3));
    assert!(turned.angle_to(&tb.world_from_capsule.rotation) < 1e-6);
    let acceleration = (tb.velocity_world_m_s - ta.velocity_world_m_s) / 1e-3;
    let felt = ta.world_from_capsule.rotation * ta.specific_force_capsule_m_s2;
    assert!((felt + GRAVITY - acceleration).norm() < 1e-3);
}

/// Builds the world of a scenario's text.
fn world(text: &str) -> Result<Box<dyn World>, ScenarioError> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let node = Node::parse_text(text, "s.toml", folder, &[])?;
    let (scenario, truth) = (node.child_or_empty("scenario"), node.child_or_empty("truth"));
    let duration_s = scenario.to_toml().and_then(|t| t.get("duration_s").and_then(toml::Value::as_float));
    build(&truth.parse()?, &truth, (&scenario, duration_s), None, &RandomStreams::new(1, 0, COMPONENT))
}

fn refusal(text: &str) -> String {
    world(text).err().map_or_else(|| panic!("accepted: {text}"), |error| error.to_string())
}

#[test]
fn law_a_scenario_that_outlasts_its_path_is_refused_or_rests() {
    let too_long = "[scenario]\nduration_s = 40.0\n[truth]\nkind = \"helix\"\n";
    let error = refusal(too_long);
    assert!(error.starts_with("s.toml:2:14: `scenario.duration_s`: 40 s is longer than the path"), "{error}");
    assert!(error.contains("ends at 36 s; allowed: up to 36") && error.contains("hold"), "{error}");
    assert!(world("[scenario]\nduration_s = 36.0\n[truth]\nkind = \"helix\"\n").is_ok());
    assert!(
        refusal("[scenario]\nduration_s = 5.0\n[truth]\nkind = \"helix\"\nspeed_factor = 8\n")
            .contains("4.5 s")
    );
    let circles = "[scenario]\nduration_s = 80.0\n[truth]\nkind = \"three-half-circles\"\nspeed_mm_s = 7.5\n";
    assert!(refusal(circles).contains("ends at 72.04"), "{}", refusal(circles));
    assert!(world(&format!("{circles}pause_s = 4.0\n")).is_ok());
    // With `hold` it rests at the end: no velocity, no rate, gravity alone.
    let held = world(&format!("{too_long}after_end = \"hold\"\n")).unwrap();
    let (end, later) = (SimTime::from_seconds(36.0), SimTime::from_seconds(40.0));
    let (moving, resting) = (held.truth().capsule(end), held.truth().capsule(later));
    assert_eq!(moving.world_from_capsule, resting.world_from_capsule);
    assert!((moving.velocity_world_m_s.z - 0.0025).abs() < 1e-9);
    assert_eq!(resting.velocity_world_m_s, Vector3::zeros());
    assert_eq!(resting.angular_rate_capsule_rad_s, Vector3::zeros());
    let felt = resting.world_from_capsule.rotation * resting.specific_force_capsule_m_s2;
    assert!((felt + GRAVITY).norm() < 1e-12, "{felt}");
}

#[test]
fn law_a_recording_that_does_not_cover_the_scenario_is_refused() {
    let file = std::env::temp_dir().join(format!("lumenav-kinematic-{}.tum", std::process::id()));
    let text = |duration_s: f64, more: &str| {
        let file = file.display();
        format!("[scenario]\nduration_s = {duration_s:?}\n[truth]\nkind = \"tum\"\nfile = '{file}'\n{more}")
    };
    std::fs::write(&file, "0 0 0 0 0 0 0 1\n2 0.01 0 0 0 0 0 1\n").unwrap();
    assert!(world(&text(2.0, "")).is_ok());
    let late = refusal(&text(2.5, ""));
    assert!(late.starts_with("s.toml:2:14: `scenario.duration_s`") && late.contains("ends at 2 s"), "{late}");
    let held = world(&text(2.5, "after_end = \"hold\"\n")).unwrap();
    let truth = held.truth().capsule(SimTime::from_seconds(2.4));
    assert!((truth.world_from_capsule.translation.x - 0.01).abs() < 1e-15);
    assert_eq!(truth.velocity_world_m_s, Vector3::zeros());
    std::fs::write(&file, "1 0 0 0 0 0 0 1\n2 0.01 0 0 0 0 0 1\n").unwrap();
    let early = refusal(&text(2.0, ""));
    assert!(early.starts_with("s.toml:5:8: `truth.file`") && early.contains("begins at 1 s"), "{early}");
    std::fs::remove_file(&file).unwrap();
}

#[test]
fn law_speeds_and_steps_outside_their_range_are_refused_at_their_line() {
    for (truth, said) in [
        (
            "kind = \"helix\"\nspeed_factor = 1e9",
            "s.toml:3:16: `truth.speed_factor`: 1e9 is not allowed here; it must be from 1e-3 to 1e3",
        ),
        ("kind = \"three-half-circles\"\nspeed_mm_s = 1e-9", "s.toml:3:14: `truth.speed_mm_s`"),
        ("kind = \"three-half-circles\"\nspeed_mm_s = 12\npause_s = 1e12", "s.toml:4:11: `truth.pause_s`"),
        (
            "kind = \"line\"\nfrom_mm = [0, 0, 0]\nto_mm = [1, 0, 0]\nspeed_mm_s = 1e12",
            "s.toml:5:14: `truth.speed_mm_s`",
        ),
    ] {
        let error = refusal(&format!("[truth]\n{truth}\n"));
        assert!(error.starts_with(said), "{error}");
    }
}

#[test]
fn law_a_jump_is_no_motion() {
    let text = "[truth]\nkind = \"helix\"\n";
    let (plain, jumps) = (
        world(text).unwrap(),
        world(&format!("{text}[truth.jump]\nat_s = 15.0\nby_mm = [0, 50, 0]\n")).unwrap(),
    );
    let off = |seconds: f64| {
        let at = SimTime::from_seconds(seconds);
        let (a, b) = (plain.truth().capsule(at), jumps.truth().capsule(at));
        assert_eq!(a.velocity_world_m_s, b.velocity_world_m_s);
        assert_eq!(a.specific_force_capsule_m_s2, b.specific_force_capsule_m_s2);
        (b.world_from_capsule.translation.vector - a.world_from_capsule.translation.vector).norm()
    };
    assert_eq!(off(14.99995), 0.0);
    assert!((off(15.0) - 0.05).abs() < 1e-15 && (off(15.00005) - 0.05).abs() < 1e-15);
}

#[test]
fn law_drawn_truth_has_the_variance_of_its_model() {
    let motion = MotionModel::default();
    let step = motion.translation(1.0);
    let n = 4000;
    let mut sum = 0.0;
    for seed in 0..n {
        let mut stream = RandomStreams::new(seed, 0, COMPONENT).stream("motion", 1);
        let (dp, _) = draw_pair(&step, &mut stream);
        sum += dp.norm_squared() / 3.0;
    }
    // Standard error of a variance of 3 n draws: sqrt(2 / 3n) = 1.3 %.
    assert!((sum / n as f64 / step.noise_pp - 1.0).abs() < 0.05);
}
