//! What a scenario file may not say: every refusal names file, line and key, and nothing runs for ever.

use lumenav_core::{ModelFolder, Node, SimTime};
use lumenav_scenario::engine::{ENGINE_SOURCES, EngineConfig};
use lumenav_scenario::{ScenarioFile, build_world};
use std::path::{Path, PathBuf};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// A scenario in a straight tube with more text behind it (from line 8 on).
fn in_a_tube(capsule: &str, duration_s: &str, more: &str) -> String {
    format!(
        "[scenario]\nname = \"t\"\nduration_s = {duration_s}\n[capsule]\nmodel = \"{capsule}\"\n[tract]\nmodel = \"straight-tube\"\n{more}\n"
    )
}

fn build(text: &str) -> Result<(), String> {
    let node = Node::parse_text(text, "s.toml", Path::new(""), &[]).map_err(|e| e.to_string())?;
    let file = ScenarioFile::from_node(node, ModelFolder::new(models())).map_err(|e| e.to_string())?;
    build_world(&file, 1, 0).map(|_| ()).map_err(|e| e.to_string())
}

#[test]
fn law_numbers_outside_their_range_are_refused_at_their_line() {
    assert_eq!(build(&in_a_tube("pillcam-magnet", "5.0", "")), Ok(()));
    for (more, said) in [
        (
            "[engine]\nstep_rate_hz = 10001",
            "s.toml:9:16: `engine.step_rate_hz`: step_rate_hz has to be from 60 to 10000",
        ),
        ("[engine]\nstep_rate_hz = 59", "s.toml:9:16: `engine.step_rate_hz`"),
        // Both were accepted and forgotten: how a capsule starts is said with the capsule.
        ("[engine]\nstart_arc_length_m = 0.1", "s.toml:9:1: `engine.start_arc_length_m`"),
        ("[engine]\nstart_roll_rad = 0.1", "s.toml:9:1: `engine.start_roll_rad`"),
        ("[engine]\nstep_rate_hz = 99999999999", "s.toml:9:16: `engine.step_rate_hz`"),
        ("[engine]\ncoulomb_newton = 1e300", "s.toml:9:18: `engine.coulomb_newton`"),
        ("[engine]\nfluid_density_kg_m3 = 1e300", "s.toml:9:23: `engine.fluid_density_kg_m3`"),
        ("[engine]\nregularisation_m_s = 1e-300", "s.toml:9:22: `engine.regularisation_m_s`"),
        ("[engine]\ncap_stiffness_newton_per_m = 1e300", "s.toml:9:30: `engine.cap_stiffness_newton_per_m`"),
        ("[engine]\ngravity_torso_m_s2 = [0, 1e300, 0]", "s.toml:9:22: `engine.gravity_torso_m_s2`"),
        ("[engine]\nstalled_after_s = 1e300", "s.toml:9:19: `engine.stalled_after_s`"),
        (
            "[motility.jejunum]\nrate_hz = [0.2, 1e9]",
            "s.toml:9:11: `motility.jejunum.rate_hz`: jejunum.rate_hz has to be from 0 to 2",
        ),
        ("[motility.colon]\nhaustral_rate_hz = 1e9", "s.toml:9:20: `motility.colon.haustral_rate_hz`"),
        ("[[motility.wave]]\nstart_time_s = 1\nwidth_m = 1e-9", "s.toml:10:11: `motility.wave[0].width_m`"),
        (
            "[patient]\nposture = \"upright\"\n[engine]\ngravity_torso_m_s2 = [0, 0, -9.81]",
            "s.toml:11:22: `engine.gravity_torso_m_s2`: with a [patient] the posture says",
        ),
        ("[record]\ntruth_rate_hz = 1e12", "s.toml:9:17: `record.truth_rate_hz`"),
        ("[record]\nscene_rate_hz = 1e-12", "s.toml:9:17: `record.scene_rate_hz`"),
        (
            "[[sensor]]\nname = \"a\"\nmodality = \"magnetic\"\n[sensor.schedule]\nrate_hz = 1e-12\nstart_s = 1",
            "s.toml:12:11: `sensor[0].schedule.rate_hz`",
        ),
        (
            "[[period]]\nname = \"a\"\nfrom_s = 3\nto_s = 3",
            "s.toml:11:8: `period[0].to_s`: ends before it begins",
        ),
        (
            "[[period]]\nname = \"a\"\nfrom_s = 5\nto_s = 9",
            "s.toml:10:10: `period[0].from_s`: begins after the end",
        ),
        (
            "[[period]]\nname = \"a b\"\nfrom_s = 1\nto_s = 9",
            "s.toml:9:8: `period[0].name`: `a b` is not allowed",
        ),
    ] {
        let error = build(&in_a_tube("pillcam-magnet", "5.0", more)).unwrap_err();
        assert!(error.starts_with(said), "{error}, wanted {said}");
    }
    let error = build(&in_a_tube("pillcam-magnet", "1e15", "")).unwrap_err();
    assert!(error.starts_with("s.toml:3:14: `scenario.duration_s`"), "{error}");
}

