//! A table of a user's file with its place.

use super::ConfigError;
use super::overrides::Override;
use super::resolved::{Resolved, ResolvedLog};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use toml::Spanned;

pub(super) type Value<'a> = toml::de::DeValue<'a>;
pub(super) type Table<'a> = toml::de::DeTable<'a>;

/// Files above this size are not configuration.
const MAX_FILE_BYTES: u64 = 16 * 1024 * 1024;

/// The text that positions point into: a file, and behind it the overrides.
#[derive(Debug)]
struct Source {
    file: String,
    folder: PathBuf,
    text: String,
    /// Start of each override's text (positions count on behind the file's), and the text.
    overrides: Vec<(usize, String)>,
}

impl Source {
    /// Parses the text and applies the overrides. Values borrow from the text, so a node keeps the way to its value and
    /// not the value; configuration is small and read once.
    fn with_root<R>(
        &self,
        then: impl FnOnce(&Spanned<Value<'_>>) -> Result<R, ConfigError>,
    ) -> Result<R, ConfigError> {
        let table = toml::de::DeTable::parse(&self.text).map_err(|error| ConfigError {
            file: self.file.clone(),
            position: error.span().map(|span| line_and_column(&self.text, span.start)),
            key: String::new(),
            message: error.message().to_owned(),
        })?;
        let mut root = Spanned::new(table.span(), Value::Table(table.into_inner()));
        for (base, text) in &self.overrides {
            Override::parse(text)?.apply(&mut root, *base)?;
        }
        then(&root)
    }
}

/// One step from a table or an array to a value in it.
#[derive(Clone, Debug)]
enum Step {
    Key(String),
    Index(usize),
}

/// A table (or any value) of a user's file.
#[derive(Clone, Debug)]
pub struct Node {
    source: Arc<Source>,
    steps: Vec<Step>,
    /// Keys that are not looked at.
    hidden: Vec<String>,
    path: String,
    log: ResolvedLog,
}

impl Node {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// [`ConfigError`]: the file cannot be read, or is not TOML (with line and column).
    pub fn open(path: &Path) -> Result<Self, ConfigError> {
        Self::open_with(path, &[])
    }

    /// Reads a TOML file and applies `key=value` overrides.
    ///
    /// # Errors
    /// As [`Node::open`], or where an override does not apply.
    pub fn open_with(path: &Path, overrides: &[String]) -> Result<Self, ConfigError> {
        let file = path.display().to_string();
        let refuse =
            |message: String| ConfigError { file: file.clone(), position: None, key: String::new(), message };
        let size = std::fs::metadata(path).map_err(|e| refuse(format!("cannot be read: {e}")))?.len();
        if size > MAX_FILE_BYTES {
            return Err(refuse(format!("{size} bytes is too large for a TOML file (16 MiB at most)")));
        }
        let text = std::fs::read_to_string(path).map_err(|e| refuse(format!("cannot be read: {e}")))?;
        let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let node = Self::parse_text(&text, &file, &folder, overrides)?;
        node.log.add_file(path);
        Ok(node)
    }

    /// Parses text as if it stood in `file` (its name for messages) in `folder` (for relative paths).
    ///
    /// # Errors
    /// [`ConfigError`] with line and column.
    pub fn parse_text(
        text: &str,
        file: &str,
        folder: &Path,
        overrides: &[String],
    ) -> Result<Self, ConfigError> {
        let mut starts = Vec::new();
        let mut base = text.len() + 1;
        for text in overrides {
            starts.push((base, text.clone()));
            base += text.len() + 1;
        }
        let source = Source {
            file: file.to_owned(),
            folder: folder.to_path_buf(),
            text: text.to_owned(),
            overrides: starts,
        };
        source.with_root(|_| Ok(()))?;
        Ok(Self {
            source: Arc::new(source),
            steps: Vec::new(),
            hidden: Vec::new(),
            path: String::new(),
            log: ResolvedLog::default(),
        })
    }

