//! The program `lumenav`: a thin door to the library.

mod args;
mod commands;
mod progress;
mod table;

use args::{Arguments, Command};
use clap::Parser as _;
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match &arguments.command {
        Command::Run(options) => commands::run::run(options, arguments.verbosity()),
        Command::Replay(options) => commands::replay::replay(options, arguments.verbosity()),
        Command::Explain(options) => commands::explain::explain(options),
        Command::Scenarios(what) => commands::scenarios::scenarios(what),
        Command::Models(what) => commands::models::models(what),
        Command::Plugins(options) => commands::models::plugins(options),
        Command::New(what) => commands::new::new(what),
        Command::Export(options) => commands::export::export(options),
        Command::View(options) => commands::view::view(options),
        Command::Completions { shell } => {
            args::completions(*shell);
            Ok(())
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            exit_code(&error)
        }
    }
}

/// 3 for something wrong in a user's file, 130 for a run stopped on request, else 1. (2 is clap's, for the command line.)
fn exit_code(error: &anyhow::Error) -> ExitCode {
    use lumenav::pipeline::RunError;
    use lumenav::scenario::ScenarioError;
    let is_input = error.chain().any(|cause| {
        cause.is::<lumenav::core::ConfigError>()
            || matches!(
                cause.downcast_ref::<ScenarioError>(),
                Some(ScenarioError::Config(_) | ScenarioError::Records(_))
            )
            || matches!(cause.downcast_ref::<RunError>(), Some(RunError::Config(_) | RunError::Modality(_)))
    });
    let stopped =
        error.chain().any(|cause| matches!(cause.downcast_ref::<RunError>(), Some(RunError::Stopped { .. })));
    ExitCode::from(if stopped {
        130
    } else if is_input {
        3
    } else {
        1
    })
}
