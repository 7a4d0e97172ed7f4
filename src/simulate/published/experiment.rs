//! What is run: a published experiment as data, and what may be changed about it.

use super::Placement;

/// A published experiment as data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Sensor model whose housing counts.
    pub model: &'static str,
    /// Beams, evenly spaced.
    pub beams: usize,
    /// From the lowest to the highest beam, degrees.
    pub field_of_view_deg: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// Least corner of the box, m.
    pub box_min_m: [f64; 3],
    /// Greatest corner of the box, m.
    pub box_max_m: [f64; 3],
    /// Length of the walk, centred in the box, m.
    pub path_length_m: f64,
    /// Height of the platform's origin, m.
    pub platform_height_m: f64,
    /// Edge of a voxel, m.
    pub voxel_m: f64,
    /// Whether rays with a zero direction component are lost.
    pub loses_axis_parallel_rays: bool,
}

/// Ouster OS1-64 in the published experiment.
pub(super) const OS1_64: Preset = Preset {
    name: "paper-os1-64",
    model: "os1-64",
    beams: 64,
    field_of_view_deg: 42.4,
    azimuths: 180,
    box_min_m: [-25.0, -25.0, 0.0],
    box_max_m: [25.0, 25.0, 20.0],
    path_length_m: 40.0,
    platform_height_m: 1.6,
    voxel_m: 0.5,
    loses_axis_parallel_rays: true,
};

/// Velodyne VLP-16 in the published experiment.
pub(super) const VLP_16: Preset =
    Preset { name: "paper-vlp-16", model: "vlp-16", beams: 16, field_of_view_deg: 30.0, ..OS1_64 };

/// Every preset.
pub const PRESETS: &[Preset] = &[OS1_64, VLP_16];

impl Preset {
    /// By name.
    pub fn named(name: &str) -> Result<&'static Self, ExperimentError> {
        PRESETS
            .iter()
            .find(|preset| preset.name == name)
            .ok_or_else(|| ExperimentError::UnknownPreset { name: name.to_owned(), known: Self::names() })
    }

    /// Names of all presets, for messages.
    pub fn names() -> String {
        PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
    }
}

/// Along which axis of the mount frame the platform walks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Path {
    /// x: sideways, as the released program runs it.
    #[default]
    Lateral,
    /// y: ahead, as the text describes it.
    Forward,
}

impl Path {
    pub(super) fn axis(self) -> usize {
        match self {
            Path::Lateral => 0,
            Path::Forward => 1,
        }
    }
}

/// What happens to the roll of a mount.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Roll {
    /// Replaced by this angle, degrees.
    Fixed(f64),
    /// Taken as it is.
    Free,
}

/// Where the first azimuth of each revolution lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    /// At zero at every pose, as published: the pattern repeats from pose to pose.
    #[default]
    Locked,
    /// Moved on by the golden ratio of an azimuth step from pose to pose: no two poses share a pattern. Rays with a
    /// zero direction component are then not lost.
    Free,
}

impl Phase {
    /// How far the pattern has turned at a pose, counted from 0, in steps from azimuth to azimuth; `shift` is where a free
    /// one starts.
    pub fn turn(self, pose: u64, shift: f64) -> f64 {
        /// Fractional part of the golden ratio: successive multiples fill an interval evenly (Weyl 1916).
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        match self {
            Self::Locked => 0.0,
            Self::Free => ((pose + 1) as f64 * GOLDEN + shift).fract(),
        }
    }
}

/// A preset with what may be changed about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// What stays.
    pub preset: Preset,
    /// Direction of the walk.
    pub path: Path,
    /// Edge of a voxel, m: 5 m divided by a whole number.
    pub voxel_m: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// What happens to the roll of masters.
    pub roll: Roll,
    /// Whether every master gets a mirror image.
    pub mirror: bool,
    /// Poses per metre of the walk.
    pub sub_poses: usize,
    /// Where each revolution starts.
    pub phase: Phase,
    /// Where the first one starts, shares of an azimuth step; only where the phase is free.
    pub phase_shift: f64,
}

impl Experiment {
    /// The preset as published: path lateral, roll fixed at 0, mirrored, one pose per metre, phase locked.
    pub fn published(preset: &Preset) -> Self {
        Self {
            preset: *preset,
            path: Path::Lateral,
            voxel_m: preset.voxel_m,
            azimuths: preset.azimuths,
            roll: Roll::Fixed(0.0),
            mirror: true,
            sub_poses: 1,
            phase: Phase::Locked,
            phase_shift: 0.0,
        }
    }

    /// Every physical sensor of these masters: roll rule applied, each master followed by its mirror image.
    pub fn sensors(&self, masters: &[Placement]) -> Vec<Placement> {
        let mut sensors = Vec::with_capacity(masters.len() * (1 + usize::from(self.mirror)));
        for master in masters {
            let roll_deg = match self.roll {
                Roll::Fixed(roll_deg) => roll_deg,
                Roll::Free => master.roll_deg,
            };
            let sensor = Placement { roll_deg, ..*master };
            sensors.push(sensor);
            if self.mirror {
                sensors.push(sensor.mirrored());
            }
        }
        sensors
    }

    /// Whether the roll rule changes one of these masters.
    pub fn replaces_a_roll(&self, masters: &[Placement]) -> bool {
        match self.roll {
            Roll::Fixed(roll_deg) => masters.iter().any(|master| master.roll_deg != roll_deg),
            Roll::Free => false,
        }
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        (self.preset.path_length_m * self.sub_poses as f64).round() as usize + 1
    }

    /// Rays of one sensor over the whole walk.
    pub fn rays_per_sensor(&self) -> u64 {
        self.poses() as u64 * self.azimuths as u64 * self.preset.beams as u64
    }
}

/// What can be wrong with an experiment or the sensors in it.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ExperimentError {
    /// No preset of that name.
    #[error("no preset is called {name:?}; known are {known}")]
    UnknownPreset {
        /// As asked for.
        name: String,
        /// All that exist.
        known: String,
    },
    /// Walls would not lie on voxel faces.
    #[error(
        "voxels of {voxel_m} m do not fill the box: give 5 m divided by a whole number (1, 0.5, 0.25, 0.2 ...)"
    )]
    Voxel {
        /// As asked for.
        voxel_m: f64,
    },
    /// The grid would not fit in memory.
    #[error("voxels of {voxel_m} m make more than 2^30 cells: give larger voxels")]
    TooManyVoxels {
        /// As asked for.
        voxel_m: f64,
    },
    /// No or too many columns.
    #[error("{azimuths} azimuths: give 1 to 1048576")]
    Azimuths {
        /// As asked for.
        azimuths: usize,
    },
    /// No or too many poses.
    #[error("{sub_poses} poses per metre: give 1 to 1000")]
    SubPoses {
        /// As asked for.
        sub_poses: usize,
    },
    /// A number is not one.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which.
        what: String,
    },
    /// A sensor would leave the box on its way.
    #[error("sensor {sensor} does not stay inside the box along the whole walk")]
    OutsideBox {
        /// Position in the list, from 1.
        sensor: usize,
    },
    /// Nothing to look with.
    #[error("no sensors: give at least one")]
    NoSensors,
}
