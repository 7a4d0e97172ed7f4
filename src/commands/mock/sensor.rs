//! `outrigger mock sensor`: a sensor that measures a scene and sends real packets.

use std::io::Write as _;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use glam::DVec3;
use sensors::catalogue;
use sensors::ouster::{ImuProfile, Metadata, Profile, Synthetic, TimestampMode};
use sensors::velodyne::{Product, ReturnMode};

use super::web::{Web, WebArgs};
use crate::base::geometry::Pose;
use crate::commands::scene_args::{MeshArgs, Numbers};
use crate::commands::scene_file::{self, MapArgs};
use crate::commands::{Context, Outcome, output, signals};
use crate::live::receive::now_ns;
use crate::mock::sensor::{FaultCounts, FaultInjector, Faults, Line, MockSensor, Surroundings};
use crate::mock::transmit::{Clock, Pace, Transmitter};
use crate::rig::{Mount, MountFile};
use crate::world::scene::{BoxScene, Scene};
use crate::world::trajectory::Trajectory;

/// Time after Ctrl-C in which a packet may still be waited for.
const TO_END_WITHIN: Duration = Duration::from_secs(1);

/// Arguments of `mock sensor`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Says when it is ready and what it sent, with --json as one line each. The sensor's clock shows \
                        the trajectory's times; without a trajectory file these begin now."
)]
pub struct Args {
    #[arg(long, value_name = "NAME", help = format!("Sensor model: {}", catalogue::names().join(", ")), value_parser = parse_model)]
    model: String,
    /// Where packets go.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    to: SocketAddr,
    /// Where IMU packets (Ouster) or position packets (Velodyne) go; not sent without it.
    #[arg(long, value_name = "HOST:PORT", value_parser = parse_address)]
    aside_to: Option<SocketAddr>,
    /// Where they come from; any free port by default.
    #[arg(long, value_name = "ADDRESS:PORT")]
    from: Option<SocketAddr>,
    /// Lidar profile of an Ouster.
    #[arg(long, value_name = "NAME", default_value = "RNG19_RFL8_SIG16_NIR16", value_parser = parse_profile)]
    profile: Profile,
    /// IMU packets of an Ouster: LEGACY or ACCEL32_GYRO32_NMEA.
    #[arg(long, value_name = "NAME", default_value = "LEGACY", value_parser = parse_imu_profile)]
    imu_profile: ImuProfile,
    /// Returns of a Velodyne; a second return of the mock's walls is the first again, as with real ones.
    #[arg(long, value_name = "MODE", default_value = "strongest", value_parser = parse_returns)]
    returns: ReturnMode,
    /// Columns in a revolution of an Ouster.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = crate::commands::ranges::count(1, 65_536))]
    columns: usize,
    /// Revolutions per second.
    #[arg(long, value_name = "HZ", default_value_t = 10.0, value_parser = crate::commands::ranges::within(0.5, 100.0))]
    rotation_hz: f64,
    /// Serial number of an Ouster; by default 992200000000 plus the port.
    #[arg(long, value_name = "N")]
    serial: Option<u64>,
    /// Write the metadata of an Ouster to this file.
    #[arg(long, value_name = "FILE")]
    metadata: Option<PathBuf>,
    /// What is around the sensor: a mesh (OBJ, PLY, STL, glTF), or what a map is made of: a session, or a point cloud
    /// (PLY without faces, PCD, LAS, LAZ).
    #[arg(long, value_name = "PATH", conflicts_with = "hall")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    mesh: MeshArgs,
    #[command(flatten)]
    map: MapArgs,
    /// Box around the sensor: least and greatest corner, m.
    #[arg(
        long = "box",
        value_name = "X0,Y0,Z0,X1,Y1,Z1",
        default_value = "-10,-6,-1.5,10,6,2.5",
        allow_hyphen_values = true
    )]
    hall: Numbers<6>,
    /// Trajectory of the platform (TUM format); by default it stands at the origin.
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Mount of the sensor: m and degrees, in the mount frame (x right, y forward, z up).
    #[arg(long, value_name = "X,Y,Z,PITCH,ROLL", default_value = "0,0,0,0,0", allow_hyphen_values = true)]
    mount: Numbers<5>,
    /// Mount file to take the sensor's mount from, by --name.
    #[arg(long, value_name = "FILE", conflicts_with = "mount", requires = "name")]
    mounts: Option<PathBuf>,
    /// The sensor's name in the mount file.
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
    /// Real pitch, degrees, where the servo did not reach that of the mount.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = crate::commands::ranges::within(-360.0, 360.0))]
    actual_pitch_deg: Option<f64>,
    /// End after this many seconds of the trajectory; without a trajectory file after a day.
    #[arg(long, value_name = "S", value_parser = parse_positive)]
    duration: Option<f64>,
    /// Times faster than real time, or `max`: as fast as a receiver on this host takes packets.
    #[arg(long, value_name = "FACTOR|max", default_value = "1")]
    rate: Pace,
    /// Send each packet when this host's clock shows its time; the trajectory begins now or later.
    #[arg(long)]
    on_time: bool,
    /// Standard deviation of the range noise, m.
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = parse_not_negative)]
    noise_m: f64,
    /// Seed of noise and faults.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Number of this sensor in its rig: sensors of one seed and different numbers have different faults.
    #[arg(long, value_name = "N", default_value_t = 0)]
    index: u64,
    /// Probability that a packet is lost. The first and the last one never are.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = parse_probability)]
    drop: f64,
    /// Probability that it is sent twice.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = parse_probability)]
    duplicate: f64,
    /// Probability that it is sent after the next one.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = parse_probability)]
    reorder: f64,
    /// Probability that one bit of it is turned over.
    #[arg(long, value_name = "P", default_value_t = 0.0, value_parser = parse_probability)]
    corrupt: f64,
    /// Send nothing from this second on, and go on running.
    #[arg(long, value_name = "S", value_parser = parse_not_negative)]
    silent_after: Option<f64>,
    /// Die in this second without a word, as if unplugged.
    #[arg(long, value_name = "S", value_parser = parse_not_negative)]
    die_after: Option<f64>,
    #[command(flatten)]
    web: WebArgs,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let mut sensor = build_sensor(args)?;
    let scene = build_scene(args, context)?;
    let mount = build_mount(args)?;
    let trajectory = build_trajectory(args)?;
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let body_from_sensor = mount.body_from_sensor();
    let surroundings = Surroundings {
        scene: &scene,
        trajectory: &trajectory,
        body_from_sensor: &|_| body_from_sensor,
        noise_m: args.noise_m,
        seed: args.seed,
    };
    if let (Some(metadata), Some(path)) = (sensor.metadata(), &args.metadata) {
        std::fs::write(path, metadata.to_json()).with_context(|| format!("metadata {}", path.display()))?;
    }
    let clock = if args.on_time {
        let wait = Duration::from_nanos(start_ns.saturating_sub(now_ns()));
        Clock::new(args.rate, Some(start_ns)).starting_in(wait)
    } else {
        Clock::new(args.rate, None)
    };
    let transmitter = Transmitter::new(args.from, args.to, clock).with_context(|| {
        format!("cannot send from {}", args.from.map_or("any port".into(), |from| from.to_string()))
    })?;
    let web = Web::start(&args.web, &args.model, sensor.metadata(), args.to, args.aside_to)?;
    announce(args, &sensor, &transmitter, web.as_ref(), [start_ns, end_ns], context)?;
    let mut sending = Sending {
        args,
        web,
        transmitter,
        injector: injector(args),
        start_ns,
        packets: 0,
        bytes: 0,
        aside_packets: 0,
        unreachable: None,
    };
    let stop = signals::stop_within(TO_END_WITHIN, "interrupted")?;
    let begun = Instant::now();
    let outcome = sensor.run_both(&surroundings, |time_ns, line, payload| match (line, args.aside_to) {
        _ if stop.load(Ordering::Relaxed) => Err(Ended::Interrupted),
        (Line::Lidar, _) => sending.take(time_ns, payload),
        (Line::Aside, Some(to)) => sending.aside(time_ns, payload, to),
        (Line::Aside, None) => Ok(()),
    });
    let mut until_ns = end_ns;
    match outcome {
        Err(Ended::Interrupted) => until_ns = start_ns, // what is held back goes now
        Err(Ended::Died) => return Ok(Outcome::Done),
        Err(Ended::Io(to, error)) => return Err(error).with_context(|| format!("cannot send to {to}")),
        Ok(()) => {}
    }
    let faults = sending.finish(until_ns)?;
    let seconds = begun.elapsed().as_secs_f64();
    let (packets, bytes) = (sending.packets, sending.bytes);
    let document = serde_json::json!({
        "sent_packets": packets, "sent_bytes": bytes, "sent_aside": sending.aside_packets, "wall_s": seconds, "faults": faults
    });
    say(context, &document, || format!("sent {packets} packets, {bytes} bytes, in {seconds:.1} s"))?;
    Ok(Outcome::Done)
}

