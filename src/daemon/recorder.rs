//! The recorder: opens, exchanges and closes sessions, watches the disk, writes what the journal hands it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::intake::Intake;
use super::journal::{Entry, Journal};
use super::session_sink::SessionSink;
use super::status::{LastSession, RecorderStatus};
use super::supervision::{Pulse, Role, Supervision};
use crate::live::receive::{Tally, now_ns};
use crate::recording::{self, Manifest, SensorInfo, SessionError, SessionWriter};
use crate::rig::{CalibrationFile, MountFile};
use crate::world::trajectory::Trajectory;

/// How often the recorder looks at the disk and its own files.
const LOOK: Duration = Duration::from_millis(100);
/// Rates are means over this time at least.
const RATE_OVER: Duration = Duration::from_millis(1000);

/// How to record.
#[derive(Clone, Debug)]
pub struct RecorderSettings {
    /// Folder in which each session gets a folder.
    pub folder: PathBuf,
    /// Record from the start on.
    pub at_start: bool,
    /// Begin a new session when packets fill this many bytes.
    pub rotate_bytes: Option<u64>,
    /// Begin a new session after this time.
    pub rotate_after: Option<Duration>,
    /// Warn below this much free space.
    pub warn_below_bytes: u64,
    /// End the recording in good order below this much free space.
    pub stop_below_bytes: u64,
    /// Every write takes so long more: a slow disk, to be tested with.
    pub held_up: Duration,
}

/// What each session holds besides packets.
#[derive(Clone, Debug, Default)]
pub(super) struct SessionAttachments {
    pub sensors: Vec<SensorInfo>,
    pub config: Option<String>,
    pub mount: Option<MountFile>,
    pub calibrations: Vec<CalibrationFile>,
    pub trajectory: Option<Trajectory>,
}

/// Why the recorder refused an order.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// A session is open.
    #[error("already recording {0}")]
    AlreadyRecording(String),
    /// None is.
    #[error("not recording")]
    NotRecording,
    /// Too little space.
    #[error(
        "{free_mib} MiB are free where sessions go, and recording ends below {min_mib} MiB: make room first"
    )]
    DiskFull {
        /// Free, MiB.
        free_mib: u64,
        /// Needed, MiB.
        min_mib: u64,
    },
    /// The session cannot be written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The recorder is gone, or its disk holds it up.
    #[error("the recorder does not answer: its disk holds it up")]
    Stalled,
}

type Reply<T> = Sender<Result<T, RecorderError>>;

enum Order {
    Start(String, Reply<String>),
    Stop(Reply<LastSession>),
    Split(Option<MountFile>, Reply<String>),
    Quit,
}

/// A handle on the recorder's thread.
pub(super) struct Recorder {
    orders: Sender<Order>,
    status: Arc<Mutex<RecorderStatus>>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

impl Recorder {
    /// Makes the folder and starts the thread.
    pub(crate) fn start(
        settings: RecorderSettings,
        attachments: SessionAttachments,
        intake: Arc<Intake>,
        sink: Arc<SessionSink>,
        journal: Arc<Journal>,
        lines: Receiver<Entry>,
        supervision: &Arc<Supervision>,
    ) -> Result<Self, RecorderError> {
        let folder = &settings.folder;
        std::fs::create_dir_all(folder).map_err(|source| SessionError::Io {
            path: folder.clone(),
            doing: "cannot be made",
            source,
        })?;
        let status = Arc::new(Mutex::new(RecorderStatus::default()));
        let (orders, waiting) = channel();
        let at_start = settings.at_start;
        let mut worker = Worker {
            settings,
            attachments,
            intake,
            sink,
            journal,
            lines,
            status: Arc::clone(&status),
            open: None,
            rate: None,
            notices: Notices::default(),
        };
        worker.check_disk();
        if at_start {
            worker.begin("")?;
        }
        worker.publish();
        let thread = supervision
            .spawn("recorder", Role::Essential, move |pulse| worker.run(&waiting, pulse))
            .map_err(|source| SessionError::Io { path: PathBuf::new(), doing: "no thread for it", source })?;
        Ok(Self { orders, status, thread: Mutex::new(Some(thread)) })
    }

    /// Begins a session; its name. The label goes into its events, never into a path.
    pub(crate) fn begin(&self, label: String) -> Result<String, RecorderError> {
        self.ask(|reply| Order::Start(label, reply))
    }