#[test]
fn law_a_tether_that_cannot_be_is_refused_at_its_key() {
    let tether = |more: &str| {
        let text = in_a_tube("pillcam-magnet", "5.0", &format!("[tract.tether]\n{more}"));
        build(&text.replace("[tract]\n", "start_arc_length_mm = 100\n[tract]\n"))
    };
    assert_eq!(tether("length_mm = 40"), Ok(()));
    for (more, said) in [
        ("length_mm = 4e3", "s.toml:10:13: `tract.tether.length_mm`"),
        ("length_mm = 0", "s.toml:10:13: `tract.tether.length_mm`"),
        ("length_mm = 40\nradius_mm = 1e3", "s.toml:11:13: `tract.tether.radius_mm`"),
        ("length_mm = 40\nlink_mm = 1e-3", "s.toml:11:11: `tract.tether.link_mm`"),
        ("length_mm = 40\ndensity_kg_m3 = 1e9", "s.toml:11:17: `tract.tether.density_kg_m3`"),
        ("length_mm = 40\nheld = 1", "s.toml:11:8: `tract.tether.held`"),
        ("length_mm = 40\nknots = 3", "s.toml:11:1: `tract.tether.knots`"),
        ("held = false", "s.toml:9:1: `tract.tether`"),
    ] {
        let error = tether(more).unwrap_err();
        assert!(error.starts_with(said), "{error}, wanted {said}");
    }
}

#[test]
fn law_faults_outside_their_range_are_refused_at_their_line() {
    let sensor = "[[sensor]]\nname = \"a\"\nmodality = \"magnetic\"\n[sensor.schedule]\nrate_hz = 1\n[[fault]]\nsensor = \"a\"\n";
    for (fault, said) in [
        ("kind = \"dropout\"\nstart_s = 1\nend_s = 1e300", "s.toml:17:9: `fault[0].end_s`"),
        ("kind = \"delay\"\nstart_s = 1\nend_s = 2\ndelay_ms = 1e300", "s.toml:18:12: `fault[0].delay_ms`"),
    ] {
        let error = build(&in_a_tube("pillcam-magnet", "5.0", &format!("{sensor}{fault}"))).unwrap_err();
        assert!(error.starts_with(said), "{error}, wanted {said}");
    }
}

#[test]
fn law_a_capsule_as_long_as_wide_is_refused_in_a_tract_at_its_own_file() {
    // The bare magnet of the recorded series: its file is right, but a wall has nothing to hold it by.
    let error = build(&in_a_tube("magnet-10x10", "5.0", "")).unwrap_err();
    assert!(error.contains("capsules/magnet-10x10.toml:5:13: `capsule.length_mm`: in a tract"), "{error}");
    let kinematic = "[scenario]\nname = \"t\"\nduration_s = 5.0\n[capsule]\nmodel = \"magnet-10x10\"\n[truth]\nkind = \"helix\"\n";
    assert_eq!(build(kinematic), Ok(()));
}

#[test]
fn law_a_scenario_that_outlasts_its_path_is_refused_at_its_duration() {
    let text = "[scenario]\nname = \"t\"\nduration_s = 60\n[capsule]\nmodel = \"pillcam-magnet\"\n[truth]\nkind = \"helix\"\n";
    let error = build(text).unwrap_err();
    assert!(error.starts_with("s.toml:3:14: `scenario.duration_s`: 60 s is longer than the path"), "{error}");
    assert_eq!(build(&format!("{text}after_end = \"hold\"\n")), Ok(()));
}

#[test]
fn law_every_default_of_the_engine_has_a_source() {
    let node = Node::parse_text("", "s.toml", Path::new(""), &[]).unwrap();
    let _: EngineConfig = node.child_or_empty("engine").parse_sourced(&ENGINE_SOURCES).unwrap();
    let rows = node.log().entries()[0].rows();
    assert_eq!(rows.len(), ENGINE_SOURCES.len());
    for row in rows {
        assert!(row.source.is_some(), "{} has no source", row.key);
    }
}

