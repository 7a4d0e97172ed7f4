//! `manifest.json`: what a session holds and what it lost.

use std::fmt::Display;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;

use sensors::capture::Interface;

use super::disk::FileEntry;
use super::{SessionError, file};
use crate::base::files;
use crate::live::clocks::host::HostTime;
use crate::live::receive::SocketReport;

/// What `format` says.
pub const FORMAT: &str = "outrigger-session/1";

/// The content of a manifest.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// Program and version that wrote it.
    pub program: String,
    /// When the session was begun, UTC nanoseconds since 1970.
    pub created_ns: u64,
    /// The same for people, RFC 3339.
    pub created: String,
    /// Both clocks of the host when it was begun. Everything in the session is on one clock: what the first of them showed then,
    /// going on steadily, whatever became of it. Absent in sessions from before that was so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<HostTime>,
    /// Whether the session was closed and everything received is in it or counted below.
    pub complete: bool,
    /// Why it ended early, where it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// Files that were removed from the session that this one continues, if any were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub follows: Option<String>,
    /// Sensors in the order of their interfaces in packets.pcapng.
    pub sensors: Vec<SensorEntry>,
    /// Sockets they were received on.
    pub sockets: Vec<SocketReport>,
    /// Files, complete only when the session is.
    #[serde(default)]
    pub files: Vec<FileEntry>,
    /// Sum of all losses.
    pub losses: Losses,
}

impl Manifest {
    /// Whether an entry is the auxiliary stream of another one.
    pub fn is_auxiliary(&self, entry: &SensorEntry) -> bool {
        crate::live::receive::is_auxiliary(
            &entry.name,
            self.sensors.iter().map(|sensor| sensor.name.as_str()),
        )
    }

    /// Why the session is not whole, where it is not.
    pub(crate) fn ended_early(&self) -> Option<String> {
        let unclosed =
            "the session was not closed: everything up to the last flush is there, losses are unknown";
        self.failure.clone().or_else(|| (!self.complete).then(|| unclosed.into()))
    }

    /// What its recorder knows to be missing, in words.
    pub(crate) fn missing(&self) -> Vec<String> {
        let lost = |entry: &SensorEntry| {
            let words = entry.losses.words();
            (!words.is_empty()).then(|| format!("{}: packets lost while recording: {words}", entry.name))
        };
        let before =
            self.follows.iter().map(|words| format!("this session goes on from another one: {words}"));
        self.ended_early().into_iter().chain(before).chain(self.sensors.iter().filter_map(lost)).collect()
    }
}

/// One sensor of a session.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SensorEntry {
    /// Name, unique in the session.
    pub name: String,
    /// Its interface in packets.pcapng.
    pub interface: u32,
    /// Where its packets were received.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<SocketAddr>,
    /// The only sender that was accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<IpAddr>,
    /// Its metadata, a path in the session.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metadata: Option<String>,
    /// Packets in packets.pcapng when the manifest was written; final once the session is closed.
    pub packets: u64,
    /// What it lost.
    pub losses: Losses,
}

/// Packets that are not in a session, by what lost them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Losses {
    /// Dropped by the kernel: its receive buffer was full. A socket shared by several sensors counts for its first.
    pub kernel_dropped: u64,
    /// Dropped because the recorder did not keep up.
    pub queue_dropped: u64,
    /// Received, but the disk did not take them.
    pub not_written: u64,
    /// Written, but their file was deleted or cut while recording.
    #[serde(default)]
    pub deleted: u64,
}

impl Losses {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.kernel_dropped + self.queue_dropped + self.not_written + self.deleted
    }

    /// Each kind that there was; empty without losses.
    fn words(&self) -> String {
        let kinds = [
            (self.kernel_dropped, "dropped by the kernel: its buffer was full"),
            (self.queue_dropped, "for which the recorder was too slow"),
            (self.not_written, "that the disk did not take"),
            (self.deleted, "in a file that was deleted or cut meanwhile"),
        ];
        let words =
            kinds.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        words.collect::<Vec<_>>().join(", ")
    }

    /// Adds those of another part.
    pub(crate) fn add(&mut self, other: &Self) {
        self.kernel_dropped += other.kernel_dropped;
        self.queue_dropped += other.queue_dropped;
        self.not_written += other.not_written;
        self.deleted += other.deleted;
    }
}

impl Manifest {
    pub(super) fn new(clock: HostTime) -> Self {
        Self {
            format: FORMAT.into(),
            program: concat!("outrigger ", env!("CARGO_PKG_VERSION")).into(),
            created_ns: clock.unix_ns,
            created: crate::base::times::rfc3339(clock.unix_ns),
            clock: Some(clock),
            complete: false,
            failure: None,
            follows: None,
            sensors: Vec::new(),
            sockets: Vec::new(),
            files: Vec::new(),
            losses: Losses::default(),
        }
    }

