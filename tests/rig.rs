//! The mock rig behind a pty, driven through the serial link.

use crate::support::Case;

pub const CASES: &[Case] = &[];
