//! Crates that panic where a file is damaged.

use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

use super::Fault;

/// What a crate makes of damage that no count shows: an error, also where it panics. A panic on this thread in the
/// meantime is not printed on stderr.
pub(super) fn guarded<T, E: std::fmt::Display>(
    format: &str,
    work: impl FnOnce() -> Result<T, E>,
) -> Result<T, Fault> {
    thread_local!(static IS_GUARDED: Cell<bool> = const { Cell::new(false) });
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let tell = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                tell(panic);
            }
        }));
    });
    IS_GUARDED.set(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(work));
    IS_GUARDED.set(false);
    match outcome {
        Ok(outcome) => outcome.map_err(|error| Fault::at(format, error.to_string())),
        Err(_) => Err(Fault::at(format, "its points are damaged; expected a file as its standard says")),
    }
}
