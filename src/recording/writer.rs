//! Writing a session.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use sensors::Packet;
use sensors::capture::PcapngWriter;

use super::clock::{ClockSource, SessionClock};
use super::manifest::{Manifest, SensorEntry};
use super::ticker::Ticker;
use super::whole_file::WholeFile;
use super::{FileEntry, SessionError, disk, file};
use crate::live::receive::{Datagram, Listen, Tally, now_ns};
use crate::rig::{CalibrationFile, MountFile};
use crate::world::trajectory::Trajectory;

/// Kept back on the disk for closing the session: statistics, manifest and some lines need far less.
const RESERVE_BYTES: usize = 256 << 10;
/// Free space below which a warning is due.
pub const LOW_DISK_BYTES: u64 = 512 << 20;
/// The recording time left below which a warning is due, s.
pub const LOW_DISK_SECONDS: f64 = 120.0;

/// What a session is told about a sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorInfo {
    /// Name: letters, digits, `.`, `_`, `-`; unique.
    pub name: String,
    /// Where it is received.
    pub address: Option<SocketAddr>,
    /// The only sender taken.
    pub source: Option<IpAddr>,
    /// Ouster metadata, JSON.
    pub metadata: Option<String>,
}

impl SensorInfo {
    /// What is known from listening.
    pub fn of(listen: &Listen, address: SocketAddr, metadata: Option<String>) -> Self {
        Self { name: listen.name.clone(), address: Some(address), source: listen.source, metadata }
    }
}

/// Writes a session folder. Any thread may write; every half second all that was written goes to the disk.
#[derive(Debug)]
pub struct SessionWriter {
    shared: Arc<Shared>,
    ticker: Mutex<Option<Ticker>>,
}

/// Space runs out.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LowDisk {
    /// Bytes still free.
    pub free_bytes: u64,
    /// How long they last at the present rate, s; none while nothing arrives.
    pub seconds_left: Option<f64>,
}

impl SessionWriter {
    /// Begins a session in an empty or absent folder. The manifest is there at once, with `complete: false`.
    pub fn create(dir: &Path, sensors: &[SensorInfo]) -> Result<Self, SessionError> {
        Self::create_with_clock(dir, sensors, ClockSource::default())
    }

    /// The same with the time from elsewhere.
    pub fn create_with_clock(
        dir: &Path,
        sensors: &[SensorInfo],
        clock: ClockSource,
    ) -> Result<Self, SessionError> {
        check_names(sensors)?;
        fs::create_dir_all(dir).map_err(|error| SessionError::io(dir, "cannot be made", error))?;
        let mut entries =
            fs::read_dir(dir).map_err(|error| SessionError::io(dir, "cannot be read", error))?;
        if entries.next().is_some() {
            return Err(SessionError::NotEmpty { dir: dir.to_owned() });
        }
        let full = |error| disk_full(dir, 0, 0, error);
        disk::write_whole(&dir.join(file::RESERVE), &vec![0xff; RESERVE_BYTES]).map_err(full)?;
        let clock = SessionClock::start(clock, sensors.len());
        let mut manifest = Manifest::new(clock.begin());
        for (interface, sensor) in (0..).zip(sensors) {
            let metadata =
                sensor.metadata.as_ref().map(|_| format!("{}/{}.json", file::METADATA, sensor.name));
            manifest.sensors.push(SensorEntry {
                name: sensor.name.clone(),
                interface,
                address: sensor.address,
                source: sensor.source,
                metadata: metadata.clone(),
                packets: 0,
                losses: Default::default(),
            });
            if let (Some(relative), Some(text)) = (metadata, &sensor.metadata) {
                manifest.files.push(put(dir, &relative, text.as_bytes())?);
            }
        }
        let make = |name: &str| -> Result<File, SessionError> {
            let path = dir.join(name);
            File::create_new(&path).map_err(|error| SessionError::io(&path, "cannot be made", error))
        };
        let files = [make(file::PACKETS)?, make(file::SERVO)?, make(file::EVENTS)?];
        let mut to_sync = Vec::new();
        for file in &files {
            to_sync
                .push(file.try_clone().map_err(|error| SessionError::io(dir, "no more open files", error))?);
        }
        let [packets, servo, events] = files.map(WholeFile::new);
        let begin = || -> io::Result<_> {
            let mut writer = PcapngWriter::new(packets)?;
            for sensor in sensors {
                writer.add_interface(&sensor.name)?;
            }
            writer.flush()?;
            Ok(writer)
        };
        let packets = begin()
            .map_err(|error| SessionError::io(&dir.join(file::PACKETS), "cannot be written", error))?;
        manifest.write(dir)?;
        let mut open =
            Open { manifest, clock, packets, servo, events, failure: None, low_disk: None, rate: None };
        open.watch_space(dir);
        let shared = Arc::new(Shared { dir: dir.to_owned(), open: Mutex::new(Some(open)) });
        let ticker = Ticker::start(Arc::clone(&shared), to_sync)
            .map_err(|error| SessionError::io(dir, "cannot start the flushing thread", error))?;
        Ok(Self { shared, ticker: Mutex::new(Some(ticker)) })
    }

