//! What the boards share: bytes in, the state machine, bytes out.
#![no_std]

pub mod clock;
pub mod queue;
pub mod registers;
pub mod rig;
