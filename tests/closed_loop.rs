//! Scene to packets to decoder to coverage equals the prediction.

use crate::support::Case;

pub const CASES: &[Case] = &[];
