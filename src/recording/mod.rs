//! Anything recorded. `source::Recording` opens a capture, a bag or a session as one thing; `mounted::MountedRecording` adds where
//! its sensors sat; `decoding`, `cutting` and `inspection` go through it.
//!
//! The session folder: raw packets, servo reports, config; readable after a crash.
//!
//! ```text
//! manifest.json        format, times, sensors, files with length and SHA-256, losses; `complete` once closed
//! packets.pcapng       every datagram, one interface per sensor, drop counts at the end
//! servo.jsonl          servo reports, one JSON object a line
//! events.jsonl         what happened meanwhile, one JSON object a line
//! trajectory.tum       where the platform was
//! mount.json           where the sensors sit on it
//! rig.toml             the configuration it was recorded with
//! metadata/NAME.json   Ouster metadata of the sensor called NAME
//! calibrations/NAME.*  the file that the mount file names for that sensor
//! ```
//!
//! ```
//! use outrigger::recording::{SensorInfo, Session, SessionWriter};
//! use sensors::Packet;
//!
//! let folder = tempfile::tempdir()?;
//! let walk = folder.path().join("walk");
//! let writer = SessionWriter::create(&walk, &[SensorInfo { name: "left".into(), ..SensorInfo::default() }])?;
//! let (source, destination) = ("192.168.1.201:2368".parse()?, "192.168.1.1:2368".parse()?);
//! writer.write_packet(0, &Packet { host_time_ns: 1_700_000_000_000_000_000, source, destination, link: Default::default(), payload: b"..." })?;
//! writer.close(None)?;
//!
//! let session = Session::open(&walk)?; // every file against its checksum
//! assert!(session.problems().is_empty() && session.manifest().complete);
//! let mut packets = session.packets()?;
//! let (sensor, packet) = packets.next()?.unwrap();
//! assert_eq!((sensor, packet.payload, packet.source), (0, &b"..."[..], source));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! All times are on one clock: UTC as the host had it when the session began, going on steadily. Each step that the host's
//! clock made meanwhile is an event `host_clock_step`.
//!
//! The folder may be moved or deleted meanwhile, or a file in it: [`SessionWriter::displaced`] says so within half a second,
//! and another session goes on in its place ([`SessionWriter::succeed`]), which has what was lost in its manifest.
//!
//! Packets and lines reach their file whole: a crash, a kill or a full disk can cut off at most what was not yet
//! flushed (every half second, followed by a sync to the disk), and what was cut through is skipped when the session is opened.

pub(crate) mod assigned_file;
pub mod bags;
mod clock;
pub(crate) mod cutting;
pub(crate) mod decoding;
mod disk;
pub mod export;
mod fault;
pub(crate) mod flows;
pub(crate) mod inspection;
mod manifest;
pub(crate) mod moment;
pub(crate) mod mounted;
mod observer;
mod open;
pub(crate) mod packet_reader;
pub(crate) mod packet_writer;
pub(crate) mod part;
mod parts;
pub(crate) mod playback;
mod receiving;
pub(crate) mod registered;
pub(crate) mod scene;
pub(crate) mod sensor_ids;
mod servo_report;
mod session;
mod shared;
pub(crate) mod source;
mod ticker;
mod trajectory_file;
pub(crate) mod walk_text;
pub(crate) mod unread;
mod whereabouts;
mod whole_file;
mod writer;

pub use clock::{ClockSource, HOST_CLOCK_STEP};
pub use disk::{FileEntry, LOW_DISK_BYTES, LOW_DISK_SECONDS, free_bytes};
pub use fault::Fault;
pub use manifest::{FORMAT, Losses, Manifest, SensorEntry};
pub use mounted::{FramePitch, TiltHistory, TiltReading};
pub(crate) use observer::Observer;
pub(crate) use parts::Parts;
pub use receiving::LiveRecording;
pub use servo_report::ServoReport;
pub use session::{Session, SessionPackets};
pub(crate) use source::{Recording, RecordingError, RecordingSpec};
pub(crate) use trajectory_file::{TrajectorySource, read_trajectory};
pub use whereabouts::Displaced;
pub use writer::{SensorInfo, SessionWriter};

use std::path::{Path, PathBuf};

