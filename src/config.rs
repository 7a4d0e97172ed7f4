//! rig.toml to types: degrees and metres in, radians out.
