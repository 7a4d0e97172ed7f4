//! Ctrl-C, counted: the first asks to stop in good order, later ones insist.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use anyhow::Context as _;

use super::output;

/// One message for each Ctrl-C (or SIGTERM) from now on, in place of ending the program.
pub fn interrupts() -> anyhow::Result<Receiver<()>> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("no runtime for signals can be made")?;
    let (sender, receiver) = channel();
    let (ready, is_ready) = channel();
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            runtime.block_on(async {
                use tokio::signal::unix::{SignalKind, signal};
                let streams = signal(SignalKind::interrupt())
                    .and_then(|interrupt| Ok((interrupt, signal(SignalKind::terminate())?)));
                let (mut interrupt, mut terminate) = match streams {
                    Ok(streams) => streams,
                    Err(error) => {
                        let _ = ready.send(Err(error)); // the caller waits for it
                        return;
                    }
                };
                let _ = ready.send(Ok(()));
                loop {
                    tokio::select! {
                        _ = interrupt.recv() => {}
                        _ = terminate.recv() => {}
                    }
                    if sender.send(()).is_err() {
                        // nobody counts any more: end as the signal would have
                        std::process::exit(130);
                    }
                }
            });
        })
        .context("no thread for signals can be started")?;
    is_ready.recv().context("the thread for signals ended")?.context("signals cannot be caught")?;
    Ok(receiver)
}

/// A flag that the first Ctrl-C (or SIGTERM) sets, and what follows it, which is given those that come after.
fn flag_then(follows: impl FnOnce(&Receiver<()>) + Send + 'static) -> anyhow::Result<Arc<AtomicBool>> {
    let interrupts = interrupts()?;
    let flag = Arc::new(AtomicBool::new(false));
    let setter = Arc::clone(&flag);
    std::thread::spawn(move || {
        if interrupts.recv().is_ok() {
            setter.store(true, Ordering::Relaxed);
            follows(&interrupts);
        }
    });
    Ok(flag)
}

/// A flag that the first Ctrl-C (or SIGTERM) sets, for work of which nothing is lost but what is under way: what has not
/// ended by itself within `grace` is ended with these last words. A second one ends the program at once.
pub fn stop_within(grace: Duration, last_words: &'static str) -> anyhow::Result<Arc<AtomicBool>> {
    flag_then(move |later| {
        if later.recv_timeout(grace).is_ok() {
            std::process::exit(130);
        }
        output::say_error(&anyhow::anyhow!(last_words));
        std::process::exit(1);
    })
}

/// A flag that the first Ctrl-C (or SIGTERM) sets; the second one ends the program at once.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    flag_then(|later| {
        output::say_notice("stopping in good order; Ctrl-C again ends at once and writes nothing more");
        if later.recv().is_ok() {
            std::process::exit(130);
        }
    })
}
