//! The thread that brings a session to the disk every half second.

use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::writer::Shared;

/// Half of the second that a crash may cost at most.
const PERIOD: Duration = Duration::from_millis(500);

/// Ends, and waits for a flush under way, when dropped.
#[derive(Debug)]
pub(super) struct Ticker {
    end: Option<mpsc::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Ticker {
    /// Flushes the session every half second, then asks the disk to have `files` for good. Syncing happens outside
    /// the session's lock: a slow disk holds up nobody.
    pub(super) fn start(session: Arc<Shared>, files: Vec<File>) -> io::Result<Self> {
        let (end, ended) = mpsc::channel();
        let thread = std::thread::Builder::new().name("session-flush".into()).spawn(move || {
            while let Err(RecvTimeoutError::Timeout) = ended.recv_timeout(PERIOD) {
                if !session.tick() {
                    return;
                }
                for file in &files {
                    if let Err(error) = file.sync_data() {
                        session.sync_failed(error);
                    }
                }
            }
        })?;
        Ok(Self { end: Some(end), thread: Some(thread) })
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
