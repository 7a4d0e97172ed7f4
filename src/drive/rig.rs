//! A rig in use: a thread talks to it, so that it holds while the program does something else.

use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::{Applied, Interrupt, Link, Options, Progress, RigController, RigError, RigStatus, open};
use crate::recording::ServoReport;

/// Reports that wait for a slow reader before they are dropped.
const WAITING_REPORTS: usize = 4096;
/// How long the thread talks before it looks for the next job.
const TURN: Duration = Duration::from_millis(10);

/// Who wants reports; `None` once the conversation ended.
type Subscribers = Arc<Mutex<Option<Vec<SyncSender<ServoReport>>>>>;

type Controller = RigController<Box<dyn Link>>;
type Operation = fn(&mut Controller) -> Result<(), RigError>;
type Reply<T> = Sender<Result<T, RigError>>;

enum Job {
    Simple(Operation, Reply<()>),
    Apply(Vec<f64>, Sender<Progress>, Reply<Applied>),
    Check(Vec<f64>, Reply<()>),
    Status(Reply<RigStatus>),
    /// An emergency stop, unless an interrupt has made one since this moment.
    EmergencyStop(Instant, Reply<RigStatus>),
    Quit,
}

/// A connected rig. Dropping it disarms: the axes hold.
///
/// ```
/// use outrigger::mock::rig::{MockConfig, MockRig};
/// use outrigger::drive::Rig;
///
/// let mock = MockRig::start(MockConfig::default(), 1)?; // behind a pseudo terminal, as a board behind its serial line
/// let rig = Rig::connect(mock.path())?;
/// assert!(rig.apply(&[0.1, -0.1]).is_err(), "nothing moves that is not armed");
/// rig.arm()?;
/// rig.home()?;
/// let applied = rig.apply(&[0.1, -0.1])?;
/// for (axis, asked_rad) in applied.axes.iter().zip([0.1, -0.1]) {
///     assert!((axis.measured_rad - asked_rad).abs() < 0.3_f64.to_radians());
///     assert_eq!(axis.source, "measured");
/// }
/// assert!(rig.apply(&[2.0, 0.0]).is_err(), "beyond its limits");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Rig {
    jobs: Sender<Job>,
    interrupt: Interrupt,
    subscribers: Subscribers,
    failure: Arc<Mutex<Option<RigError>>>,
    thread: Option<JoinHandle<()>>,
    axes: usize,
}

impl Rig {
    /// Connects with the usual options; the address is a serial device's (or a pty's) path, or what [`open`] knows.
    pub fn connect(address: impl AsRef<Path>) -> Result<Self, RigError> {
        Self::connect_with(address, Options::new_session())
    }

    /// Connects with these options.
    pub fn connect_with(address: impl AsRef<Path>, options: Options) -> Result<Self, RigError> {
        Self::connect_over(open(&address.as_ref().to_string_lossy())?, options)
    }

    /// Connects over any line.
    pub(crate) fn connect_over(link: Box<dyn Link>, options: Options) -> Result<Self, RigError> {
        let mut controller = RigController::connect(link, options)?;
        let (interrupt, axes) = (controller.interrupt(), controller.axis_count());
        let (jobs, waiting) = channel();
        let failure = Arc::new(Mutex::new(None));
        let subscribers: Subscribers = Arc::new(Mutex::new(Some(Vec::new())));
        let to = subscribers.clone();
        controller.reports_to(Box::new(move |report| {
            lock(&to).iter_mut().for_each(|subscribers| {
                subscribers.retain(|subscriber| {
                    !matches!(subscriber.try_send(report.clone()), Err(TrySendError::Disconnected(_)))
                });
            });
        }));
        let worker =
            Worker { controller, waiting, subscribers: subscribers.clone(), failure: failure.clone() };
        let thread = std::thread::Builder::new()
            .name("rig".into())
            .spawn(move || worker.run())
            .map_err(|_| RigError::Closed)?;
        Ok(Self { jobs, interrupt, subscribers, failure, thread: Some(thread), axes })
    }

    /// How many axes it has.
    pub(crate) fn axis_count(&self) -> usize {
        self.axes
    }

    /// Stops the present move, from any thread.
    pub(crate) fn interrupt(&self) -> Interrupt {
        self.interrupt.clone()
    }

    /// Readings of every axis, about 20 a second, from now on. The channel closes when the conversation ends;
    /// [`Rig::status`] then says why.
    pub fn reports(&self) -> Receiver<ServoReport> {
        let (sender, receiver) = sync_channel(WAITING_REPORTS);
        if let Some(subscribers) = lock(&self.subscribers).as_mut() {
            subscribers.push(sender);
        }
        receiver
    }

    /// Allows motion.
    pub fn arm(&self) -> Result<(), RigError> {
        self.simple(RigController::arm)
    }

    /// Forbids motion; the axes hold.
    pub(crate) fn disarm(&self) -> Result<(), RigError> {
        self.simple(RigController::disarm)
    }