    /// The session's folder.
    pub fn dir(&self) -> &Path {
        &self.shared.dir
    }

    /// Writes a packet of a sensor, given by its place in the list the session was created with.
    pub fn write_packet(&self, sensor: usize, packet: &Packet<'_>) -> Result<(), SessionError> {
        self.with(|open, dir| {
            open.look_at_clock(dir);
            open.write_packet(dir, sensor, packet)
        })
    }

    /// Writes received datagrams. After an error the remaining ones are counted as not written.
    pub fn write_datagrams(&self, datagrams: &[Datagram]) -> Result<(), SessionError> {
        self.with(|open, dir| {
            open.look_at_clock(dir);
            let mut outcome = Ok(());
            for datagram in datagrams {
                let written = open.write_packet(dir, datagram.sensor, &datagram.packet());
                outcome = outcome.and(written);
            }
            outcome
        })
    }

    /// Appends a servo report, one line of JSON.
    pub fn write_servo(&self, report: &impl serde::Serialize) -> Result<(), SessionError> {
        self.with(|open, dir| {
            let path = dir.join(file::SERVO);
            match open.clock.servo(report) {
                Some(restamped) => write_line(&mut open.servo, &path, &restamped),
                None => write_line(&mut open.servo, &path, report),
            }
        })
    }

    /// Appends an event, one line of JSON.
    pub fn write_event(&self, event: &impl serde::Serialize) -> Result<(), SessionError> {
        self.with(|open, dir| {
            open.look_at_clock(dir);
            open.write_event(dir, event)
        })
    }

    /// Every time that the host's clock was set meanwhile, in words.
    pub fn clock_steps(&self) -> Vec<String> {
        let words = |open: &Open| {
            let begin_ns = open.clock.begin().unix_ns;
            open.clock.steps().iter().map(|step| step.words(begin_ns)).collect()
        };
        self.shared.lock().as_ref().map_or_else(Vec::new, words)
    }

    /// Keeps a copy of the mounts, and one of each calibration that they name: a session is read wherever it is taken.
    pub fn put_mount(&self, mount: &MountFile, calibrations: &[CalibrationFile]) -> Result<(), SessionError> {
        let mut mount = mount.clone();
        mount.calibrations = None;
        for CalibrationFile { sensor, ending, content } in calibrations {
            check_name(sensor)?;
            let inside = format!("{}/{sensor}.{ending}", file::CALIBRATIONS);
            self.put(&inside, content)?;
            mount.calibrations.get_or_insert_default().insert(sensor.clone(), inside.into());
        }
        let path = self.shared.dir.join(file::MOUNT);
        let text = serde_json::to_string_pretty(&mount)
            .map_err(|error| SessionError::Content { path, reason: error.to_string() })?;
        self.put(file::MOUNT, format!("{text}\n").as_bytes())
    }

