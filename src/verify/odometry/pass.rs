//! Odometry over a stream of frames, and the notes on its result.

use sensors::{Frame, SensorModel};

use super::{Limits, Odometry, OdometryError, Settings, Step, Sweeps, Walked};
use crate::base::geometry::Pose;

/// Odometry over the frames of a rig's sensors.
pub(crate) struct OdometryPass {
    sweeps: Sweeps,
    odometry: Odometry,
    revolutions_ns: Vec<u64>,
    /// Of the first and the last firing of any sensor.
    span_ns: Option<[u64; 2]>,
}

impl OdometryPass {
    pub(crate) fn new(sensors: usize, limits: Limits, settings: Settings) -> Self {
        Self {
            sweeps: Sweeps::new(sensors, limits),
            odometry: Odometry::new(settings),
            revolutions_ns: Vec::new(),
            span_ns: None,
        }
    }

    /// `body_from_sensor`: at a time of the sensor's clock, ns.
    pub(crate) fn add_frame(
        &mut self,
        sensor: usize,
        model: &SensorModel,
        body_from_sensor: &dyn Fn(u64) -> Pose,
        frame: &Frame,
    ) {
        if let Some([first_ns, last_ns]) = frame.time_span_ns().filter(|_| sensor == 0) {
            self.revolutions_ns.push(first_ns + (last_ns - first_ns) / 2);
        }
        if let Some([first_ns, last_ns]) = frame.time_span_ns() {
            let fired_ns = model.beams().iter().map(|beam| beam.fire_offset_ns.round() as i64);
            let (least_ns, most_ns) =
                fired_ns.fold((0, 0), |(least, most), at| (at.min(least), at.max(most)));
            let span_ns = [first_ns.saturating_add_signed(least_ns), last_ns.saturating_add_signed(most_ns)];
            let known_ns = self.span_ns.unwrap_or(span_ns);
            self.span_ns = Some([known_ns[0].min(span_ns[0]), known_ns[1].max(span_ns[1])]);
        }
        self.sweeps.add_frame(sensor, model, body_from_sensor, frame);
        while let Some(sweep) = self.sweeps.next_whole() {
            self.odometry.add(sweep);
        }
    }

    /// The result, and the middle of every revolution of the first sensor, ns.
    ///
    /// # Errors
    /// Those of [`Odometry::finish_over`].
    pub(crate) fn finish(mut self, losses: &mut Vec<String>) -> Result<(Walked, Vec<u64>), OdometryError> {
        while let Some(sweep) = self.sweeps.next_rest() {
            self.odometry.add(sweep);
        }
        let late = self.sweeps.late();
        if late > 0 {
            losses.push(format!(
                "{late} returns bear times before those already used (clocks of the sensors apart, or a clock set back): \
                 they were left out"
            ));
        }
        let span_ns = self.span_ns.map(|[first_ns, last_ns]| [first_ns, last_ns + 1]);
        Ok((self.odometry.finish_over(span_ns)?, self.revolutions_ns))
    }
}

impl Walked {
    /// Says so where the surfaces left a direction of the trajectory open.
    pub(crate) fn open_direction(&self) -> Option<String> {
        let start_ns = self.trajectory.time_span_ns()[0];
        let open: Vec<&Step> = self.steps.iter().filter(|step| step.is_degenerate()).collect();
        let (first, last) = (open.first()?, open.last()?);
        let seconds = |step: &Step| step.time_ns.saturating_sub(start_ns) as f64 * 1e-9;
        let worst = open.iter().filter_map(|step| Some((step.least_translation?, step.weakest_direction?)));
        let along = worst
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(String::new(), |(_, [x, y, z])| format!(" along ({x:.2}, {y:.2}, {z:.2})"));
        Some(format!(
            "cannot determine the motion{along} in {} of {} revolutions, between {:.1} and {:.1} s: the surfaces leave it open, the \
             last velocity was held",
            open.len(),
            self.steps.len(),
            seconds(first),
            seconds(last)
        ))
    }
}