    /// Reads the manifest of a session.
    pub fn read(dir: &Path) -> Result<Self, SessionError> {
        let path = dir.join(file::MANIFEST);
        let text = match files::read_inside(dir, file::MANIFEST).and_then(files::text) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(SessionError::NotASession { dir: dir.to_owned() });
            }
            other => other.map_err(|error| SessionError::io(&path, "cannot be read", error))?,
        };
        let wrong = |reason| SessionError::Content { path: path.clone(), reason };
        let manifest: Self = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        if manifest.format != FORMAT {
            return Err(wrong(format!("format is {:?}, this program reads {FORMAT:?}", manifest.format)));
        }
        manifest.check().map_err(wrong)?;
        Ok(manifest)
    }

    /// Refuses names and paths that lead out of the session: whoever wrote it may be anyone.
    fn check(&self) -> Result<(), String> {
        for (at, sensor) in self.sensors.iter().enumerate() {
            let place = format!("sensors[{at}]");
            super::check_name(&sensor.name).map_err(|error| format!("{place}: {error}"))?;
            if let Some(twin) = self.sensors[..at].iter().position(|other| other.name == sensor.name) {
                return Err(format!(
                    "{place} is called {:?} like sensors[{twin}]: names must differ",
                    sensor.name
                ));
            }
            if sensor.interface as usize != at {
                return Err(format!("{place}.interface is {}, expected {at}", sensor.interface));
            }
            if let Some(path) = &sensor.metadata {
                files::ensure_inside(path.as_ref()).map_err(|error| format!("{place}.metadata: {error}"))?;
            }
        }
        for (at, entry) in self.files.iter().enumerate() {
            files::ensure_inside(entry.path.as_ref())
                .map_err(|error| format!("files[{at}].path: {error}"))?;
        }
        Ok(())
    }

    /// Where the counters are not those of the packets that were found, by interface, or contradict each other. What was
    /// found is held against them once the session is closed: before, they count nothing.
    pub fn contradictions(&self, found: &[u64], interfaces: &[Interface]) -> Vec<String> {
        let mut words = Vec::new();
        let sum = self.sensors.iter().map(|sensor| sensor.losses.total()).sum::<u64>();
        if sum != self.losses.total() {
            let total = self.losses.total();
            words.push(format!("{}: losses are {total} in all, those of its sensors {sum}", file::MANIFEST));
        }
        for (at, packets) in
            found.iter().enumerate().skip(self.sensors.len()).filter(|(_, packets)| **packets > 0)
        {
            let sensors = self.sensors.len();
            words.push(format!(
                "{}: {packets} packets of interface {at}, but {} names {sensors} sensors",
                file::PACKETS,
                file::MANIFEST
            ));
        }
        for (at, sensor) in self.sensors.iter().enumerate() {
            let (name, interface) = (&sensor.name, interfaces.get(at));
            let mut compare = |what: &str, noted: &dyn Display, found: &dyn Display| {
                words.push(format!(
                    "{name}: {} has {noted} {what}, {} {found}",
                    file::MANIFEST,
                    file::PACKETS
                ));
            };
            let packets = found.get(at).copied().unwrap_or(0);
            if (self.complete || self.failure.is_some()) && packets != sensor.packets {
                compare("packets", &sensor.packets, &packets);
            }
            if let Some(lost) =
                interface.map(|found| found.dropped).filter(|lost| *lost != sensor.losses.total())
                && self.complete
            {
                compare("packets lost", &sensor.losses.total(), &lost);
            }
            if let Some(other) =
                interface.and_then(|found| found.name.as_ref()).filter(|other| *other != name)
            {
                compare(&format!("as interface {at}"), name, other);
            }
        }
        words
    }

    /// Sensors of which nothing was recorded, though they were listened to.
    pub(crate) fn silent(&self, found: &[u64]) -> Vec<String> {
        let is_silent = |(at, entry): &(usize, &SensorEntry)| {
            entry.packets == 0
                && found.get(*at).is_none_or(|packets| *packets == 0)
                && !self.is_auxiliary(entry)
        };
        let silent = self.sensors.iter().enumerate().filter(is_silent);
        let words = silent.map(|(_, entry)| {
            let on = entry.address.map_or(String::new(), |address| format!(" on port {}", address.port()));
            format!("{}: not one packet was recorded{on}", entry.name)
        });
        words.collect()
    }

    /// Which of its files no digest covers, where the session was closed.
    pub(super) fn uncovered(&self) -> Vec<String> {
        if self.complete && !self.files.iter().any(FileEntry::has_digest) {
            return vec![format!(
                "{} has no digest: no file of the session is covered by one",
                file::MANIFEST
            )];
        }
        let lacks_packets = self.complete && !self.files.iter().any(|entry| entry.path == file::PACKETS);
        let without = self.files.iter().filter(|entry| !entry.has_digest()).map(|entry| entry.path.as_str());
        let without = without.chain(lacks_packets.then_some(file::PACKETS));
        without.map(|path| format!("{path}: {} has no digest of it", file::MANIFEST)).collect()
    }

    pub(super) fn write(&self, dir: &Path) -> Result<(), SessionError> {
        let path = dir.join(file::MANIFEST);
        let text = serde_json::to_string_pretty(self)
            .map_err(|error| SessionError::Content { path: path.clone(), reason: error.to_string() })?;
        super::disk::write_whole(&path, format!("{text}\n").as_bytes())
    }
}
