//! How the process ends: the codes that `lumenav --help` promises.

use lumenav::layouts::LayoutError;
use lumenav::pipeline::RunError;
use lumenav::reproduce::ReproduceError;
use lumenav::scenario::ScenarioError;
use std::fmt;
use std::process::ExitCode;

/// Something is wrong in files of the user's, and each has been told apart already.
#[derive(Debug)]
pub struct WrongFiles(pub String);

impl fmt::Display for WrongFiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongFiles {}

/// A run came to its end, and not everything that its file expects is so.
#[derive(Debug)]
pub struct Unexpected(pub String);

impl fmt::Display for Unexpected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Unexpected {}

/// Whether a run ended because somebody asked it to.
pub fn was_stopped(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        matches!(cause.downcast_ref::<RunError>(), Some(RunError::Stopped { .. }))
            || matches!(cause.downcast_ref::<ReproduceError>(), Some(ReproduceError::Stopped { .. }))
            || matches!(
                cause.downcast_ref::<LayoutError>(),
                Some(LayoutError::Stopped | LayoutError::Interrupted)
            )
    })
}

/// 3 for something wrong in a user's file, 4 for a run that is not as its file expects, 130 for a run stopped on request, else 1. (2 is clap's, for the command line.)
pub fn code_of(error: &anyhow::Error) -> ExitCode {
    let of_scenario =
        |error: &ScenarioError| matches!(error, ScenarioError::Config(_) | ScenarioError::Records(_));
    let is_input = error.chain().any(|cause| {
        cause.is::<WrongFiles>()
            || cause.is::<lumenav::core::ConfigError>()
            || cause.downcast_ref::<ScenarioError>().is_some_and(of_scenario)
            || matches!(cause.downcast_ref::<ReproduceError>(), Some(ReproduceError::Config(_)))
            || cause
                .downcast_ref::<LayoutError>()
                .is_some_and(|e| !matches!(e, LayoutError::Stopped | LayoutError::Interrupted))
            || match cause.downcast_ref::<RunError>() {
                Some(RunError::Config(_) | RunError::Modality(_) | RunError::Checkpoint { .. }) => true,
                // Transparent: the chain goes past the inner error to its source.
                Some(RunError::Scenario(inner)) => of_scenario(inner),
                _ => false,
            }
    });
    ExitCode::from(match (was_stopped(error), is_input) {
        (true, _) => 130,
        (false, true) => 3,
        (false, false) if error.is::<Unexpected>() => 4,
        (false, false) => 1,
    })
}
