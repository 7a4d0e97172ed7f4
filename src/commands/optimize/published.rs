//! The best mount as the published program exports it.

use std::path::Path;

use anyhow::{Context as _, bail};

use super::Document;
use crate::base::files;
use crate::design::optimize::MountProblem;
use crate::rig::{
    MountFile, Optimization, PublishedExport, PublishedPose, RollRule, Symmetry, Walk, sensor_type,
};
use crate::simulate::published::{Path as Along, Roll};

/// Writes it, whole or not at all. `total_coverage` is that of the mount as searched: the released program writes there
/// what its re-score with noise sees.
pub fn write(
    path: &Path,
    problem: &MountProblem,
    file: &MountFile,
    document: &Document,
) -> anyhow::Result<()> {
    let experiment = problem.objective().simulator().experiment();
    let preset = &experiment.preset;
    let Some(sensor_type) = sensor_type(preset.model) else {
        bail!("the published export knows no sensor {}", preset.model);
    };
    let (path_axis, axis) = match experiment.path {
        Along::Lateral => ("x", 0),
        Along::Forward => ("y", 1),
    };
    let (fixed, fixed_deg) = match experiment.roll {
        Roll::Fixed(roll_deg) => (true, roll_deg),
        Roll::Free => (false, 0.0),
    };
    let pose = |pose: usize| {
        let mut position = [0.0, 0.0, preset.platform_height_m];
        position[axis] = pose as f64 / experiment.sub_poses as f64 - 0.5 * preset.path_length_m;
        PublishedPose { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], position }
    };
    let evaluation = &document.best.evaluation;
    let export = PublishedExport {
        sensor_type: sensor_type.into(),
        symmetry: Symmetry { enabled: experiment.mirror, plane: "YZ".into() },
        roll: RollRule { fixed, fixed_deg },
        backpack: Walk {
            path_axis: path_axis.into(),
            path_length: preset.path_length_m,
            path_step: 1.0 / experiment.sub_poses as f64,
            margin: preset.box_max_m[axis] - 0.5 * preset.path_length_m,
        },
        optimization: Optimization {
            total_coverage: evaluation.unique_voxels,
            lambda: problem.objective().prices()[0],
            sensors: evaluation.sensors,
            method: Some(document.method.name().into()),
        },
        mounts: file.sensors.iter().map(|sensor| sensor.mount().into()).collect(),
        trajectory_world: (0..experiment.poses()).map(pose).collect(),
    };
    files::write_json(path, &export).with_context(|| path.display().to_string())
}