/// Why sending ended early.
enum Ended {
    Died,
    Interrupted,
    Io(SocketAddr, std::io::Error),
}

struct Sending<'a> {
    args: &'a Args,
    web: Option<Web>,
    transmitter: Transmitter,
    injector: FaultInjector,
    start_ns: u64,
    packets: u64,
    bytes: u64,
    aside_packets: u64,
    /// Where nothing gets through to, which was said.
    unreachable: Option<IpAddr>,
}

impl Sending<'_> {
    fn take(&mut self, time_ns: u64, payload: &[u8]) -> Result<(), Ended> {
        let time_s = time_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
        if self.args.die_after.is_some_and(|death_s| time_s >= death_s) {
            return Err(Ended::Died);
        }
        let to = self.web.as_ref().and_then(|web| web.destinations()[0]).unwrap_or(self.args.to);
        let is_told = self.web.is_some();
        let Self { transmitter, injector, packets, bytes, unreachable, .. } = self;
        injector.apply(time_s, payload, &mut |packet| match transmitter.send(time_ns, packet, to) {
            Ok(()) => {
                *packets += 1;
                *bytes += packet.len() as u64;
                Ok(())
            }
            Err(error) if is_told => {
                lost(to, &error, unreachable);
                Ok(())
            }
            Err(error) => Err(Ended::Io(to, error)),
        })
    }

    /// A packet beside: no fault strikes it, but it falls silent with the sensor.
    fn aside(&mut self, time_ns: u64, payload: &[u8], to: SocketAddr) -> Result<(), Ended> {
        let time_s = time_ns.saturating_sub(self.start_ns) as f64 * 1e-9;
        if self.args.silent_after.is_some_and(|silent_s| time_s >= silent_s) {
            return Ok(());
        }
        let to = self.web.as_ref().and_then(|web| web.destinations()[1]).unwrap_or(to);
        match self.transmitter.send(time_ns, payload, to) {
            Ok(()) => self.aside_packets += 1,
            Err(error) if self.web.is_some() => lost(to, &error, &mut self.unreachable),
            Err(error) => return Err(Ended::Io(to, error)),
        }
        Ok(())
    }

    fn finish(&mut self, end_ns: u64) -> anyhow::Result<FaultCounts> {
        let to = self.web.as_ref().and_then(|web| web.destinations()[0]).unwrap_or(self.args.to);
        let is_told = self.web.is_some();
        let Self { transmitter, injector, packets, bytes, unreachable, .. } = self;
        injector
            .finish(&mut |packet| {
                match transmitter.send(end_ns, packet, to) {
                    Ok(()) => {
                        *packets += 1;
                        *bytes += packet.len() as u64;
                    }
                    Err(error) if is_told => lost(to, &error, unreachable),
                    Err(error) => return Err(error),
                }
                Ok::<(), std::io::Error>(())
            })
            .with_context(|| format!("cannot send to {to}"))
    }
}

