//! Metadata of any text: parsed or refused; what is parsed survives its own file and makes a decoder.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sensors::ouster::{Metadata, OusterDecoder};

fuzz_target!(|text: &str| {
    if let Ok(metadata) = Metadata::parse(text, "fuzz") {
        let written = metadata.to_json();
        let again = Metadata::parse(&written, "written").expect("what we write we read");
        assert_eq!(again.packet_format(), metadata.packet_format());
        if metadata.columns_per_frame * metadata.pixels_per_column < 1 << 20 {
            OusterDecoder::new(metadata);
        }
    }
});
