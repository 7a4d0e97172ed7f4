//! With what a mount was found.

/// The settings of a score: with them the same mount has the same J.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoundWith {
    /// Direction of the walk.
    pub path: Path,
    /// Edge of a voxel.
    pub voxel_m: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// Poses per metre.
    pub sub_poses: usize,
    /// Where revolutions start.
    pub phase: Phase,
    /// Price of a sensor of each preset.
    pub lambda: Vec<f64>,
    /// Weight of registration strength.
    pub registration_weight: f64,
    /// Least of that which is allowed.
    pub least_conditioning: f64,
    /// Least distance between sensor origins, m.
    pub least_distance_m: f64,
}

/// Along which axis of the mount frame the platform walks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Path {
    /// x: sideways, as the released program runs it.
    #[default]
    Lateral,
    /// y: ahead, as the text describes it.
    Forward,
}

/// Where the first azimuth of each revolution lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// At zero at every pose, as published: the pattern repeats from pose to pose.
    #[default]
    Locked,
    /// Moved on by the golden ratio of an azimuth step from pose to pose: no two poses share a pattern. Rays with a
    /// zero direction component are then not lost.
    Free,
}

/// What happens to the roll of a mount.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roll {
    /// Replaced by this angle, degrees.
    Fixed(f64),
    /// No change.
    Free,
}

impl Path {
    /// As flags and files call it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Path::Lateral => "lateral",
            Path::Forward => "forward",
        }
    }

    pub(crate) fn axis(self) -> usize {
        match self {
            Path::Lateral => 0,
            Path::Forward => 1,
        }
    }
}

impl Phase {
    /// As flags and files call it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Locked => "locked",
            Self::Free => "free",
        }
    }

    /// How far the pattern has turned at a pose, counted from 0, in steps from azimuth to azimuth; `shift` is where a free
    /// one starts.
    pub(crate) fn turn(self, pose: u64, shift: f64) -> f64 {
        /// Fractional part of the golden ratio: successive multiples fill an interval evenly (Weyl 1916).
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        match self {
            Self::Locked => 0.0,
            Self::Free => ((pose + 1) as f64 * GOLDEN + shift).fract(),
        }
    }
}