/// A sensor that is told to send where nothing gets through goes on, and can be told otherwise.
fn lost(to: SocketAddr, error: &std::io::Error, unreachable: &mut Option<IpAddr>) {
    if unreachable.replace(to.ip()) != Some(to.ip()) {
        output::say_notice(&format!("what is sent to {to} is lost: {error}"));
    }
}

fn injector(args: &Args) -> FaultInjector {
    let faults = Faults {
        seed: args.seed,
        drop: args.drop,
        duplicate: args.duplicate,
        reorder: args.reorder,
        corrupt: args.corrupt,
        silent_after_s: args.silent_after,
    };
    FaultInjector::new(faults, args.index)
}

fn announce(
    args: &Args,
    sensor: &MockSensor,
    transmitter: &Transmitter,
    web: Option<&Web>,
    time_span_ns: [u64; 2],
    context: Context,
) -> anyhow::Result<()> {
    let from = transmitter.local_addr().context("the socket has no address")?;
    let serial = sensor.metadata().map(|metadata| metadata.serial.clone());
    let written = sensor.metadata().and(args.metadata.as_ref());
    let document = serde_json::json!({
        "ready": true, "model": args.model.to_lowercase(), "serial": serial, "from": from, "to": args.to,
        "metadata": written, "time_span_ns": time_span_ns, "http": web.map(Web::address),
    });
    say(context, &document, || {
        let metadata = written.map_or(String::new(), |path| format!(", metadata in {}", path.display()));
        let http = web.map_or(String::new(), |web| format!(", web interface at {}", web.address()));
        format!("{} sends from {from} to {}{metadata}{http}", args.model, args.to)
    })
}

