//! Small sums over what runs leave.

use lumenav::evaluation::trajectory::Trajectory;
use lumenav::records::tum;
use lumenav::report::read_arc_length;
use std::path::Path;

/// A TUM file as a trajectory.
pub fn trajectory(path: &Path) -> Result<Trajectory, String> {
    let poses = tum::read(path).map_err(|e| e.to_string())?;
    let (stamps, poses) = poses.iter().map(|(at, pose)| (at.seconds(), *pose)).unzip();
    Trajectory::new(stamps, poses).map_err(|e| format!("{}: {e}", path.display()))
}

/// Transport along the tract, m: where the capsule is at the end minus where it was at the start. To and fro counts nothing.
pub fn transported_m(path: &Path) -> Result<f64, String> {
    let rows = read_arc_length(path).map_err(|e| e.to_string())?;
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Err(format!("{}: no arc length", path.display()));
    };
    Ok(last.1 - first.1)
}

/// One line of a bench's table.
pub struct Bench {
    /// Its name, and its argument after a `/`.
    pub name: String,
    /// Median time of one run, s.
    pub median_s: f64,
    /// Items per second at the median, where the bench counts them.
    pub items_per_s: Option<f64>,
}

/// The benches of divan's tree: a line `├─ name  fastest │ slowest │ median │ …`, below it the throughputs.
pub fn divan_table(text: &str) -> Vec<Bench> {
    let mut found: Vec<Bench> = Vec::new();
    let mut group = String::new();
    for line in text.lines() {
        let quantities: Vec<(f64, &str)> = line.split('│').filter_map(last_quantity).collect();
        if let Some((indent, name)) = branch(line) {
            if indent == 0 {
                name.clone_into(&mut group);
            }
            let name = if indent == 0 { name.to_owned() } else { format!("{group}/{name}") };
            if let Some(median_s) =
                quantities.get(2).and_then(|(value, unit)| Some(value * seconds_per(unit)?))
            {
                found.push(Bench { name, median_s, items_per_s: None });
            }
        } else if let (Some(last), Some((value, unit))) = (found.last_mut(), quantities.get(2)) {
            last.items_per_s = last.items_per_s.or(unit.strip_suffix("item/s").map(|p| value * prefix(p)));
        }
    }
    found
}

/// Depth in the tree and name, of a line that has one.
fn branch(line: &str) -> Option<(usize, &str)> {
    let at = line.find("├─ ").or_else(|| line.find("╰─ "))?;
    let name = line[at..].trim_start_matches(['├', '╰', '─', ' ']).split_whitespace().next()?;
    Some((line[..at].chars().count(), name))
}

/// The number and unit at the end of a cell: `6.2 µs`.
fn last_quantity(cell: &str) -> Option<(f64, &str)> {
    let mut words = cell.split_whitespace().rev();
    let unit = words.next()?;
    Some((words.next()?.parse().ok()?, unit))
}

fn seconds_per(unit: &str) -> Option<f64> {
    match unit {
        "ns" => Some(1e-9),
        "µs" => Some(1e-6),
        "ms" => Some(1e-3),
        "s" => Some(1.0),
        _ => None,
    }
}

fn prefix(letter: &str) -> f64 {
    match letter {
        "K" => 1e3,
        "M" => 1e6,
        "G" => 1e9,
        _ => 1.0,
    }
}
