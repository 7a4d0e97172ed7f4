//! Everything the daemon knows, as one document: what the page shows and programs read.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Instant;

use sensors::router::Unclaimed;
use serde::Serialize;

use super::journal::Event;
use super::latency::Percentiles;
use crate::drive::RigStatus;
use crate::live::clocks::ClockReport;
use crate::recording::Manifest;
use crate::simulate::view::MapCells;

mod ages;
mod health;

pub use health::{Component, ComponentState, LogStatus};

/// The whole state.
#[derive(Clone, Debug, Serialize)]
pub struct Status {
    /// Program and version.
    pub program: &'static str,
    /// When this was put together, UTC nanoseconds since 1970.
    pub time_ns: u64,
    /// How long ago that was, ms. Ages within count up to the moment at which this was asked for.
    pub age_ms: f64,
    /// The moment that the ages within are of.
    #[serde(skip)]
    pub as_of: Instant,
    /// Since the daemon started, s.
    pub uptime_s: f64,
    /// How far this host's clock was set in the last seconds, s.
    pub host_clock_jump_s: Option<f64>,
    /// In the order of the configuration.
    pub sensors: Vec<SensorStatus>,
    /// Of the servo rig; none where the configuration names none.
    pub rig: Option<RigState>,
    /// Of the recorder.
    pub recorder: RecorderStatus,
    /// Threads of the daemon, and how they do.
    pub components: Vec<Component>,
    /// Of the log on stderr.
    pub log: LogStatus,
    /// Where the memory is.
    pub memory: MemoryStatus,
    /// What was seen since recording began.
    pub coverage: Option<CoverageStatus>,
    /// Better pitches for the place seen so far.
    pub reconfiguration: Reconfiguration,
    /// What is wrong and what to do, worst first.
    pub problems: Vec<Problem>,
    /// The newest events, oldest first.
    pub events: Vec<Event>,
}

/// Memory of the daemon, bytes. Whatever grows with what arrives has a bound, which stands next to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MemoryStatus {
    /// Resident, by the system's own counting; none where it does not say.
    pub resident: Option<u64>,
    /// Buffers of packets: free, waiting, being written or decoded.
    pub packets: u64,
    /// Packets that wait for the recorder now.
    pub queue: u64,
    /// The most that ever waited for it.
    pub queue_most: u64,
    /// More than this never waits for it: what comes then is lost and counted.
    pub queue_limit: u64,
    /// The most that ever waited to be decoded for the picture, summed over the sensors.
    pub picture_most: u64,
    /// More than this never waits for the picture: what comes then is recorded and not shown.
    pub picture_limit: u64,
    /// Cells of the coverage.
    pub coverage: u64,
    /// The map that pitches are proposed from.
    pub map: u64,
}

/// Better pitches for the place seen so far.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Reconfiguration {
    /// A proposal is being made.
    pub thinking: bool,
    /// The newest one that waits for agreement.
    pub proposal: Option<Proposal>,
}

/// What the operator may agree to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Proposal {
    /// To be named when agreeing.
    pub id: u64,
    /// When it was made, UTC nanoseconds since 1970.
    pub time_ns: u64,
    /// Where the axes stood then, degrees.
    pub now_deg: Vec<f64>,
    /// Where they should go, degrees.
    pub pitches_deg: Vec<f64>,
    /// What the present pitches see of the map.
    pub now: MapCells,
    /// What the proposed ones see.
    pub proposed: MapCells,
    /// Whether they see enough more to be worth the move.
    pub is_better: bool,
    /// Poses of the trajectory that were looked from.
    pub poses: usize,
    /// Assumed pose of the platform: `standing` or `trajectory`.
    pub pose: &'static str,
    /// The map had no more room: it is of the first part of the recording only.
    pub map_is_full: bool,
    /// The same for people.
    pub words: String,
}

/// How a sensor does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorState {
    /// Nothing came yet.
    #[default]
    Waiting,
    /// Packets come and are decoded.
    Ok,
    /// Packets come, but none of them can be decoded.
    NotDecoded,
    /// Packets came and stopped.
    Silent,
}

