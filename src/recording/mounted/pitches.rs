//! Angles of an axis at the times of its sensor's frames.

use sensors::Frame;

use super::tilt::{FramePitch, TiltHistory};

/// Angles of an axis at the times of its sensor's frames, their zero added: what it measured before and after counts nothing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pitches {
    pub(super) frames: u64,
    pub(super) sum_rad: f64,
    pub(super) span_rad: Option<[f64; 2]>,
    /// Arrival of the first and the last frame, ns.
    host_ns: Option<[u64; 2]>,
    pub(super) readings: usize,
    /// Frames near which nothing was read, and how far the nearest reading was from the first of them, ns.
    unknown: u64,
    nearest_ns: u64,
}

impl Pitches {
    /// Takes that of a frame.
    pub(crate) fn add(&mut self, tilt: &TiltHistory, frame: &Frame) -> Option<FramePitch> {
        let device_ns = frame.time_span_ns().unwrap_or_default();
        let Some(pitch) = tilt.pitch_over(frame.host_time_ns, device_ns) else {
            if frame.host_time_ns.iter().any(|time_ns| tilt.lacks_zero(*time_ns)) {
                return None; // reported once for the axis
            }
            if self.unknown == 0 {
                self.nearest_ns = tilt.nearest_ns(frame.host_time_ns[0]).unwrap_or(0);
            }
            self.unknown += 1;
            return None;
        };
        self.frames += 1;
        self.sum_rad += pitch.mean_rad();
        let [least_rad, max_rad] = pitch.span_rad();
        let span_rad = self.span_rad.get_or_insert([least_rad, max_rad]);
        *span_rad = [span_rad[0].min(least_rad), span_rad[1].max(max_rad)];
        let [first_ns, last_ns] = frame.host_time_ns;
        // a reading within two frames' times counts once
        let from_ns = self.host_ns.map_or(first_ns, |host_ns| host_ns[1] + 1);
        self.readings += tilt.readings_within([from_ns, last_ns]);
        let host_ns = self.host_ns.get_or_insert(frame.host_time_ns);
        *host_ns = [host_ns[0].min(first_ns), host_ns[1].max(last_ns)];
        Some(pitch)
    }

    /// Frames with an unknown angle, in words; none where all are known.
    pub(crate) fn unknown(&self, sensor: &str) -> Option<String> {
        (self.unknown > 0).then(|| {
            format!(
                "{sensor}: its axis measured nothing near {} of {} revolutions (the nearest reading is {:.1} s from the first of \
                 these): the angle of the mount file was used for them",
                self.unknown,
                self.unknown + self.frames,
                self.nearest_ns as f64 * 1e-9
            )
        })
    }
}
