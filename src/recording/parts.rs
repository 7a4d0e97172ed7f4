//! The sessions of one recording.

use std::path::{Path, PathBuf};

use super::{LiveRecording, Losses, SensorInfo, SessionError, SessionWriter};
use crate::live::receive::now_ns;
use crate::rig::{MountSlots, Rig};

/// The sessions of a recording: one, and another for each that is moved or deleted meanwhile.
pub(crate) struct Parts {
    /// The folder that was asked for; a path that holds whatever becomes of the folder that the program runs in.
    asked: PathBuf,
    /// The folder that is written to.
    dir: PathBuf,
    infos: Vec<SensorInfo>,
    slots: Option<MountSlots>,
    /// What was lost in those that were closed, as their manifests have it.
    losses: Losses,
    /// What became of them.
    pub(crate) displaced: Vec<String>,
}

impl Parts {
    pub(crate) fn new(dir: PathBuf, infos: Vec<SensorInfo>, slots: Option<MountSlots>) -> Self {
        let asked = std::path::absolute(&dir).unwrap_or_else(|_| dir.clone());
        Self { asked, dir, infos, slots, losses: Losses::default(), displaced: Vec::new() }
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    pub(crate) fn losses(&self) -> &Losses {
        &self.losses
    }

    /// None without a mount file.
    pub(crate) fn rig(&self) -> Option<&Rig> {
        self.slots.as_ref().map(|slots| &slots.rig)
    }

    pub(crate) fn begin(&self) -> Result<SessionWriter, SessionError> {
        let session = SessionWriter::create(&self.dir, &self.infos)?;
        if let Some(MountSlots { mount, calibrations, .. }) = &self.slots {
            session.put_mount(mount, calibrations)?;
        }
        Ok(session)
    }

    /// Goes on in a new session: under the same name where that is free, as programs read that.
    pub(crate) fn go_on(&mut self, recording: &mut LiveRecording, words: &str) -> Result<(), SessionError> {
        let numbered = (2..).map(|number| {
            let mut name = self.asked.clone().into_os_string();
            name.push(format!("-{number}"));
            PathBuf::from(name)
        });
        let is_free = |path: &PathBuf| path.symlink_metadata().is_err();
        self.dir = std::iter::once(self.asked.clone()).chain(numbered).find(is_free).unwrap_or_default();
        let next = self.begin()?;
        let event = serde_json::json!({"time_ns": now_ns(), "event": "session_displaced", "words": words});
        next.write_event(&event)?;
        self.displaced.push(words.to_owned());
        match recording.go_on_in(next) {
            Ok(manifest) => self.losses.add(&manifest.losses),
            Err(SessionError::Displaced { manifest, is_retained: true, .. }) => {
                self.losses.add(&manifest.losses)
            }
            Err(SessionError::Displaced { is_retained: false, .. }) => {} // the session that goes on has them
            Err(error) => self.displaced.push(error.to_string()),
        }
        Ok(())
    }
}
