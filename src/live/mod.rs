//! Sockets, clocks, the sensors' web interfaces, and `rig.toml`, which says what to listen to.

pub mod receive;
pub mod clocks;
pub mod watch;
pub mod setup;
pub mod config;
mod stream;
