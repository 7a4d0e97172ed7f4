//! The daemon itself: everything put together, looked at several times a second, and ended in order.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use sensors::ouster::Metadata;
use tokio::sync::{broadcast, watch};

use super::coverage::LiveCoverage;
use super::hub::Hub;
use super::intake::Intake;
use super::journal::Journal;
use super::live::{self, DecodeQueue, Subject};
use super::log::Log;
use super::problems;
use super::recorder::{Recorder, RecorderError, RecorderSettings, SessionAttachments};
use super::rig::{RigCommandError, RigHost, RigSettings};
use super::session_sink::SessionSink;
use super::site::{Motion, Site};
use super::status::{LastSession, RecorderStatus, RigState, Status};
use super::supervision::{Pulse, Role, Supervision};
use super::surroundings::Surroundings;
use super::survey::Survey;
use crate::drive::RigError;
use crate::live::config::SensorConfig;
use crate::live::receive::{self, Listen, ReceiveError, now_ns};
use crate::recording::SensorInfo;
use crate::rig::MountFile;
use crate::world::coverage::Coverage;
use crate::world::scene::VoxelMapError;

mod sampler;
mod memory;
mod pages;
mod proposal;

pub use proposal::ProposalError;

use proposal::Proposals;
use sampler::Sampler;

/// How often the state is put together.
const LOOK: Duration = Duration::from_millis(200);
/// How often changed cells are sent to pages.
const SEND_CELLS: Duration = Duration::from_secs(1);
/// Messages that a slow page may be behind before it misses some.
const PAGE_BACKLOG: usize = 64;

/// A sensor, as configured.
#[derive(Clone, Debug)]
pub struct SensorSettings {
    /// Name, model and addresses.
    pub config: SensorConfig,
    /// Metadata of an Ouster, its text.
    pub metadata: Option<String>,
}

/// Everything that the daemon needs to start.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Sensors.
    pub sensors: Vec<SensorSettings>,
    /// Kernel buffers and queues.
    pub receive: receive::Options,
    /// Sessions.
    pub recorder: RecorderSettings,
    /// The rig, where there is one.
    pub rig: Option<RigSettings>,
    /// Mounts, scene and trajectory.
    pub site: Site,
    /// Text of the rig.toml, stored with each session.
    pub config: Option<String>,
    /// Who watches the threads.
    pub supervision: Arc<Supervision>,
    /// The log, where it is this program's.
    pub log: Option<Log>,
}

