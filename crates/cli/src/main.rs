//! The program `lumenav`: the library's program with the modalities that lumenav ships.

use std::process::ExitCode;

fn main() -> ExitCode {
    lumenav_cli::main_with(lumenav::default_registry())
}
