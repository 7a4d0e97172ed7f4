//! Outrigger designs, drives and verifies rigs of spinning LiDARs.
//!
//! Modules stand in order: each uses only modules above it (`tests/tidy.rs` holds the order). The common currency is
//! the **return** (channel, azimuth, range, time): decoder and simulator both yield returns, and
//! [`coverage::Coverage::add`] is the only way into coverage, so predicted and recorded are never counted differently.
//!
//! Deliberately absent: a second definition of beam geometry (there is [`sensors::SensorModel::ray`]), a second servo
//! state machine (there is `firmware_protocol::Controller`), clocks, files and sockets inside kernels.

pub mod files;
pub mod instructions;
pub mod statistics;
pub mod rng;
pub mod clocks;
pub mod geometry;
pub mod scene;
pub mod trajectory;
pub mod rig;
pub mod coverage;
pub mod surface;
pub mod simulate;
pub mod registration;
pub mod odometry;
pub mod objective;
pub mod robustness;
pub mod fidelity;
pub mod optimize;
pub mod reconfigure;
pub mod compare;
pub mod calibrate;
pub mod servo;
pub mod receive;
pub mod watch;
pub mod record;
pub mod export;
pub mod chart;
pub mod report;
pub mod study;
pub mod setup;
pub mod mock;
pub mod config;
pub mod daemon;
pub mod commands;
