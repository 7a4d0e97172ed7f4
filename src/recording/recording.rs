//! Receiver to session: a recording that runs by itself until it is stopped.

use std::sync::Arc;
use std::thread::JoinHandle;

use super::{Manifest, SessionError, SessionWriter};
use crate::live::receive::{Datagram, Monitor, Receiver, Stop};

/// Datagrams written under one lock of the session.
const BATCH: usize = 64;

/// A thread that writes what a receiver receives.
#[derive(Debug)]
pub struct Recording {
    session: Arc<SessionWriter>,
    monitor: Monitor,
    stop: Stop,
    thread: JoinHandle<()>,
}

impl Recording {
    /// Starts to write. Sensors of the receiver and of the session are the same, in the same order.
    pub fn start(receiver: Receiver, session: SessionWriter) -> Result<Self, SessionError> {
        Self::start_beside(receiver, session, |_| {})
    }

    /// The same; what is written is shown to someone else, too, on the thread that writes.
    pub fn start_beside(
        mut receiver: Receiver,
        session: SessionWriter,
        mut show: impl FnMut(&[Datagram]) + Send + 'static,
    ) -> Result<Self, SessionError> {
        let session = Arc::new(session);
        let (monitor, stop) = (receiver.monitor(), receiver.stop_handle());
        let (writer, on_failure) = (Arc::clone(&session), stop.clone());
        let work = move || {
            let mut batch = Vec::with_capacity(BATCH);
            while receiver.recv_many_blocking(&mut batch, BATCH) > 0 {
                // the session keeps the failure and counts what it does not take; the rest of the queue is counted too
                if writer.write_datagrams(&batch).is_err() {
                    on_failure.stop();
                }
                show(&batch);
                batch.clear();
            }
        };
        let thread = std::thread::Builder::new()
            .name("record".into())
            .spawn(work)
            .map_err(|error| SessionError::io(session.dir(), "cannot start the recording thread", error))?;
        Ok(Self { session, monitor, stop, thread })
    }

    /// The session being written, for servo reports, events and copies of mounts and trajectory.
    pub fn session(&self) -> &Arc<SessionWriter> {
        &self.session
    }

    /// What was received and lost so far.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Whether recording ended by itself: the disk is full or broken. [`Recording::stop`] says why.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Ends receiving, writes what was received, closes the session.
    pub fn stop(self) -> Result<Manifest, SessionError> {
        self.stop.stop();
        let panicked = self.thread.join().is_err();
        let manifest = self.session.close(Some(&self.monitor.tally()))?;
        if panicked {
            let reason = "the recording thread panicked".into();
            return Err(SessionError::Content { path: self.session.dir().to_owned(), reason });
        }
        Ok(manifest)
    }
}