    /// Hands the value to `then`; `None` where the user did not write it.
    fn with_value<R>(&self, then: impl FnOnce(Option<&Spanned<Value<'_>>>) -> R) -> R {
        let mut then = Some(then);
        let result = self.source.with_root(|root| {
            let mut value = Some(root);
            for step in &self.steps {
                value = value.and_then(|v| match step {
                    Step::Key(key) => v.get_ref().as_table().and_then(|t| t.get(key.as_str())),
                    Step::Index(index) => v.get_ref().as_array().and_then(|a| a.get(*index)),
                });
            }
            Ok(then.take().map(|then| then(value)))
        });
        match (result, then) {
            (Ok(Some(result)), _) => result,
            // The same text parsed when this node was made, so this arm is for the compiler.
            (_, Some(then)) => then(None),
            _ => unreachable!("`then` runs once, in one of the arms above"),
        }
    }

    /// Shares another node's log, so that a scenario and its models are resolved together.
    pub fn with_log_of(mut self, other: &Self) -> Self {
        other.log.add_files_of(&self.log);
        self.log = other.log.clone();
        self
    }

    /// What was parsed so far.
    pub fn log(&self) -> &ResolvedLog {
        &self.log
    }

    /// The file's name as messages print it.
    pub fn file(&self) -> &str {
        &self.source.file
    }

    /// The file's text.
    pub fn text(&self) -> &str {
        &self.source.text
    }

    /// Folder of the file: what relative paths in it are relative to.
    pub fn folder(&self) -> &Path {
        &self.source.folder
    }

    /// What a path in `key` is relative to: the file's folder, or the working folder where `--set` gave it.
    pub fn folder_of(&self, key: &str) -> &Path {
        let start = self.span_of(key).start;
        if start > self.source.text.len() { Path::new("") } else { &self.source.folder }
    }

    /// The path that `key` holds as `name`: relative to its file (or to the working folder for `--set`); a leading
    /// `$LUMENAV_DATA/` stands for the folder of recorded data. The path is noted in the log: a reader that comes to its files this way
    /// finds them among the inputs of the run's manifest.
    ///
    /// # Errors
    /// [`ConfigError`] at the key: the variable is not set, or nothing exists there.
    pub fn existing_path(&self, key: &str, name: &str) -> Result<PathBuf, ConfigError> {
        let path = if let Some(rest) = name.strip_prefix("$LUMENAV_DATA/") {
            let Some(folder) = std::env::var_os("LUMENAV_DATA") else {
                let message = "LUMENAV_DATA is not set; it names the folder of recorded data";
                return Err(self.error_at(key, message));
            };
            PathBuf::from(folder).join(rest)
        } else {
            self.folder_of(key).join(name)
        };
        if path.exists() {
            self.log.add_file(&path);
            Ok(path)
        } else {
            Err(self.error_at(key, &format!("{} does not exist", path.display())))
        }
    }

    /// Path of keys to this node.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Keys of this table, sorted.
    pub fn keys(&self) -> Vec<String> {
        self.with_value(|value| {
            value
                .and_then(|v| v.get_ref().as_table())
                .map(|table| table.keys().map(|k| k.get_ref().to_string()).collect())
                .unwrap_or_default()
        })
    }

    /// As [`Node::keys`], with the dotted keys of the tables within.
    fn keys_within(&self) -> Vec<String> {
        fn collect(value: &Spanned<Value<'_>>, path: &str, keys: &mut Vec<String>) {
            match value.get_ref() {
                Value::Table(table) => {
                    for (key, inner) in table {
                        let path = join(path, key.get_ref());
                        keys.push(path.clone());
                        collect(inner, &path, keys);
                    }
                }
                Value::Array(items) => {
                    for (i, item) in items.iter().enumerate() {
                        collect(item, &format!("{path}[{i}]"), keys);
                    }
                }
                _ => {}
            }
        }
        let mut keys = Vec::new();
        self.with_value(|value| value.into_iter().for_each(|value| collect(value, "", &mut keys)));
        keys
    }

    /// The value under a key, `None` where it is not written.
    pub fn child(&self, key: &str) -> Option<Self> {
        let child = self.child_or_empty(key);
        child.with_value(|value| value.is_some()).then_some(child)
    }

    /// The table under a key, or an empty one.
    pub fn child_or_empty(&self, key: &str) -> Self {
        self.step(Step::Key(key.to_owned()), join(&self.path, key))
    }

    /// This table without one key: for tables in which one key chooses what the others mean.
    pub fn without(&self, key: &str) -> Self {
        let mut node = self.clone();
        node.hidden.push(key.to_owned());
        node
    }

    /// The entries of the array under a key; none where it is not written.
    ///
    /// # Errors
    /// [`ConfigError`] where the key holds something else.
    pub fn children(&self, key: &str) -> Result<Vec<Self>, ConfigError> {
        let Some(child) = self.child(key) else { return Ok(Vec::new()) };
        let length = child.with_value(|value| value.and_then(|v| v.get_ref().as_array()).map(|a| a.len()));
        let Some(length) = length else {
            return Err(self.error_at(key, &format!("expected an array of tables: [[{key}]]")));
        };
        Ok((0..length).map(|i| child.step(Step::Index(i), format!("{}[{i}]", child.path))).collect())
    }

    fn step(&self, step: Step, path: String) -> Self {
        let mut steps = self.steps.clone();
        steps.push(step);
        Self { source: self.source.clone(), steps, hidden: Vec::new(), path, log: self.log.clone() }
    }

    /// Reads this table into a type and notes it, defaults included, in the log.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key and what is allowed.
    pub fn parse<T: DeserializeOwned + Serialize>(&self) -> Result<T, ConfigError> {
        self.parse_sourced(&[])
    }

    /// As [`Node::parse`]; the log then tells the source of each default, too: pairs of key (dotted for tables within this one)
    /// and source in words.
    ///
    /// # Errors
    /// As [`Node::parse`].
    pub fn parse_sourced<T: DeserializeOwned + Serialize>(
        &self,
        sources: &[(&str, &str)],
    ) -> Result<T, ConfigError> {
        let parsed: T = self.parse_quietly()?;
        if let Ok(values) = toml::Table::try_from(&parsed) {
            let (file, path) = (self.source.file.clone(), self.path.clone());
            let sources = sources.iter().map(|(key, text)| ((*key).to_owned(), (*text).to_owned())).collect();
            self.log.push(Resolved { file, path, values, set: self.keys_within(), sources });
        }
        Ok(parsed)
    }

    /// As [`Node::parse`], without a note in the log.
    ///
    /// # Errors
    /// As [`Node::parse`].
    pub fn parse_quietly<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        let outcome = self.with_value(|value| {
            let empty = Spanned::new(0..0, Value::Table(Table::new()));
            let value = value.unwrap_or(&empty);
            let mut shown = value.clone();
            if let Value::Table(table) = shown.get_mut() {
                for key in &self.hidden {
                    table.remove(key.as_str());
                }
            }
            T::deserialize(toml::de::ValueDeserializer::from(shown)).map_err(|error| {
                let key = error.span().and_then(|span| key_at(value, &span));
                (error.span(), key, error.message().to_owned())
            })
        });
        outcome.map_err(|(span, key, message)| {
            let key = key.map_or(self.path.clone(), |inner| join(&self.path, &inner));
            match span.filter(|_| self.is_written()) {
                Some(span) => self.error_in(span.start, key, &message),
                None => self.error_in(self.own_span().start, key, &message),
            }
        })
    }

