#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| firmware_protocol_fuzz::rig(bytes));
