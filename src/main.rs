//! The `embrace` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    embrace::cli::run(std::env::args_os())
}
