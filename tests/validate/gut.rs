//! A living gut: the Shows lines that there are so far.

use crate::row::{Outcome, Sheet};
use crate::tools::{lumenav, run};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What of a reproduction's table is read here.
#[derive(Deserialize)]
struct Table {
    rows: Vec<Row>,
}

#[derive(Deserialize)]
struct Row {
    quantity: String,
    unit: String,
    published: Option<f64>,
    ours: BTreeMap<String, Option<f64>>,
    verdict: String,
}

/// Measures all rows.
pub fn rows(sheet: &mut Sheet) {
    let scratch = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => return eprintln!("no temporary folder: {error}"),
    };
    for (line, ask) in [
        ("transit", "every row with a published number within the tolerance that the issue states"),
        ("colon", "median of 20 persons from 16 to 29 h, at most 2 % do not pass"),
        ("exam", "10 exams from the swallow to the way out"),
        ("speeds", "the fastest 5 % of the time make more than half of the way"),
        ("traction", "58 to 91 mN per contraction: each phase within 25 % of its own"),
        ("gastric", "3.1 contractions per minute, about 11 mm each"),
    ] {
        let id = format!("gut/{line}");
        let command = format!("reproduce {id} --json");
        sheet.row(&format!("1 {id}"), &command, ask, || reproduction(&id, scratch.path()));
    }
}

/// Every row in words; passes where each that has a published number is met.
fn reproduction(id: &str, out: &Path) -> Outcome {
    let ended = run(lumenav().args(["-q", "reproduce", id, "--json", "--out"]).arg(out))?;
    let table: Table = serde_json::from_str(&ended.stdout).map_err(|e| format!("{id}: {e}"))?;
    let mut told = Vec::new();
    let mut holds = true;
    for row in &table.rows {
        let ours = row.ours.values().copied().flatten().next().unwrap_or(f64::NAN);
        let published = row.published.map_or_else(String::new, |p| format!(" ({p})"));
        told.push(format!("{}: {ours:.2}{published} {}: {}", row.quantity, row.unit, row.verdict));
        // What has a published number and came to none of ours (a median among those that did not pass) is not comparable, and no pass.
        let is_met = matches!(row.verdict.as_str(), "reproduced" | "better" | "holds");
        holds &= row.published.is_none() || is_met;
    }
    Ok((told.join("; "), holds))
}