/// One line on stdout.
fn say(context: Context, document: &serde_json::Value, text: impl FnOnce() -> String) -> anyhow::Result<()> {
    let line = if context.json { document.to_string() } else { text() };
    match writeln!(std::io::stdout(), "{line}").and_then(|()| std::io::stdout().flush()) {
        // a reader that went away is no reason to stop sending
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("stdout"),
        _ => Ok(()),
    }
}

fn build_sensor(args: &Args) -> anyhow::Result<MockSensor> {
    if let Some(product) = Product::from_name(&args.model) {
        let sensor = MockSensor::velodyne(product, args.returns, args.rotation_hz)?;
        return Ok(if args.aside_to.is_some() { sensor.with_aside() } else { sensor });
    }
    let port = args.to.port();
    let serial = args.serial.unwrap_or(992_200_000_000 + u64::from(port));
    let mut wanted = Synthetic::new(&args.model, serial, args.profile).columns(args.columns, 16);
    wanted.frame_rate_hz = args.rotation_hz;
    wanted.lidar_port = port;
    wanted.imu_profile = if args.aside_to.is_some() { args.imu_profile } else { ImuProfile::Off };
    wanted.imu_port = args.aside_to.map_or(0, |to| to.port());
    wanted.timestamp_mode = TimestampMode::SyncPulseIn;
    if args.trajectory.is_none() {
        // a real one has another after each start
        wanted.init_id = (now_ns() / 1_000_000_000 % 0xFF_FFFF + 1) as u32;
    }
    Ok(MockSensor::ouster(Metadata::synthetic(&wanted)?).with_aside())
}

fn build_scene(args: &Args, context: Context) -> anyhow::Result<Scene> {
    if let Some(path) = &args.scene {
        let read = scene_file::read(path, &args.mesh, &args.map, context)?;
        read.warnings.iter().for_each(|warning| output::say_notice(warning));
        return Ok(read.scene);
    }
    scene_file::ensure_none_typed(context, "there is none")?;
    let [x0, y0, z0, x1, y1, z1] = args.hall.0;
    let (least, greatest) = (DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1));
    if !least.cmplt(greatest).all() {
        refuse!("--box: {least} must be less than {greatest} in each coordinate");
    }
    Ok(Scene::Box(BoxScene::closed(least, greatest)))
}

