//! What a recording proves: odometry, comparison with a prediction, calibration.

pub mod judgement;
pub mod odometry;
pub(crate) mod readiness;
pub mod compare;
pub mod calibrate;
pub mod align;
pub(crate) mod walk;
