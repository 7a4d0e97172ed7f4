//! Receiver to session: a recording that runs by itself until it is stopped.

use std::sync::{Arc, PoisonError, RwLock};
use std::thread::JoinHandle;

use super::{Manifest, SessionError, SessionWriter};
use crate::live::receive::{Datagram, Monitor, Receiver, Stop, Tally};

/// Datagrams written under one lock of the session.
const BATCH: usize = 64;

/// A thread that writes what a receiver receives.
#[derive(Debug)]
pub struct LiveRecording {
    session: Arc<RwLock<Arc<SessionWriter>>>,
    /// What was lost before the session began.
    before: Tally,
    monitor: Monitor,
    stop: Stop,
    thread: JoinHandle<()>,
}

impl LiveRecording {
    /// Starts to write. Sensors of the receiver and of the session are the same, in the same order.
    pub fn start(receiver: Receiver, session: SessionWriter) -> Result<Self, SessionError> {
        Self::start_observed(receiver, session, |_| {})
    }

    /// The same; what is written is shown to someone else, too, on the thread that writes.
    pub(crate) fn start_observed(
        mut receiver: Receiver,
        session: SessionWriter,
        mut show: impl FnMut(&[Datagram]) + Send + 'static,
    ) -> Result<Self, SessionError> {
        let dir = session.dir().to_owned();
        let session = Arc::new(RwLock::new(Arc::new(session)));
        let (monitor, stop) = (receiver.monitor(), receiver.stop_handle());
        let (writer, on_failure) = (Arc::clone(&session), stop.clone());
        let work = move || {
            let mut batch = Vec::with_capacity(BATCH);
            while receiver.recv_many_blocking(&mut batch, BATCH) > 0 {
                // the session keeps the failure and counts what it does not take; the rest of the queue is counted too
                let session = writer.read().unwrap_or_else(PoisonError::into_inner);
                if session.write_datagrams(&batch).is_err() {
                    on_failure.stop();
                }
                drop(session);
                show(&batch);
                batch.clear();
            }
        };
        let thread = std::thread::Builder::new()
            .name("record".into())
            .spawn(work)
            .map_err(|error| SessionError::io(&dir, "cannot start the recording thread", error))?;
        Ok(Self { session, before: Tally::default(), monitor, stop, thread })
    }

    /// The session being written, for servo reports, events and copies of mounts and trajectory.
    pub(crate) fn session(&self) -> Arc<SessionWriter> {
        self.session.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Goes on in another session with the same sensors: every packet is in one of the two. How the one before was
    /// closed; what was lost with it without a trace is counted in the other one.
    pub(crate) fn go_on_in(&mut self, next: SessionWriter) -> Result<Manifest, SessionError> {
        let mut place = self.session.write().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *place, Arc::new(next));
        let next = Arc::clone(&place);
        drop(place);
        let tally = self.monitor.tally();
        let received = tally.since(&std::mem::replace(&mut self.before, tally.clone()));
        next.succeed(&before, Some(&received))
    }

    /// What was received and lost so far.
    pub(crate) fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Whether recording ended by itself: the disk is full or broken. [`LiveRecording::stop`] says why.
    pub(crate) fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Ends receiving, writes what was received, closes the session.
    pub fn stop(self) -> Result<Manifest, SessionError> {
        self.stop.stop();
        let session = self.session();
        let panicked = self.thread.join().is_err();
        let manifest = session.close(Some(&self.monitor.tally().since(&self.before)))?;
        if panicked {
            let reason = "the recording thread panicked".into();
            return Err(SessionError::Content { path: session.dir().to_owned(), reason });
        }
        Ok(manifest)
    }
}
