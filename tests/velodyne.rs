//! Velodyne captures against the digests of velodyne_decoder.

use crate::support::Case;

pub const CASES: &[Case] = &[];
