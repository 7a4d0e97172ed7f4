//! Writing a session.

use std::fs::{self, File};
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use sensors::Packet;
use sensors::capture::PcapngWriter;

use super::clock::{ClockSource, SessionClock};
use super::disk::LowDisk;
use super::manifest::{Manifest, SensorEntry};
use super::open::{Open, no_space, put, write_line};
use super::shared::Shared;
use super::ticker::Ticker;
use super::whereabouts::{Displaced, OPEN_FILES, Whereabouts};
use super::whole_file::WholeFile;
use super::{SessionError, check_name, disk, file};
use crate::live::receive::{Datagram, Listen, Tally};
use crate::rig::{CalibrationFile, MountFile};
use crate::world::trajectory::Trajectory;

/// Reserved on the disk for closing the session: statistics, manifest and some lines need far less.
const RESERVE_BYTES: usize = 256 << 10;

/// What a session records about a sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SensorInfo {
    /// Name: letters, digits, `.`, `_`, `-`; unique.
    pub name: String,
    /// Where it is received.
    pub address: Option<SocketAddr>,
    /// The only sender accepted.
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

impl SessionWriter {
    /// Begins a session in an empty or absent folder. The manifest is there at once, with `complete: false`. Where that
    /// fails nothing is left of it.
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
        let was_there = dir.exists();
        fs::create_dir_all(dir).map_err(|error| SessionError::io(dir, "cannot be made", error))?;
        match fs::read_dir(dir).map(|mut entries| entries.next().is_none()) {
            Ok(true) => Self::begin(dir, sensors, clock).inspect_err(|_| clear(dir, was_there)),
            Ok(false) => Err(SessionError::NotEmpty { dir: dir.to_owned() }),
            Err(error) => {
                if !was_there {
                    let _ = fs::remove_dir(dir); // only an empty one
                }
                Err(SessionError::io(dir, "cannot be read", error))
            }
        }
    }

    fn begin(dir: &Path, sensors: &[SensorInfo], clock: ClockSource) -> Result<Self, SessionError> {
        let full = |error| no_space(dir, 0, 0, error);
        match disk::write_whole(&dir.join(file::RESERVE), &vec![0xff; RESERVE_BYTES]) {
            // a limit on the size of each file, not on the space: nothing has to be reserved
            Err(SessionError::Io { source, .. }) if source.kind() == io::ErrorKind::FileTooLarge => {}
            outcome => outcome.map_err(full)?,
        }
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
            // appending: a file that someone cuts stays shorter than what was written, which is seen
            let made = File::options().append(true).create_new(true).open(&path);
            made.map_err(|error| SessionError::io(&path, "cannot be made", error))
        };
        let [packets, servo, events] = OPEN_FILES.map(make);
        let files = [packets?, servo?, events?];
        let too_many = |error| SessionError::io(dir, "its files cannot be opened once more", error);
        let [packets, servo, events] = files.each_ref().map(File::try_clone);
        let clones = [packets.map_err(too_many)?, servo.map_err(too_many)?, events.map_err(too_many)?];
        let [packets, servo, events] = files.map(WholeFile::new);
        let start = || -> io::Result<_> {
            let mut writer = PcapngWriter::new(packets)?;
            for sensor in sensors {
                writer.add_interface(&sensor.name)?;
            }
            writer.flush()?;
            Ok(writer)
        };
        let packets = start()
            .map_err(|error| full(SessionError::io(&dir.join(file::PACKETS), "cannot be written", error)))?;
        manifest.write(dir)?;
        let files = Whereabouts::new(dir, clones)
            .map_err(|error| SessionError::io(dir, "cannot be opened", error))?;
        let mut open = Open::new(manifest, clock, packets, [servo, events]);
        open.watch_space(dir);
        let shared = Arc::new(Shared { files, displaced: OnceLock::new(), open: Mutex::new(Some(open)) });
        let ticker = Ticker::start(Arc::clone(&shared))
            .map_err(|error| SessionError::io(dir, "cannot start the flushing thread", error))?;
        Ok(Self { shared, ticker: Mutex::new(Some(ticker)) })
    }

    /// The session's folder.
    pub(crate) fn dir(&self) -> &Path {
        self.shared.files.dir()
    }

    /// Writes a packet of a sensor, given by its place in the list the session was created with.
    pub fn write_packet(&self, sensor: usize, packet: &Packet<'_>) -> Result<(), SessionError> {
        self.with(|open, dir| {
            open.look_at_clock(dir);
            open.write_packet(dir, sensor, packet)
        })
    }

    /// Writes received datagrams. After an error the remaining ones are counted as not written.
    pub(crate) fn write_datagrams(&self, datagrams: &[Datagram]) -> Result<(), SessionError> {
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
    pub(crate) fn clock_steps(&self) -> Vec<String> {
        let words = |open: &Open| {
            let begin_ns = open.clock.begin().unix_ns;
            open.clock.steps().iter().map(|step| step.words(begin_ns)).collect()
        };
        self.shared.lock().as_ref().map_or_else(Vec::new, words)
    }

    /// Keeps a copy of the mounts, and one of each calibration that they name: a session can be read anywhere.
    pub fn put_mount(&self, mount: &MountFile, calibrations: &[CalibrationFile]) -> Result<(), SessionError> {
        let mut mount = mount.clone();
        mount.calibrations = None;
        for CalibrationFile { sensor, ending, content } in calibrations {
            check_name(sensor)?;
            let inside = format!("{}/{sensor}.{ending}", file::CALIBRATIONS);
            self.put(&inside, content)?;
            mount.calibrations.get_or_insert_default().insert(sensor.clone(), inside.into());
        }
        let path = self.dir().join(file::MOUNT);
        let text = serde_json::to_string_pretty(&mount)
            .map_err(|error| SessionError::Content { path, reason: error.to_string() })?;
        self.put(file::MOUNT, format!("{text}\n").as_bytes())
    }

    /// Keeps a copy of the trajectory.
    pub fn put_trajectory(&self, trajectory: &Trajectory) -> Result<(), SessionError> {
        self.put(file::TRAJECTORY, trajectory.to_tum().as_bytes())
    }

    /// Keeps a copy of the configuration, a `rig.toml`.
    pub(crate) fn put_config(&self, text: &str) -> Result<(), SessionError> {
        self.put(file::CONFIG, text.as_bytes())
    }

    /// The files removed from the session, once any were: go on in another one.
    pub fn displaced(&self) -> Option<&Displaced> {
        self.shared.displaced.get()
    }

    /// Closes another session in the place of which this one goes on; how that was closed. Where files were removed
    /// from it, the manifest here says so, and holds what was lost unless a manifest there does.
    pub fn succeed(&self, before: &Self, received: Option<&Tally>) -> Result<Manifest, SessionError> {
        let closed = before.close(received);
        let Some(displaced) = before.displaced() else { return closed };
        self.with(|open, dir| {
            open.manifest.follows = Some(displaced.words.clone());
            if let Err(SessionError::Displaced { manifest, is_retained: false, .. }) = &closed {
                for (carried, sensor) in open.carried.iter_mut().zip(&manifest.sensors) {
                    carried.add(&sensor.losses);
                }
            }
            open.manifest.write(dir)
        })?;
        closed
    }

    /// Whether space runs out.
    pub(crate) fn low_disk(&self) -> Option<LowDisk> {
        self.shared.lock().as_ref().and_then(|open| open.low_disk)
    }

    /// Bytes of packets in the file, gathered ones not counted.
    pub(crate) fn packet_bytes(&self) -> u64 {
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
        drop(ticker); // waits for a running flush
        let Shared { files, displaced, .. } = &*self.shared;
        let dir = files.dir();
        let open = self.shared.lock().take().ok_or_else(|| SessionError::Closed { dir: dir.to_owned() })?;
        let (closed, found) = open.close(files, received);
        if let Some(found) = found {
            displaced.get_or_init(|| found);
        }
        closed
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
        let dir = self.shared.files.dir();
        match self.shared.lock().as_mut() {
            Some(open) => work(open, dir),
            None => Err(SessionError::Closed { dir: dir.to_owned() }),
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

/// Removes what a session that could not be begun left in its folder, and the folder where that was made for it.
fn clear(dir: &Path, was_there: bool) {
    for name in OPEN_FILES.into_iter().chain([file::RESERVE, file::MANIFEST]) {
        let _ = fs::remove_file(dir.join(name)); // it may not have come so far
    }
    let _ = fs::remove_dir_all(dir.join(file::METADATA));
    if !was_there {
        let _ = fs::remove_dir(dir); // only an empty one
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