/// Why the daemon cannot start.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// A port cannot be had.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The rig is another program's.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// Sessions cannot be written.
    #[error(transparent)]
    Recorder(#[from] RecorderError),
    /// Metadata that are none.
    #[error("metadata of {name}: {reason}")]
    Metadata {
        /// The sensor.
        name: String,
        /// What is wrong.
        reason: String,
    },
    /// Cells that are none.
    #[error(transparent)]
    Map(#[from] VoxelMapError),
    /// The system refuses a thread.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// How the daemon ended.
#[derive(Clone, Debug)]
pub struct Ending {
    /// The recorder's last state.
    pub recorder: RecorderStatus,
    /// Packets were lost while recording, or a recording ended by itself.
    pub data_lost: bool,
    /// Components that died, and how.
    pub deaths: Vec<String>,
}

/// A running daemon.
pub struct Daemon {
    core: Arc<Core>,
    recorder: Recorder,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

/// What the threads of the daemon share.
pub(super) struct Core {
    pub(super) sensors: Vec<SensorSettings>,
    pub(super) intake: Arc<Intake>,
    /// One per sensor.
    pub(super) decode_queues: Mutex<Vec<DecodeQueue>>,
    /// Streams of each sensor.
    pub(super) streams: Vec<Vec<usize>>,
    pub(super) rig: Option<RigHost>,
    pub(super) journal: Arc<Journal>,
    pub(super) coverage: Arc<LiveCoverage>,
    pub(super) site: Arc<Site>,
    motion: Arc<Motion>,
    pages: broadcast::Sender<Bytes>,
    hub: Arc<Hub>,
    pub(super) survey: Arc<Survey>,
    pub(super) proposals: Proposals,
    supervision: Arc<Supervision>,
    log: Option<Log>,
    sink: Arc<SessionSink>,
    status: watch::Sender<Arc<Status>>,
    quit: AtomicBool,
}

impl Daemon {
    /// Binds every port, finds the rig, opens the folder of sessions; all or nothing.
    pub(crate) fn start(settings: Settings) -> Result<Self, DaemonError> {
        let Settings { sensors, receive, recorder, rig, site, config, supervision, log } = settings;
        let (journal, lines) = Journal::new();
        let journal = Arc::new(journal);
        let site = Arc::new(site);
        let motion = Arc::new(Motion::new(site.rig.sensors.len()));
        let pose = if site.trajectory.is_some() { "trajectory" } else { "standing" };
        let seen = Coverage::new(site.grid(), sensors.len());
        let coverage = Arc::new(LiveCoverage::new(seen, pose, site.scene.is_some()));
        let (pages, _) = broadcast::channel(PAGE_BACKLOG);
        let hub = Arc::new(Hub::new(sensors.iter().map(|sensor| sensor.config.name.clone())));
        let survey = Arc::new(Survey::new(site.voxel_m)?);
        let mut listens: Vec<Listen> = Vec::new();
        let (mut sensor_of, mut streams, mut infos) = (Vec::new(), Vec::new(), Vec::new());
        for (sensor, SensorSettings { config, metadata }) in sensors.iter().enumerate() {
            let mut mine = Vec::new();
            for stream in config.streams() {
                mine.push(listens.len());
                sensor_of.push(sensor);
                let metadata = stream.metadata.is_some().then(|| metadata.clone()).flatten();
                infos.push((stream.listen.clone(), metadata));
                listens.push(stream.listen);
            }
            streams.push(mine);
        }
        let around = Surroundings {
            site: Arc::clone(&site),
            motion: Arc::clone(&motion),
            coverage: Arc::clone(&coverage),
            journal: Arc::clone(&journal),
            pages: pages.clone(),
            hub: Arc::clone(&hub),
            survey: Arc::clone(&survey),
        };
        for sensor in &sensors {
            if let Some(error) = site.unseated(&sensor.config.name) {
                journal.tell_of(&sensor.config.name, "unseated", error.to_string());
            }
        }
        let mut threads = Vec::new();
        let mut decode_queues = Vec::new();
        for (sensor, settings) in sensors.iter().enumerate() {
            let subject = Subject {
                sensor,
                name: settings.config.name.clone(),
                model: settings.config.model.clone(),
                metadata: metadata_of(settings)?,
            };
            let (decode_queue, thread) = live::start(subject, around.clone(), &supervision)?;
            decode_queues.push(decode_queue);
            threads.push(thread);
        }
        // before the first packet: what is seen is drawn by the angles at which the axes stand
        let rig = rig
            .map(|rig| RigHost::start(rig, Arc::clone(&journal), Arc::clone(&motion), &supervision))
            .transpose()?;
        let of_streams: Vec<DecodeQueue> =
            sensor_of.iter().map(|sensor| decode_queues[*sensor].clone()).collect();
        let sink = Arc::new(SessionSink::new(recorder.held_up));
        let names: Vec<String> =
            sensor_of.iter().map(|sensor| sensors[*sensor].config.name.clone()).collect();
        let intake = Intake::start(&listens, &sensor_of, receive, &sink, &of_streams, &names, &supervision)?;
        let intake = Arc::new(intake);
        drop(of_streams);
        let attachments = SessionAttachments {
            sensors: infos
                .into_iter()
                .enumerate()
                .map(|(stream, (listen, metadata))| SensorInfo::of(&listen, intake.address(stream), metadata))
                .collect(),
            config,
            mount: site.mount.clone(),
            calibrations: site.calibrations.clone(),
            trajectory: site.recorded_trajectory(),
        };
        let recorder = Recorder::start(
            recorder,
            attachments,
            Arc::clone(&intake),
            Arc::clone(&sink),
            Arc::clone(&journal),
            lines,
            &supervision,
        )?;
        if recorder.status().recording {
            begin_trajectory(&site, &motion);
            survey.begin();
        }
        let first = sampler::empty(&recorder.status());
        let core = Arc::new(Core {
            sensors,
            intake,
            decode_queues: Mutex::new(decode_queues),
            streams,
            rig,
            journal,
            coverage,
            site,
            motion,
            pages,
            hub,
            survey,
            proposals: Proposals::default(),
            supervision,
            log,
            sink,
            status: watch::Sender::new(Arc::new(first)),
            quit: AtomicBool::new(false),
        });
        // it ends by itself; no thread waits for it
        drop(spawn("predict", Role::Passing, &core, |core, _| core.predict())?);
        let recorder_status = recorder.reader();
        let look = move |core: &Core, pulse: &Pulse| core.watch(&recorder_status, pulse);
        threads.push(spawn("state", Role::Essential, &core, look)?);
        Ok(Self { core, recorder, threads: Mutex::new(threads) })
    }

    /// The state, put together at most a fifth of a second ago; its ages, components and log are those of now.
    pub(crate) fn status(&self) -> Status {
        let core = &self.core;
        let mut status = core.status.borrow().aged();
        status.components = core.supervision.components();
        status.log = core.log.as_ref().map(Log::status).unwrap_or_default();
        problems::of_daemon(&mut status);
        status
    }

    /// Waits until something dies that the daemon cannot be without: what, and how.
    pub(crate) async fn death(&self) -> String {
        self.core.supervision.death().await
    }

    /// Every new state.
    pub(crate) fn states(&self) -> watch::Receiver<Arc<Status>> {
        self.core.status.subscribe()
    }

    /// Since the state was last put together: a daemon that hangs does not.
    pub(crate) fn last_look(&self) -> Duration {
        self.core.status.borrow().as_of.elapsed()
    }

    /// Begins to record; the session's name.
    pub(crate) fn begin_recording(&self, label: String) -> Result<String, RecorderError> {
        let name = self.recorder.begin(label)?;
        self.core.coverage.clear();
        begin_trajectory(&self.core.site, &self.core.motion);
        self.core.survey.begin();
        self.core.proposals.forget();
        Ok(name)
    }

    pub(crate) fn end_recording(&self) -> Result<LastSession, RecorderError> {
        let last = self.recorder.end()?;
        self.core.survey.end();
        self.core.proposals.forget();
        Ok(last)
    }

    pub(super) fn core(&self) -> &Core {
        &self.core
    }

    pub(super) fn is_recording(&self) -> bool {
        self.recorder.status().recording
    }

    /// Goes on in a new session with this mount; its name.
    pub(super) fn split(&self, mount: Option<MountFile>) -> Result<String, RecorderError> {
        self.recorder.split(mount)
    }

    /// The rig does something; `work` is given it.
    pub(super) fn rig(&self) -> Result<&RigHost, RigCommandError> {
        self.core.rig.as_ref().ok_or(RigCommandError::NoRig)
    }

    /// The rig now, not as of the last look.
    pub(crate) fn rig_state(&self) -> Option<RigState> {
        self.core.rig.as_ref().map(RigHost::state)
    }

    /// Latency from the kernel's stamp until points leave for the page, by sensor.
    pub(crate) fn picture_latency(&self) -> Vec<super::Percentiles> {
        self.core.decode_queues().iter().map(|decode_queue| decode_queue.latency().percentiles()).collect()
    }

    /// Ends everything: what was received is written, the session closed, the rig disarmed.
    pub(crate) fn stop(&self) -> Ending {
        self.core.supervision.end();
        self.core.journal.tell("stopping", "the daemon ends");
        self.core.intake.stop();
        let mut recorder = self.recorder.quit();
        // a recorder that died has left its session open
        if let Some(session) = self.core.sink.exchange(None) {
            recorder.failed |= session.close(Some(&self.core.intake.tally())).is_err();
            recorder.ended_early = true;
        }
        self.core.quit.store(true, Ordering::Relaxed);
        self.core.decode_queues().clear();
        if let Some(rig) = &self.core.rig {
            rig.quit();
        }
        for thread in self.threads.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            let _ = thread.join(); // whoever watches it says how it ended
        }
        let data_lost = recorder.lost > 0 || recorder.failed || recorder.ended_early;
        Ending { recorder, data_lost, deaths: self.core.supervision.deaths() }
    }
}

impl Core {
    pub(super) fn decode_queues(&self) -> std::sync::MutexGuard<'_, Vec<DecodeQueue>> {
        self.decode_queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn predict(&self) {
        live::lower_priority();
        // its own, single thread: the pool of the process would take every core from the recorder
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(1).start_handler(|_| live::lower_priority()).build();
        let predicted = pool.ok().and_then(|pool| pool.install(|| self.site.predict()));
        self.coverage.set_predicted(predicted.as_ref());
    }

    fn watch(&self, recorder: &dyn Fn() -> RecorderStatus, pulse: &Pulse) {
        let mut sampler = Sampler::new(self);
        let mut sent = (Instant::now(), 0);
        let mut deaths_reported = 0;
        while !self.quit.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
            pulse.beat();
            for death in self.supervision.deaths().into_iter().skip(deaths_reported) {
                deaths_reported += 1;
                self.journal.tell("component_dead", death);
            }
            self.status.send_replace(Arc::new(sampler.sample(self, recorder())));
            let version = self.coverage.version();
            if self.pages.receiver_count() > 0 && version != sent.1 && sent.0.elapsed() >= SEND_CELLS {
                sent = (Instant::now(), version);
                let _ = self.pages.send(self.coverage.message(now_ns()).into()); // the last page may just have gone
            }
        }
    }
}

fn spawn(
    name: &str,
    role: Role,
    core: &Arc<Core>,
    work: impl FnOnce(&Core, &Pulse) + Send + 'static,
) -> Result<JoinHandle<()>, std::io::Error> {
    let shared = Arc::clone(core);
    core.supervision.spawn(name, role, move |pulse| work(&shared, pulse))
}

fn begin_trajectory(site: &Site, motion: &Motion) {
    if let Some(trajectory) = site.trajectory.as_ref().filter(|_| site.starts_with_recording) {
        motion.begin(trajectory, now_ns());
    }
}

fn metadata_of(sensor: &SensorSettings) -> Result<Option<(Metadata, String)>, DaemonError> {
    let Some(text) = &sensor.metadata else { return Ok(None) };
    let name = &sensor.config.name;
    let metadata = Metadata::parse(text, name)
        .map_err(|error| DaemonError::Metadata { name: name.clone(), reason: error.to_string() })?;
    Ok(Some((metadata, name.clone())))
}
