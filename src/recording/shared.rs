//! What a session's writer and its flushing thread share.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use super::file;
use super::open::Open;
use super::whereabouts::{Displaced, Whereabouts};

/// What the writer and its flushing thread share.
#[derive(Debug)]
pub(super) struct Shared {
    pub files: Whereabouts,
    pub displaced: OnceLock<Displaced>,
    pub open: Mutex<Option<Open>>,
}

impl Shared {
    pub(crate) fn lock(&self) -> MutexGuard<'_, Option<Open>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Flushes, syncs, and looks at the free space and whether the files still lie where they were made. False once the
    /// session is closed. A slow disk blocks no other thread: it is waited for outside the lock.
    pub(super) fn tick(&self) -> bool {
        let expected = {
            let mut guard = self.lock();
            let Some(open) = guard.as_mut() else { return false };
            open.look_at_clock(self.files.dir());
            open.flush();
            open.watch_space(self.files.dir());
            open.expected()
        };
        if let Some(found) = self.files.check(&expected) {
            self.displaced.get_or_init(|| found);
        }
        if let (Err(error), Some(open)) = (self.files.sync(), self.lock().as_mut()) {
            open.failed(file::PACKETS, error);
        }
        true
    }
}
