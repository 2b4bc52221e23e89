//! A panic as an error of one sentence: whatever a model's own functions do, the program ends with words.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use signal_hook::consts::SIGABRT;
use signal_hook::flag::register_conditional_shutdown;

use super::voice::tell_failure;
use crate::error::Failure;

/// Exit code of a program that panicked.
const PANICKED: u8 = 70;

/// The first panic; others follow from it.
static FIRST: OnceLock<String> = OnceLock::new();

/// Does `work`; a panic in it, in any thread that it waits for, is told and gives the exit code 70. So does a
/// function that calls itself without end, of which Rust itself tells.
pub(super) fn told(work: impl FnOnce() -> ExitCode) -> ExitCode {
    // without it the exit code is the system's
    let _ =
        register_conditional_shutdown(SIGABRT, PANICKED.into(), Arc::new(AtomicBool::new(true)));
    set_hook(Box::new(|info| {
        FIRST.get_or_init(|| words(info));
    }));
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        let panic = FIRST.get().map_or("", String::as_str);
        tell_failure(&Failure::new(format_args!(
            "a panic{panic}\nhelp: if this is in your model's file, mend it there; else it is a fault of eplat: please report it with the command line"
        )));
        ExitCode::from(PANICKED)
    })
}

/// Where it was, and what it said.
fn words(info: &PanicHookInfo<'_>) -> String {
    let place =
        info.location().map_or(String::new(), |at| format!(" at {}:{}", at.file(), at.line()));
    let said = info.payload_as_str().map_or(String::new(), |text| format!(": {text}"));
    place + &said
}
