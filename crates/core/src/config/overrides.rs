//! `--set key=value`: one value of a file replaced from the command line.

use super::ConfigError;
use super::node::{Table, Value};
use toml::Spanned;

/// One parsed override.
pub(super) struct Override<'a> {
    /// As the user typed it.
    pub text: &'a str,
    /// The keys, outermost first; a number or a `name` picks from an array of tables.
    pub keys: Vec<String>,
    /// The value; its spans count from the start of `text`.
    pub value: Spanned<Value<'a>>,
}

impl<'a> Override<'a> {
    /// Parses `a.b.c=value`; a value that is not TOML is taken as a string.
    pub fn parse(text: &'a str) -> Result<Self, ConfigError> {
        let refuse = |message: &str| ConfigError {
            file: format!("--set {text}"),
            position: None,
            key: String::new(),
            message: message.to_owned(),
        };
        let (keys, value) = text.split_once('=').ok_or_else(|| refuse("expected key=value"))?;
        let keys: Vec<String> = keys.trim().split('.').map(|k| k.trim().to_owned()).collect();
        if keys.iter().any(String::is_empty) {
            return Err(refuse("an empty key; expected for example capsule.model=pillcam-magnet"));
        }
        let start = text.len() - value.len();
        let value = match Value::parse(value.trim()) {
            Ok(parsed) => parsed.into_inner(),
            Err(_) => Value::String(value.trim().into()),
        };
        Ok(Self { text, keys, value: Spanned::new(start..text.len(), value) })
    }

    /// Puts the value into a document; `base` is where this override's text starts in the document's positions.
    pub fn apply(self, root: &mut Spanned<Value<'a>>, base: usize) -> Result<(), ConfigError> {
        let span = self.value.span();
        let value = respan(self.value.into_inner(), base + span.start..base + span.end);
        let Some((last, path)) = self.keys.split_last() else { return Ok(()) };
        let mut place = root;
        for key in path {
            place = descend(place, key).map_err(|message| ConfigError {
                file: format!("--set {}", self.text),
                position: None,
                key: key.clone(),
                message,
            })?;
        }
        insert(place, last, value).map_err(|message| ConfigError {
            file: format!("--set {}", self.text),
            position: None,
            key: last.clone(),
            message,
        })
    }
}

/// The same value with every span replaced: an override's values all stand at the override.
fn respan(value: Value<'_>, span: std::ops::Range<usize>) -> Spanned<Value<'_>> {
    let inner = match value {
        Value::Array(items) => {
            Value::Array(items.into_iter().map(|item| respan(item.into_inner(), span.clone())).collect())
        }
        Value::Table(table) => Value::Table(
            table
                .into_iter()
                .map(|(key, item)| {
                    (Spanned::new(span.clone(), key.into_inner()), respan(item.into_inner(), span.clone()))
                })
                .collect(),
        ),
        other => other,
    };
    Spanned::new(span, inner)
}

/// The table one key further in, made where it does not exist yet.
fn descend<'p, 'a>(
    place: &'p mut Spanned<Value<'a>>,
    key: &str,
) -> Result<&'p mut Spanned<Value<'a>>, String> {
    let span = place.span();
    match place.get_mut() {
        Value::Table(table) => {
            if !table.iter().any(|(k, _)| k.get_ref() == key) {
                table.insert(
                    Spanned::new(span.clone(), key.to_owned().into()),
                    Spanned::new(span, Value::Table(Table::new())),
                );
            }
            // It was there or has just been inserted.
            table
                .iter_mut()
                .find(|(k, _)| k.get_ref() == key)
                .map(|(_, value)| value)
                .ok_or_else(|| format!("no key `{key}`"))
        }
        Value::Array(items) => {
            let names: Vec<String> = items
                .iter()
                .map(|item| {
                    item.get_ref().get("name").and_then(|n| n.get_ref().as_str()).unwrap_or("").to_owned()
                })
                .collect();
            let index = names.iter().position(|n| n == key).or_else(|| key.parse().ok());
            match index.filter(|i| *i < names.len()) {
                Some(index) => items.get_mut(index).ok_or_else(|| format!("no entry `{key}`")),
                None => Err(format!(
                    "no entry `{key}`; use a number from 0 to {} or a name: {}",
                    names.len().saturating_sub(1),
                    names.join(", ")
                )),
            }
        }
        other => Err(format!("`{key}` is asked of a {}, which has no keys", other.type_str())),
    }
}

fn insert<'a>(place: &mut Spanned<Value<'a>>, key: &str, value: Spanned<Value<'a>>) -> Result<(), String> {
    match place.get_mut() {
        Value::Table(table) => {
            let span = value.span();
            table.remove(key);
            table.insert(Spanned::new(span, key.to_owned().into()), value);
            Ok(())
        }
        Value::Array(_) => {
            *descend(place, key)? = value;
            Ok(())
        }
        other => Err(format!("`{key}` is asked of a {}, which has no keys", other.type_str())),
    }
}