/// One sensor.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SensorStatus {
    /// Name in the configuration.
    pub name: String,
    /// Model that the configuration names.
    pub model: String,
    /// Product that metadata or packets name.
    pub product: String,
    /// Serial number; empty when not known.
    pub serial: String,
    /// Firmware; empty when not known.
    pub firmware: String,
    /// Packet format.
    pub format: String,
    /// How it does.
    pub state: SensorState,
    /// Where its packets are received.
    pub address: Option<SocketAddr>,
    /// Where its IMU or position packets are received.
    #[serde(rename = "address_aside")]
    pub auxiliary_address: Option<SocketAddr>,
    /// Where its packets come from.
    pub source: Option<String>,
    /// Packets received of both streams.
    pub packets: u64,
    /// In the last second or so.
    pub packets_per_s: f64,
    /// The same, payload bytes.
    pub bytes_per_s: f64,
    /// The same, returns.
    pub points_per_s: f64,
    /// Since its last packet, s.
    pub last_packet_age_s: Option<f64>,
    /// Since its packets were last decoded and what follows was put out, ms; none before the first time.
    pub decoded_age_ms: Option<f64>,
    /// Revolutions decoded.
    pub frames: u64,
    /// Of these, whole ones.
    pub complete_frames: u64,
    /// By the sensor's clock.
    pub frame_rate_hz: Option<f64>,
    /// Inertial samples.
    pub imu_samples: u64,
    /// Position packets.
    pub position_packets: u64,
    /// What was lost, by where.
    pub losses: SensorLosses,
    /// The same in the last quarter of a minute.
    pub recent_losses: SensorLosses,
    /// Times the sensor was initialised again, and its clock jumped, in the last quarter of a minute.
    pub recent_restarts: u64,
    /// See `recent_restarts`.
    pub recent_clock_jumps: u64,
    /// Times the sensor was initialised again.
    pub restarts: u64,
    /// Packets left out of the picture so that recording keeps up; they are recorded.
    pub picture_dropped: u64,
    /// Revolutions counted and not drawn, for the same reason.
    pub frames_not_drawn: u64,
    /// Its clock against the host's.
    pub clock: Option<ClockReport>,
    /// Clock that its metadata says it uses.
    pub timestamp_mode: Option<String>,
    /// GPS sentence valid, where it passes one on.
    pub gps_valid: Option<bool>,
    /// Hours in use, where the sensor says so.
    pub hours_in_use: Option<u16>,
    /// The sensor's own warnings.
    pub warnings: Vec<String>,
    /// Packets on its port that are not its own, the commonest kinds.
    pub unclaimed: Vec<Unclaimed>,
    /// What was wrong with its first malformed packet.
    pub first_damage: Option<String>,
    /// What to do when the kernel grants less receive buffer than asked.
    pub buffer_warning: Option<String>,
    /// The packets are those of another model than configured.
    pub is_other_model: bool,
    /// There are mounts, and it has none: why.
    pub unseated: Option<String>,
}

/// What a sensor lost since the daemon started, by where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SensorLosses {
    /// The kernel's buffer was full.
    pub kernel_dropped: u64,
    /// The queue to the disk was full.
    pub queue_dropped: u64,
    /// Sent by the sensor, by its own counting, and never seen by this host.
    #[serde(rename = "on_the_way")]
    pub in_network: u64,
    /// Came too short or contradicting themselves.
    pub malformed: u64,
    /// Came with a wrong checksum.
    pub crc_errors: u64,
    /// Came after their revolution was closed.
    pub late: u64,
    /// Came twice (nothing is lost).
    pub duplicated: u64,
    /// Came after a later one (nothing is lost).
    pub reordered: u64,
    /// Came from a sender that is none of the sensors.
    pub foreign_source: u64,
    /// The first such sender.
    pub first_foreign_source: Option<SocketAddr>,
    /// Came from the right sender and are no packets of this sensor.
    pub not_its_own: u64,
}

/// The servo rig.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RigState {
    /// Where it is, as configured.
    pub port: String,
    /// Whether it answers.
    pub connected: bool,
    /// Why not.
    pub error: Option<String>,
    /// What it does for the operator now: `home`, `apply`.
    pub busy: Option<&'static str>,
    /// How the last command ended, in words.
    pub last_command: Option<String>,
    /// What the rig says.
    pub status: Option<RigStatus>,
    /// Pitches of the configured mount, degrees, by axis.
    pub mount_pitches_deg: Vec<f64>,
    /// Pitches of the mount that goes into a session, degrees, by axis: the configured ones, or those agreed to since.
    pub recorded_pitches_deg: Vec<f64>,
    /// The configured limits, degrees, by axis: within the firmware's.
    #[serde(skip)]
    pub limits_deg: Vec<[f64; 2]>,
    /// Until the daemon disarms it by itself, s.
    pub disarms_in_s: Option<f64>,
    /// Since its last positions, ms; none before the first time.
    pub age_ms: Option<f64>,
    /// The moment that the age of each axis in `status` is of.
    #[serde(skip)]
    pub axes_as_of: Vec<Instant>,
}

