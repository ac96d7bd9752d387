//! Every key of a scenario and of the models it uses: value, where it was set, unit, source.
//!
//! Tables inside tables become dotted keys, one per line. *Origin* is `set` (the file holds the key), `--set` (the command
//! line does) or `default`. The *unit* is the suffix of the key (`lumenav_core::units`). The *source* of a key that the file
//! sets is the nearest `source` line around it in the same file; that of a default is what the plugin says of it.

use lumenav::core::units::unit_of;
use lumenav::core::{Node, Resolved, ResolvedRow};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

/// One table of a file, with every key.
#[derive(Serialize)]
pub struct ResolvedTable {
    /// The file.
    pub file: String,
    /// The table's path in it.
    pub table: String,
    /// Source of the keys that the file sets, where it names one.
    pub source: Option<String>,
    /// The keys.
    pub keys: Vec<ResolvedKey>,
}

/// One key.
#[derive(Serialize)]
pub struct ResolvedKey {
    /// Its name, dotted where it stands in a table inside the table.
    pub key: String,
    /// Its value.
    pub value: toml::Value,
    /// `set`, `--set` or `default`.
    pub origin: &'static str,
    /// Its unit, where the name ends in one.
    pub unit: Option<&'static str>,
    /// Where the value comes from, where that is known.
    pub source: Option<String>,
}

/// All tables that were parsed, each once, in the order in which they were.
pub fn tables(root: &Node, overrides: &[String]) -> Vec<ResolvedTable> {
    let mut files: BTreeMap<String, toml::Table> = BTreeMap::new();
    let whole = root.to_toml().unwrap_or_default();
    let by_command_line = overridden(overrides, &whole);
    files.insert(root.file().to_owned(), whole);
    let mut seen = BTreeSet::new();
    let mut tables = Vec::new();
    for entry in root.log().entries() {
        if !seen.insert((entry.file.clone(), entry.path.clone())) {
            continue;
        }
        let written = files.entry(entry.file.clone()).or_insert_with(|| {
            Node::open(Path::new(&entry.file)).ok().and_then(|node| node.to_toml()).unwrap_or_default()
        });
        let none = BTreeSet::new();
        let is_root = entry.file == root.file();
        tables.push(table(&entry, written, if is_root { &by_command_line } else { &none }));
    }
    tables
}

fn table(entry: &Resolved, written: &toml::Table, by_command_line: &BTreeSet<String>) -> ResolvedTable {
    let mut keys = Vec::new();
    for ResolvedRow { key, value, source, .. } in entry.rows() {
        let path = join(&entry.path, &key);
        let origin = if by_command_line.iter().any(|set| covers(set, &path)) {
            "--set"
        } else if at(written, &path).is_some() {
            "set"
        } else {
            "default"
        };
        let source = match origin {
            "set" => nearest_source(written, &path),
            "default" => source,
            _ => None,
        };
        keys.push(ResolvedKey { unit: unit_of(&key), key, value, origin, source });
    }
    // A table's own `source` line is printed once, at its head.
    let source = nearest_source(written, &join(&entry.path, "source"));
    ResolvedTable { file: entry.file.clone(), table: entry.path.clone(), source, keys }
}

impl ResolvedTable {
    /// As TOML with comments.
    pub fn text(&self) -> String {
        let mut text = format!("[{}]  # {}\n", self.table, self.file);
        if let Some(source) = &self.source {
            // Writing to a string cannot fail, here and below.
            writeln!(text, "# source: {source}").ok();
        }
        // The table's own source stands at its head already.
        for key in self.keys.iter().filter(|key| key.key != "source") {
            write!(text, "{} = {}  # {}", key.key, key.value, key.origin).ok();
            if let Some(unit) = key.unit {
                write!(text, ", {unit}").ok();
            }
            if let Some(source) = key.source.as_ref().filter(|s| Some(*s) != self.source.as_ref()) {
                write!(text, "; source: {source}").ok();
            }
            text.push('\n');
        }
        text
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Keys and indices of a path such as `sensor[0].schedule.rate_hz`.
fn steps(path: &str) -> Vec<&str> {
    path.split(['.', '[', ']']).filter(|step| !step.is_empty()).collect()
}

/// Whether one path is another or lies around it.
fn covers(outer: &str, inner: &str) -> bool {
    let (outer, inner) = (steps(outer), steps(inner));
    inner.starts_with(&outer)
}

fn step_into<'v>(value: &'v toml::Value, step: &str) -> Option<&'v toml::Value> {
    match value {
        toml::Value::Table(table) => table.get(step),
        toml::Value::Array(items) => items.get(step.parse::<usize>().ok()?),
        _ => None,
    }
}

/// The value at a path.
fn at<'t>(table: &'t toml::Table, path: &str) -> Option<&'t toml::Value> {
    let steps = steps(path);
    let (first, rest) = steps.split_first()?;
    rest.iter().try_fold(table.get(*first)?, |value, step| step_into(value, step))
}

/// The `source` of the innermost table around a key that has one.
fn nearest_source(table: &toml::Table, path: &str) -> Option<String> {
    let steps = steps(path);
    let mut found = table.get("source").and_then(|s| s.as_str());
    let mut value = steps.first().and_then(|step| table.get(*step));
    for step in steps.iter().skip(1) {
        let Some(here) = value else { break };
        if let Some(source) = here.get("source").and_then(|s| s.as_str()) {
            found = Some(source);
        }
        value = step_into(here, step);
    }
    found.map(str::to_owned)
}

/// The paths that `--set` replaced, entries of arrays by index as in the log.
fn overridden(overrides: &[String], table: &toml::Table) -> BTreeSet<String> {
    overrides
        .iter()
        .filter_map(|text| {
            let (key, _) = text.split_once('=')?;
            let mut value = toml::Value::Table(table.clone());
            let mut path = String::new();
            for step in key.trim().split('.') {
                let index = match &value {
                    toml::Value::Array(items) => Some(
                        items
                            .iter()
                            .position(|item| item.get("name").and_then(|n| n.as_str()) == Some(step))
                            .or_else(|| step.parse().ok())?,
                    ),
                    _ => None,
                };
                path = match index {
                    Some(index) => format!("{path}[{index}]"),
                    None => join(&path, step),
                };
                let step = index.map_or_else(|| step.to_owned(), |index| index.to_string());
                value = step_into(&value, &step)?.clone();
            }
            Some(path)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> toml::Table {
        text.parse().unwrap()
    }

    #[test]
    fn closed_form_the_nearest_source_counts() {
        let table = parse("source = \"all\"\n[a]\nx = 1\n[b]\nsource = \"inner\"\nx = 1\n[b.c]\ny = 2\n");
        let of = |path: &str| nearest_source(&table, path).unwrap();
        assert_eq!((of("a.x"), of("b.x"), of("b.c.y")), ("all".into(), "inner".into(), "inner".into()));
    }

    #[test]
    fn closed_form_overrides_by_name_are_found_by_index() {
        let table =
            parse("[[sensor]]\nname = \"a\"\n[[sensor]]\nname = \"b\"\n[sensor.schedule]\nrate_hz = 2\n");
        let set =
            overridden(&["sensor.b.schedule.rate_hz=2".to_owned(), "sensor.0.name=x".to_owned()], &table);
        assert_eq!(set.into_iter().collect::<Vec<_>>(), ["sensor[0].name", "sensor[1].schedule.rate_hz"]);
        assert!(covers("sensor[1]", "sensor[1].schedule") && !covers("sensor[1]", "sensor[10].schedule"));
    }
}
