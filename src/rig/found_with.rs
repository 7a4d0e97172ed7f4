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
