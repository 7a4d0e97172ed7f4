//! A recording with known slots of its sensors on the rig: a session, which knows them, or a capture with a mount file.

pub mod axes;
pub mod beams;
pub mod feed;
pub mod data_gaps;
pub mod host_clock;
pub mod judge;
mod homing;

use std::cell::OnceCell;
use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use sensors::router::{AppliesTo, GivenCalibration, SourceFilter};

use crate::base::files::is_same;
use crate::base::geometry::Pose;
use crate::commands::Context;
use crate::commands::output;
use crate::commands::recording::{Recording, ensure_recording};
use crate::commands::registered::bag_mount;
use crate::commands::sensor_args::{SensorArgs, ensure_named};
use crate::commands::stage::Stage;
use crate::drive::ServoReport;
use crate::recording::Session;
use crate::recording::bags::is_bag_at;
use crate::recording::packet_reader::PacketReader;
use crate::rig::{MountFile, MountedSensor, Rig};
use crate::verify::compare::{RecordedRay, Thinning, TiltHistory};
use crate::world::trajectory::Trajectory;
use axes::{AxisSummary, AxisZeros, Tilts, contradicted, reports_of, summaries, tilts};
use feed::{MountedFrame, MountedSession, PassSummary};

/// Which recording, and where its sensors sit: the arguments that `compare`, `boresight` and `odometry` share.
#[derive(clap::Args, Debug, Default)]
pub struct RecordedArgs {
    /// Session folder, capture (pcap or pcapng; plain, gzip, zstd or lz4), bag (ROS 1, MCAP, db3, or the folder of one), or -
    /// for standard input.
    pub recording: PathBuf,
    #[command(flatten)]
    pub sensors: SensorArgs,
    /// Where the sensors sit; without it the session's own, and a single sensor level at the origin. A session's sensors are
    /// identified by name; those of a capture by their order: that of --meta, then of their first packets.
    #[arg(long, value_name = "FILE")]
    pub mount: Option<PathBuf>,
    #[command(flatten)]
    pub zeros: AxisZeros,
}

impl RecordedArgs {
    /// Looks, before the work is done, whether the files that were asked for could be written, and are none that is read.
    pub(crate) fn check_places<'a>(
        &self,
        outs: impl IntoIterator<Item = &'a Option<PathBuf>> + Clone,
    ) -> anyhow::Result<()> {
        output::check_places(outs.clone())?;
        for out in outs.into_iter().flatten() {
            let metadata = self.sensors.meta.iter().map(|file| &file.path);
            let mut inputs = [&self.recording].into_iter().chain(&self.mount).chain(metadata);
            let is_read = inputs.any(|input| is_same(out, input));
            ensure!(!is_read, "{}: this file is read; write to another", out.display());
        }
        Ok(())
    }
}

enum Source {
    Session { session: Box<Session>, tilts: Vec<TiltHistory>, calibrations: Vec<GivenCalibration> },
    Capture(Box<Recording>),
}

/// A recording and the rig that made it.
pub struct Recorded {
    source: Source,
    pub mount: MountFile,
    pub rig: Rig,
    zeros: AxisZeros,
    /// What may not be as the user thinks.
    pub notices: Vec<String>,
    span_ns: OnceCell<Option<[u64; 2]>>,
}

/// Some of the rays of a recording.
pub struct RaySample {
    /// In order of time.
    pub rays: Vec<RecordedRay>,
    /// The rig's, each with the beams of its packets.
    pub sensors: Vec<MountedSensor>,
    pub pass: PassSummary,
}

impl Recorded {
    /// Opens a session or, where metadata are given too, whatever the path names as a capture. The sensors sit as `--mount`
    /// says, or as the recording does; a single sensor without a mount is level at the origin.
    pub(crate) fn open(args: &RecordedArgs, context: Context) -> anyhow::Result<Self> {
        if let Some(recorded) = Self::open_if_mounted(args, context)? {
            return Ok(recorded);
        }
        let (path, sensors) = (&args.recording, &args.sensors.of(context, &args.recording));
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let recording = Recording::open_to_reread(path, sensors)?;
        let mut notices = Vec::new();
        match bag_mount::of_only_sensor(&recording, session.as_ref(), &mut notices)? {
            Some(mount) => Self::mounted(args, sensors, mount, (session, Some(recording)), notices),
            None => {
                bail!("{}: give --mount: the recording does not say where its sensors sit", path.display())
            }
        }
    }

    /// The same; none without mounts.
    pub(crate) fn open_if_mounted(args: &RecordedArgs, context: Context) -> anyhow::Result<Option<Self>> {
        let RecordedArgs { recording: path, sensors, mount, zeros } = args;
        let sensors = &sensors.of(context, path);
        // a name that was mistyped is no recording without a mount
        if path.as_os_str() != "-" {
            std::fs::metadata(path).with_context(|| path.display().to_string())?;
            ensure_recording(path)?;
        }
        let session = Session::is_session(path).then(|| Session::open(path)).transpose()?;
        let mount = match mount {
            Some(file) => Some(MountFile::read(file)?),
            None => session.as_ref().map(Session::mount).transpose()?.flatten(),
        };
        let (mut in_bag, mut notices) = (None, Vec::new());
        if mount.is_none() && is_bag_at(path) {
            let recording = Recording::open(path, sensors)?;
            in_bag = bag_mount::of_bag(&recording, &mut notices)?;
        }
        let Some(mount) = mount.or(in_bag) else {
            // what is no recording at all does not lack a mount; a pipe could be read but once
            if path.is_file() || path.is_dir() {
                PacketReader::open(path, &path.display().to_string())?;
            }
            zeros.ensure_measured(&Rig { sensors: Vec::new() }, &[])?;
            return Ok(None);
        };
        Self::mounted(args, sensors, mount, (session, None), notices).map(Some)
    }

