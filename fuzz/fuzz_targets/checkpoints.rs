//! The reader `checkpoints` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| eplat_fuzz::feed("checkpoints", bytes));