    /// Makes positions trusted. Needs an armed rig.
    pub fn home(&self) -> Result<(), RigError> {
        self.simple(RigController::home)
    }

    /// Decelerates and holds; stays armed.
    pub fn hold(&self) -> Result<(), RigError> {
        self.simple(RigController::hold)
    }

    /// Decelerates, holds, disarms.
    pub(crate) fn stop(&self) -> Result<(), RigError> {
        self.simple(RigController::stop)
    }

    /// Stops as fast as the rig can and latches that.
    pub(crate) fn e_stop(&self) -> Result<(), RigError> {
        self.simple(RigController::e_stop)
    }

    /// The same for whoever has raised the [interrupt](Interrupt) since `asked`: answers as soon as the rig is seen to have
    /// stopped. The fault that this latches comes with a later status.
    pub(crate) fn e_stop_since(&self, asked: Instant) -> Result<RigStatus, RigError> {
        self.ask(|reply| Job::EmergencyStop(asked, reply))
    }

    /// Clears latched faults without a cause any more.
    pub(crate) fn clear_faults(&self) -> Result<(), RigError> {
        self.simple(RigController::clear_faults)
    }

    /// Whether these pitches may be applied.
    pub(crate) fn check(&self, pitches_rad: &[f64]) -> Result<(), RigError> {
        self.ask(|reply| Job::Check(pitches_rad.to_vec(), reply))
    }

    /// Moves every axis to its pitch and returns where they stand.
    pub fn apply(&self, pitches_rad: &[f64]) -> Result<Applied, RigError> {
        self.apply_with(pitches_rad, |_| {})
    }

    /// The same, telling how far it is.
    pub fn apply_with(
        &self,
        pitches_rad: &[f64],
        mut progress: impl FnMut(&Progress),
    ) -> Result<Applied, RigError> {
        let (progress_sender, progress_receiver) = channel();
        let (sender, receiver) = channel();
        let job = Job::Apply(pitches_rad.to_vec(), progress_sender, sender);
        self.jobs.send(job).map_err(|_| self.why_closed())?;
        for step in progress_receiver {
            progress(&step);
        }
        receiver.recv().unwrap_or_else(|_| Err(self.why_closed()))
    }

    /// Everything known about it now.
    pub fn status(&self) -> Result<RigStatus, RigError> {
        self.ask(Job::Status)
    }

    fn simple(&self, operation: Operation) -> Result<(), RigError> {
        self.ask(|reply| Job::Simple(operation, reply))
    }

    fn ask<T>(&self, job: impl FnOnce(Reply<T>) -> Job) -> Result<T, RigError> {
        let (sender, receiver) = channel();
        self.jobs.send(job(sender)).map_err(|_| self.why_closed())?;
        receiver.recv().unwrap_or_else(|_| Err(self.why_closed()))
    }

    fn why_closed(&self) -> RigError {
        lock(&self.failure).clone().unwrap_or(RigError::Closed)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        let _ = self.jobs.send(Job::Quit);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Worker {
    controller: Controller,
    waiting: Receiver<Job>,
    subscribers: Subscribers,
    failure: Arc<Mutex<Option<RigError>>>,
}

impl Worker {
    fn run(mut self) {
        loop {
            let result = self.controller.idle(TURN);
            let result = result.and_then(|()| self.controller.apply_interrupt());
            match result {
                Ok(()) | Err(RigError::Interrupted { .. } | RigError::Refused { .. }) => {}
                Err(error) => return self.end(error),
            }
            while let Ok(job) = self.waiting.try_recv() {
                if let Job::Quit = job {
                    // the watchdog would call a silent host a fault; a disarmed rig holds in peace
                    let _ = self.controller.disarm();
                    return;
                }
                self.work(job);
            }
        }
    }

    fn work(&mut self, job: Job) {
        // a caller that went away does not want its answer
        match job {
            Job::Simple(operation, reply) => drop(reply.send(operation(&mut self.controller))),
            Job::Apply(pitches, progress, reply) => {
                let applied = self.controller.apply(&pitches, |step| drop(progress.send(step.clone())));
                let _ = reply.send(applied);
            }
            Job::Check(pitches, reply) => drop(reply.send(self.controller.check(&pitches).map(drop))),
            Job::Status(reply) => drop(reply.send(self.controller.status())),
            Job::EmergencyStop(asked, reply) => {
                let stopped = self.controller.stop_since(asked);
                let _ = reply.send(stopped.and_then(|()| self.controller.status()));
                // before the next job: whoever clears faults is to find it; a line that fails shows in the next turn
                let _ = self.controller.hear_fault();
            }
            Job::Quit => {}
        }
    }

    fn end(self, error: RigError) {
        *lock(&self.failure) = Some(error);
    }
}

impl Drop for Worker {
    /// Closes the channels of reports.
    fn drop(&mut self) {
        *lock(&self.subscribers) = None;
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
