//! Every file a user writes is refused with file, line, key and what is allowed; nothing half-written is left behind.

use crate::support::{Run, lumenav as program, root, scratch};
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence::WithSource;
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
        ("scenario.observe_from_s=2", ["scenario.observe_from_s", "less than duration_s = 2"]),
        ("scenario.observe_from_s=-1", ["scenario.observe_from_s", "0 or above"]),
        ("scenario.observe_from_s=1e8", ["scenario.observe_from_s", "1e7"]),
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
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: Some(Box::new(WithSource("regressions"))), ..ProptestConfig::default() })]

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

/// Text that is likely to hurt: numbers out of range, brackets, quotes, anything printable.
fn spoiled() -> impl Strategy<Value = String> {
    "(nan|-1|0|inf|1e999|1e-320|\\[|\\]|=|\"|,|\n|[a-z_]{1,6}|[0-9.\\-]{1,8}|\\PC{1,4})".prop_map(|s| s)
}

/// Reads every reading of a replay and drives it through its tracks, as the program does.
fn replay_all(replay: &Path) -> Result<u64, String> {
    let models = root().join("models");
    let opened = lumenav::open_replay(replay, &[], Some(&models));
    let (file, truth) = opened.map_err(|e| e.to_string())?;
    let registry = lumenav::default_registry();
    let known = |at| truth.as_ref().and_then(|reference| reference.at(at));
    let truth = truth.is_some().then_some(&known as lumenav::pipeline::TruthAt<'_>);
    let mut nobody = lumenav::pipeline::Observers::new(vec![]);
    lumenav::pipeline::replay(&file, &registry, truth, &mut nobody, &|| false)
        .map(|summary| summary.readings)
        .map_err(|e| e.to_string())
}

/// A replay of `flux.csv` beside it, compared with `truth.tum` where `with_truth`; what else stands in `[sensor.files]`.
fn write_replay(folder: &Path, more: &str, with_truth: bool) -> std::path::PathBuf {
    let truth = if with_truth { "[truth]\nkind = \"tum\"\nfile = \"truth.tum\"\n" } else { "" };
    let text = format!(
        "[scenario]\nname = \"again\"\n[capsule]\nmodel = \"pillcam-magnet\"\n{truth}[[sensor]]\nname = \
         \"plane\"\nmodality = \"magnetic\"\n[sensor.installed]\narray = \"plane-4x4-below\"\n[sensor.files]\n\
         flux_csv = \"flux.csv\"\n{more}[[track]]\nname = \"magnetic\"\nsensors = [\"plane\"]\n[track.filter]\nkind = \
         \"none\"\n"
    );
    let file = folder.join("replay.toml");
    std::fs::write(&file, text).expect("a scratch file");
    file
}

/// A tenth of a second of saved readings and the truth with them, made once by the program itself.
fn saved() -> &'static (String, String) {
    static SAVED: std::sync::OnceLock<(String, String)> = std::sync::OnceLock::new();
    SAVED.get_or_init(|| {
        let folder = scratch();
        let out = folder.path().join("run");
        let run = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--save-readings");
        run.arg("--record").arg("none").arg("--set").arg("scenario.duration_s=0.3").ok();
        let read = |name: &str| std::fs::read_to_string(out.join(name)).expect("written");
        (read("readings/plane.csv"), read("truth.tum"))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: Some(Box::new(WithSource("regressions"))), ..ProptestConfig::default() })]

    #[test]
    fn law_a_mutated_trajectory_is_read_or_refused_by_name(at in 0_usize..4000, length in 0_usize..12, with in spoiled()) {
        let folder = scratch();
        let (flux, truth) = saved();
        std::fs::write(folder.path().join("flux.csv"), flux).expect("a scratch file");
        std::fs::write(folder.path().join("truth.tum"), mutate(truth, at, length, &with)).expect("a scratch file");
        if let Err(message) = replay_all(&write_replay(folder.path(), "", true)) {
            prop_assert!(message.contains("truth.tum"), "the file is not named: {message}");
        }
    }

    #[test]
    fn law_mutated_readings_are_read_or_refused_by_name(
        at in 0_usize..8000,
        length in 0_usize..12,
        with in spoiled(),
        skip in any::<bool>(),
    ) {
        let folder = scratch();
        std::fs::write(folder.path().join("flux.csv"), mutate(&saved().0, at, length, &with)).expect("a scratch file");
        let more = if skip { "bad_rows = \"skip\"\n" } else { "" };
        if let Err(message) = replay_all(&write_replay(folder.path(), more, false)) {
            prop_assert!(message.contains("flux.csv"), "the file is not named: {message}");
        }
    }

    #[test]
    fn law_mutated_models_are_read_or_refused_by_name(
        which in 0_usize..6,
        at in 0_usize..1200,
        length in 0_usize..12,
        with in spoiled(),
    ) {
        let name = [
            "capsules/pillcam-magnet",
            "sensor-arrays/belt-16",
            "sensor-arrays/plane-4x4-below",
            "sensor-arrays/cube",
            "tracts/helix",
            "tracts/straight-tube",
        ][which];
        let text = std::fs::read_to_string(root().join("models").join(name).with_extension("toml")).expect("shipped");
        let folder = scratch();
        let path = folder.path().join("mutated.toml");
        std::fs::write(&path, mutate(&text, at, length, &with)).expect("a scratch file");
        let read = || -> Result<(), lumenav::core::ConfigError> {
            let node = lumenav::core::Node::open(&path)?;
            match name.split('/').next() {
                Some("capsules") => drop(node.child_or_empty("capsule").parse::<lumenav::scenario::file::CapsuleModelTable>()?),
                Some("tracts") => drop(lumenav::anatomy::tract_file::load(&node, &lumenav::anatomy::tract_file::TractOptions::default())?),
                _ => drop(lumenav::magnetic::array::SensorArray::from_node(&node)?),
            }
            Ok(())
        };
        if let Err(error) = read() {
            prop_assert!(error.to_string().contains("mutated.toml"), "the file is not named: {error}");
        }
    }

    /// What the check lets pass must also run.
    #[test]
    fn law_a_mutated_scenario_that_passes_the_check_runs(
        which in 0_usize..3,
        at in 0_usize..800,
        length in 0_usize..6,
        with in "(0|-1|1e9|1e-9|[0-9.]{1,4})",
    ) {
        let file = ["smoke/helix", "smoke/faults", "smoke/colon"][which];
        let path = root().join("scenarios").join(file).with_extension("toml");
        let text = std::fs::read_to_string(&path).expect("shipped");
        let mutated = mutate(&text, at, length, &with);
        let short = ["scenario.duration_s=0.1".to_owned()];
        let folder = path.parent().expect("a folder");
        let Ok(node) = lumenav::core::Node::parse_text(&mutated, "mutated.toml", folder, &short) else { return Ok(()) };
        let models = lumenav::core::ModelFolder::new(root().join("models"));
        let Ok(scenario) = lumenav::scenario::ScenarioFile::from_node(node, models) else { return Ok(()) };
        let registry = lumenav::default_registry();
        // A rate of a billion per second is no mistake of the program's, but no test either.
        let slow = scenario.sensors.iter().filter_map(|s| s.schedule).all(|s| s.rate_hz.0 <= 1e4);
        if !slow || lumenav::check(&scenario, &registry).is_err() {
            return Ok(());
        }
        let stage = lumenav::stage(&scenario, 1, 0).map_err(|e| TestCaseError::fail(e.to_string()))?;
        let mut nobody = lumenav::pipeline::Observers::new(vec![]);
        let run = lumenav::pipeline::simulate(&scenario, &registry, 1, 0, stage, &mut nobody, &|| false);
        if let Err(error) = run {
            prop_assert!(!error.to_string().is_empty());
        }
    }
}

