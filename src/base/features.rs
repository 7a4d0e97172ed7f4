//! What a build may lack: the features of Cargo.toml.

/// What to say where something is asked for that this program was built without.
#[cfg(not(all(feature = "daemon", feature = "mcap", feature = "survey")))]
pub(crate) fn left_out(what: &str, feature: &str) -> String {
    format!(
        "this program was built without {what}: build it with the feature `{feature}` (as `cargo build` does by itself)"
    )
}