    /// Keeps a copy of the trajectory.
    pub fn put_trajectory(&self, trajectory: &Trajectory) -> Result<(), SessionError> {
        self.put(file::TRAJECTORY, trajectory.to_tum().as_bytes())
    }

    /// Keeps a copy of the configuration, a `rig.toml`.
    pub fn put_config(&self, text: &str) -> Result<(), SessionError> {
        self.put(file::CONFIG, text.as_bytes())
    }

    /// Whether space runs out.
    pub fn low_disk(&self) -> Option<LowDisk> {
        self.shared.lock().as_ref().and_then(|open| open.low_disk)
    }

    /// Bytes of packets in the file, gathered ones not counted.
    pub fn packet_bytes(&self) -> u64 {
        self.shared.lock().as_ref().map_or(0, |open| open.packets.get_ref().bytes())
    }

    /// Hands everything written so far to the system.
    pub fn flush(&self) -> Result<(), SessionError> {
        self.with(|open, dir| {
            open.flush();
            open.check(dir)
        })
    }

    /// Closes the session: drop counts, checksums and `complete: true` where nothing failed. A session that failed (a
    /// full disk) is closed as far as possible, `complete` stays false, and the failure is returned.
    pub fn close(&self, received: Option<&Tally>) -> Result<Manifest, SessionError> {
        let ticker = self.ticker.lock().unwrap_or_else(PoisonError::into_inner).take();
        drop(ticker); // waits for a flush under way
        let dir = &self.shared.dir;
        let open = self.shared.lock().take().ok_or_else(|| SessionError::Closed { dir: dir.clone() })?;
        open.close(dir, received)
    }

    fn put(&self, relative: &str, content: &[u8]) -> Result<(), SessionError> {
        self.with(|open, dir| {
            let entry = put(dir, relative, content)?;
            open.manifest.files.retain(|known| known.path != entry.path);
            open.manifest.files.push(entry);
            open.manifest.write(dir)
        })
    }

    fn with<T>(
        &self,
        work: impl FnOnce(&mut Open, &Path) -> Result<T, SessionError>,
    ) -> Result<T, SessionError> {
        let dir = &self.shared.dir;
        match self.shared.lock().as_mut() {
            Some(open) => work(open, dir),
            None => Err(SessionError::Closed { dir: dir.clone() }),
        }
    }
}

impl Drop for SessionWriter {
    /// A session that was not closed keeps all that was written and stays `complete: false`.
    fn drop(&mut self) {
        if let Some(open) = self.shared.lock().as_mut() {
            open.flush();
        }
    }
}

/// What the writer and its flushing thread share.
#[derive(Debug)]
pub(super) struct Shared {
    dir: PathBuf,
    open: Mutex<Option<Open>>,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Option<Open>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Flushes and looks at the free space. False once the session is closed.
    pub(super) fn tick(&self) -> bool {
        let mut guard = self.lock();
        let Some(open) = guard.as_mut() else { return false };
        open.look_at_clock(&self.dir);
        open.flush();
        open.watch_space(&self.dir);
        true
    }

    /// Remembers that a sync failed.
    pub(super) fn sync_failed(&self, error: io::Error) {
        if let Some(open) = self.lock().as_mut() {
            open.failure.get_or_insert(error);
        }
    }
}

struct Open {
    manifest: Manifest,
    clock: SessionClock,
    packets: PcapngWriter<WholeFile<File>>,
    servo: WholeFile<File>,
    events: WholeFile<File>,
    failure: Option<io::Error>,
    low_disk: Option<LowDisk>,
    /// When the rate was last taken, and the bytes there were then.
    rate: Option<(Instant, u64)>,
}

impl std::fmt::Debug for Open {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Open").field("manifest", &self.manifest).finish_non_exhaustive()
    }
}

impl Open {
    fn look_at_clock(&mut self, dir: &Path) {
        if let Some(step) = self.clock.look() {
            // a failure shows in the next flush
            let _ = write_line(&mut self.events, &dir.join(file::EVENTS), &step);
        }
    }

