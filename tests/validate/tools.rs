//! Starting programs and reading what they leave.

use crate::figures::{Bench, divan_table};
use crate::row::Sheet;
use lumenav::report::{Metrics, read_json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The checkout.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The program, in the checkout's folder: it lies beside this example's folder.
pub fn lumenav() -> Command {
    let here = std::env::current_exe().unwrap_or_default();
    let folder = here.parent().and_then(Path::parent).unwrap_or(Path::new("target/release"));
    let mut command = Command::new(folder.join("lumenav"));
    command.current_dir(root());
    command
}

/// Short name of the commit, with `+` where the checkout differs from it.
pub fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).current_dir(root()).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_none_or(|text| !text.is_empty());
    let name = git(&["rev-parse", "--short", "HEAD"]).unwrap_or_else(|| "unknown".to_owned());
    if changed { name + "+" } else { name }
}

/// Processor and number of cores, as far as the system tells.
pub fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':')).map(|(_, m)| m.trim());
    format!("{}, {cores} cores", model.unwrap_or(std::env::consts::ARCH))
}

/// A program that has ended well: its output, wall time, and the largest resident memory seen.
pub struct Ended {
    /// Standard output.
    pub stdout: String,
    /// Wall time, s.
    pub seconds: f64,
    /// Peak of the resident memory, MB (10^6 bytes); `None` where the system does not tell.
    pub peak_mb: Option<f64>,
}

/// Runs a program to its end; an error holds the last lines of what it said.
pub fn run(command: &mut Command) -> Result<Ended, String> {
    let begin = Instant::now();
    let log = tempfile::tempdir().map_err(|e| e.to_string())?;
    let file = |name: &str| std::fs::File::create(log.path().join(name)).map_err(|e| e.to_string());
    let mut child = command
        .stdin(Stdio::null())
        .stdout(file("out")?)
        .stderr(file("err")?)
        .spawn()
        .map_err(|e| format!("{} does not start: {e}", command.get_program().to_string_lossy()))?;
    let mut peak_mb = None;
    let status = loop {
        // The peak is kept by the system, so the last look before the end is all but exact.
        peak_mb = resident_peak_mb(child.id()).or(peak_mb);
        match child.try_wait().map_err(|e| e.to_string())? {
            Some(status) => break status,
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let read = |name: &str| {
        std::fs::read(log.path().join(name))
            .map(|b| String::from_utf8_lossy(&b).into_owned())
            .unwrap_or_default()
    };
    if !status.success() {
        let err = read("err") + &read("out");
        let tail: Vec<&str> = err.lines().rev().take(8).collect();
        return Err(format!("{status}: {}", tail.into_iter().rev().collect::<Vec<_>>().join(" | ")));
    }
    Ok(Ended { stdout: read("out"), seconds: begin.elapsed().as_secs_f64(), peak_mb })
}

fn resident_peak_mb(process: u32) -> Option<f64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0 * 1e-6)
}

/// `lumenav run` (or `replay`) into `out`, with its metrics.
pub fn metrics_of(arguments: &[&str], out: &Path) -> Result<Metrics, String> {
    run(lumenav().arg("-q").args(arguments).arg("--out").arg(out).arg("--force"))?;
    read_json(&out.join("metrics.json")).map_err(|e| e.to_string())
}

/// A test of the workspace at its full size, in release, with these variables set. Lines `figure: …` that it prints are its
/// figures.
pub fn test(target: &str, name: &str, variables: &[(&str, &str)]) -> Result<(String, bool), String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let ended = run(Command::new(cargo)
        .args(["test", "--release", "--workspace", "--quiet", "--test", target, "--"])
        .args([name, "--nocapture"])
        .env("LUMENAV_FULL", "1")
        .envs(variables.iter().copied())
        .current_dir(root()))?;
    // The harness writes its dots into the same lines.
    let figures: Vec<&str> = ended
        .stdout
        .lines()
        .filter_map(|line| line.split_once("figure: "))
        .map(|(_, figure)| figure)
        .collect();
    let passed: u64 = ended.stdout.lines().filter_map(passed_in).sum();
    if passed == 0 {
        return Err(format!("no test is called `{name}`"));
    }
    let text = if figures.is_empty() { format!("{passed} passed") } else { figures.join("; ") };
    Ok((text, true))
}

/// `test result: ok. 3 passed; …`
fn passed_in(line: &str) -> Option<u64> {
    line.split("ok. ").nth(1)?.split(' ').next()?.parse().ok()
}

/// The benches of a bench target.
pub fn bench(target: &str) -> Result<Vec<Bench>, String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let ended = run(Command::new(cargo)
        .args(["bench", "--quiet", "--workspace", "--bench", target])
        .current_dir(root()))?;
    Ok(divan_table(&ended.stdout))
}

/// A row that is a test of the workspace at its full size.
pub fn tested(sheet: &mut Sheet, line: &str, target: &str, name: &str) {
    let command = format!("LUMENAV_FULL=1 cargo test --release --workspace --test {target} -- {name}");
    sheet.row(line, command.trim_end_matches([' ', '-']), "passes", || test(target, name, &[]));
}
