//! Opening a session, closed or not.

use std::path::{Path, PathBuf};

use sensors::Packet;
use sensors::capture::CaptureReader;

use super::manifest::Manifest;
use super::{SessionError, clock, disk, file};
use crate::base::files;
use crate::live::clocks::host::{HostStep, StepsUndone};
use crate::rig::{MountFile, MountFileError};
use crate::world::trajectory::{ReadTrajectory, Trajectory};

/// A session that was opened for reading.
#[derive(Clone, Debug)]
pub struct Session {
    dir: PathBuf,
    manifest: Manifest,
    problems: Vec<String>,
    steps_ns: Vec<i64>,
}

impl Session {
    /// Opens a session and checks every file against its checksum. What is wrong and can be lived with (a session that
    /// was not closed, a file that differs) is in [`Session::problems`].
    pub fn open(dir: &Path) -> Result<Self, SessionError> {
        Ok(Self::of(dir, Manifest::read(dir)?))
    }

    /// The same of a folder and its manifest.
    pub(crate) fn of(dir: &Path, manifest: Manifest) -> Self {
        let mut problems: Vec<String> = manifest.ended_early().into_iter().collect();
        problems.extend(manifest.uncovered());
        for expected in &manifest.files {
            match disk::entry_of(dir, &expected.path) {
                Ok(found) if found == *expected => {}
                Ok(found) if found.bytes != expected.bytes => problems.push(format!(
                    "{}: {} bytes, the manifest says {}",
                    found.path, found.bytes, expected.bytes
                )),
                Ok(_) if !expected.has_digest() => {}
                Ok(found) => problems.push(format!("{}: content differs from its checksum", found.path)),
                Err(error) => problems.push(error.to_string()),
            }
        }
        Self { dir: dir.to_owned(), manifest, problems, steps_ns: Vec::new() }
    }

    /// Whether a path is a folder with a manifest.
    pub fn is_session(path: &Path) -> bool {
        path.join(file::MANIFEST).is_file()
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// What the session says about itself.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Sensors that the mount file of the session has, but that were not recorded.
    pub(crate) fn unrecorded(&self) -> Vec<String> {
        let mount = match self.mount() {
            Ok(mount) => mount,
            Err(error) => return vec![error.to_string()],
        };
        let is_recorded = |name: &str| self.manifest.sensors.iter().any(|entry| entry.name == name);
        let mounted = mount.iter().flat_map(|mount| &mount.sensors);
        let absent = mounted.filter(|sensor| !is_recorded(&sensor.name));
        absent
            .map(|sensor| format!("{}: {} has it, and it was not recorded", sensor.name, file::MOUNT))
            .collect()
    }

    /// Everything that is not as it should be.
    pub fn problems(&self) -> &[String] {
        &self.problems
    }

    /// Path of the packets.
    pub(crate) fn packets_path(&self) -> PathBuf {
        self.dir.join(file::PACKETS)
    }

    /// The packets of all sensors, in the order in which they were received.
    pub fn packets(&self) -> Result<SessionPackets, SessionError> {
        let path = self.packets_path();
        let file = files::open_inside(&self.dir, file::PACKETS)
            .map_err(|error| SessionError::io(&path, "cannot be read", error))?;
        let reader = CaptureReader::new(file, path.display().to_string())
            .map_err(|error| SessionError::Content { path: path.clone(), reason: error.to_string() })?;
        let sensors = self.manifest.sensors.len();
        let undone = StepsUndone::new(self.steps_ns.clone());
        Ok(SessionPackets { path, sensors, found: vec![0; sensors], reader, undone })
    }

    /// Takes steps that the host's clock made, ns, out of the stamps of packets: for sessions in which they are.
    pub(crate) fn undo_clock_steps(&mut self, steps_ns: Vec<i64>) {
        self.steps_ns = steps_ns;
    }

    /// Servo reports in order. A last line that was cut is left out.
    pub fn servo<T: serde::de::DeserializeOwned>(&self) -> Result<Vec<T>, SessionError> {
        self.lines(file::SERVO)
    }

    /// Events in order. A last line that was cut is left out.
    pub fn events<T: serde::de::DeserializeOwned>(&self) -> Result<Vec<T>, SessionError> {
        self.lines(file::EVENTS)
    }

    /// Every time that the host's clock was set while it was recorded; packets, servo reports and events are on one clock all
    /// the same. None for a session from before that was so.
    pub(crate) fn clock_steps(&self) -> Result<Option<Vec<HostStep>>, SessionError> {
        if self.manifest.clock.is_none() {
            return Ok(None);
        }
        Ok(Some(clock::steps_of(&self.events()?)))
    }

    /// Where the platform was, if the session knows: one that SLAM found later may have been put there, so it is read as any
    /// trajectory file. Notes begin with the file's name.
    pub fn trajectory(&self) -> Result<Option<ReadTrajectory>, SessionError> {
        let Some(bytes) = self.bytes(file::TRAJECTORY)? else { return Ok(None) };
        let path = self.dir.join(file::TRAJECTORY);
        match Trajectory::read(&bytes, None) {
            Ok(mut read) => {
                read.notes.iter_mut().for_each(|note| *note = format!("{}: {note}", path.display()));
                Ok(Some(read))
            }
            Err(error) => Err(SessionError::Content { path, reason: error.to_string() }),
        }
    }

    /// Where the sensors sit, if the session knows.
    pub fn mount(&self) -> Result<Option<MountFile>, SessionError> {
        let path = self.dir.join(file::MOUNT);
        if path.symlink_metadata().is_err() {
            return Ok(None);
        }
        let wrong = |reason: String| SessionError::Content { path: path.clone(), reason };
        MountFile::read_inside(&self.dir, file::MOUNT).map(Some).map_err(|error| match error {
            MountFileError::Unreadable { source, .. } => SessionError::io(&path, "cannot be read", source),
            other => wrong(other.to_string()),
        })
    }

    /// Metadata of an Ouster sensor, JSON; none for a sensor without.
    pub fn metadata(&self, sensor: &str) -> Result<Option<String>, SessionError> {
        let entry = self.manifest.sensors.iter().find(|entry| entry.name == sensor);
        match entry.and_then(|entry| entry.metadata.as_deref()) {
            Some(relative) => {
                let bytes = self.bytes(relative)?;
                let unreadable = |error| SessionError::io(&self.dir.join(relative), "cannot be read", error);
                bytes.map(files::text).transpose().map_err(unreadable)
            }
            None => Ok(None),
        }
    }

    fn bytes(&self, relative: &str) -> Result<Option<Vec<u8>>, SessionError> {
        match files::read_inside(&self.dir, relative) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(SessionError::io(&self.dir.join(relative), "cannot be read", error)),
        }
    }

