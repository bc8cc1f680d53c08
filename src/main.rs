//! The `embrace` command.

fn main() {}
