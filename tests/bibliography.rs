//! Every short key of a source has its full reference in `docs/bibliography.md`.

use crate::support::root;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn texts_below(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok) {
        let path = entry.path();
        if path.is_dir() {
            texts_below(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs" || e == "toml" || e == "csv") {
            out.push(path);
        }
    }
}

/// `moussakhani2012`: letters, then a year.
fn is_key(word: &str) -> bool {
    let letters = word.trim_end_matches(|c: char| c.is_ascii_digit());
    let year = &word[letters.len()..];
    letters.len() >= 3
        && letters.bytes().all(|b| b.is_ascii_lowercase())
        && year.len() == 4
        && (year.starts_with("19") || year.starts_with("20"))
}

#[test]
fn law_every_key_of_a_source_is_in_the_bibliography() {
    let bibliography = std::fs::read_to_string(root().join("docs/bibliography.md")).expect("it ships");
    let mut files = Vec::new();
    for folder in ["models", "scenarios", "crates"] {
        texts_below(&root().join(folder), &mut files);
    }
    let mut keys: BTreeMap<String, PathBuf> = BTreeMap::new();
    for path in files {
        let text = std::fs::read_to_string(&path).expect("sources are UTF-8");
        let words = text.split(|c: char| !c.is_ascii_alphanumeric());
        keys.extend(words.filter(|word| is_key(word)).map(|word| (word.to_owned(), path.clone())));
    }
    assert!(keys.len() >= 3, "no keys were found: {keys:?}");
    for (key, path) in keys {
        let row = format!("| `{key}` |");
        assert!(bibliography.contains(&row), "{} names `{key}`, the bibliography does not", path.display());
    }
}
