//! Outrigger designs, drives and verifies rigs of spinning LiDARs.
//!
//! Fourteen wings stand in order: each uses only wings above it (`tests/tidy.rs` holds the order). The common currency is
//! the **return** (channel, azimuth, range, time): decoder and simulator both yield returns, and
//! [`world::coverage::Coverage::add`] alone counts coverage, so predicted and recorded are never counted differently.
//!
//! A pair of sensors, and what it would see of a room on a walk of three metres:
//!
//! ```
//! use glam::DVec3;
//! use outrigger::world::coverage::{Coverage, VoxelGrid};
//! use outrigger::rig::{Mount, MountedSensor, Rig};
//! use outrigger::world::scene::{BoxScene, Scene};
//! use outrigger::simulate::scan::{Scanner, Spin};
//! use outrigger::world::trajectory::Trajectory;
//!
//! let model = sensors::catalogue::nominal("vlp-16")?;
//! let right = Mount { x_m: 0.1, pitch_rad: 25_f64.to_radians(), ..Mount::default() };
//! let mounted = |name: &str, mount| MountedSensor { name: name.into(), model: model.clone(), mount };
//! let rig = Rig { sensors: vec![mounted("right", right), mounted("left", right.mirrored())] };
//!
//! let scene = Scene::Box(BoxScene::closed(DVec3::new(-4.0, -3.0, 0.0), DVec3::new(4.0, 3.0, 2.5)));
//! let walk = Trajectory::straight(DVec3::new(-1.5, 0.0, 1.2), DVec3::new(1.5, 0.0, 1.2), 1.5, 0);
//! let mut coverage = Coverage::new(VoxelGrid::centred_on(scene.bounds_m(), 0.1), rig.sensors.len());
//! Scanner::new(&scene, &walk, &rig, Spin::default()).cover(&mut coverage);
//!
//! let counts = coverage.counts();
//! assert_eq!(coverage.outside(), 0, "a room is closed");
//! assert!(counts.union > 10_000 && counts.overlap > 0 && counts.overlap < counts.union);
//! # Ok::<(), sensors::catalogue::ModelError>(())
//! ```
//!
//! Deliberately absent: a second definition of beam geometry (there is [`sensors::SensorModel::ray`]), a second servo
//! state machine (there is `firmware_protocol::Controller`), clocks, files and sockets inside kernels.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))] // they panic on a closed pipe
// a build without some of its features has no use for all of the rest
#![cfg_attr(
    not(all(feature = "daemon", feature = "mcap", feature = "survey")),
    allow(dead_code, unused_imports)
)]

pub mod base;
pub mod world;
pub mod rig;
pub mod simulate;
pub mod design;
pub mod live;
pub mod recording;
pub mod drive;
pub mod verify;
pub mod report;
pub mod mock;
pub mod study;
#[cfg(feature = "daemon")]
pub mod daemon;
pub mod commands;
