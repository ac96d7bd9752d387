//! Starts the program as a user would.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The checkout.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The program, in the checkout's folder.
pub fn lumenav() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lumenav"));
    command.current_dir(root());
    command
}

/// A folder that is gone when the test ends.
pub fn scratch() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder can be made")
}

/// The folder of recorded data, or a line that says it is skipped.
pub fn data_or_skip(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("LUMENAV_DATA").map(PathBuf::from);
    match &folder {
        Some(_) => println!("REAL-DATA ran {test}"),
        None => println!("{test}: SKIPPED (LUMENAV_DATA unset)"),
    }
    folder
}

/// A `lumenav run` being put together.
pub struct Run {
    command: Command,
}

impl Run {
    /// Runs this scenario without a recording (most tests do not look at one).
    pub fn new(scenario: &Path) -> Self {
        let mut command = lumenav();
        command.arg("run").arg(scenario);
        Self { command }
    }

    /// Into this folder.
    pub fn out(mut self, folder: &Path) -> Self {
        self.command.arg("--out").arg(folder);
        self
    }

    /// Called from this folder.
    pub fn here(mut self, folder: &Path) -> Self {
        self.command.current_dir(folder);
        self
    }

    /// One more argument.
    pub fn arg(mut self, argument: impl AsRef<std::ffi::OsStr>) -> Self {
        self.command.arg(argument);
        self
    }

    /// Several more arguments.
    pub fn args_of(mut self, arguments: &[&str]) -> Self {
        self.command.args(arguments);
        self
    }

    /// Runs it, whatever comes of it.
    pub fn output(mut self) -> Output {
        self.command.output().expect("the program starts")
    }

    /// Runs it; it must succeed.
    pub fn ok(self) -> String {
        let output = self.output();
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success(), "stdout:\n{out}\nstderr:\n{err}");
        out.into_owned()
    }

    /// Runs it; it must fail with this exit code. What it said on stderr.
    pub fn fails(self, code: i32) -> String {
        let output = self.output();
        let err = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "stderr:\n{err}");
        err
    }

    /// The same, with the table before it.
    pub fn fails_with_table(self, code: i32) -> String {
        let output = self.output();
        let said =
            [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned()).concat();
        assert_eq!(output.status.code(), Some(code), "{said}");
        said
    }
}
