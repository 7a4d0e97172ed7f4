//! The trajectory through a scene, as typed: a file, waypoints, or a planned walk.

use crate::recording::walk_text::WalkText;
use crate::world::local_origin::LocalOrigin;
use crate::world::placement::Placement;
use crate::world::scene::Scene;
use crate::world::trajectory::Trajectory;

/// Trajectory of the body.
#[derive(clap::Args, Debug, Clone)]
pub struct TrajectoryArgs {
    /// Trajectory of the body: TUM, EuRoC or another table with named time, position and quaternion; KITTI poses with
    /// --rate; or waypoints "x,y x,y ..." that are walked 1.6 m above the floor [default: a path through all of the free floor].
    #[arg(long, value_name = "FILE", allow_hyphen_values = true)]
    trajectory: Option<WalkText>,
    /// Poses per second of a trajectory in KITTI format.
    #[arg(long, value_name = "HZ", value_parser = crate::commands::ranges::within(1e-3, 1e6))]
    rate: Option<f64>,
}

impl TrajectoryArgs {
    /// The file's name.
    pub(crate) fn name(&self) -> String {
        match &self.trajectory {
            Some(WalkText::File(path)) => path.display().to_string(),
            Some(WalkText::Waypoints(waypoints)) => format!("{} waypoints", waypoints.len()),
            None => "planned trajectory".into(),
        }
    }

    pub(crate) fn is_file(&self) -> bool {
        matches!(self.trajectory, Some(WalkText::File(_)))
    }

    /// Reads the file into the local frame of a scene, or plans a walk there; how it was made, and what is odd about it alone.
    pub(crate) fn read(
        &self,
        scene: &Scene,
        origin: LocalOrigin,
    ) -> anyhow::Result<(Trajectory, Vec<String>)> {
        let walk = WalkText::walk_through(self.trajectory.as_ref(), self.rate, scene, origin)?;
        if self.is_file() {
            return Ok((walk.trajectory, walk.doubts));
        }
        let legs = walk.corners_m.len().saturating_sub(1);
        let length_m = walk.trajectory.length_m();
        let mut notes =
            vec![format!("{}: {legs} legs, {length_m:.1} m; --trajectory gives another", self.name())];
        notes.extend(walk.doubts);
        Ok((walk.trajectory, notes))
    }

    /// Where the trajectory lies in a scene; sensors are `height_m` above it.
    pub(crate) fn placement(
        &self,
        scene: &Scene,
        trajectory: &Trajectory,
        height_m: f64,
        origin: LocalOrigin,
    ) -> Placement {
        let mut placement = Placement::new(scene, trajectory, height_m, origin);
        placement.doubts.iter_mut().for_each(|doubt| *doubt = format!("{}: {doubt}", self.name()));
        placement
    }
}
