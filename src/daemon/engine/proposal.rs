//! Better pitches while recording: proposed from the map so far, and driven to when the operator agrees, with a new
//! session from there on.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::{Core, Daemon};
use crate::daemon::live;
use crate::daemon::recorder::RecorderError;
use crate::daemon::rig::RigCommandError;
use crate::daemon::status::Proposal;
use crate::design::reconfigure::{self, Answer, Question, ReconfigureError};
use crate::live::receive::now_ns;
use crate::rig::{MountedSensor, Rig};
use crate::simulate::view::{MapCells, MapView};

/// Sets of pitches that are looked at.
const EVALUATIONS: usize = 60;
/// Less than this share more is not worth a move.
const WORTH: f64 = 0.02;
/// The rig has moved when an axis is so far from where it was, degrees.
const MOVED_DEG: f64 = 1.0;

/// Why there is no proposal, or nothing was done about one.
#[derive(Debug, thiserror::Error)]
pub enum ProposalError {
    /// There is nothing to go by, and nothing to split.
    #[error("not recording: pitches are proposed from what is being recorded")]
    NotRecording,
    /// One is being thought about.
    #[error("a proposal is being made already: wait for it")]
    Busy,
    /// The rig moves meanwhile or another was made.
    #[error("that is not the newest proposal: look at it again, or ask for another")]
    Outdated,
    /// The rig stands elsewhere.
    #[error("the rig has moved since the proposal was made: ask for another")]
    Moved,
    /// It is no better than the present pitches.
    #[error("the proposal is no better than where the rig stands: nothing is moved")]
    NotBetter,
    /// The daemon does not know where its sensors sit, or not which axis turns which.
    #[error(
        "the mount names {sensors} sensors and the rig has {axes} axes: pitches can be proposed where each axis turns one \
         sensor"
    )]
    Axes {
        /// Sensors of the mount.
        sensors: usize,
        /// Axes of the rig.
        axes: usize,
    },
    /// Angles are not known.
    #[error("the angle of axis {0} is not known: home the rig first")]
    Unknown(usize),
    /// No proposal can be made.
    #[error(transparent)]
    Reconfigure(#[from] ReconfigureError),
    /// No thread to think on.
    #[error("no thread to think on: {0}")]
    Thread(String),
    /// The rig refused; the recording goes on as it was.
    #[error(transparent)]
    Rig(#[from] RigCommandError),
    /// The rig moved, and the recorder did not split the session.
    #[error("the rig has moved, and the session was not split there: {0}")]
    NotSplit(RecorderError),
}

/// The newest proposal.
#[derive(Debug, Default)]
pub(in crate::daemon) struct Proposals {
    newest: Mutex<Option<Proposal>>,
    made: AtomicU64,
    is_thinking: AtomicBool,
}

impl Proposals {
    pub(crate) fn newest(&self) -> Option<Proposal> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// There is none any more.
    pub(crate) fn forget(&self) {
        self.put(None);
    }

    /// One is being made.
    pub(crate) fn is_thinking(&self) -> bool {
        self.is_thinking.load(Ordering::Relaxed)
    }

    fn put(&self, proposal: Option<Proposal>) {
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) = proposal;
    }
}

/// Says that thinking is over, however it ends.
struct Thinking<'a>(&'a AtomicBool);

impl Drop for Thinking<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Daemon {
    /// Thinks about better pitches for what was recorded so far; takes some seconds.
    pub(crate) fn propose(&self) -> Result<Proposal, ProposalError> {
        let core = self.core();
        if !self.is_recording() {
            return Err(ProposalError::NotRecording);
        }
        if core.proposals.is_thinking.swap(true, Ordering::Relaxed) {
            return Err(ProposalError::Busy);
        }
        let thinking = Thinking(&core.proposals.is_thinking);
        let proposal = self.think()?;
        drop(thinking);
        core.journal.tell("proposal", proposal.words.clone());
        core.proposals.put(Some(proposal.clone()));
        Ok(proposal)
    }

    /// Drives to a proposal that the operator agrees to, then goes on in a new session with its mount.
    pub(crate) fn agree(&self, id: u64) -> Result<Proposal, ProposalError> {
        let core = self.core();
        if !self.is_recording() {
            return Err(ProposalError::NotRecording);
        }
        let newest = core.proposals.newest().filter(|newest| newest.id == id);
        let proposal = newest.ok_or(ProposalError::Outdated)?;
        if !proposal.is_better {
            return Err(ProposalError::NotBetter);
        }
        let rig = self.rig()?;
        let (stands_deg, _) = axes(core)?;
        let has_moved = |(is_deg, was_deg): (&f64, &f64)| (is_deg - was_deg).abs() > MOVED_DEG;
        if stands_deg.iter().zip(&proposal.now_deg).any(has_moved) {
            return Err(ProposalError::Moved);
        }
        rig.apply(&proposal.pitches_deg)?;
        core.proposals.forget();
        let mount = core.site.mount.clone().map(|mut mount| {
            for (sensor, pitch_deg) in mount.sensors.iter_mut().zip(&proposal.pitches_deg) {
                sensor.pitch_deg = *pitch_deg;
            }
            mount
        });
        self.split(mount).map_err(ProposalError::NotSplit)?;
        rig.record_with(&proposal.pitches_deg);
        core.journal.tell("reconfigured", format!("the rig stands at {}", listed(&proposal.pitches_deg)));
        Ok(proposal)
    }

