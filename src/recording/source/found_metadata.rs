//! Metadata next to a capture: found by their name or by the serial number in its packets, where none were given.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use sensors::Packet;
use sensors::ouster::Metadata;
use sensors::router::Guess;

/// Ousters in the first packets of a recording.
#[derive(Default)]
pub(super) struct OustersMet {
    pub serials: Vec<u64>,
    /// Lengths of their lidar packets.
    pub lengths: Vec<usize>,
}

impl OustersMet {
    pub(super) fn add(&mut self, packet: &Packet<'_>) {
        let length = packet.payload.len();
        let is_known = self.lengths.contains(&length) && self.serials.is_empty();
        if is_known {
            return; // of LEGACY packets one is as good as another
        }
        let guess = Guess::of(packet.payload);
        if !matches!(guess, Guess::OusterLidar { .. }) {
            return;
        }
        if !self.lengths.contains(&length) {
            self.lengths.push(length);
        }
        if let Some(serial) = guess.serial().filter(|serial| !self.serials.contains(serial)) {
            self.serials.push(serial);
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.lengths.is_empty()
    }

    /// Of several files that describe one sensor the one that bears the name of the capture; none where that leaves a choice.
    pub(super) fn choose(&self, files: Vec<PathBuf>, capture: &Path) -> Vec<PathBuf> {
        let mut groups: BTreeMap<(Option<u64>, usize), Vec<PathBuf>> = BTreeMap::new();
        for file in files {
            let text = crate::base::files::read_text(&file).unwrap_or_default();
            let Ok(metadata) = Metadata::parse(&text, "") else { continue };
            let serial = metadata.serial_number().filter(|serial| self.serials.contains(serial));
            let length = if serial.is_some() { 0 } else { metadata.packet_format().packet_bytes() };
            groups.entry((serial, length)).or_default().push(file);
        }
        let stem = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name = stem(capture).unwrap_or_default();
        let chosen = groups.into_values().filter_map(|files| {
            let called = |name: String| files.iter().find(|file| stem(file).as_ref() == Some(&name)).cloned();
            let only = || if files.len() == 1 { files.first().cloned() } else { None };
            called(name.clone()).or_else(|| called(format!("{name}_0"))).or_else(only)
        });
        chosen.collect()
    }
}
