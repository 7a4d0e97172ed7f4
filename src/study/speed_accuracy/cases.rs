//! Where models are compared, and the mounts that they score.

use crate::base::statistics::index_of_max;
use crate::rig::Path as Walk;
use crate::study::StudyError;

/// A scene, a sensor and a walk.
#[derive(Debug)]
pub(super) struct Case {
    /// Name, and what it is in words.
    pub name: &'static str,
    pub about: &'static str,
    pub place: Site,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Site {
    /// A published experiment.
    Box { preset: &'static str, walk: Walk },
    /// A mesh that is asked for, with a sensor carried through it.
    Mesh { sensor: &'static str },
}

pub(super) const CASES: &[Case] = &[
    Case {
        name: "os1-64-lateral",
        about: "OS1-64 in the published box, walking sideways as the released program does",
        place: Site::Box { preset: "paper-os1-64", walk: Walk::Lateral },
    },
    Case {
        name: "os1-64-forward",
        about: "OS1-64 in the published box, walking ahead",
        place: Site::Box { preset: "paper-os1-64", walk: Walk::Forward },
    },
    Case {
        name: "vlp-16-lateral",
        about: "VLP-16 in the published box, walking sideways as the released program does",
        place: Site::Box { preset: "paper-vlp-16", walk: Walk::Lateral },
    },
    Case {
        name: "vlp-16-forward",
        about: "VLP-16 in the published box, walking ahead",
        place: Site::Box { preset: "paper-vlp-16", walk: Walk::Forward },
    },
    Case {
        name: "scene-os1-64",
        about: "OS1-64 in the mesh, voxels of 0.2 m",
        place: Site::Mesh { sensor: "os1-64" },
    },
    Case {
        name: "scene-vlp-16",
        about: "VLP-16 in the mesh, voxels of 0.2 m",
        place: Site::Mesh { sensor: "vlp-16" },
    },
];

/// What a model says about the mounts.
pub(super) struct Scored {
    /// Of the random mounts.
    pub scores: Vec<f64>,
    /// The error that the model states for each; none where it states none.
    pub bounds: Option<Vec<f64>>,
    /// Of the line of pitches.
    pub pitch_scores: Vec<f64>,
    /// Which of each list it takes for the best.
    pub chosen: usize,
    pub chosen_pitch: usize,
    /// Pitches that the model takes for as good; none where it says nothing about that.
    pub pitches_alike: Option<Vec<usize>>,
    pub rays_per_mount: f64,
    pub wall_ms_per_mount: f64,
}

impl Scored {
    /// A model that takes the max score.
    pub(crate) fn plain(scores: Vec<f64>, pitch_scores: Vec<f64>, rays_per_mount: f64) -> Self {
        let (chosen, chosen_pitch) = (index_of_max(&scores), index_of_max(&pitch_scores));
        Self {
            scores,
            bounds: None,
            pitch_scores,
            chosen,
            chosen_pitch,
            pitches_alike: None,
            rays_per_mount,
            wall_ms_per_mount: 0.0,
        }
    }
}

impl Case {
    pub(crate) fn named(name: &str) -> Result<&'static Self, StudyError> {
        CASES
            .iter()
            .find(|case| case.name == name)
            .ok_or_else(|| StudyError(format!("the study has no case {name:?}")))
    }

    pub(crate) fn needs_scene(&self) -> bool {
        matches!(self.place, Site::Mesh { .. })
    }
}
