//! The `embrace` command.

use std::panic;
use std::process::ExitCode;

fn main() -> ExitCode {
    // The default code of a panic, 101, is none of the contract's.
    panic::catch_unwind(|| embrace::cli::run(std::env::args_os())).unwrap_or(ExitCode::from(1))
}