/// The recorder.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RecorderStatus {
    /// Whether a session is open.
    pub recording: bool,
    /// Its name.
    pub session: Option<String>,
    /// When it began, UTC nanoseconds since 1970.
    pub since_ns: Option<u64>,
    /// Number of the session within a recording that is cut into several.
    pub part: u32,
    /// Packets in it.
    pub packets: u64,
    /// Payload bytes in it.
    pub bytes: u64,
    /// In the last second or so.
    pub bytes_per_s: f64,
    /// Packets lost since it began: kernel and queue.
    pub session_lost: u64,
    /// From the kernel's stamp until the session took a packet, since recording began.
    pub latency: Percentiles,
    /// Free where sessions go.
    pub free_bytes: Option<u64>,
    /// How long that lasts at the present rate, s.
    pub seconds_left: Option<f64>,
    /// A warning is due.
    pub low_disk: bool,
    /// How long the disk has held up a write, s.
    pub stalled_s: f64,
    /// Sessions closed.
    pub sessions: u64,
    /// Packets lost in all closed sessions.
    pub lost: u64,
    /// A session could not be written to its end.
    pub failed: bool,
    /// A recording ended by itself.
    pub ended_early: bool,
    /// Since the recorder put this out, ms.
    pub age_ms: f64,
    /// When it did.
    #[serde(skip)]
    pub as_of: Option<Instant>,
    /// The session closed last.
    pub last: Option<LastSession>,
}

/// A session that was closed.
#[derive(Clone, Debug, Serialize)]
pub struct LastSession {
    /// Its name.
    pub name: String,
    /// Its folder on this host.
    #[serde(skip)]
    pub dir: PathBuf,
    /// Why it was closed: `stopped`, `rotated`, `reconfigured`, `disk_full`, `displaced`, `failed`.
    pub why: &'static str,
    /// Everything received is in it or counted.
    pub complete: bool,
    /// Packets in it.
    pub packets: u64,
    /// Payload bytes.
    pub bytes: u64,
    /// Packets lost: kernel, queue, disk.
    pub lost: u64,
    /// Why it could not be written to its end.
    pub failure: Option<String>,
}

impl LastSession {
    pub(super) fn take(&mut self, manifest: &Manifest) {
        self.complete = manifest.complete;
        self.packets = manifest.sensors.iter().map(|sensor| sensor.packets).sum();
        self.lost = manifest.losses.total();
    }
}

impl SensorLosses {
    /// What was added since.
    #[must_use]
    pub(crate) fn since(&self, before: &Self) -> Self {
        Self {
            kernel_dropped: self.kernel_dropped.saturating_sub(before.kernel_dropped),
            queue_dropped: self.queue_dropped.saturating_sub(before.queue_dropped),
            in_network: self.in_network.saturating_sub(before.in_network),
            malformed: self.malformed.saturating_sub(before.malformed),
            crc_errors: self.crc_errors.saturating_sub(before.crc_errors),
            late: self.late.saturating_sub(before.late),
            duplicated: self.duplicated.saturating_sub(before.duplicated),
            reordered: self.reordered.saturating_sub(before.reordered),
            foreign_source: self.foreign_source.saturating_sub(before.foreign_source),
            first_foreign_source: self.first_foreign_source,
            not_its_own: self.not_its_own.saturating_sub(before.not_its_own),
        }
    }
}

/// What was seen so far.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CoverageStatus {
    /// Edge of a cell, m.
    pub voxel_m: f64,
    /// Cells seen.
    pub seen: u64,
    /// Cells that the prediction promises; none without a prediction.
    pub predicted: Option<u64>,
    /// Cells seen that were predicted.
    pub seen_of_predicted: Option<u64>,
    /// Since points were last counted, s; none before the first.
    pub last_point_age_s: Option<f64>,
    /// Points outside the grid.
    pub outside: u64,
    /// Assumed pose of the platform: `standing` or `trajectory`.
    pub pose: &'static str,
    /// Points at times that the trajectory does not cover.
    pub without_pose: u64,
    /// What to know about these numbers, for people.
    pub about: String,
    /// The prediction is still being made.
    pub predicting: bool,
}

/// How bad something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Data is being lost, or cannot be trusted.
    Error,
    /// Soon, or a little.
    Warning,
}

/// Something is wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Problem {
    /// How bad.
    pub severity: Severity,
    /// For programs: `silent`, `wrong_metadata`, `disk_full`.
    pub kind: &'static str,
    /// Sensor, `rig`, `recorder`, `host`, `daemon` or `log`.
    pub about: String,
    /// What is wrong.
    pub what: String,
    /// What to do.
    pub advice: String,
}
