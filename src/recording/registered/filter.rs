//! Which points of a registered cloud are written.

use std::str::FromStr;

use glam::DVec3;

use super::{ClipBox, VoxelThinning};
use crate::recording::export::Point;
use crate::recording::moment::Moment;
use crate::simulate::occluder::Occluder;

/// The operator of a backpack: all within 0.45 m of the vertical through the rig's origin, from 1.7 m below it to the origin.
const OPERATOR: Occluder =
    Occluder::Capsule { from_m: DVec3::new(0.0, 0.0, -1.7), to_m: DVec3::ZERO, radius_m: 0.45 };

/// Ranges that are wanted, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RangeLimits {
    min_m: f64,
    max_m: f64,
}

impl RangeLimits {
    fn contains(self, range_mm: u32) -> bool {
        (self.min_m..=self.max_m).contains(&(f64::from(range_mm) * 1e-3))
    }
}

impl FromStr for RangeLimits {
    type Err = String;

    /// `A..B`, `A..` or `..B`.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?}: expected metres, like 0.5..30, 0.5.. or ..30");
        let number = |text: &str, open: f64| match text.trim() {
            "" => Some(open),
            text => text.parse().ok().filter(|value: &f64| value.is_finite() && *value >= 0.0),
        };
        let (min, max) = text.split_once("..").ok_or_else(wrong)?;
        let limits = number(min, 0.0).zip(number(max, f64::INFINITY));
        let (min_m, max_m) = limits.filter(|(min_m, max_m)| min_m < max_m).ok_or_else(wrong)?;
        Ok(Self { min_m, max_m })
    }
}

/// Which of a firing's returns are wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Returns {
    #[default]
    Both,
    First,
    Second,
}

/// What travels with the rig and is left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mask(Occluder);

impl FromStr for Mask {
    type Err = String;

    /// `operator`, or a capsule `x,y,z,x,y,z,radius`.
    fn from_str(text: &str) -> Result<Self, String> {
        if text == "operator" {
            return Ok(Self(OPERATOR));
        }
        let number = |text: &str| text.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let numbers: Option<Vec<f64>> = text.split(',').map(number).collect();
        match numbers.as_deref() {
            Some(&[x0, y0, z0, x1, y1, z1, radius_m]) if radius_m > 0.0 => Ok(Self(Occluder::Capsule {
                from_m: DVec3::new(x0, y0, z0),
                to_m: DVec3::new(x1, y1, z1),
                radius_m,
            })),
            _ => Err(format!(
                "{text:?}: expected operator, or x,y,z,x,y,z,radius: both ends of a capsule's axis in the rig's frame, m"
            )),
        }
    }
}

/// Times that are wanted, on the host's clock.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TimeWindow {
    pub from: Option<Moment>,
    pub to: Option<Moment>,
    /// Arrival of the first packet, ns.
    start_ns: Option<u64>,
}

impl TimeWindow {
    pub(crate) fn new(from: Option<Moment>, to: Option<Moment>) -> Self {
        Self { from, to, start_ns: None }
    }

    pub(super) fn begin(&mut self, host_time_ns: u64) {
        self.start_ns.get_or_insert(host_time_ns);
    }

    fn is_open(&self) -> bool {
        self.from.is_none() && self.to.is_none()
    }

    /// The ends, ns.
    fn limits_ns(&self) -> [i128; 2] {
        let start_ns = self.start_ns.unwrap_or(0);
        let at = |moment: Option<Moment>, open: i128| {
            moment.and_then(|moment| moment.time_ns(start_ns)).map_or(open, i128::from)
        };
        [at(self.from, i128::MIN), at(self.to, i128::MAX)]
    }

    pub(super) fn overlaps(&self, [first_ns, last_ns]: [u64; 2]) -> bool {
        let [from_ns, to_ns] = self.limits_ns();
        i128::from(last_ns) >= from_ns && i128::from(first_ns) < to_ns
    }
}

/// All of it.
#[derive(Clone, Debug, Default)]
pub(crate) struct PointFilter {
    pub range: Option<RangeLimits>,
    pub returns: Returns,
    pub window: TimeWindow,
    pub mask: Option<Mask>,
    pub clip: Option<ClipBox>,
    pub voxels: Option<VoxelThinning>,
}

impl PointFilter {
    /// By what a return is: its range, its number and its time, which is so far behind the host's, ns.
    pub(super) fn select_returns(&self, points: &mut Vec<Point>, host_from_device_ns: i128) {
        if self.range.is_none() && self.returns == Returns::Both && self.window.is_open() {
            return;
        }
        let [from_ns, to_ns] = self.window.limits_ns();
        points.retain(|point| {
            let host_ns = i128::from(point.time_ns) + host_from_device_ns;
            let is_of_return = match self.returns {
                Returns::Both => true,
                Returns::First => point.return_number == 1,
                Returns::Second => point.return_number == 2,
            };
            is_of_return
                && self.range.is_none_or(|range| range.contains(point.range_mm))
                && (from_ns..to_ns).contains(&host_ns)
        });
    }

    pub(super) fn masks(&self) -> bool {
        self.mask.is_some()
    }

    /// By where a point lies on the rig.
    pub(super) fn mask(&self, points: &mut Vec<Point>) {
        let Some(Mask(solid)) = &self.mask else { return };
        // a ray that begins inside enters at once
        points.retain(|point| solid.distance_m(point.position_m, DVec3::X) != Some(0.0));
    }

    /// By where a point lies in the end.
    pub(super) fn select_places(&mut self, points: &mut Vec<Point>) {
        if let Some(clip) = &self.clip {
            points.retain(|point| clip.contains(point.position_m));
        }
        if let Some(voxels) = &mut self.voxels {
            points.retain(|point| voxels.is_first(point.position_m));
        }
    }

    pub(super) fn notice(&self) -> Option<String> {
        self.voxels.as_ref().and_then(VoxelThinning::notice)
    }
}
