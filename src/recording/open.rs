//! What a session that is being written holds under its lock, and how it is closed.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::Path;
use std::time::Instant;

use sensors::Packet;
use sensors::capture::{CaptureReader, PcapngWriter};

use super::clock::SessionClock;
use super::disk::{LOW_DISK_BYTES, LOW_DISK_SECONDS, LowDisk};
use super::manifest::{Losses, Manifest};
use super::whereabouts::{Displaced, Expected, OPEN_FILES, PacketsLeft, Whereabouts};
use super::whole_file::WholeFile;
use super::{FileEntry, SessionError, disk, file};
use crate::live::receive::{Tally, now_ns};

pub(super) struct Open {
    pub manifest: Manifest,
    pub clock: SessionClock,
    pub packets: PcapngWriter<WholeFile<File>>,
    pub servo: WholeFile<File>,
    pub events: WholeFile<File>,
    pub low_disk: Option<LowDisk>,
    /// What each sensor lost with the session before.
    pub carried: Vec<Losses>,
    /// The first file that could not be written, and why.
    failure: Option<(&'static str, io::Error)>,
    /// When the rate was last computed, and the bytes there were then.
    rate: Option<(Instant, u64)>,
}

impl std::fmt::Debug for Open {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Open").field("manifest", &self.manifest).finish_non_exhaustive()
    }
}

impl Open {
    pub(crate) fn new(
        manifest: Manifest,
        clock: SessionClock,
        packets: PcapngWriter<WholeFile<File>>,
        lines: [WholeFile<File>; 2],
    ) -> Self {
        let [servo, events] = lines;
        let carried = vec![Losses::default(); manifest.sensors.len()];
        Self { manifest, clock, packets, servo, events, low_disk: None, carried, failure: None, rate: None }
    }

    pub(crate) fn look_at_clock(&mut self, dir: &Path) {
        if let Some(step) = self.clock.look() {
            // a failure shows in the next flush
            let _ = write_line(&mut self.events, &dir.join(file::EVENTS), &step);
        }
    }

    pub(crate) fn write_event(
        &mut self,
        dir: &Path,
        event: &impl serde::Serialize,
    ) -> Result<(), SessionError> {
        let path = dir.join(file::EVENTS);
        match self.clock.event(event) {
            Some(restamped) => write_line(&mut self.events, &path, &restamped),
            None => write_line(&mut self.events, &path, event),
        }
    }

