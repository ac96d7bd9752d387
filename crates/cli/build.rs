//! Notes which sources the program is made from: `LUMENAV_GIT_REVISION` and, where something is changed and not committed,
//! `LUMENAV_GIT_CHANGES` (a fingerprint of the changes). Outside a checkout, or without git, both stay unset.
//!
//! Run again when the checked-out commit changes or a source of any crate does; this program depends on all of them, so
//! nothing is built more often than it would be anyway.

use std::io::Write as _;
use std::process::{Command, Stdio};

fn main() {
    println!("cargo:rerun-if-env-changed=LUMENAV_GIT_REVISION");
    if std::env::var_os("LUMENAV_GIT_REVISION").is_some() {
        // The packager knows better; `option_env!` sees the variable itself.
        return;
    }
    for watched in ["..", "../../Cargo.toml", "../../Cargo.lock"] {
        if std::path::Path::new(watched).exists() {
            println!("cargo:rerun-if-changed={watched}");
        }
    }
    // A checkout of another project that merely contains this one says nothing about these sources.
    if git(&["ls-files", "--error-unmatch", "build.rs"], None).is_none() {
        return;
    }
    let head = git(&["rev-parse", "--git-path", "HEAD"], None);
    let branch = git(&["symbolic-ref", "--quiet", "HEAD"], None);
    let branch = branch.and_then(|name| git(&["rev-parse", "--git-path", &name], None));
    for watched in [head, branch].into_iter().flatten() {
        if std::path::Path::new(&watched).exists() {
            println!("cargo:rerun-if-changed={watched}");
        }
    }
    let Some(revision) = git(&["rev-parse", "HEAD"], None) else { return };
    println!("cargo:rustc-env=LUMENAV_GIT_REVISION={revision}");
    if let Some(changes) = changes() {
        println!("cargo:rustc-env=LUMENAV_GIT_CHANGES={changes}");
    }
}

/// Fingerprint of what differs from the commit in the crates; `None` where nothing does.
fn changes() -> Option<String> {
    let places = ["--", "..", "../../Cargo.toml", "../../Cargo.lock"];
    let mut text = git(&[&["diff", "HEAD", "--binary"][..], &places].concat(), None)?;
    let new = git(&[&["ls-files", "--others", "--exclude-standard"][..], &places].concat(), None)?;
    for file in new.lines() {
        text.push_str(file);
        text.push_str(&git(&["hash-object", file], None)?);
    }
    if text.is_empty() {
        return None;
    }
    git(&["hash-object", "--stdin"], Some(&text))
}

/// What git answers; `None` where it is not there or does not like the question.
fn git(arguments: &[&str], input: Option<&str>) -> Option<String> {
    let mut command = Command::new("git");
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().ok()?;
    if let Some(mut stdin) = child.stdin.take() {
        stdin.write_all(input.unwrap_or_default().as_bytes()).ok()?;
    }
    let output = child.wait_with_output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).trim_end().to_owned();
    output.status.success().then_some(text)
}
