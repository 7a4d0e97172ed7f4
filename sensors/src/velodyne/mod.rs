//! Velodyne VLP-16, Puck LITE, Puck Hi-Res, VLP-32, VLS-128, HDL-32E and HDL-64E: data and position packets,
//! calibration, encode and decode.

/// One position packet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Position {}
