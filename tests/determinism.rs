//! Same scenario and seed, same bytes; another seed, other bytes; trials alone or among others, with any number of threads.

use crate::support::{Run, lumenav, root, scratch};
use std::path::Path;

/// Files of a run that must be equal byte for byte (`timing.json` holds wall times, the recording is compared by content).
const EQUAL: [&str; 6] =
    ["metrics.json", "tracks.parquet", "truth.tum", "magnetic.tum", "magnetic-eskf.tum", "events.jsonl"];

fn assert_equal_bytes(a: &Path, b: &Path, names: &[&str]) {
    for name in names {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(read(a) == read(b), "{name} differs between {} and {}", a.display(), b.display());
    }
}

#[test]
fn law_same_seed_same_bytes() {
    let folder = scratch();
    let scenario = root().join("scenarios/smoke/helix.toml");
    for name in ["a", "b"] {
        Run::new(&scenario).out(&folder.path().join(name)).ok();
    }
    assert_equal_bytes(&folder.path().join("a"), &folder.path().join("b"), &EQUAL);
    Run::new(&scenario).out(&folder.path().join("c")).arg("--seed").arg("2").ok();
    let tracks = |name: &str| std::fs::read(folder.path().join(name).join("magnetic.tum")).unwrap();
    assert!(tracks("a") != tracks("c"), "another seed gave the same track");
}

#[test]
fn law_threads_do_not_matter() {
    let folder = scratch();
    let scenario = root().join("scenarios/smoke/helix.toml");
    for threads in ["1", "2"] {
        let out = folder.path().join(threads);
        Run::new(&scenario).out(&out).arg("--trials").arg("3").arg("--threads").arg(threads).ok();
    }
    for trial in ["000", "001", "002"] {
        let at = |threads: &str| folder.path().join(threads).join("trials").join(trial);
        assert_equal_bytes(&at("1"), &at("2"), &EQUAL);
    }
    // Trial 0 among others is the run alone.
    let alone = folder.path().join("alone");
    Run::new(&scenario).out(&alone).ok();
    assert_equal_bytes(&alone, &folder.path().join("1/trials/000"), &EQUAL);
}

#[test]
fn law_the_engine_gives_the_same_bytes_twice() {
    let folder = scratch();
    let scenario = root().join("scenarios/smoke/colon.toml");
    for name in ["a", "b"] {
        Run::new(&scenario).out(&folder.path().join(name)).ok();
    }
    let names = ["metrics.json", "tracks.parquet", "truth.tum", "magnetic-eskf.tum"];
    assert_equal_bytes(&folder.path().join("a"), &folder.path().join("b"), &names);
}

#[test]
fn law_the_version_is_printed() {
    let output = lumenav().arg("--version").output().expect("the program starts");
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("lumenav "));
}
