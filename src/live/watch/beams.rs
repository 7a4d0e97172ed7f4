//! Beams that never return where their neighbours do: a laser that is broken, or a window that is dirty.

use sensors::{Frame, SensorModel};

/// Columns that show it: less than a revolution of any sensor's.
const ENOUGH_COLUMNS: u64 = 400;
/// Neighbours on both sides return in this part of the columns; one at the edge of a sensor's view, where there is but one
/// side, may look at the sky.
const BETWEEN: f64 = 0.2;
const AT_EDGE: f64 = 0.5;

/// Returns of each beam.
#[derive(Clone, Debug, Default)]
pub(super) struct BeamWatch {
    returns: Vec<u64>,
    columns: u64,
}

impl BeamWatch {
    pub(super) fn take(&mut self, frame: &Frame) {
        if self.returns.len() != frame.channels {
            *self = Self { returns: vec![0; frame.channels], columns: 0 };
        }
        if frame.channels == 0 {
            return;
        }
        let columns = frame.first.range_mm.chunks_exact(frame.channels).zip(&frame.column_valid);
        for (ranges_mm, _) in columns.filter(|(_, valid)| **valid) {
            self.columns += 1;
            for (returns, range_mm) in self.returns.iter_mut().zip(ranges_mm) {
                *returns += u64::from(*range_mm > 0);
            }
        }
    }

    /// Numbers, as point files have them (`ring`), of beams that never returned and should have.
    pub(super) fn silent(&self, model: &SensorModel, rings: &[u16]) -> Vec<u16> {
        let channels = self.returns.len();
        if self.columns < ENOUGH_COLUMNS || model.channels() != channels || rings.len() != channels {
            return Vec::new();
        }
        let shares: Vec<f64> =
            self.returns.iter().map(|returns| *returns as f64 / self.columns as f64).collect();
        let mut silent: Vec<u16> =
            silent_channels(model, &shares).into_iter().map(|channel| rings[channel]).collect();
        silent.sort_unstable();
        silent
    }
}

/// Channels without returns whose neighbours have some; `return_shares` by channel.
pub(crate) fn silent_channels(model: &SensorModel, return_shares: &[f64]) -> Vec<usize> {
    let channels = return_shares.len();
    let mut by_elevation: Vec<usize> = (0..channels).collect();
    by_elevation.sort_by(|a, b| model.beams()[*a].elevation_rad.total_cmp(&model.beams()[*b].elevation_rad));
    let share = |at: usize| return_shares[by_elevation[at]];
    let is_silent = |at: &usize| share(*at) == 0.0;
    let is_wrong = |at: &usize| {
        let below = (0..*at).rev().find(|at| !is_silent(at));
        let above = (*at + 1..channels).find(|at| !is_silent(at));
        match (below, above) {
            (Some(below), Some(above)) => share(below) > BETWEEN && share(above) > BETWEEN,
            // the outermost beam alone: several neighbours may look over everything
            (Some(only), None) | (None, Some(only)) => {
                [0, channels - 1].contains(at) && only.abs_diff(*at) == 1 && share(only) > AT_EDGE
            }
            (None, None) => false,
        }
    };
    (0..channels).filter(is_silent).filter(is_wrong).map(|at| by_elevation[at]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dead_laser_is_named_and_the_sky_is_not() {
        let model = sensors::catalogue::nominal("vlp-16").unwrap();
        let rings = model.rings_by_elevation();
        let silent = |dead: &[u16]| {
            let mut frame = Frame { channels: 16, column_valid: vec![true; 500], ..Frame::default() };
            let range_mm = |at: usize| if dead.contains(&rings[at % 16]) { 0 } else { 3000 };
            frame.first.range_mm = (0..500 * 16).map(range_mm).collect();
            let mut watch = BeamWatch::default();
            watch.take(&frame);
            watch.silent(&model, &rings)
        };
        assert_eq!(silent(&[]), [0_u16; 0]);
        assert_eq!(silent(&[10]), [10]);
        assert_eq!(silent(&[3, 4]), [3, 4]);
        assert_eq!(silent(&[15]), [15]);
        assert_eq!(silent(&[13, 14, 15]), [0_u16; 0], "they may look at the sky");
        assert_eq!(silent(&(0..16).collect::<Vec<_>>()), [0_u16; 0]);
    }

    #[test]
    fn channels_are_named_as_they_stand_in_the_model() {
        for name in ["vlp-16", "os1-16"] {
            let model = sensors::catalogue::nominal(name).unwrap();
            let shares: Vec<f64> = (0..16).map(|channel| f64::from(u8::from(channel != 5))).collect();
            assert_eq!(silent_channels(&model, &shares), [5], "{name}");
        }
    }
}
