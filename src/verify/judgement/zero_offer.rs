//! Zeros of servo axes that would make their readings true; never applied.

use serde::Serialize;

use crate::base::numbers::signed;
use crate::recording::mounted::AxisSummary;
use crate::verify::calibrate::SensorCheck;

/// What to add to what an axis measures so that it is its sensor's tilt.
#[derive(Debug, Serialize)]
pub(crate) struct ZeroOffer {
    pub sensor: String,
    /// Mean of what the axis measured, degrees.
    pub measured_deg: f64,
    /// What was typed to be added, degrees.
    pub typed_deg: f64,
    /// Found less measured, degrees; what was typed as its zero is part of it.
    pub add_deg: f64,
    /// Half of its 95 % interval, degrees.
    pub u95_deg: f64,
}

impl ZeroOffer {
    /// For every sensor on a measured axis with an observable pitch.
    pub(crate) fn of(axes: &[AxisSummary], mount: &[SensorCheck]) -> Vec<Self> {
        let offer = |axis: &AxisSummary| {
            let check = mount.iter().find(|check| check.sensor == axis.sensor)?;
            Some(Self {
                sensor: axis.sensor.clone(),
                measured_deg: axis.measured_pitch_deg,
                typed_deg: axis.zero_deg,
                add_deg: axis.zero_deg + check.tilt_error_deg?,
                u95_deg: check.u95_deg?,
            })
        };
        axes.iter().filter_map(offer).collect()
    }

    /// In words.
    pub(crate) fn words(&self) -> String {
        let (sensor, measured) = (&self.sensor, signed(self.measured_deg, 3));
        if (self.add_deg - self.typed_deg).abs() <= self.u95_deg {
            let typed = match self.typed_deg == 0.0 {
                true => String::new(),
                false => format!(" with {} deg added to it", signed(self.typed_deg, 3)),
            };
            return format!(
                "the axis of {sensor} measured {measured} deg, and{typed} the sensor sat there: its zero is right within \
                 {:.3} deg",
                self.u95_deg
            );
        }
        format!(
            "the axis of {sensor} measured {measured} deg and the sensor sat at {}: its zero wants {} ± {:.3} deg (offered, not \
             applied: --axis-zero {}={} compares with it)",
            signed(self.measured_deg + self.add_deg, 3),
            signed(self.add_deg, 3),
            self.u95_deg,
            sensor,
            signed(self.add_deg, 3)
        )
    }
}