#[test]
fn law_every_default_of_a_scenario_has_a_source() {
    let text = in_a_tube("pillcam-magnet", "5.0", "");
    let node = Node::parse_text(&text, "s.toml", Path::new(""), &[]).unwrap();
    let file = ScenarioFile::from_node(node, ModelFolder::new(models())).unwrap();
    build_world(&file, 1, 0).unwrap();
    let mut numbers = 0;
    for entry in file.node.log().entries() {
        for row in entry.rows().into_iter().filter(|row| !row.set) {
            let is_number = row.value.is_float() || row.value.is_integer();
            numbers += usize::from(is_number);
            assert!(
                !is_number || row.source.is_some(),
                "{}: {}.{} has no source",
                entry.file,
                entry.path,
                row.key
            );
        }
    }
    assert!(numbers > 60, "{numbers}");
}

#[test]
fn law_a_world_starts_at_rest() {
    let text = |more: &str| {
        format!(
            "[scenario]\nname = \"t\"\nduration_s = 5.0\n[capsule]\nmodel = \"pillcam-magnet\"\nstart_arc_length_mm = \
             100.0\n[tract]\nmodel = \"colon\"\n[motility]\nspontaneous = false\n{more}"
        )
    };
    let fastest_m_s = |more: &str| {
        let node = Node::parse_text(&text(more), "s.toml", Path::new(""), &[]).unwrap();
        let file = ScenarioFile::from_node(node, ModelFolder::new(models())).unwrap();
        let mut world = build_world(&file, 1, 0).unwrap().world;
        world.advance_to(SimTime::from_seconds(0.2)).unwrap();
        let speed =
            |i: i32| world.truth().capsule(SimTime(i64::from(i) * 5_000_000)).velocity_world_m_s.norm();
        (0..=40).map(speed).fold(0.0, f64::max)
    };
    let (settled, falling) = (fastest_m_s(""), fastest_m_s("[engine]\nsettle_s = 0\n"));
    println!(
        "figure: first 0.2 s in the shipped colon: {:.2} mm/s, unsettled {:.1}",
        1e3 * settled,
        1e3 * falling
    );
    assert!(settled < 5e-3, "{settled} m/s");
    assert!(falling > 0.05, "{falling} m/s: nothing was shown");
}

#[test]
fn law_a_start_without_hold_is_refused_at_its_line() {
    // The tube lies along z: with gravity along it nothing holds a capsule in a wide one.
    let more = |g: &str| format!("radius_scale = 3\n[engine]\ngravity_torso_m_s2 = {g}\n");
    let build = |g: &str| build(&in_a_tube("pillcam-magnet", "5.0", &more(g)));
    let error = build("[0, 0, -9.81]").unwrap_err();
    assert!(
        error.starts_with("s.toml:4:1: `capsule.start_arc_length_mm`: the wall does not hold"),
        "{error}"
    );
    assert_eq!(build("[0, -9.81, 0]"), Ok(()));
}

#[test]
fn law_meals_and_faults_are_told_when_they_begin_and_end() {
    let text = in_a_tube(
        "pillcam-magnet",
        "20.0",
        "[motility]\nspontaneous = false\n[[motility.fault]]\nkind = \"ileus\"\nstart_s = 4\nend_s = 9\n\
         [[motility.meal]]\nstart_s = 6\nduration_s = 30",
    );
    let node = Node::parse_text(&text, "s.toml", Path::new(""), &[]).unwrap();
    let file = ScenarioFile::from_node(node, ModelFolder::new(models())).unwrap();
    let mut world = build_world(&file, 1, 0).unwrap().world;
    let mut told = Vec::new();
    for second in 0..=20 {
        world.advance_to(SimTime::from_seconds(f64::from(second))).unwrap();
        let notes = world.take_notes().into_iter().filter(|note| note.text.starts_with("motility"));
        told.extend(notes.map(|note| (note.at.seconds(), note.text)));
    }
    let expected = [
        (4.0, "motility: ileus begins, 0 % of the contractions are left"),
        (6.0, "motility: a meal is digested"),
        (9.0, "motility: ileus ends"),
    ];
    assert_eq!(told, expected.map(|(at_s, text)| (at_s, text.to_owned())));
}