    /// With this mount: the session, where that has its metadata itself, or what was opened as a capture.
    fn mounted(
        args: &RecordedArgs,
        sensors: &SensorArgs,
        mount: MountFile,
        (session, opened): (Option<Session>, Option<Recording>),
        mut notices: Vec<String>,
    ) -> anyhow::Result<Self> {
        let RecordedArgs { recording: path, zeros, .. } = args;
        let rig = mount.rig()?;
        let source = match session {
            Some(mut session) if sensors.meta.is_empty() => {
                ensure!(
                    sensors.model.is_empty(),
                    "--model: {} is a session, which names the models of its sensors; give --model to a capture",
                    path.display()
                );
                notices.extend(host_clock::settle(&mut session, &rig)?);
                let calibrations = sensors.calibrations()?;
                ensure_meant(&calibrations, &session)?;
                let Tilts { histories: tilts, notices: not_homed } = tilts(&session, &rig, zeros)?;
                notices.extend(not_homed);
                zeros.ensure_measured(&rig, &tilts)?;
                Source::Session { session: Box::new(session), tilts, calibrations }
            }
            _ => {
                zeros.ensure_measured(&rig, &[])?;
                let opened = opened.map_or_else(|| Recording::open_to_reread(path, sensors), Ok)?;
                Source::Capture(Box::new(opened))
            }
        };
        let zeros = zeros.clone();
        Ok(Self { source, mount, rig, zeros, notices, span_ns: OnceCell::new() })
    }

    /// What its axes reported, by the places of their sensors in the rig; nothing for a capture.
    pub(crate) fn servo(&self) -> anyhow::Result<Vec<ServoReport>> {
        match &self.source {
            Source::Session { session, .. } => reports_of(session, &self.rig),
            Source::Capture(_) => Ok(Vec::new()),
        }
    }

    /// What its axes measured while its sensors recorded, which a pass over it has found.
    pub(crate) fn axes(&self, pass: &PassSummary) -> Vec<AxisSummary> {
        summaries(&self.rig, &self.zeros, &pass.pitches)
    }

    /// Mounts that are not as their axes measured, in words.
    pub(crate) fn contradicted(&self, pass: &PassSummary) -> Vec<String> {
        contradicted(&self.rig, &self.zeros, &pass.pitches)
    }

    /// What it is, in words.
    pub(crate) fn what(&self) -> &'static str {
        match self.source {
            Source::Session { .. } => "the session",
            Source::Capture(_) => "a capture",
        }
    }

    /// The trajectory that it holds itself.
    pub(crate) fn own_trajectory(&self) -> anyhow::Result<Option<Trajectory>> {
        match &self.source {
            Source::Session { session, .. } => Ok(session.trajectory()?),
            Source::Capture(_) => Ok(None),
        }
    }

    /// Every frame.
    pub(crate) fn feed(&self, take: &mut dyn FnMut(MountedFrame<'_>)) -> anyhow::Result<PassSummary> {
        match &self.source {
            Source::Session { session, tilts, calibrations } => {
                let stage = Stage::begin("going through the session");
                feed::session(&MountedSession { session, rig: &self.rig, tilts, calibrations }, &stage, take)
            }
            Source::Capture(recording) => feed::capture(recording, &self.rig, take),
        }
    }

    /// An even share of its returns, `most` at most, on its own clock.
    pub(crate) fn rays(&self, most: usize) -> anyhow::Result<RaySample> {
        let mut sensors = self.rig.sensors.clone();
        let mut sample = Thinning::new(most);
        let pass = self.feed(&mut |mounted_frame| {
            let MountedFrame { sensor, model, frame, .. } = mounted_frame;
            mounted_frame.tell_model(&mut sensors);
            sample.add_frame(sensor, model, &mounted_frame.pitch_or(&sensors[sensor].mount), 0, frame);
        })?;
        Ok(RaySample { rays: Thinning::joined([sample]), sensors, pass })
    }

    /// Times of the first and the last column of any sensor, ns; none where no frame was recorded. Decodes all of it once.
    pub(crate) fn span_ns(&self) -> anyhow::Result<Option<[u64; 2]>> {
        if let Some(known) = self.span_ns.get() {
            return Ok(*known);
        }
        let mut span: Option<[u64; 2]> = None;
        self.feed(&mut |mounted_frame| {
            if let Some([first, last]) = mounted_frame.frame.time_span_ns() {
                let known = span.unwrap_or([first, last]);
                span = Some([known[0].min(first), known[1].max(last)]);
            }
        })?;
        Ok(*self.span_ns.get_or_init(|| span))
    }

    /// The trajectory of a rig that does not move.
    pub(crate) fn still(&self) -> anyhow::Result<Trajectory> {
        let [first_ns, last_ns] = self.span_ns()?.context("the recording holds no frame")?;
        Ok(Trajectory::new(vec![(first_ns, Pose::IDENTITY), (last_ns + 1, Pose::IDENTITY)])?)
    }
}

/// A calibration that is meant for one sensor is meant for one of the session.
fn ensure_meant(calibrations: &[GivenCalibration], session: &Session) -> anyhow::Result<()> {
    let entries = &session.manifest().sensors;
    ensure_named(calibrations, Some(session.manifest()), session.dir())?;
    for given in calibrations {
        let AppliesTo::From(SourceFilter::Sender(address)) = given.applies_to else { continue };
        ensure!(
            entries.iter().any(|entry| entry.source == Some(address)),
            "--calibration {address}=...: {} names no sensor that sends from there; name the file under `calibrations` \
             in the mount file, or without an address where one holds for every Velodyne",
            session.dir().join(crate::recording::file::MANIFEST).display()
        );
    }
    Ok(())
}