    fn write_event(&mut self, dir: &Path, event: &impl serde::Serialize) -> Result<(), SessionError> {
        let path = dir.join(file::EVENTS);
        match self.clock.event(event) {
            Some(restamped) => write_line(&mut self.events, &path, &restamped),
            None => write_line(&mut self.events, &path, event),
        }
    }

    fn write_packet(&mut self, dir: &Path, sensor: usize, packet: &Packet<'_>) -> Result<(), SessionError> {
        let Some(entry) = self.manifest.sensors.get(sensor) else {
            let reason = format!("sensor {sensor} of a session with {} sensors", self.manifest.sensors.len());
            return Err(SessionError::Content { path: dir.join(file::PACKETS), reason });
        };
        let outcome = match &self.failure {
            Some(failure) => Err(failure.kind().into()),
            None => {
                let host_time_ns = self.clock.packet_ns(sensor, packet.host_time_ns);
                self.packets.write(entry.interface, &Packet { host_time_ns, ..*packet })
            }
        };
        match outcome {
            Ok(()) => {
                self.manifest.sensors[sensor].packets += 1;
                Ok(())
            }
            Err(error) => {
                self.manifest.sensors[sensor].losses.not_written += 1;
                if error.kind() == io::ErrorKind::InvalidInput {
                    return Err(SessionError::io(
                        &dir.join(file::PACKETS),
                        "packet cannot be written",
                        error,
                    ));
                }
                self.failed(error);
                self.check(dir)
            }
        }
    }

    fn flush(&mut self) {
        let outcomes = [self.packets.flush(), self.servo.flush(), self.events.flush()];
        for error in outcomes.into_iter().filter_map(Result::err) {
            self.failed(error);
        }
    }

    /// Keeps the first failure and counts what was gathered and is lost with it.
    fn failed(&mut self, error: io::Error) {
        for head in self.packets.get_mut().take_lost() {
            // an enhanced packet block (type 6) has its interface behind type and length
            if let (Some([6, 0, 0, 0]), Some(interface)) = (head.first_chunk::<4>(), head.get(8..12)) {
                let interface = interface.iter().rev().fold(0, |value, byte| value << 8 | usize::from(*byte));
                if let Some(sensor) = self.manifest.sensors.get_mut(interface) {
                    sensor.packets -= 1;
                    sensor.losses.not_written += 1;
                }
            }
        }
        self.failure.get_or_insert(error);
    }

    fn not_written(&self) -> u64 {
        self.manifest.sensors.iter().map(|sensor| sensor.losses.not_written).sum()
    }

    fn check(&self, dir: &Path) -> Result<(), SessionError> {
        let Some(failure) = &self.failure else { return Ok(()) };
        let error = io::Error::from(failure.kind());
        let error = SessionError::io(&dir.join(file::PACKETS), "cannot be written", error);
        Err(disk_full(dir, self.packets.get_ref().bytes(), self.not_written(), error))
    }

    fn watch_space(&mut self, dir: &Path) {
        let written = self.packets.get_ref().bytes();
        let last = self.rate.map(|(since, before)| (since.elapsed().as_secs_f64(), before));
        if last.is_some_and(|(seconds, _)| seconds < 1.0) {
            return;
        }
        self.rate = Some((Instant::now(), written));
        // a file system that does not say how much is free gets no warning, and still the error when it is full
        let Ok(free_bytes) = disk::free_bytes(dir) else { return };
        let bytes_per_second = last.map_or(0.0, |(seconds, before)| (written - before) as f64 / seconds);
        let seconds_left = (bytes_per_second > 0.0).then(|| free_bytes as f64 / bytes_per_second);
        let low = free_bytes < LOW_DISK_BYTES || seconds_left.is_some_and(|left| left < LOW_DISK_SECONDS);
        let now = low.then_some(LowDisk { free_bytes, seconds_left });
        if let (Some(state), None) = (now, self.low_disk) {
            let event = serde_json::json!({
                "time_ns": now_ns(), "event": "low_disk", "free_bytes": free_bytes, "seconds_left": state.seconds_left
            });
            let _ = self.write_event(dir, &event); // a failure shows in the next flush
        }
        self.low_disk = now;
    }

