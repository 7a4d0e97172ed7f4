//! What pages and viewers are shown of a daemon.

use std::sync::Arc;

use axum::body::Bytes;
use tokio::sync::broadcast;

use super::{Core, Daemon};
use crate::base::geometry::Pose;
use crate::daemon::hub::Hub;
use crate::live::receive::now_ns;
use crate::recording::export::foxglove::Voxels;

impl Daemon {
    /// Messages of points and cells for a page; the first are the cells as they are now.
    pub(crate) fn picture(&self) -> (Bytes, broadcast::Receiver<Bytes>) {
        let messages = self.core.pages.subscribe();
        (self.core.coverage.message(now_ns()).into(), messages)
    }

    /// Points for Foxglove clients.
    pub(in crate::daemon) fn hub(&self) -> &Arc<Hub> {
        &self.core.hub
    }

    /// Grows when the coverage changes.
    pub(in crate::daemon) fn coverage_version(&self) -> u64 {
        self.core.coverage.version()
    }

    /// The coverage as Foxglove draws it.
    pub(in crate::daemon) fn voxels(&self) -> Voxels {
        self.core.coverage.voxels()
    }

    /// Where body and sensors stand now: name of the outer frame, of the inner one, pose. Without a pose of the platform
    /// `body` has none.
    pub(in crate::daemon) fn transforms(&self) -> Vec<(&str, &str, Pose)> {
        let Core { site, motion, hub, .. } = &*self.core;
        let world_from_body = motion.world_from_body(site.trajectory.as_ref(), now_ns());
        let body = world_from_body.map(|pose| ("world", "body", pose));
        let sensors = hub.names().map(|name| {
            let mounted = site.mounted(name);
            let pose = mounted.map(|(axis, sensor)| motion.body_from_sensor(axis, &sensor.mount));
            ("body", name, pose.unwrap_or(Pose::IDENTITY))
        });
        body.into_iter().chain(sensors).collect()
    }
}