    /// Closes the session.
    pub(crate) fn end(&self) -> Result<LastSession, RecorderError> {
        self.ask(Order::Stop)
    }

    /// Goes on in a new session with this mount; its name.
    pub(crate) fn split(&self, mount: Option<MountFile>) -> Result<String, RecorderError> {
        self.ask(|reply| Order::Split(mount, reply))
    }

    /// What it does now.
    pub(crate) fn status(&self) -> RecorderStatus {
        self.reader()()
    }

    /// Reads its state from another thread.
    pub(crate) fn reader(&self) -> impl Fn() -> RecorderStatus + Send + use<> {
        let status = Arc::clone(&self.status);
        move || {
            let mut status = status.lock().unwrap_or_else(PoisonError::into_inner).clone();
            status.age_ms = status.as_of.map_or(0.0, |as_of| as_of.elapsed().as_secs_f64() * 1e3);
            status
        }
    }

    /// Closes the session if one is open and ends the thread; what it did last.
    pub(crate) fn quit(&self) -> RecorderStatus {
        let _ = self.orders.send(Order::Quit); // a thread that is gone has ended
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            let _ = thread.join();
        }
        self.status()
    }

    fn ask<T>(&self, order: impl FnOnce(Reply<T>) -> Order) -> Result<T, RecorderError> {
        let (reply, answer) = channel();
        self.orders.send(order(reply)).map_err(|_| RecorderError::Stalled)?;
        answer.recv_timeout(Duration::from_secs(10)).unwrap_or(Err(RecorderError::Stalled))
    }
}

/// A session being written.
struct Open {
    session: Arc<SessionWriter>,
    name: String,
    label: String,
    begun: Instant,
    begun_ns: u64,
    /// What was lost before it began.
    before: Tally,
    /// Parts of this recording, this one included.
    part: u32,
    /// Whether each axis has a zero, as this session's events say.
    has_zero: BTreeMap<usize, bool>,
}

/// What was already reported about the present state.
#[derive(Default)]
struct Notices {
    low_disk: bool,
    stalled: bool,
}

struct Worker {
    settings: RecorderSettings,
    attachments: SessionAttachments,
    intake: Arc<Intake>,
    sink: Arc<SessionSink>,
    journal: Arc<Journal>,
    lines: Receiver<Entry>,
    status: Arc<Mutex<RecorderStatus>>,
    open: Option<Open>,
    rate: Option<(Instant, u64)>,
    notices: Notices,
}

