//! What is run: a published experiment as data, and what may be changed about it.

use crate::rig::{MountDeg, Path, Phase, Roll};

/// Presets of the types after the first.
pub type MoreTypes = [Option<&'static Preset>; 3];

/// Sensor types on one rig at most.
pub const MOST_TYPES: usize = 1 + size_of::<MoreTypes>() / size_of::<Option<&'static Preset>>();

/// A published experiment as data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// Sensor model that gives the housing.
    pub model: &'static str,
    /// Beams, evenly spaced.
    pub beams: usize,
    /// From the lowest to the highest beam, degrees.
    pub field_of_view_deg: f64,
    /// Columns per revolution.
    pub azimuths: usize,
    /// Least corner of the box, m.
    pub box_min_m: [f64; 3],
    /// Maximum corner of the box, m.
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
    pub(crate) fn names() -> String {
        PRESETS.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ")
    }

    /// Whether sensors of both can stand on one rig: all but the sensor is the same.
    fn shares_a_walk_with(&self, other: &Self) -> bool {
        let sensor_of = Self {
            name: self.name,
            model: self.model,
            beams: self.beams,
            field_of_view_deg: self.field_of_view_deg,
            ..*other
        };
        *self == sensor_of
    }
}

/// A preset with what may be changed about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// What stays; its sensor is type 0.
    pub preset: Preset,
    /// Presets of the sensor types 1, 2 ... of the same rig, in box and walk of the first.
    pub more_types: MoreTypes,
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
            more_types: MoreTypes::default(),
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

    /// The same experiment with rigs on which sensors of these presets may stand side by side: type 0 is the first's.
    ///
    /// # Errors
    /// No preset, too many, one twice, or presets that differ in more than the sensor.
    pub fn mixed(presets: &[&'static Preset]) -> Result<Self, ExperimentError> {
        let names = || presets.iter().map(|preset| preset.name).collect::<Vec<_>>().join(", ");
        let [first, more @ ..] = presets else { return Err(ExperimentError::Types { names: names() }) };
        let mut experiment = Self::published(first);
        if more.len() > experiment.more_types.len() {
            return Err(ExperimentError::Types { names: names() });
        }
        for (index, preset) in more.iter().enumerate() {
            let is_twin = presets[..=index].iter().any(|other| other.model == preset.model);
            if is_twin || !first.shares_a_walk_with(preset) {
                return Err(ExperimentError::Types { names: names() });
            }
            experiment.more_types[index] = Some(preset);
        }
        Ok(experiment)
    }

    /// The presets of the sensors that the rig may carry, by type.
    pub(crate) fn types(&self) -> impl Iterator<Item = &Preset> {
        std::iter::once(&self.preset).chain(self.more_types.iter().flatten().copied())
    }

    /// The model of each type.
    pub(crate) fn models(&self) -> Vec<&'static str> {
        self.types().map(|preset| preset.model).collect()
    }

    /// How many types.
    pub(crate) fn type_count(&self) -> usize {
        self.types().count()
    }

    /// Whether a rig may have sensors of several types.
    pub(crate) fn is_mixed(&self) -> bool {
        self.type_count() > 1
    }

    /// The preset of a mount's sensor; the first where there is no such type.
    pub(crate) fn preset_of(&self, sensor: &MountDeg) -> &Preset {
        self.types().nth(sensor.sensor_type).unwrap_or(&self.preset)
    }

    /// The sensor model of a mount; the first type's where there is no such type.
    pub fn model_of(&self, sensor: &MountDeg) -> &'static str {
        self.preset_of(sensor).model
    }

    /// Names of the presets of all types, as they are given and read: with commas between them.
    pub(crate) fn name(&self) -> String {
        self.types().map(|preset| preset.name).collect::<Vec<_>>().join(",")
    }

    /// The same experiment for sensors of one type alone.
    pub(super) fn of_type(&self, preset: &Preset) -> Self {
        Self { preset: *preset, more_types: MoreTypes::default(), ..*self }
    }

    /// Every physical sensor of these masters: roll rule applied, each master followed by its mirror image.
    pub fn sensors(&self, masters: &[MountDeg]) -> Vec<MountDeg> {
        let mut sensors = Vec::with_capacity(masters.len() * (1 + usize::from(self.mirror)));
        for master in masters {
            let roll_deg = match self.roll {
                Roll::Fixed(roll_deg) => roll_deg,
                Roll::Free => master.roll_deg,
            };
            let sensor = MountDeg { roll_deg, ..*master };
            sensors.push(sensor);
            if self.mirror {
                sensors.push(sensor.mirrored());
            }
        }
        sensors
    }

    /// The same without mirror images: sensors are listed one by one.
    pub(crate) fn without_images(&self) -> Self {
        Self { mirror: false, ..*self }
    }

    /// Whether the roll rule changes one of these masters.
    pub(crate) fn replaces_a_roll(&self, masters: &[MountDeg]) -> bool {
        match self.roll {
            Roll::Fixed(roll_deg) => masters.iter().any(|master| master.roll_deg != roll_deg),
            Roll::Free => false,
        }
    }

    /// Number of poses.
    pub(crate) fn poses(&self) -> usize {
        (self.preset.path_length_m * self.sub_poses as f64).round() as usize + 1
    }

    /// Rays of one sensor of the first type over the whole walk.
    pub fn rays_per_sensor(&self) -> u64 {
        self.rays_of(&self.preset)
    }

    /// Rays of these physical sensors over the whole walk.
    pub(crate) fn rays(&self, sensors: &[MountDeg]) -> u64 {
        sensors.iter().map(|sensor| self.rays_of(self.preset_of(sensor))).sum()
    }

    fn rays_of(&self, preset: &Preset) -> u64 {
        self.poses() as u64 * self.azimuths as u64 * preset.beams as u64
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
    /// Sensor types that cannot share a rig.
    #[error(
        "the presets {names:?} make no rig: give 1 to {MOST_TYPES} different ones that differ in nothing but the sensor"
    )]
    Types {
        /// As asked for.
        names: String,
    },
    /// A mount of a type that the experiment does not have.
    #[error("sensor {sensor} is of type {sensor_type}, counted from 0, of {types} types")]
    UnknownType {
        /// Position in the list, from 1.
        sensor: usize,
        /// As asked for.
        sensor_type: usize,
        /// That there are.
        types: usize,
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
    /// A sensor would leave the box on its path.
    #[error("sensor {sensor} does not stay inside the box along the whole walk")]
    OutsideBox {
        /// Position in the list, from 1.
        sensor: usize,
    },
    /// Nothing to look with.
    #[error("no sensors: give at least one")]
    NoSensors,
}
