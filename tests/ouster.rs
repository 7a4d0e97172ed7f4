//! Ouster captures against the digests of ouster-sdk.

use crate::support::Case;

pub const CASES: &[Case] = &[];