fn build_mount(args: &Args) -> anyhow::Result<Mount> {
    let mut mount = match (&args.mounts, &args.name) {
        (Some(path), Some(name)) => {
            let file = MountFile::read(path)?;
            let entry = file.sensors.iter().find(|entry| entry.name == *name);
            entry.with_context(|| format!("{}: no sensor is called {name:?}", path.display()))?.mount()
        }
        _ => {
            let [x_m, y_m, z_m, pitch_deg, roll_deg] = args.mount.0;
            let (pitch_rad, roll_rad) = (pitch_deg.to_radians(), roll_deg.to_radians());
            Mount { x_m, y_m, z_m, pitch_rad, roll_rad, yaw_rad: 0.0 }
        }
    };
    if let Some(pitch_deg) = args.actual_pitch_deg {
        mount.pitch_rad = pitch_deg.to_radians();
    }
    Ok(mount)
}

fn build_trajectory(args: &Args) -> anyhow::Result<Trajectory> {
    let whole = match &args.trajectory {
        Some(path) => read_trajectory(path)?,
        None => {
            let start_ns = now_ns();
            let day_ns = 86_400_000_000_000;
            Trajectory::new(vec![(start_ns, Pose::IDENTITY), (start_ns + day_ns, Pose::IDENTITY)])?
        }
    };
    let [start_ns, end_ns] = whole.time_span_ns();
    let wanted_ns = args.duration.map_or(end_ns, |duration_s| start_ns + (duration_s * 1e9) as u64);
    let Some(last) = whole.at(wanted_ns).filter(|_| wanted_ns < end_ns) else { return Ok(whole) };
    let kept = whole.stamped().take_while(|(time_ns, _)| *time_ns < wanted_ns);
    Ok(Trajectory::new(kept.chain([(wanted_ns, last)]).collect())?)
}

fn read_trajectory(path: &Path) -> anyhow::Result<Trajectory> {
    let text =
        crate::base::files::read_text(path).with_context(|| format!("trajectory {}", path.display()))?;
    Trajectory::from_tum(&text).with_context(|| format!("trajectory {}", path.display()))
}

fn parse_address(text: &str) -> Result<SocketAddr, String> {
    use std::net::ToSocketAddrs as _;
    let mut found =
        text.to_socket_addrs().map_err(|error| format!("{text:?}: {error}; expected HOST:PORT"))?;
    found.next().ok_or_else(|| format!("{text:?} has no address"))
}

fn parse_model(text: &str) -> Result<String, String> {
    catalogue::nominal(text).map(|_| text.to_owned()).map_err(|error| error.to_string())
}

fn parse_profile(text: &str) -> Result<Profile, String> {
    let names = || Profile::all().map(Profile::name).collect::<Vec<_>>().join(", ");
    Profile::from_name(&text.to_uppercase()).ok_or_else(|| format!("{text:?}; known are {}", names()))
}

fn parse_imu_profile(text: &str) -> Result<ImuProfile, String> {
    ImuProfile::from_name(&text.to_uppercase())
        .filter(|profile| *profile != ImuProfile::Off)
        .ok_or_else(|| format!("{text:?}; known are LEGACY, ACCEL32_GYRO32_NMEA"))
}

fn parse_returns(text: &str) -> Result<ReturnMode, String> {
    match text {
        "strongest" => Ok(ReturnMode::Strongest),
        "last" => Ok(ReturnMode::Last),
        "dual" => Ok(ReturnMode::Dual),
        _ => Err(format!("{text:?}; known are strongest, last, dual")),
    }
}

fn parse_positive(text: &str) -> Result<f64, String> {
    in_range(text, f64::MIN_POSITIVE, 1e9, "a number above 0")
}

fn parse_not_negative(text: &str) -> Result<f64, String> {
    in_range(text, 0.0, 1e9, "a number of at least 0")
}

fn parse_probability(text: &str) -> Result<f64, String> {
    in_range(text, 0.0, 1.0, "a probability from 0 to 1")
}

fn in_range(text: &str, least: f64, greatest: f64, expected: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| (least..=greatest).contains(number));
    number.ok_or_else(|| format!("{text:?}: expected {expected}"))
}
