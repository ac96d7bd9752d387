//! Every file a user writes is refused with file, line, key and what is allowed; nothing half-written is left behind.

use crate::support::{Run, root, scratch};
use proptest::prelude::*;
use std::path::Path;

/// Runs the smoke scenario with one override that must be refused (exit code 3) and returns the message.
fn refused(set: &str) -> String {
    let folder = scratch();
    let out = folder.path().join("run");
    let message =
        Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--set").arg(set).fails(3);
    assert!(!out.exists(), "a refused run left {}", out.display());
    message
}

#[test]
fn law_values_out_of_range_name_key_and_range() {
    for (set, words) in [
        ("scenario.duration_s=-1", ["scenario.duration_s", "above 0"]),
        ("scenario.duration_s=nan", ["scenario.duration_s", "finite"]),
        ("sensor.plane.schedule.rate_hz=0", ["rate_hz", "above 0"]),
        ("sensor.plane.modality=magic", ["unknown modality `magic`", "magnetic"]),
        ("sensor.plane.installed.array=nowhere", ["no model `nowhere`", "belt-16"]),
        ("capsule.model=nothing", ["no model `nothing`", "pillcam-magnet"]),
        ("truth.kind=spiral", ["unknown variant `spiral`", "helix"]),
        ("track.magnetic.sensors=[\"camera\"]", ["no sensor `camera`", "plane"]),
        ("track.magnetic.filter.kind=ukf", ["unknown filter `ukf`", "eskf"]),
        ("scenario.colour=red", ["unknown field `colour`", "duration_s"]),
        ("sensor.plane.reality.bias=1", ["unknown field `bias`", "bias_sigma_tesla"]),
        ("scenario.name=a/b", ["not allowed as a name", "A-Z"]),
        ("sensor.belt.x=1", ["no entry `belt`", "plane"]),
    ] {
        let message = refused(set);
        for word in words {
            assert!(message.contains(word), "`{set}`: expected `{word}` in: {message}");
        }
    }
}

#[test]
fn law_a_file_error_names_file_and_line() {
    let folder = scratch();
    let file = folder.path().join("s.toml");
    let text = std::fs::read_to_string(root().join("scenarios/smoke/helix.toml")).expect("shipped");
    std::fs::write(&file, text.replace("duration_s = 2.0", "duration_s = -2.0")).expect("a scratch file");
    let message = Run::new(&file).arg("--models").arg(root().join("models")).fails(3);
    assert!(message.contains("s.toml:5:14") && message.contains("`scenario.duration_s`"), "{message}");
    std::fs::write(&file, "[scenario\n").expect("a scratch file");
    let message = Run::new(&file).fails(3);
    assert!(message.contains("s.toml:1:"), "{message}");
    let message = Run::new(Path::new("does-not-exist.toml")).fails(3);
    assert!(message.contains("does-not-exist.toml"), "{message}");
}

#[test]
fn law_an_unwritable_folder_is_named_and_nothing_is_left() {
    let folder = scratch();
    let file = folder.path().join("a-file");
    std::fs::write(&file, "x").expect("a scratch file");
    let out = file.join("run");
    let message = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).fails(1);
    assert!(message.contains("a-file"), "{message}");
}

#[test]
fn law_an_existing_folder_is_refused_unless_forced() {
    let folder = scratch();
    let out = folder.path().join("run");
    let scenario = root().join("scenarios/smoke/helix.toml");
    Run::new(&scenario).out(&out).arg("--record").arg("none").ok();
    let message = Run::new(&scenario).out(&out).fails(1);
    assert!(message.contains("exists already") && message.contains("--force"), "{message}");
    Run::new(&scenario).out(&out).arg("--record").arg("none").arg("--force").ok();
    assert!(out.join("metrics.json").is_file());
}

/// One shipped file with one stretch of it replaced: it loads, or is refused with a message. Never a panic.
fn mutate(text: &str, at: usize, length: usize, with: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let at = at % chars.len().max(1);
    let end = (at + length).min(chars.len());
    chars[..at].iter().collect::<String>() + with + &chars[end..].iter().collect::<String>()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn law_a_mutated_scenario_never_panics(
        which in 0_usize..4,
        at in 0_usize..2000,
        length in 0_usize..12,
        with in "(nan|-1|0|inf|1e999|\\[|\\]|=|\"|[a-z_]{1,6}|[0-9.\\-]{1,8}|\\PC{1,4})",
    ) {
        let file = ["smoke/helix", "smoke/faults", "smoke/colon", "helix-magnetic"][which];
        let path = root().join("scenarios").join(file).with_extension("toml");
        let text = std::fs::read_to_string(&path).expect("shipped");
        let mutated = mutate(&text, at, length, &with);
        let folder = path.parent().expect("a folder");
        let opened = lumenav::core::Node::parse_text(&mutated, "mutated.toml", folder, &[]);
        if let Ok(node) = opened {
            let models = lumenav::core::ModelFolder::new(root().join("models"));
            match lumenav::scenario::ScenarioFile::from_node(node, models) {
                Ok(scenario) => {
                    if let Err(error) = lumenav::check(&scenario, &lumenav::default_registry()) {
                        prop_assert!(!error.to_string().is_empty());
                    }
                }
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }
}