/// A disk that is full while an export is written: the error names the file, and no half file is left under its name.
#[cfg(target_os = "linux")]
#[test]
fn law_a_full_disk_is_named_and_leaves_no_half_export() {
    let folder = scratch();
    let out = folder.path().join("run");
    Run::new(&root().join("scenarios/smoke/helix.toml")).out(&out).arg("--record").arg("none").ok();
    for (format, file) in
        [("tum", "truth.tum"), ("csv", "magnetic.csv"), ("mcap", "run.mcap"), ("parquet", "tracks.parquet")]
    {
        let to = folder.path().join(format);
        std::fs::create_dir(&to).expect("a scratch folder");
        // Files are written beside their name: that one leads to the device that is always full.
        std::os::unix::fs::symlink("/dev/full", to.join(format!("{file}.part"))).expect("a scratch link");
        let output = program()
            .arg("export")
            .arg(&out)
            .args(["--format", format, "--out"])
            .arg(&to)
            .output()
            .expect("the program starts");
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{format}: {text}");
        assert!(text.contains(file) && text.contains("No space left"), "{format}: {text}");
        assert!(!to.join(file).exists(), "{format}: a half file");
    }
}

/// A folder that may not be written into. The superuser may write anywhere; then there is nothing to see.
#[cfg(unix)]
#[test]
fn law_a_folder_without_the_right_to_write_is_named() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = scratch();
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).expect("a scratch folder");
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o500)).expect("our own folder");
    if std::fs::write(closed.join("probe"), "x").is_ok() {
        println!(
            "law_a_folder_without_the_right_to_write_is_named: SKIPPED (the superuser may write anywhere)"
        );
        return;
    }
    let message = Run::new(&root().join("scenarios/smoke/helix.toml")).out(&closed.join("run")).fails(1);
    assert!(message.contains("closed") && message.contains("ermission denied"), "{message}");
}
