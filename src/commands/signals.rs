//! Ctrl-C, SIGTERM and SIGHUP, counted: the first asks to stop in good order, later ones insist.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use tokio::runtime::Runtime;
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::output;

/// What comes so soon after a signal is the same request, sent twice: `timeout` signals its child and then the group that the
/// child is in, and a terminal's Ctrl-C reaches a wrapper that passes it on. A person does not press Ctrl-C twice in so short a time.
const SAME_REQUEST: Duration = Duration::from_millis(80);

/// Requests to stop.
pub struct StopRequests {
    interrupt: Signal,
    terminate: Signal,
    /// The terminal or the connection is gone; none under `nohup`, which has this signal ignored.
    hangup: Option<Signal>,
    last: Option<Instant>,
}

/// Whether whoever started this program has SIGHUP ignored.
fn is_hangup_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let bits = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    bits.is_some_and(|bits| bits & 1 << (SignalKind::hangup().as_raw_value() - 1) != 0)
}

impl StopRequests {
    /// From now on signals end the program no more. In a runtime.
    pub(crate) fn new() -> std::io::Result<Self> {
        let (interrupt, terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
        let hangup = if is_hangup_ignored() { None } else { Some(signal(SignalKind::hangup())?) };
        Ok(Self { interrupt, terminate, hangup, last: None })
    }

    /// Waits for the next one; may be dropped while it waits.
    pub(crate) async fn next(&mut self) {
        loop {
            let hangup = async {
                match &mut self.hangup {
                    Some(hangup) => hangup.recv().await,
                    None => std::future::pending().await,
                }
            };
            let is_hangup = tokio::select! {
                _ = self.interrupt.recv() => false,
                _ = self.terminate.recv() => false,
                _ = hangup => true,
            };
            let now = Instant::now();
            if is_hangup && self.last.is_some() {
                continue; // a shell and the kernel both say that the terminal is gone: neither insists
            }
            if self.last.is_none_or(|last| now.duration_since(last) > SAME_REQUEST) {
                self.last = Some(now);
                return;
            }
        }
    }
}

/// A runtime on this thread that can wait for signals.
pub(crate) fn runtime() -> anyhow::Result<Runtime> {
    crate::base::files::ensure_descriptors()?;
    tokio::runtime::Builder::new_current_thread().enable_all().build().context("no runtime can be made")
}

/// One message for each [request](StopRequests) from now on, in place of ending the program.
pub(crate) fn interrupts() -> anyhow::Result<Receiver<()>> {
    let runtime = runtime()?;
    let (sender, receiver) = channel();
    let (ready, is_ready) = channel();
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            runtime.block_on(async {
                let mut stop_requests = match StopRequests::new() {
                    Ok(stop_requests) => stop_requests,
                    Err(error) => {
                        let _ = ready.send(Err(error)); // the caller waits for it
                        return;
                    }
                };
                let _ = ready.send(Ok(()));
                loop {
                    stop_requests.next().await;
                    if sender.send(()).is_err() {
                        // no receiver any more: end as the signal would have
                        std::process::exit(130);
                    }
                }
            });
        })
        .context("no thread for signals can be started")?;
    is_ready.recv().context("the thread for signals ended")?.context("signals cannot be caught")?;
    Ok(receiver)
}

/// A flag that the first Ctrl-C (or SIGTERM, or SIGHUP) sets, and what follows it, which is given those that come after.
fn flag_then(follows: impl FnOnce(&Receiver<()>) + Send + 'static) -> anyhow::Result<Arc<AtomicBool>> {
    let interrupts = interrupts()?;
    let flag = Arc::new(AtomicBool::new(false));
    let setter = Arc::clone(&flag);
    let wait = move || {
        if interrupts.recv().is_ok() {
            setter.store(true, Ordering::Relaxed);
            follows(&interrupts);
        }
    };
    std::thread::Builder::new().spawn(wait).context("no thread for signals can be started")?;
    Ok(flag)
}

/// A flag that the first Ctrl-C (or SIGTERM) sets, for work that loses only its present step: what has not
/// ended by itself within `grace` is ended with these last words. A second one ends the program at once.
pub(crate) fn stop_within(grace: Duration, last_words: &'static str) -> anyhow::Result<Arc<AtomicBool>> {
    flag_then(move |later| {
        if later.recv_timeout(grace).is_ok() {
            std::process::exit(130);
        }
        output::say_error(&anyhow::anyhow!(last_words));
        std::process::exit(1);
    })
}

/// A flag that the first Ctrl-C (or SIGTERM) sets; the second one ends the program at once.
pub(crate) fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    flag_then(|later| {
        output::say_notice("stopping in good order; Ctrl-C again ends at once and writes nothing more");
        if later.recv().is_ok() {
            std::process::exit(130);
        }
    })
}
