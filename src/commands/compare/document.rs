//! The JSON documents of `compare`.

use serde::Serialize;

use crate::base::numbers::signed;
use crate::recording::mounted::{AxisSummary, SensorSummary};
use crate::verify::align::Alignment;
use crate::verify::calibrate::SensorCheck;
use crate::verify::compare::TimeOffset;
use crate::verify::judgement::comparison::{Comparison, Reason, Verdict};

/// The document that `compare` prints.
#[derive(Debug, Serialize)]
pub struct Document {
    pub format: &'static str,
    #[serde(flatten)]
    pub comparison: Comparison,
    pub recording: Vec<SensorSummary>,
    /// What the axes measured, where the session holds it.
    pub rig: Vec<AxisSummary>,
    /// Zeros of servo axes that would make their readings true; never applied.
    pub servo_zero: Vec<ZeroOffer>,
    /// What is odd or was lost.
    pub problems: Vec<String>,
    /// Where the trajectory lies in the scene; null where its frame is the scene's.
    pub alignment: Option<Alignment>,
    pub time_offset_s: f64,
    /// With how sure it is, where it was looked for.
    pub time_offset: Option<TimeOffset>,
    pub wall_s: f64,
}

impl Document {
    /// The zeros of servo axes, in words.
    pub(crate) fn zeros(&self) -> Vec<String> {
        self.servo_zero.iter().map(ZeroOffer::words).collect()
    }
}

/// What to add to what an axis measures so that it is its sensor's tilt.
#[derive(Debug, Serialize)]
pub struct ZeroOffer {
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
    fn words(&self) -> String {
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
            "the axis of {sensor} measured {measured} deg and the sensor sat at {}: its zero wants {} +- {:.3} deg (offered, not \
             applied: --axis-zero {}={} compares with it)",
            signed(self.measured_deg + self.add_deg, 3),
            signed(self.add_deg, 3),
            self.u95_deg,
            sensor,
            signed(self.add_deg, 3)
        )
    }
}

/// The document where no place of the trajectory in the scene is sure: nothing is compared.
#[derive(Serialize)]
pub(crate) struct Unplaced<'a> {
    pub(crate) format: &'static str,
    pub(crate) verdict: Verdict,
    pub(crate) reason: Reason,
    pub(crate) words: [String; 1],
    pub(crate) alignment: &'a Alignment,
    pub(crate) problems: Vec<String>,
    pub(crate) wall_s: f64,
}