/// A folder name that says when: `session-2026-11-21T111500Z`.
pub(crate) fn folder_name_now() -> String {
    let time = crate::base::times::rfc3339(crate::live::receive::now_ns());
    let seconds = time.split_once('.').map_or(time.as_str(), |(seconds, _)| seconds);
    format!("session-{}Z", seconds.replace(':', ""))
}

/// Whether a name can be that of a file.
fn check_name(name: &str) -> Result<(), SessionError> {
    let allowed = |letter: char| letter.is_ascii_alphanumeric() || "._-".contains(letter);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(allowed) {
        let reason = "use letters, digits, '.', '_' and '-', not '.' first";
        return Err(SessionError::Name { name: name.to_owned(), reason });
    }
    Ok(())
}

/// Names of the files in a session.
pub mod file {
    /// What the session holds.
    pub const MANIFEST: &str = "manifest.json";
    /// Raw packets.
    pub const PACKETS: &str = "packets.pcapng";
    /// Servo reports.
    pub const SERVO: &str = "servo.jsonl";
    /// Events.
    pub const EVENTS: &str = "events.jsonl";
    /// Trajectory of the platform.
    pub const TRAJECTORY: &str = "trajectory.tum";
    /// The rig.toml it was recorded with.
    pub const CONFIG: &str = "rig.toml";
    /// Mounts of the sensors.
    pub const MOUNT: &str = "mount.json";
    /// Folder of sensor metadata.
    pub const METADATA: &str = "metadata";
    /// Folder of the calibrations that the mount file names.
    pub const CALIBRATIONS: &str = "calibrations";
    /// Space reserved for closing the session on a full disk; gone once it is closed.
    pub(super) const RESERVE: &str = ".reserve";
}

/// What can be wrong with a session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The folder holds something already.
    #[error("{dir} is not empty: a session needs a folder of its own", dir = dir.display())]
    NotEmpty {
        /// The folder.
        dir: PathBuf,
    },
    /// The folder holds no session.
    #[error("{dir} is no session: it has no manifest.json", dir = dir.display())]
    NotASession {
        /// The folder.
        dir: PathBuf,
    },
    /// A sensor's name cannot be a file name, or comes twice.
    #[error("sensor name {name:?}: {reason}")]
    Name {
        /// The name.
        name: String,
        /// Why not.
        reason: &'static str,
    },
    /// A file's content is not what it should be.
    #[error("{path}: {reason}", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected, with the line where there is one.
        reason: String,
    },
    /// No space is left.
    #[error(
        "disk full: no space is left for the session {dir}; the {written_bytes} bytes of packets written before are \
         safe in it, {not_written} packets are lost",
        dir = dir.display()
    )]
    DiskFull {
        /// The session's folder.
        dir: PathBuf,
        /// Bytes of packets.pcapng that were written.
        written_bytes: u64,
        /// Packets that were received and could not be written.
        not_written: u64,
    },
    /// A file may not become larger.
    #[error(
        "{path} is as large as a file may be here (limits: `ulimit -f`, and 4 GiB on FAT32): {written_bytes} bytes of packets \
         are safe in the session, {not_written} packets are lost; raise the limit, or let the daemon record in parts \
         (--rotate-mib)",
        path = path.display()
    )]
    FileTooLarge {
        /// The file.
        path: PathBuf,
        /// Bytes of packets.pcapng that were written.
        written_bytes: u64,
        /// Packets that were received and could not be written.
        not_written: u64,
    },
    /// Files of the session were removed while it was written.
    #[error("{words}: {deleted} packets are lost with it", deleted = manifest.losses.deleted)]
    Displaced {
        /// What happened.
        words: String,
        /// The manifest, as the session ended.
        manifest: Box<Manifest>,
        /// Whether that lies in the folder.
        is_retained: bool,
    },
    /// The session was closed before.
    #[error("the session {dir} is closed", dir = dir.display())]
    Closed {
        /// The session's folder.
        dir: PathBuf,
    },
    /// The system refused something.
    #[error("{path}: {doing}: {source}", path = path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// What was tried.
        doing: &'static str,
        /// Why not.
        source: std::io::Error,
    },
}

impl SessionError {
    fn io(path: &Path, doing: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), doing, source }
    }
}