    fn close(mut self, dir: &Path, received: Option<&Tally>) -> Result<Manifest, SessionError> {
        self.flush();
        let reserve = dir.join(file::RESERVE);
        fs::remove_file(&reserve).map_err(|error| SessionError::io(&reserve, "cannot be removed", error))?;
        let trouble = self.check(dir).err();
        for line_file in [&mut self.servo, &mut self.events] {
            line_file.retry();
        }
        if let Some(tally) = received {
            for (entry, lost) in self.manifest.sensors.iter_mut().zip(&tally.sensors) {
                entry.losses.queue_dropped = lost.queue_dropped;
                entry.losses.kernel_dropped = lost.kernel_dropped;
            }
            self.manifest.sockets.clone_from(&tally.sockets);
        }
        for sensor in &mut self.manifest.sensors {
            self.manifest.losses.add(&sensor.losses);
        }
        let drops: Vec<u64> = self.manifest.sensors.iter().map(|sensor| sensor.losses.total()).collect();
        let path = dir.join(file::PACKETS);
        let packets = if trouble.is_none() {
            self.packets.close(&drops).map_err(|error| SessionError::io(&path, "cannot be closed", error))?
        } else {
            // the file ends with its last whole packet; the manifest has the counts
            std::mem::replace(self.packets.get_mut(), WholeFile::new(open_again(&path)?))
        };
        for (relative, whole) in
            [(file::PACKETS, &packets), (file::SERVO, &self.servo), (file::EVENTS, &self.events)]
        {
            let entry = FileEntry { path: relative.into(), bytes: whole.bytes(), sha256: whole.sha256() };
            self.manifest.files.push(entry);
            open_again(&dir.join(relative))?
                .sync_all()
                .map_err(|error| SessionError::io(&dir.join(relative), "cannot be synced", error))?;
        }
        self.manifest.complete = trouble.is_none();
        self.manifest.failure = trouble.as_ref().map(ToString::to_string);
        self.manifest.write(dir)?;
        match trouble {
            Some(error) => Err(error),
            None => Ok(self.manifest),
        }
    }
}

fn open_again(path: &Path) -> Result<File, SessionError> {
    File::options().append(true).open(path).map_err(|error| SessionError::io(path, "cannot be opened", error))
}

fn write_line(
    lines: &mut WholeFile<File>,
    path: &Path,
    value: &impl serde::Serialize,
) -> Result<(), SessionError> {
    let mut line = serde_json::to_vec(value)
        .map_err(|error| SessionError::Content { path: path.to_owned(), reason: error.to_string() })?;
    line.push(b'\n');
    lines.write_all(&line).map_err(|error| SessionError::io(path, "cannot be written", error))
}

fn put(dir: &Path, relative: &str, content: &[u8]) -> Result<FileEntry, SessionError> {
    let path = dir.join(relative);
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| SessionError::io(folder, "cannot be made", error))?;
    }
    disk::write_whole(&path, content)?;
    disk::entry_of(dir, relative)
}

/// Turns "no space" into the error that says what it means for the session.
fn disk_full(dir: &Path, written_bytes: u64, not_written: u64, error: SessionError) -> SessionError {
    match &error {
        SessionError::Io { source, .. }
            if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) =>
        {
            SessionError::DiskFull { dir: dir.to_owned(), written_bytes, not_written }
        }
        _ => error,
    }
}

fn check_names(sensors: &[SensorInfo]) -> Result<(), SessionError> {
    for (index, sensor) in sensors.iter().enumerate() {
        let name = &sensor.name;
        check_name(name)?;
        if sensors[..index].iter().any(|other| other.name == *name) {
            return Err(SessionError::Name { name: name.clone(), reason: "two sensors have it" });
        }
    }
    Ok(())
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