    fn is_written(&self) -> bool {
        self.with_value(|value| value.is_some())
    }

    /// Where this value stands; the nearest written table around it where it is not written.
    fn own_span(&self) -> std::ops::Range<usize> {
        let mut node = self.clone();
        loop {
            if let Some(span) = node.with_value(|value| value.map(Spanned::span)) {
                return span;
            }
            if node.steps.pop().is_none() {
                return 0..0;
            }
        }
    }

    /// This table as plain TOML, for manifests.
    pub fn to_toml(&self) -> Option<toml::Table> {
        self.parse_quietly().ok()
    }

    /// An error at a key of this table (or at the table, where the key is not written).
    pub fn error_at(&self, key: &str, message: &str) -> ConfigError {
        self.error_in(self.span_of(key).start, join(&self.path, key), message)
    }

    /// An error at this table.
    pub fn error(&self, message: &str) -> ConfigError {
        self.error_in(self.own_span().start, self.path.clone(), message)
    }

    fn span_of(&self, key: &str) -> std::ops::Range<usize> {
        self.child_or_empty(key).own_span()
    }

    fn error_in(&self, offset: usize, key: String, message: &str) -> ConfigError {
        let message = message.to_owned();
        let set = self.source.overrides.iter().rev().find(|(start, _)| *start <= offset);
        match set {
            Some((_, text)) => ConfigError { file: format!("--set {text}"), position: None, key, message },
            None => ConfigError {
                file: self.source.file.clone(),
                position: Some(line_and_column(&self.source.text, offset)),
                key,
                message,
            },
        }
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Line and column, from 1, of a byte offset.
fn line_and_column(text: &str, offset: usize) -> (usize, usize) {
    let mut end = offset.min(text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let before = &text[..end];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
    (line, column)
}

/// The innermost key whose key or value covers a position.
fn key_at(value: &Spanned<Value<'_>>, span: &std::ops::Range<usize>) -> Option<String> {
    let covers = |outer: std::ops::Range<usize>| outer.start <= span.start && span.end <= outer.end;
    match value.get_ref() {
        Value::Table(table) => table.iter().find_map(|(key, item)| {
            if covers(key.span()) {
                return Some(key.get_ref().to_string());
            }
            let inner = key_at(item, span);
            if let Some(inner) = inner {
                return Some(format!("{}.{inner}", key.get_ref()));
            }
            covers(item.span()).then(|| key.get_ref().to_string())
        }),
        Value::Array(items) => items.iter().enumerate().find_map(|(i, item)| {
            if let Some(inner) = key_at(item, span) {
                return Some(format!("[{i}].{inner}"));
            }
            covers(item.span()).then(|| format!("[{i}]"))
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ResolvedRow;
    use crate::config::quantity::Positive;
    use serde::Deserialize;

    #[derive(Debug, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Body {
        radius_mm: Positive,
        #[serde(default = "three")]
        rings: u32,
    }

    fn three() -> u32 {
        3
    }

    fn node(text: &str, overrides: &[&str]) -> Result<Node, ConfigError> {
        let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
        Node::parse_text(text, "s.toml", Path::new("folder"), &overrides)
    }

    #[test]
    fn law_errors_name_file_line_key_and_what_is_allowed() {
        let text = "[body]\n\nradius_mm = -1.0\n";
        let error = node(text, &[]).unwrap().child("body").unwrap().parse::<Body>().unwrap_err();
        assert_eq!(
            error.to_string(),
            "s.toml:3:13: `body.radius_mm`: -1 is not allowed here; it must be a finite number above 0"
        );
        let text = "[body]\nradius_mm = 5\nringz = 3\n";
        let error = node(text, &[]).unwrap().child("body").unwrap().parse::<Body>().unwrap_err();
        assert!(error.to_string().starts_with("s.toml:3:1: `body.ringz`: unknown field `ringz`"), "{error}");
        assert!(error.to_string().contains("rings"), "{error}");
        let error = node("a = [1,\n", &[]).unwrap_err();
        assert!(error.to_string().starts_with("s.toml:"), "{error}");
    }

    #[test]
    fn law_overrides_replace_and_keep_their_origin() {
        let text = "[body]\nradius_mm = 5.0\n[[part]]\nname = \"a\"\nx = 1\n";
        let root = node(text, &["body.radius_mm=7", "part.a.x=4", "body.rings = 9"]).unwrap();
        let body: Body = root.child("body").unwrap().parse().unwrap();
        assert_eq!((body.radius_mm.0, body.rings), (7.0, 9));
        assert_eq!(root.children("part").unwrap()[0].to_toml().unwrap()["x"].as_integer(), Some(4));
        let root = node(text, &["body.radius_mm=nan"]).unwrap();
        let error = root.child("body").unwrap().parse::<Body>().unwrap_err();
        assert!(error.to_string().starts_with("--set body.radius_mm=nan: `body.radius_mm`"), "{error}");
        assert!(node(text, &["part.zz.x=1"]).unwrap_err().to_string().contains("a name: a"));
        assert!(node(text, &["nonsense"]).is_err());
    }

    #[test]
    fn law_paths_are_relative_to_who_names_them() {
        let root = node("a = \"x.toml\"\nb = \"y.toml\"\n", &["b=z.toml"]).unwrap();
        assert_eq!(root.folder_of("a"), Path::new("folder"));
        assert_eq!(root.folder_of("b"), Path::new(""));
    }

    #[test]
    fn law_the_log_names_every_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("s.toml"), "model = \"m.toml\"\ndata = \"d.csv\"\n").unwrap();
        std::fs::write(path("m.toml"), "[body]\npoints = \"p.csv\"\n").unwrap();
        for data in ["d.csv", "p.csv"] {
            std::fs::write(path(data), "1\n").unwrap();
        }
        let root = Node::open(&path("s.toml")).unwrap();
        root.existing_path("data", "d.csv").unwrap();
        assert!(root.existing_path("data", "missing.csv").is_err());
        // What a model names is noted whether it was opened before the two were joined or after.
        let model = Node::open(&path("m.toml")).unwrap().with_log_of(&root);
        model.child_or_empty("body").existing_path("points", "p.csv").unwrap();
        let expected: Vec<PathBuf> = ["d.csv", "m.toml", "p.csv", "s.toml"].map(path).to_vec();
        assert_eq!(root.log().files(), expected);
    }

    #[test]
    fn law_the_log_tells_defaults_from_what_was_set() {
        let root = node("[body]\nradius_mm = 5.0\n", &[]).unwrap();
        let _: Body = root.child("body").unwrap().parse().unwrap();
        let entry = &root.log().entries()[0];
        assert_eq!(entry.path, "body");
        assert_eq!(entry.set, vec!["radius_mm"]);
        assert_eq!(entry.values["rings"].as_integer(), Some(3));
        assert!(entry.sources.is_empty());
        let _: Body = root.child("body").unwrap().parse_sourced(&[("rings", "chosen: fits")]).unwrap();
        let entry = &root.log().entries()[1];
        let row = |key: &str, value: toml::Value, set, source: Option<&str>| ResolvedRow {
            key: key.into(),
            value,
            set,
            source: source.map(ToOwned::to_owned),
        };
        let expected =
            [row("radius_mm", 5.0.into(), true, None), row("rings", 3.into(), false, Some("chosen: fits"))];
        assert_eq!(entry.rows(), expected);
    }

    #[test]
    fn law_rows_take_tables_and_arrays_of_tables_apart() {
        let root =
            node("[a]\nx = [1, 2]\n[[a.part]]\ny = 1\n[[a.part]]\n[a.inner]\nz = true\n", &[]).unwrap();
        let _: toml::Table =
            root.child("a").unwrap().parse_sourced(&[("part.y", "p"), ("inner.z", "q")]).unwrap();
        let rows = root.log().entries()[0].rows();
        let keys: Vec<(&str, bool, Option<&str>)> =
            rows.iter().map(|row| (row.key.as_str(), row.set, row.source.as_deref())).collect();
        assert_eq!(keys, [("inner.z", true, Some("q")), ("part[0].y", true, Some("p")), ("x", true, None)]);
    }
}
