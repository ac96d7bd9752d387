//! The program `lumenav` as a function: commands, progress, tables, exit codes.
//!
//! A program of your own that knows one modality more is this:
//!
//! ```no_run
//! fn main() -> std::process::ExitCode {
//!     let registry = lumenav_cli::lumenav::default_registry(); // add yours: .with(MyModality)
//!     lumenav_cli::main_with(registry)
//! }
//! ```
//!
//! It has every command of `lumenav`, and `[[sensor]] modality = "…"` finds yours.

#[macro_use]
mod output;

mod args;
mod commands;
mod exit;
mod files;
mod progress;
mod provenance;
mod table;
mod threads;

pub use lumenav;

use args::{Arguments, Command};
use clap::Parser as _;
use lumenav::core::Registry;
use std::process::ExitCode;

/// Does what the command line asks for, with these modalities, and says how the process should end.
#[expect(clippy::needless_pass_by_value, reason = "a program hands its registry over and is done")]
pub fn main_with(registry: Registry) -> ExitCode {
    let arguments = Arguments::parse();
    match obey(&arguments, &registry) {
        Ok(()) => ExitCode::SUCCESS,
        // `lumenav … | head -1`: the reader has what it wanted.
        Err(error) if error.is::<output::ReaderGone>() => ExitCode::SUCCESS,
        Err(error) => {
            complain!("error: {error:#}");
            exit::code_of(&error)
        }
    }
}

fn obey(arguments: &Arguments, registry: &Registry) -> anyhow::Result<()> {
    let verbosity = arguments.verbosity();
    match &arguments.command {
        Command::Run(options) => commands::run::run(options, registry, verbosity),
        Command::Replay(options) => commands::replay::replay(options, registry, verbosity),
        Command::Reproduce(options) => commands::reproduce::reproduce(options, verbosity),
        Command::Explain(options) => commands::explain::explain(options),
        Command::Scenarios(what) => commands::scenarios::scenarios(what, registry),
        Command::Models(what) => commands::models::models(what),
        Command::Plugins(options) => commands::models::plugins(options, registry),
        Command::New(what) => commands::new::new(what, registry, verbosity),
        Command::Layout(what) => commands::layout::layout(what, registry, verbosity),
        Command::Export(options) => commands::export::export(options, verbosity),
        Command::Dose(options) => commands::dose::dose(options),
        Command::View(options) => commands::view::view(options),
        Command::Completions { shell } => args::completions(*shell),
    }
}
