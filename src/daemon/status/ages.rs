//! Every value that is shown has an age, and that grows whether or not anybody renews the value.

use std::time::{Duration, Instant};

use super::{RigState, Status};
use crate::drive::RigStatus;

impl RigState {
    /// Last status of the rig.
    pub(in crate::daemon) fn take(&mut self, status: RigStatus) {
        self.axes_as_of = vec![Instant::now(); status.axes.len()];
        self.status = Some(status);
    }

    /// Its ages as of now.
    pub(in crate::daemon) fn count_ages(&mut self) {
        let now = Instant::now();
        self.age_ms = self.axes_as_of.iter().max().map(|newest| ms(now.saturating_duration_since(*newest)));
        let axes = self.status.iter_mut().flat_map(|status| &mut status.axes);
        for (axis, as_of) in axes.zip(&self.axes_as_of) {
            axis.age_ms += ms(now.saturating_duration_since(*as_of));
        }
    }
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

impl Status {
    /// The same with every age counted up to now.
    #[must_use]
    pub(in crate::daemon) fn aged(&self) -> Self {
        let (now, mut status) = (Instant::now(), self.clone());
        let since = now.saturating_duration_since(self.as_of);
        let (since_s, since_ms) = (since.as_secs_f64(), ms(since));
        status.as_of = now;
        status.age_ms += since_ms;
        status.uptime_s += since_s;
        status.recorder.age_ms += since_ms;
        for sensor in &mut status.sensors {
            sensor.last_packet_age_s = sensor.last_packet_age_s.map(|age_s| age_s + since_s);
            sensor.decoded_age_ms = sensor.decoded_age_ms.map(|age_ms| age_ms + since_ms);
        }
        if let Some(rig) = &mut status.rig {
            rig.age_ms = rig.age_ms.map(|age_ms| age_ms + since_ms);
            rig.disarms_in_s = rig.disarms_in_s.map(|left_s| (left_s - since_s).max(0.0));
            rig.status
                .iter_mut()
                .flat_map(|status| &mut status.axes)
                .for_each(|axis| axis.age_ms += since_ms);
        }
        if let Some(coverage) = &mut status.coverage {
            coverage.last_point_age_s = coverage.last_point_age_s.map(|age_s| age_s + since_s);
        }
        status
    }
}
