//! Flags of `mock sensor`.

use std::net::SocketAddr;
use std::path::PathBuf;

use sensors::catalogue;
use sensors::ouster::{ImuProfile, Profile};
use sensors::velodyne::ReturnMode;

use super::parse::{parse_address, parse_imu_profile, parse_model, parse_profile, parse_returns};
use crate::commands::mock::web::WebArgs;
use crate::commands::ranges::{count, within};
use crate::commands::scene_args::{MeshArgs, Numbers};
use crate::commands::scene_file::MapArgs;
use crate::mock::transmit::Pace;

/// Arguments of `mock sensor`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Says when it is ready and what it sent, with --json as one line each. The sensor's clock shows \
                        the trajectory's times; without a trajectory file these begin now."
)]
pub struct Args {
    #[arg(long, value_name = "NAME", help = format!("Sensor model: {}", catalogue::decoded_names().join(", ")), value_parser = parse_model)]
    pub(super) model: String,
    /// Where packets go.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    pub(super) to: SocketAddr,
    /// Where IMU packets (Ouster) or position packets (Velodyne) go; not sent without it.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    pub(super) aside_to: Option<SocketAddr>,
    /// Where they come from; any free port by default.
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub(super) from: Option<SocketAddr>,
    /// Lidar profile of an Ouster.
    #[arg(long, value_name = "NAME", default_value = "RNG19_RFL8_SIG16_NIR16", value_parser = parse_profile)]
    pub(super) profile: Profile,
    /// IMU packets of an Ouster: LEGACY or ACCEL32_GYRO32_NMEA.
    #[arg(long, value_name = "NAME", default_value = "LEGACY", value_parser = parse_imu_profile)]
    pub(super) imu_profile: ImuProfile,
    /// Returns of a Velodyne; a second return of the mock's walls is the first again, as with real ones.
    #[arg(long, value_name = "MODE", default_value = "strongest", value_parser = parse_returns)]
    pub(super) returns: ReturnMode,
    /// Columns in a revolution of an Ouster.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = count(1, 65_536))]
    pub(super) columns: usize,
    /// Revolutions per second.
    #[arg(long, value_name = "HZ", default_value_t = 10.0, value_parser = within(0.5, 100.0))]
    pub(super) rotation_hz: f64,
    /// Serial number of an Ouster; by default 992200000000 plus the port.
    #[arg(long, value_name = "N")]
    pub(super) serial: Option<u64>,
    /// Write the metadata of an Ouster to this file.
    #[arg(long, value_name = "FILE")]
    pub(super) metadata: Option<PathBuf>,
    /// What is around the sensor: a mesh (OBJ, PLY, STL, glTF), or what a map is made of: a session, or a point cloud
    /// (PLY without faces, PCD, LAS, LAZ).
    #[arg(long, value_name = "PATH", conflicts_with = "hall")]
    pub(super) scene: Option<PathBuf>,
    #[command(flatten)]
    pub(super) mesh: MeshArgs,
    #[command(flatten)]
    pub(super) map: MapArgs,
    /// Box around the sensor: min and max corner, m.
    #[arg(
        long = "box",
        value_name = "X0,Y0,Z0,X1,Y1,Z1",
        default_value = "-10,-6,-1.5,10,6,2.5",
        allow_hyphen_values = true
    )]
    pub(super) hall: Numbers<6>,
    /// Trajectory of the platform (TUM, EuRoC or another table with named columns); by default it stands at the
    /// origin.
    #[arg(long, value_name = "FILE")]
    pub(super) trajectory: Option<PathBuf>,
    /// Mount of the sensor: m and degrees, in the mount frame (x right, y forward, z up).
    #[arg(long, value_name = "X,Y,Z,PITCH,ROLL", default_value = "0,0,0,0,0", allow_hyphen_values = true)]
    pub(super) mount: Numbers<5>,
    /// Mount file to take the sensor's mount from, by --name.
    #[arg(long, value_name = "FILE", conflicts_with = "mount", requires = "name")]
    pub(super) mounts: Option<PathBuf>,
    /// The sensor's name in the mount file.
    #[arg(long, value_name = "NAME")]
    pub(super) name: Option<String>,
    /// Real pitch, degrees, where the servo did not reach that of the mount.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = within(-360.0, 360.0))]
    pub(super) actual_pitch_deg: Option<f64>,
    /// End after this many seconds of the trajectory; without a trajectory file after a day.
    #[arg(long, value_name = "S", value_parser = within(1e-9, 1e9))]
    pub(super) duration: Option<f64>,
    /// Times faster than real time, or `max`: as fast as a receiver on this host takes packets.
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    pub(super) rate: Pace,
    /// Send each packet when this host's clock shows its time; the trajectory begins now or later.
    #[arg(long)]
    pub(super) on_time: bool,
    /// Standard deviation of the range noise, m.
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = within(0.0, 1e9))]
    pub(super) noise_m: f64,
    /// Seed of noise and faults.
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub(super) seed: u64,
    /// Number of this sensor in its rig: sensors of one seed and different numbers have different faults.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) index: u64,
    /// Probability that a packet is lost. The first and the last one never are.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = within(0.0, 1.0))]
    pub(super) drop: f64,
    /// Probability that it is sent twice.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = within(0.0, 1.0))]
    pub(super) duplicate: f64,
    /// Probability that it is sent after the next one.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = within(0.0, 1.0))]
    pub(super) reorder: f64,
    /// Probability that one bit of it is turned over.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = within(0.0, 1.0))]
    pub(super) corrupt: f64,
    /// Send nothing from this second on, and go on running.
    #[arg(long, value_name = "S", value_parser = within(0.0, 1e9))]
    pub(super) silent_after: Option<f64>,
    /// Die in this second without a word, as if unplugged.
    #[arg(long, value_name = "S", value_parser = within(0.0, 1e9))]
    pub(super) die_after: Option<f64>,
    #[command(flatten)]
    pub(super) web: WebArgs,
}
