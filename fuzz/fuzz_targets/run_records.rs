//! The reader `run_records` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| eplat_fuzz::feed("run_records", bytes));
