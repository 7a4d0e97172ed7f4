//! The daemon as a service of systemd: readiness, end, watchdog. Without systemd nothing happens.

use std::sync::Arc;
use std::time::Duration;

use sd_notify::NotifyState;

use crate::daemon::Daemon;

/// A daemon that has not looked at itself for so long is not reported alive.
const HANGS: Duration = Duration::from_secs(5);

/// Everything runs, and where the page is.
pub(crate) fn ready(url: &str) {
    notify(&[NotifyState::Ready, NotifyState::Status(url)]);
}

/// The end began.
pub(crate) fn stopping() {
    notify(&[NotifyState::Stopping]);
}

/// Tells the watchdog that the daemon is alive, for as long as it looks at itself.
pub(crate) async fn feed_watchdog(daemon: Arc<Daemon>) {
    let Some(limit) = sd_notify::watchdog_enabled() else { return };
    let mut beat = tokio::time::interval(limit / 3);
    loop {
        beat.tick().await;
        if daemon.last_look() < HANGS {
            notify(&[NotifyState::Watchdog]);
        }
    }
}

fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!("the service manager takes no message: {error}");
    }
}
