#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| sensors_fuzz::router(bytes));
