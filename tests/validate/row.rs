//! Rows of the acceptance, and the sheet they are written to.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Instant;

/// One promise, measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Number of the Shows line and what it says.
    pub line: String,
    /// What was run.
    pub command: String,
    /// The commit it was run at; `+` where the checkout had changes.
    pub commit: String,
    /// Wall time, s.
    pub seconds: f64,
    /// What came out.
    pub figure: String,
    /// What was asked.
    pub threshold: String,
    /// Whether it holds.
    pub pass: bool,
    /// Processor and cores.
    pub machine: String,
}

/// What a measurement says: the figure in words and whether it holds; an error where it could not be made.
pub type Outcome = Result<(String, bool), String>;

#[derive(Serialize, Deserialize)]
struct Document {
    schema: u32,
    rows: Vec<Row>,
}

/// `docs/validation/<issue>.json` being written.
pub struct Sheet {
    path: PathBuf,
    words: Vec<String>,
    commit: String,
    rows: Vec<Row>,
    measured: Vec<String>,
}

impl Sheet {
    /// Opens the sheet of an issue with the rows it has.
    pub fn open(issue: &str, words: Vec<String>) -> Result<Self, String> {
        let path = super::tools::root().join("docs/validation").join(format!("{issue}.json"));
        let rows = match std::fs::read_to_string(&path) {
            Ok(text) => {
                let document: Document =
                    serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
                document.rows
            }
            Err(_) => Vec::new(),
        };
        Ok(Self { path, words, commit: super::tools::commit(), rows, measured: Vec::new() })
    }

    /// Measures a row, unless the words leave it out, and writes the sheet.
    pub fn row(&mut self, line: &str, command: &str, threshold: &str, measure: impl FnOnce() -> Outcome) {
        if !self.words.is_empty() && !self.words.iter().any(|word| line.contains(word)) {
            return;
        }
        eprintln!("… {line}");
        let begin = Instant::now();
        let (figure, pass) = measure().unwrap_or_else(|why| (format!("not measured: {why}"), false));
        let seconds = (begin.elapsed().as_secs_f64() * 10.0).round() / 10.0;
        println!("{} {line}: {figure}  [{threshold}]  {seconds} s", if pass { "pass" } else { "FAIL" });
        let row = Row {
            line: line.to_owned(),
            command: command.to_owned(),
            commit: self.commit.clone(),
            seconds,
            figure,
            threshold: threshold.to_owned(),
            pass,
            machine: super::tools::machine(),
        };
        self.measured.push(line.to_owned());
        match self.rows.iter_mut().find(|old| old.line == line) {
            Some(old) => *old = row,
            None => self.rows.push(row),
        }
        if let Err(error) = self.write() {
            eprintln!("{error}");
        }
    }

    fn write(&self) -> Result<(), String> {
        let document = Document { schema: 1, rows: self.rows.clone() };
        let text = serde_json::to_string_pretty(&document).map_err(|e| e.to_string())? + "\n";
        let part = self.path.with_extension("json.part");
        std::fs::write(&part, text).map_err(|e| format!("{}: {e}", part.display()))?;
        std::fs::rename(&part, &self.path).map_err(|e| format!("{}: {e}", self.path.display()))
    }

    /// Writes the sheet; how many rows of it do not pass.
    pub fn close(mut self) -> Result<usize, String> {
        // A whole run leaves no row behind that nobody measures any more.
        if self.words.is_empty() {
            let measured = std::mem::take(&mut self.measured);
            self.rows.retain(|row| measured.contains(&row.line));
        }
        self.write()?;
        Ok(self.rows.iter().filter(|row| !row.pass).count())
    }
}
