//! One thread per sensor that decodes what comes, counts, and makes the picture. Everything else has priority.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use sensors::Decoded;
use sensors::ouster::Metadata;
use sensors::router::{Routed, Router, Sensor, Unclaimed};

use super::journal::Journal;
use super::latency::Latency;
use super::painter::Painter;
use super::supervision::{Pulse, Role, Supervision};
use super::surroundings::Surroundings;
use crate::live::receive::{Datagram, now_ns};
use crate::live::watch::{SensorReport, Watch, correction_words, is_model};

/// Datagrams that may wait: a revolution and more of the busiest sensor.
const WAITING: usize = 1024;
/// The same in bytes of memory: 0.8 s of the busiest Ouster (OS1-128 at 1024x10, dual return).
pub(super) const WAITING_BYTES: usize = 16 << 20;
/// How often the numbers are put out.
const PUBLISH: Duration = Duration::from_millis(250);
/// Priority of these threads (`nice`).
const NICE: i32 = 10;
/// Kinds of strange packets that are named.
const MAX_UNASSIGNED: usize = 3;

/// Gives the present thread a lower priority than those that receive and record.
pub(super) fn lower_priority() {
    // a system without priorities runs it like the others
    let _ = rustix::process::setpriority_process(None, NICE);
}

/// Queue into which a receive worker puts packets.
#[derive(Clone)]
pub(super) struct DecodeQueue {
    queue: SyncSender<Datagram>,
    shared: Arc<Shared>,
}

#[derive(Default)]
struct Shared {
    dropped: AtomicU64,
    waiting: AtomicUsize,
    waiting_bytes: AtomicUsize,
    max_waiting_bytes: AtomicUsize,
    numbers: Mutex<Numbers>,
    /// From the kernel's stamp until points were handed to the page's connections.
    latency: Latency,
}

impl Shared {
    fn add(&self, held: usize) {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        self.waiting_bytes.fetch_add(held, Ordering::Relaxed);
    }

    fn take(&self, held: usize) {
        self.waiting.fetch_sub(1, Ordering::Relaxed);
        self.waiting_bytes.fetch_sub(held, Ordering::Relaxed);
    }

    /// With half of what may wait waiting, revolutions are decoded and counted, and not drawn.
    fn is_busy(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) > WAITING / 2
            || self.waiting_bytes.load(Ordering::Relaxed) > WAITING_BYTES / 2
    }
}

/// What the thread found out.
#[derive(Clone, Default)]
pub(super) struct Numbers {
    pub report: Option<SensorReport>,
    /// Returns so far.
    pub points: u64,
    pub unclaimed: Vec<Unclaimed>,
    pub not_its_own: u64,
    pub first_damage: Option<String>,
    /// Revolutions that were not drawn.
    pub frames_not_drawn: u64,
    /// The packets are those of another model than configured.
    pub is_other_model: bool,
    /// When these numbers were put out.
    pub as_of: Option<Instant>,
}

impl DecodeQueue {
    /// Takes a packet if there is room; counts it otherwise.
    pub(crate) fn offer(&self, datagram: Datagram) {
        let (shared, held) = (&self.shared, datagram.held_bytes());
        // a sensor has one receive worker: no other thread adds meanwhile
        let bytes = shared.waiting_bytes.load(Ordering::Relaxed) + held;
        if bytes <= WAITING_BYTES {
            shared.add(held);
            if self.queue.try_send(datagram).is_ok() {
                shared.max_waiting_bytes.fetch_max(bytes, Ordering::Relaxed);
                return;
            }
            shared.take(held);
        }
        shared.dropped.fetch_add(1, Ordering::Relaxed);
    }

    /// The most bytes of packets that ever waited here.
    pub(crate) fn max_waiting_bytes(&self) -> usize {
        self.shared.max_waiting_bytes.load(Ordering::Relaxed)
    }

    /// Packets that were left out.
    pub(crate) fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }

    /// What the thread found out.
    pub(crate) fn numbers(&self) -> Numbers {
        self.shared.numbers.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// From the kernel's stamp until points were handed to the page's connections.
    pub(crate) fn latency(&self) -> &Latency {
        &self.shared.latency
    }
}

/// What a live thread works on.
pub(super) struct Subject {
    /// Number of the sensor.
    pub sensor: usize,
    pub name: String,
    /// As configured.
    pub model: String,
    /// Of an Ouster, with the name of its file.
    pub metadata: Option<(Metadata, String)>,
}