    pub(crate) fn write_packet(
        &mut self,
        dir: &Path,
        sensor: usize,
        packet: &Packet<'_>,
    ) -> Result<(), SessionError> {
        let Some(entry) = self.manifest.sensors.get(sensor) else {
            let reason = format!("sensor {sensor} of a session with {} sensors", self.manifest.sensors.len());
            return Err(SessionError::Content { path: dir.join(file::PACKETS), reason });
        };
        let outcome = match &self.failure {
            Some((_, failure)) => Err(failure.kind().into()),
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
                self.failed(file::PACKETS, error);
                self.check(dir)
            }
        }
    }

    pub(crate) fn flush(&mut self) {
        let outcomes = [self.packets.flush(), self.servo.flush(), self.events.flush()];
        for (name, outcome) in OPEN_FILES.into_iter().zip(outcomes) {
            if let Err(error) = outcome {
                self.failed(name, error);
            }
        }
    }

    /// Keeps the first failure and counts what was gathered and is lost with it.
    pub(crate) fn failed(&mut self, name: &'static str, error: io::Error) {
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
        self.failure.get_or_insert((name, error));
    }

    fn not_written(&self) -> u64 {
        self.manifest.sensors.iter().map(|sensor| sensor.losses.not_written).sum()
    }

    pub(crate) fn check(&self, dir: &Path) -> Result<(), SessionError> {
        let Some((name, failure)) = &self.failure else { return Ok(()) };
        let error = SessionError::io(&dir.join(name), "cannot be written", io::Error::from(failure.kind()));
        Err(no_space(dir, self.packets.get_ref().bytes(), self.not_written(), error))
    }

    pub(crate) fn watch_space(&mut self, dir: &Path) {
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

    /// What should lie in the folder.
    pub(super) fn expected(&self) -> Expected {
        let bytes = [self.packets.get_ref(), &self.servo, &self.events].map(WholeFile::bytes);
        let closed = self.manifest.files.iter().map(|entry| entry.path.clone());
        Expected { bytes, closed: closed.chain([file::MANIFEST.to_owned()]).collect() }
    }

    /// Closes the session where it lies now, and reports a folder that was moved.
    pub(super) fn close(
        mut self,
        files: &Whereabouts,
        received: Option<&Tally>,
    ) -> (Result<Manifest, SessionError>, Option<Displaced>) {
        self.flush();
        let displaced = files.check(&self.expected());
        (self.close_at(files.dir(), displaced.as_ref(), received), displaced)
    }

    fn close_at(
        mut self,
        dir: &Path,
        displaced: Option<&Displaced>,
        received: Option<&Tally>,
    ) -> Result<Manifest, SessionError> {
        let is_missing = displaced.is_some_and(|displaced| displaced.packets != PacketsLeft::WholeSession);
        let words = displaced.map(|displaced| displaced.words.clone()).unwrap_or_default();
        if let Some(displaced) = displaced {
            self.count_deleted(displaced);
        }
        self.count_losses(received);
        let Some(home) = displaced.map_or(Some(dir), |displaced| displaced.home.as_deref()) else {
            let manifest = Box::new(self.manifest);
            return Err(SessionError::Displaced { words, manifest, is_retained: false });
        };
        let reserve = home.join(file::RESERVE);
        match fs::remove_file(&reserve) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(SessionError::io(&reserve, "cannot be removed", error));
            }
            _ => {} // the last lines and the manifest have the space now
        }
        if self.failure.is_none() && !is_missing {
            let drops: Vec<u64> = self.manifest.sensors.iter().map(|sensor| sensor.losses.total()).collect();
            if let Err(error) = self.packets.write_statistics(&drops) {
                self.failed(file::PACKETS, error);
            }
        }
        // a file that failed ends with its last whole packet; the manifest has the counts
        let failure = self.check(home).err();
        let ended = displaced.map(|_| ("displaced", words.clone()));
        let ended = ended.or_else(|| failure.as_ref().map(|error| ("failed", error.to_string())));
        if let Some((event, words)) = ended {
            let event = serde_json::json!({"time_ns": now_ns(), "event": event, "words": words});
            self.events.retry();
            let written = self.write_event(home, &event);
            let _ = written.is_ok() && self.events.flush().is_ok(); // the manifest has it, too
        }
        let Self { mut manifest, packets, servo, events, .. } = self;
        for (relative, whole) in OPEN_FILES.into_iter().zip([packets.into_sink(), servo, events]) {
            let path = home.join(relative);
            whole.file().sync_all().map_err(|error| SessionError::io(&path, "cannot be synced", error))?;
            if is_missing {
                manifest.files.extend(disk::entry_of(home, relative).ok());
            } else {
                let (bytes, sha256) = (whole.bytes(), whole.sha256());
                manifest.files.push(FileEntry { path: relative.into(), bytes, sha256 });
            }
        }
        // its files are closed: there is a descriptor for the manifest, also where there was none left
        manifest.complete = failure.is_none() && !is_missing;
        manifest.failure =
            if is_missing { Some(words.clone()) } else { failure.as_ref().map(ToString::to_string) };
        manifest.write(home)?;
        match failure {
            _ if is_missing => {
                Err(SessionError::Displaced { words, manifest: Box::new(manifest), is_retained: true })
            }
            Some(error) => Err(error),
            None => Ok(manifest),
        }
    }

    /// Packets that are in no file any more.
    fn count_deleted(&mut self, displaced: &Displaced) {
        let left: Vec<u64> = match (displaced.packets, &displaced.home) {
            (PacketsLeft::WholeSession | PacketsLeft::All, _) => return,
            (PacketsLeft::Some, Some(home)) => {
                packets_in(&home.join(file::PACKETS), self.manifest.sensors.len())
            }
            _ => Vec::new(),
        };
        for (at, sensor) in self.manifest.sensors.iter_mut().enumerate() {
            let left = left.get(at).map_or(0, |left| sensor.packets.min(*left));
            sensor.losses.deleted += sensor.packets - left;
            sensor.packets = left;
        }
    }

    fn count_losses(&mut self, received: Option<&Tally>) {
        if let Some(tally) = received {
            for (entry, lost) in self.manifest.sensors.iter_mut().zip(&tally.sensors) {
                entry.losses.queue_dropped = lost.queue_dropped;
                entry.losses.kernel_dropped = lost.kernel_dropped;
            }
            self.manifest.sockets.clone_from(&tally.sockets);
        }
        for (entry, carried) in self.manifest.sensors.iter_mut().zip(&self.carried) {
            entry.losses.add(carried);
        }
        for sensor in &self.manifest.sensors {
            self.manifest.losses.add(&sensor.losses);
        }
    }
}

/// Packets of each sensor that can be read from a file, up to its end or the first damage.
fn packets_in(path: &Path, sensors: usize) -> Vec<u64> {
    let mut found = vec![0; sensors];
    let Ok(mut reader) = CaptureReader::open(path) else { return found };
    while let Ok(Some((sensor, _))) = reader.next_from() {
        if let Some(count) = found.get_mut(sensor) {
            *count += 1;
        }
    }
    found
}

pub(super) fn write_line(
    lines: &mut WholeFile<File>,
    path: &Path,
    value: &impl serde::Serialize,
) -> Result<(), SessionError> {
    let mut line = serde_json::to_vec(value)
        .map_err(|error| SessionError::Content { path: path.to_owned(), reason: error.to_string() })?;
    line.push(b'\n');
    lines.write_all(&line).map_err(|error| SessionError::io(path, "cannot be written", error))
}

pub(super) fn put(dir: &Path, relative: &str, content: &[u8]) -> Result<FileEntry, SessionError> {
    let path = dir.join(relative);
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|error| SessionError::io(folder, "cannot be made", error))?;
    }
    disk::write_whole(&path, content)?;
    disk::entry_of(dir, relative)
}

/// Turns "no space" into the error that says what it means for the session.
pub(super) fn no_space(
    dir: &Path,
    written_bytes: u64,
    not_written: u64,
    error: SessionError,
) -> SessionError {
    match &error {
        SessionError::Io { source, .. }
            if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) =>
        {
            SessionError::DiskFull { dir: dir.to_owned(), written_bytes, not_written }
        }
        SessionError::Io { path, source, .. } if source.kind() == io::ErrorKind::FileTooLarge => {
            SessionError::FileTooLarge { path: path.clone(), written_bytes, not_written }
        }
        _ => error,
    }
}
