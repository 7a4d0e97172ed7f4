//! The best mount as files: that of this program, and the export of the published one.

use super::{Kind, MountProblem};
use crate::design::objective::Evaluation;
use crate::rig::{
    MountDeg, MountFile, Optimization, Path, PublishedExport, PublishedPose, Roll, RollRule, Symmetry, Walk,
    sensor_type,
};

impl MountProblem {
    /// The mount file of these masters.
    pub(crate) fn mount_file(&self, masters: &[MountDeg], objective: f64) -> MountFile {
        let experiment = self.objective().simulator().experiment();
        let entry = |(index, sensor): (usize, MountDeg)| {
            let name = sensor_name(index, experiment.mirror, masters.len());
            sensor.entry(name, experiment.model_of(&sensor))
        };
        let mut file =
            MountFile::new(experiment.sensors(masters).into_iter().enumerate().map(entry).collect());
        file.masters = Some(masters.iter().map(|master| (*master).into()).collect());
        if experiment.is_mixed() {
            let models = masters.iter().map(|master| experiment.model_of(master).to_owned());
            file.master_models = Some(models.collect());
        }
        file.preset = Some(experiment.name());
        file.objective = Some(objective);
        file.found_with = Some(Box::new(self.objective().settings()));
        file
    }

    /// A mount as the published program exports it; none for a sensor that it does not know. `total_coverage` is that of
    /// the mount as searched: the released program writes there what its re-score with noise sees.
    pub(crate) fn published_export(
        &self,
        file: &MountFile,
        evaluation: &Evaluation,
        method: Kind,
    ) -> Option<PublishedExport> {
        let experiment = self.objective().simulator().experiment();
        let preset = &experiment.preset;
        let sensor_type = sensor_type(preset.model)?;
        let (path_axis, axis) = match experiment.path {
            Path::Lateral => ("x", 0),
            Path::Forward => ("y", 1),
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
        Some(PublishedExport {
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
                lambda: self.objective().prices()[0],
                sensors: evaluation.sensors,
                method: Some(method.name().into()),
            },
            mounts: file.sensors.iter().map(|sensor| sensor.mount().into()).collect(),
            trajectory_world: (0..experiment.poses()).map(pose).collect(),
        })
    }
}

/// `master` and `mirrored`, numbered where there are several.
fn sensor_name(index: usize, is_mirrored: bool, masters: usize) -> String {
    let (master, side) = match is_mirrored {
        true => (index / 2, if index.is_multiple_of(2) { "master" } else { "mirrored" }),
        false => (index, "sensor"),
    };
    if masters == 1 { side.into() } else { format!("{side}-{}", master + 1) }
}