/// Starts the thread; it ends when every queue handle is gone.
pub(super) fn start(
    subject: Subject,
    around: Surroundings,
    supervision: &Arc<Supervision>,
) -> std::io::Result<(DecodeQueue, JoinHandle<()>)> {
    let (queue, waiting) = sync_channel(WAITING);
    let shared = Arc::new(Shared::default());
    let decode_queue = DecodeQueue { queue, shared: Arc::clone(&shared) };
    let mut router = Router::new();
    if let Some((metadata, name)) = subject.metadata {
        router.add_ouster(metadata, name);
    }
    let painter = Painter::new(subject.sensor, &subject.name, around.clone());
    let live = Live {
        name: subject.name,
        model: subject.model,
        router,
        watch: Watch::default(),
        painter,
        journal: around.journal,
        shared,
        points: 0,
        not_its_own: 0,
        frames_not_drawn: 0,
        seen: [0; 2],
        changes_reported: 0,
    };
    let component = format!("live {}", live.name);
    let thread = supervision.spawn(&component, Role::Dispensable, move |pulse| live.run(&waiting, pulse))?;
    Ok((decode_queue, thread))
}

struct Live {
    name: String,
    model: String,
    router: Router,
    watch: Watch,
    painter: Painter,
    journal: Arc<Journal>,
    shared: Arc<Shared>,
    points: u64,
    not_its_own: u64,
    frames_not_drawn: u64,
    /// Restarts and clock jumps that were reported.
    seen: [u64; 2],
    /// Settings that changed while it sent, and were reported.
    changes_reported: usize,
}

impl Live {
    fn run(mut self, waiting: &Receiver<Datagram>, pulse: &Pulse) {
        lower_priority();
        let mut published = Instant::now();
        loop {
            pulse.beat();
            match waiting.recv_timeout(PUBLISH) {
                Ok(datagram) => {
                    self.shared.take(datagram.held_bytes());
                    self.take(&datagram);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.publish(),
            }
            if published.elapsed() >= PUBLISH {
                published = Instant::now();
                self.publish();
            }
        }
    }

    fn take(&mut self, datagram: &Datagram) {
        let busy = self.shared.is_busy();
        let Self { router, watch, painter, points, frames_not_drawn, shared, .. } = self;
        let routed = router.push(&datagram.packet(), &mut |at, sensor: &Sensor, decoded| {
            if at != 0 {
                return; // a second Velodyne on this port: counted below
            }
            watch.take(&decoded);
            let Decoded::Frame(frame) = decoded else { return };
            let returns = frame.first.points() + frame.second.as_ref().map_or(0, |layer| layer.points());
            *points += returns as u64;
            match sensor.model() {
                Some(model) if !busy => {
                    painter.draw(sensor, model, frame);
                    shared.latency.add(frame.host_time_ns[1], now_ns());
                }
                _ => *frames_not_drawn += 1,
            }
        });
        self.not_its_own += u64::from(!matches!(routed, Routed::Assigned(0) | Routed::Damaged(0)));
    }

    fn publish(&mut self) {
        let sensor = self.router.sensors().first();
        let report = sensor.map(|sensor| self.watch.report(self.name.clone(), sensor));
        let mut unclaimed: Vec<Unclaimed> = self.router.unclaimed().cloned().collect();
        unclaimed.sort_by_key(|entry| std::cmp::Reverse(entry.packets));
        unclaimed.truncate(MAX_UNASSIGNED);
        if let Some(report) = &report {
            let jumps = report.clock.as_ref().map_or(0, |clock| clock.jump_count);
            let [restarts_reported, jumps_reported] = self.seen;
            let restarts = report.counters.init_id_changes;
            if restarts > restarts_reported {
                self.journal.tell_of(&self.name, "sensor_restarted", "the sensor was initialised again");
            }
            if jumps > jumps_reported && restarts == restarts_reported {
                let by_s = report
                    .clock
                    .as_ref()
                    .and_then(|clock| clock.jumps.last())
                    .map_or(0.0, |jump| jump.change_s);
                let words = format!("its clock and this host's moved apart by {by_s:.3} s at once");
                self.journal.tell_of(&self.name, "clock_jump", words);
            }
            self.seen = [restarts, jumps];
            let later = sensor.iter().flat_map(|sensor| {
                let corrections = sensor.corrections().iter().filter(|found| found.since_ns.is_some());
                corrections.map(|found| correction_words(sensor, found))
            });
            for words in later.skip(self.changes_reported) {
                self.changes_reported += 1;
                self.journal.tell_of(&self.name, "sensor_settings", words);
            }
        }
        let numbers = Numbers {
            report,
            points: self.points,
            unclaimed,
            not_its_own: self.not_its_own,
            first_damage: sensor.and_then(Sensor::first_damage).map(str::to_owned),
            frames_not_drawn: self.frames_not_drawn,
            is_other_model: sensor.is_some_and(|sensor| {
                let found = sensor.model();
                found.is_some_and(|found| !is_model(&self.model, &sensor.product(), &found.name))
            }),
            as_of: Some(Instant::now()),
        };
        *self.shared.numbers.lock().unwrap_or_else(PoisonError::into_inner) = numbers;
    }
}
