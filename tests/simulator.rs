//! The published simulator to the bit, and the general one against stored references.

use crate::support::Case;

pub const CASES: &[Case] = &[];