    fn think(&self) -> Result<Proposal, ProposalError> {
        let core = self.core();
        let (now_deg, limits_rad) = axes(core)?;
        let mut rig: Rig = core.site.rig.clone();
        for (sensor, pitch_deg) in rig.sensors.iter_mut().zip(&now_deg) {
            sensor.mount.pitch_rad = pitch_deg.to_radians();
        }
        let (map, poses, map_is_full) = core.survey.now();
        let keep_out = self.rig()?.keep_out();
        let is_excluded = |pitches_rad: &[f64]| match *pitches_rad {
            [first_rad, second_rad] => {
                let urad = |pitch_rad: f64| (pitch_rad * 1e6).round() as i32;
                let from_urad = [now_deg[0], now_deg[1]].map(|pitch_deg| urad(pitch_deg.to_radians()));
                keep_out.crosses(from_urad, [urad(first_rad), urad(second_rad)], 0)
            }
            _ => false, // a region is one of pairs
        };
        let view = MapView::new(&map, &poses);
        let question =
            Question { view: &view, rig: &rig, limits_rad: &limits_rad, is_excluded: &is_excluded };
        let id = core.proposals.made.fetch_add(1, Ordering::Relaxed) + 1;
        // its own, single thread of low priority: the recorder needs the others
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(1).start_handler(|_| live::lower_priority()).build();
        let pool = pool.map_err(|error| ProposalError::Thread(error.to_string()))?;
        let (answer, cells) = pool.install(|| {
            let answer = reconfigure::propose(&question, id, EVALUATIONS)?;
            let cells = [&rig, &answer.rig].map(|rig| view.cells(rig));
            Ok::<_, ReconfigureError>((answer, cells))
        })?;
        Ok(self.proposal(id, now_deg, (&answer, cells), poses.len(), map_is_full))
    }

    fn proposal(
        &self,
        id: u64,
        now_deg: Vec<f64>,
        (answer, [now, proposed]): (&Answer, [MapCells; 2]),
        poses: usize,
        full: bool,
    ) -> Proposal {
        let pitch_deg = |sensor: &MountedSensor| (sensor.mount.pitch_rad.to_degrees() * 10.0).round() / 10.0;
        let pitches_deg: Vec<f64> = answer.rig.sensors.iter().map(pitch_deg).collect();
        let is_better = answer.best.union >= (1.0 + WORTH) * answer.now.union.max(1.0);
        let words = if is_better {
            format!(
                "pitches {} would see {} cells of the surface mapped so far and look into {} unknown ones; at {} it is {} \
                 and {}",
                listed(&pitches_deg),
                proposed.surface,
                proposed.frontier,
                listed(&now_deg),
                now.surface,
                now.frontier
            )
        } else {
            format!("no pitches were found that see clearly more than the present {}", listed(&now_deg))
        };
        let pose = self.core().coverage.pose();
        let time_ns = now_ns();
        Proposal {
            id,
            time_ns,
            now_deg,
            pitches_deg,
            now,
            proposed,
            is_better,
            poses,
            pose,
            map_is_full: full,
            words,
        }
    }
}

/// Where each axis stands, degrees, and within which pitches it may move by rig and configuration, rad.
fn axes(core: &Core) -> Result<(Vec<f64>, Vec<[f64; 2]>), ProposalError> {
    let rig = core.rig.as_ref().ok_or(RigCommandError::NoRig)?;
    if core.site.mount.is_none() {
        return Err(RigCommandError::NoMount.into());
    }
    let state = rig.state();
    let connected = state.connected.then_some(state.status).flatten();
    let status =
        connected.ok_or_else(|| RigCommandError::NotConnected(state.error.clone().unwrap_or_default()))?;
    let (sensors, axes) = (core.site.rig.sensors.len(), status.axes.len());
    if sensors != axes {
        return Err(ProposalError::Axes { sensors, axes });
    }
    let mut stands_deg = Vec::new();
    let mut limits_rad = Vec::new();
    for axis in &status.axes {
        if !axis.homed || axis.source == "stale" {
            return Err(ProposalError::Unknown(axis.axis));
        }
        stands_deg.push(axis.position_deg);
        let [low_deg, high_deg] = axis.limits_deg;
        let (low_rad, high_rad) = rig.limits_rad(axis.axis).unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
        limits_rad.push([low_rad.max(low_deg.to_radians()), high_rad.min(high_deg.to_radians())]);
    }
    Ok((stands_deg, limits_rad))
}

fn listed(pitches_deg: &[f64]) -> String {
    let all: Vec<String> = pitches_deg.iter().map(|pitch_deg| format!("{pitch_deg:+.1}°")).collect();
    all.join(", ")
}
