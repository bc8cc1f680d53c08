//! A check of tests/fuzz as a fuzz target.

#[allow(dead_code, reason = "a target runs one of the checks")]
#[path = "../tests/fuzz/checks/mod.rs"]
pub mod checks;

use std::panic;

/// libFuzzer's hook ends the process at every panic, also at those of image decoders, which the library catches and turns
/// into errors. Without it only a panic that leaves the check does.
pub fn let_panics_be_caught() {
    drop(panic::take_hook());
}

macro_rules! target {
    ($check:ident) => {
        libfuzzer_sys::fuzz_target!(init: harness::let_panics_be_caught(), |data: &[u8]| {
            harness::checks::$check::check(data)
        });
    };
}
pub(crate) use target;
