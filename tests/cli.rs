//! The program as a user meets it: flags, exit codes, JSON documents, messages.

use crate::support::Case;

pub const CASES: &[Case] = &[];