impl Worker {
    fn run(mut self, orders: &Receiver<Order>, pulse: &Pulse) {
        loop {
            pulse.beat();
            match orders.recv_timeout(LOOK) {
                Ok(Order::Start(label, reply)) => drop(reply.send(self.begin(&label))),
                Ok(Order::Stop(reply)) => {
                    drop(reply.send(self.end("stopped").ok_or(RecorderError::NotRecording)))
                }
                Ok(Order::Split(mount, reply)) => {
                    self.write_lines(); // what the rig did until now belongs to the session before
                    self.attachments.mount = mount.or(self.attachments.mount.take());
                    drop(reply.send(self.rotate("reconfigured")));
                }
                Ok(Order::Quit) | Err(RecvTimeoutError::Disconnected) => {
                    self.write_lines();
                    self.end("stopped");
                    self.publish();
                    return;
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
            self.write_lines();
            self.check();
            self.publish();
        }
    }

    /// Opens a session and puts it in the place of none.
    fn begin(&mut self, label: &str) -> Result<String, RecorderError> {
        if let Some(open) = &self.open {
            return Err(RecorderError::AlreadyRecording(open.name.clone()));
        }
        self.check_disk();
        let min_bytes = self.settings.stop_below_bytes;
        if let Some(free_bytes) = self.state().free_bytes.filter(|free_bytes| *free_bytes < min_bytes) {
            let [free_mib, min_mib] = [free_bytes, min_bytes].map(|bytes| bytes >> 20);
            return Err(RecorderError::DiskFull { free_mib, min_mib });
        }
        self.sink.latency().clear();
        let open = self.make(label, 1)?;
        let name = open.name.clone();
        self.sink.exchange(Some(Arc::clone(&open.session)));
        self.open = Some(open);
        self.journal.tell("recording", format!("recording {name}"));
        self.write_lines();
        self.publish();
        Ok(name)
    }

    fn make(&self, label: &str, part: u32) -> Result<Open, RecorderError> {
        let name = free_name(&self.settings.folder);
        let session = SessionWriter::create(&self.settings.folder.join(&name), &self.attachments.sensors)?;
        if let Some(config) = &self.attachments.config {
            session.put_config(config)?;
        }
        if let Some(mount) = &self.attachments.mount {
            session.put_mount(mount, &self.attachments.calibrations)?;
        }
        if let Some(trajectory) = &self.attachments.trajectory {
            session.put_trajectory(trajectory)?;
        }
        let begun_ns = now_ns();
        let session = Arc::new(session);
        let before = self.intake.tally();
        let label = label.to_owned();
        let event = serde_json::json!({
            "time_ns": begun_ns, "event": "begin", "label": label, "part": part,
            "follows": self.open.as_ref().map(|open| &open.name),
        });
        session.write_event(&event)?;
        let has_zero = BTreeMap::new();
        Ok(Open { session, name, label, begun: Instant::now(), begun_ns, before, part, has_zero })
    }

    /// Goes on in a new session: every packet is in one of the two.
    fn rotate(&mut self, why: &'static str) -> Result<String, RecorderError> {
        let next = self.open.as_ref().map(|open| (open.label.clone(), open.part + 1));
        let (label, part) = next.ok_or(RecorderError::NotRecording)?;
        match self.make(&label, part) {
            Ok(next) => {
                let [packets, bytes] = self.sink.counts();
                self.sink.exchange(Some(Arc::clone(&next.session)));
                self.journal.tell("rotated", format!("part {part} goes into {}", next.name));
                let name = next.name.clone();
                if let Some(full) = self.open.replace(next) {
                    self.close(full, why, [packets, bytes]);
                }
                Ok(name)
            }
            // the session that is open goes on; the disk will say what is wrong with it
            Err(error) => {
                self.journal.tell("rotation_failed", format!("no new session: {error}"));
                Err(error)
            }
        }
    }

    fn end(&mut self, why: &'static str) -> Option<LastSession> {
        let open = self.open.take()?;
        let counts = self.sink.counts();
        self.sink.exchange(None);
        Some(self.close(open, why, counts))
    }

    fn close(&mut self, open: Open, why: &'static str, [packets, bytes]: [u64; 2]) -> LastSession {
        let tally = self.intake.tally().since(&open.before);
        let event = serde_json::json!({"time_ns": now_ns(), "event": "end", "why": why});
        let _ = open.session.write_event(&event); // closing tells of a disk that takes no more
        let closed = match &self.open {
            Some(next) => next.session.succeed(&open.session, Some(&tally)),
            None => open.session.close(Some(&tally)),
        };
        let mut last = LastSession {
            name: open.name,
            dir: open.session.dir().to_owned(),
            why,
            complete: false,
            packets,
            bytes,
            lost: tally.lost(),
            failure: None,
        };
        let mut lost_here = true;
        match closed {
            Ok(manifest) => last.take(&manifest),
            Err(error) => {
                last.failure = Some(error.to_string());
                if let SessionError::Displaced { manifest, is_retained, .. } = error {
                    last.take(&manifest);
                    lost_here = is_retained || self.open.is_none(); // else the session that goes on has them
                } else if let Ok(manifest) = Manifest::read(open.session.dir()) {
                    last.take(&manifest);
                }
            }
        }
        if let Some(displaced) = open.session.displaced() {
            last.failure.get_or_insert(displaced.words.clone());
        }
        match &last.failure {
            Some(failure) => self.journal.tell("recording_failed", format!("{}: {failure}", last.name)),
            None => {
                let words = format!("{}: {} packets, {} lost", last.name, last.packets, last.lost);
                self.journal.tell("recorded", words);
            }
        }
        let mut state = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        state.sessions += 1;
        state.lost += if lost_here { last.lost } else { 0 };
        state.failed |= last.failure.is_some();
        state.last = Some(last.clone());
        last
    }

    fn write_lines(&mut self) {
        while let Ok(line) = self.lines.try_recv() {
            let Some(open) = &mut self.open else { continue };
            // a refusal is the session's failure, which it keeps
            let _ = match line {
                Entry::Event(event) => open.session.write_event(&event),
                Entry::Servo(report) => {
                    self.journal.tell_homing(&report, &mut open.has_zero);
                    open.session.write_servo(&report)
                }
            };
        }
    }

    fn check(&mut self) {
        self.check_disk();
        let stalled = self.intake.stalled_s() > 0.5;
        if stalled && !self.notices.stalled {
            self.journal.tell("disk_slow", "the disk takes packets more slowly than they come");
        }
        self.notices.stalled = stalled;
        let Some(open) = &self.open else { return };
        let state = self.state();
        let full = state.free_bytes.is_some_and(|free_bytes| free_bytes < self.settings.stop_below_bytes);
        let old = self.settings.rotate_after.is_some_and(|after| open.begun.elapsed() >= after);
        let large = self.settings.rotate_bytes.is_some_and(|bytes| self.sink.counts()[1] >= bytes);
        if let Some(displaced) = open.session.displaced().cloned() {
            self.journal.tell("session_displaced", displaced.words);
            if self.rotate("displaced").is_err() {
                self.end_early("displaced");
            }
        } else if self.sink.has_failed() {
            self.end_early("failed");
        } else if full {
            self.journal.tell("disk_full", "recording ends in good order: the disk is nearly full");
            self.end_early("disk_full");
        } else if old || large {
            let _ = self.rotate("rotated"); // the journal has the failure
        }
    }

    /// Ends a recording without an order.
    fn end_early(&mut self, why: &'static str) {
        self.write_lines();
        self.end(why);
        self.status.lock().unwrap_or_else(PoisonError::into_inner).ended_early = true;
    }

    fn check_disk(&mut self) {
        // a file system that does not say what is free gets no warning, and still the error when it is full
        let free_bytes = recording::free_bytes(&self.settings.folder).ok();
        let bytes = if self.open.is_some() { self.sink.counts()[1] } else { 0 };
        let mut bytes_per_s = self.state().bytes_per_s;
        match self.rate {
            Some((since, before)) if bytes >= before => {
                if since.elapsed() >= RATE_OVER {
                    bytes_per_s = (bytes - before) as f64 / since.elapsed().as_secs_f64();
                    self.rate = Some((Instant::now(), bytes));
                }
            }
            _ => self.rate = Some((Instant::now(), bytes)), // another session
        }
        let usable = free_bytes.map(|free_bytes| free_bytes.saturating_sub(self.settings.stop_below_bytes));
        let seconds_left =
            usable.filter(|_| bytes_per_s > 0.0).map(|usable_bytes| usable_bytes as f64 / bytes_per_s);
        let low = free_bytes.is_some_and(|free_bytes| free_bytes < self.settings.warn_below_bytes)
            || seconds_left.is_some_and(|left_s| left_s < recording::LOW_DISK_SECONDS);
        if low && !self.notices.low_disk {
            let free_mib = free_bytes.unwrap_or(0) >> 20;
            self.journal.tell("low_disk", format!("{free_mib} MiB are left where sessions go"));
        }
        self.notices.low_disk = low;
        let mut state = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        state.free_bytes = free_bytes;
        state.bytes_per_s = bytes_per_s;
        state.seconds_left = seconds_left;
        state.low_disk = low;
    }

    fn state(&self) -> RecorderStatus {
        self.status.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn publish(&self) {
        let [packets, bytes] = if self.open.is_some() { self.sink.counts() } else { [0; 2] };
        let losses = self.open.as_ref().map(|open| self.intake.tally().since(&open.before).lost());
        let mut state = self.status.lock().unwrap_or_else(PoisonError::into_inner);
        state.recording = self.open.is_some();
        state.session = self.open.as_ref().map(|open| open.name.clone());
        state.since_ns = self.open.as_ref().map(|open| open.begun_ns);
        state.part = self.open.as_ref().map_or(0, |open| open.part);
        (state.packets, state.bytes) = (packets, bytes);
        state.session_lost = losses.unwrap_or(0);
        state.latency = self.sink.latency().percentiles();
        state.as_of = Some(Instant::now());
    }
}

/// A name for a session that no folder has.
fn free_name(folder: &Path) -> String {
    let name = recording::folder_name_now();
    let numbered = (2..).map(|number| format!("{name}-{number}"));
    let mut names = std::iter::once(name.clone()).chain(numbered);
    names.find(|name| !folder.join(name).exists()).unwrap_or(name)
}
