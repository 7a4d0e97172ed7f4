//! Receive, record, reopen: nothing lost in silence.

use crate::support::Case;

pub const CASES: &[Case] = &[];
