//! The reader `carto` under libFuzzer.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| eplat_fuzz::feed("carto", bytes));
