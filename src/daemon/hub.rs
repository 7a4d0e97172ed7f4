//! Points for Foxglove clients: made only while one listens, bounded, never waited for.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use axum::body::Bytes;
use tokio::sync::broadcast;

/// Messages that a slow listener may be behind before it misses some.
const BACKLOG: usize = 8;

/// A message of points.
#[derive(Clone, Debug)]
pub(super) struct Poured {
    /// Number of the sensor.
    pub sensor: usize,
    /// Kernel's stamp of the last packet in it, UTC ns.
    pub time_ns: u64,
    /// A `foxglove.PointCloud`.
    pub message: Bytes,
}

/// What live threads and listeners share.
#[derive(Debug)]
pub(super) struct Hub {
    /// Each sensor's name and how many listen to it.
    sensors: Vec<(String, AtomicUsize)>,
    poured: broadcast::Sender<Poured>,
}

/// Somebody listens to a sensor, until this is dropped.
#[derive(Debug)]
pub(super) struct Wanted {
    hub: Arc<Hub>,
    sensor: usize,
}

impl Hub {
    /// Without clients.
    pub(crate) fn new(names: impl Iterator<Item = String>) -> Self {
        let (poured, _) = broadcast::channel(BACKLOG);
        Self { sensors: names.map(|name| (name, AtomicUsize::new(0))).collect(), poured }
    }

    /// Names of the sensors, in the order of the configuration.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.sensors.iter().map(|(name, _)| name.as_str())
    }

    pub(crate) fn name(&self, sensor: usize) -> &str {
        &self.sensors[sensor].0
    }

    /// Whether anybody listens to a sensor.
    pub(crate) fn is_wanted(&self, sensor: usize) -> bool {
        self.sensors[sensor].1.load(Ordering::Relaxed) > 0
    }

    /// Says that somebody listens to a sensor.
    pub(crate) fn want(self: &Arc<Self>, sensor: usize) -> Wanted {
        self.sensors[sensor].1.fetch_add(1, Ordering::Relaxed);
        Wanted { hub: Arc::clone(self), sensor }
    }

    /// Hands a message to whoever listens.
    pub(crate) fn put(&self, sensor: usize, time_ns: u64, message: Vec<u8>) {
        let _ = self.poured.send(Poured { sensor, time_ns, message: message.into() }); // the last may just have gone
    }

    /// Every message from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<Poured> {
        self.poured.subscribe()
    }
}

impl Drop for Wanted {
    fn drop(&mut self) {
        self.hub.sensors[self.sensor].1.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_clients_no_message_is_made() {
        let hub = Arc::new(Hub::new(["left", "right"].map(str::to_owned).into_iter()));
        let mut messages = hub.listen();
        let (first, second) = (hub.want(1), hub.want(1));
        assert!(!hub.is_wanted(0) && hub.is_wanted(1));
        drop(first);
        assert!(hub.is_wanted(1), "another still listens");
        hub.put(1, 7, vec![1, 2]);
        let poured = messages.try_recv().unwrap();
        assert_eq!((poured.sensor, poured.time_ns, &poured.message[..]), (1, 7, &[1, 2][..]));
        drop(second);
        assert!(!hub.is_wanted(1));
    }
}