    fn lines<T: serde::de::DeserializeOwned>(&self, relative: &str) -> Result<Vec<T>, SessionError> {
        let Some(content) = self.bytes(relative)? else { return Ok(Vec::new()) };
        let mut values = Vec::new();
        for (index, line) in content.split_inclusive(|byte| *byte == b'\n').enumerate() {
            let Some(whole) = line.strip_suffix(b"\n") else { break };
            let value = serde_json::from_slice(whole).map_err(|error| SessionError::Content {
                path: self.dir.join(relative),
                reason: format!("line {}: {error}", index + 1),
            })?;
            values.push(value);
        }
        Ok(values)
    }
}

/// The packets of a session, read one by one.
pub struct SessionPackets {
    path: PathBuf,
    sensors: usize,
    /// Packets of each sensor so far.
    found: Vec<u64>,
    reader: CaptureReader,
    undone: StepsUndone,
}

impl SessionPackets {
    /// The next packet and the place of its sensor in the manifest. `None` at the end, also where the recording was
    /// cut off; damage in the middle is an error, and everything before it was handed out.
    #[expect(clippy::should_implement_trait, reason = "an Iterator cannot lend the reader's buffer")]
    pub fn next(&mut self) -> Result<Option<(usize, Packet<'_>)>, SessionError> {
        let wrong = |reason: String| SessionError::Content { path: self.path.clone(), reason };
        let Some((interface, packet)) = self.reader.next_from().map_err(|error| wrong(error.to_string()))?
        else {
            return Ok(None);
        };
        if interface >= self.sensors {
            return Err(wrong(format!(
                "interface {interface}, but the manifest names {} sensors",
                self.sensors
            )));
        }
        self.found[interface] += 1;
        let host_time_ns = self.undone.place(interface, packet.host_time_ns);
        Ok(Some((interface, Packet { host_time_ns, ..packet })))
    }

    /// Where the manifest contradicts the packets; at their end.
    pub(crate) fn contradictions(&self, manifest: &Manifest) -> Vec<String> {
        manifest.contradictions(&self.found, self.reader.interfaces())
    }
}
