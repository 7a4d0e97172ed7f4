//! Sockets to session and live threads: one receive worker per sensor, so that a storm on one port is that sensor's loss alone.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::live::DecodeQueue;
use super::session_sink::SessionSink;
use super::supervision::{Pulse, Role, Supervision};
use crate::live::receive::{
    Datagram, Listen, Memory, Monitor, Options, ReceiveError, Receiver, SensorCounters, Stop, Tally, now_ns,
};

/// Datagrams written under one lock of the session.
const BATCH: usize = 64;

/// All receive workers. Streams are numbered over all of them, in the order of the configuration.
pub(super) struct Intake {
    workers: Vec<ReceiveWorker>,
    /// Worker of each stream and its place there.
    places: Vec<(usize, usize)>,
    /// Bytes of packets that may wait in each worker.
    queue_bytes: usize,
}

struct ReceiveWorker {
    monitor: Monitor,
    stop: Stop,
    /// When the present write began, UTC ns; 0 while none is.
    writing_since_ns: Arc<AtomicU64>,
    /// Packets handed on, by place.
    handed: Arc<Vec<AtomicU64>>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// A bound worker that does not run yet.
struct Bound {
    receiver: Receiver,
    streams: Vec<usize>,
}

impl Intake {
    /// Binds every socket, all or none, and starts to receive. `queues` has the live thread of each stream, `names` its sensor.
    pub(crate) fn start(
        listens: &[Listen],
        sensor_of: &[usize],
        options: Options,
        sink: &Arc<SessionSink>,
        queues: &[DecodeQueue],
        names: &[String],
        supervision: &Arc<Supervision>,
    ) -> Result<Self, ReceiveError> {
        let mut places = vec![(0, 0); listens.len()];
        let mut bound = Vec::new();
        for (worker, streams) in groups(listens, sensor_of).into_iter().enumerate() {
            let mine: Vec<Listen> = streams.iter().map(|stream| listens[*stream].clone()).collect();
            let receiver = Receiver::start(&mine, options)?;
            for (place, stream) in streams.iter().enumerate() {
                places[*stream] = (worker, place);
            }
            bound.push(Bound { receiver, streams });
        }
        let workers =
            bound.into_iter().map(|bound| ReceiveWorker::start(bound, sink, queues, names, supervision));
        Ok(Self { workers: workers.collect::<Result<_, _>>()?, places, queue_bytes: options.queue_bytes })
    }

    /// Local address of a stream.
    pub(crate) fn address(&self, stream: usize) -> std::net::SocketAddr {
        let (worker, place) = self.places[stream];
        self.workers[worker].monitor.address(place)
    }

    /// Counters of each stream.
    pub(crate) fn counters(&self) -> Vec<SensorCounters> {
        let workers: Vec<_> = self.workers.iter().map(|worker| worker.monitor.sensors()).collect();
        self.places.iter().map(|(worker, place)| workers[*worker][*place]).collect()
    }

    /// What was lost so far, by stream, and every socket.
    pub(crate) fn tally(&self) -> Tally {
        let workers: Vec<Tally> = self.workers.iter().map(ReceiveWorker::tally).collect();
        Tally {
            sensors: self.places.iter().map(|(worker, place)| workers[*worker].sensors[*place]).collect(),
            sockets: workers.iter().flat_map(|worker| worker.sockets.iter().cloned()).collect(),
        }
    }

    /// Memory of all workers' packets.
    pub(crate) fn memory(&self) -> Memory {
        let workers = self.workers.iter().map(|worker| worker.monitor.memory());
        workers.fold(Memory::default(), |sum, worker| Memory {
            held_bytes: sum.held_bytes + worker.held_bytes,
            waiting_bytes: sum.waiting_bytes + worker.waiting_bytes,
            max_waiting_bytes: sum.max_waiting_bytes + worker.max_waiting_bytes,
        })
    }

    /// The most bytes of packets that can wait for the recorder in all workers.
    pub(crate) fn queue_limit_bytes(&self) -> usize {
        self.workers.len() * self.queue_bytes
    }

    /// How long the present longest write already lasts, s.
    pub(crate) fn stalled_s(&self) -> f64 {
        let now = now_ns();
        let since = |worker: &ReceiveWorker| worker.writing_since_ns.load(Ordering::Relaxed);
        let begun = self.workers.iter().map(since).filter(|since_ns| *since_ns > 0);
        begun.map(|since_ns| now.saturating_sub(since_ns) as f64 * 1e-9).fold(0.0, f64::max)
    }

    /// Ends receiving with what the kernel holds now, and waits until everything received was handed on.
    pub(crate) fn stop(&self) {
        self.workers.iter().for_each(|worker| worker.stop.stop());
        let take =
            |worker: &ReceiveWorker| worker.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        for thread in self.workers.iter().filter_map(take) {
            let _ = thread.join(); // whoever watches it says how it ended
        }
    }
}

impl Drop for Intake {
    fn drop(&mut self) {
        self.stop();
    }
}

impl ReceiveWorker {
    fn start(
        bound: Bound,
        sink: &Arc<SessionSink>,
        queues: &[DecodeQueue],
        names: &[String],
        supervision: &Arc<Supervision>,
    ) -> Result<Self, ReceiveError> {
        let Bound { mut receiver, streams } = bound;
        let (monitor, stop) = (receiver.monitor(), receiver.stop_handle());
        let queues: Vec<DecodeQueue> = streams.iter().map(|stream| queues[*stream].clone()).collect();
        let sink = Arc::clone(sink);
        let writing_since_ns = Arc::new(AtomicU64::new(0));
        let since_ns = Arc::clone(&writing_since_ns);
        let handed: Arc<Vec<AtomicU64>> = Arc::new(streams.iter().map(|_| AtomicU64::new(0)).collect());
        let counts = Arc::clone(&handed);
        let name = format!("receive {}", streams.first().map_or("", |stream| names[*stream].as_str()));
        let work = move |pulse: &Pulse| {
            let mut batch: Vec<Datagram> = Vec::with_capacity(BATCH);
            while receiver.recv_many_blocking(&mut batch, BATCH) > 0 {
                pulse.beat();
                let places: Vec<usize> = batch.iter().map(|datagram| datagram.sensor).collect();
                for datagram in &mut batch {
                    datagram.sensor = streams[datagram.sensor];
                }
                since_ns.store(now_ns(), Ordering::Relaxed);
                sink.write(&batch);
                since_ns.store(0, Ordering::Relaxed);
                for (datagram, place) in batch.drain(..).zip(places) {
                    counts[place].fetch_add(1, Ordering::Relaxed);
                    queues[place].offer(datagram);
                }
            }
        };
        let thread = supervision.spawn(&name, Role::Essential, work).map_err(ReceiveError::Thread)?;
        Ok(Self { monitor, stop, writing_since_ns, handed, thread: Mutex::new(Some(thread)) })
    }

    /// What was lost here: of a worker that has ended, also what it received and did not hand on.
    fn tally(&self) -> Tally {
        let mut tally = self.monitor.tally();
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if thread.as_ref().is_none_or(JoinHandle::is_finished) {
            let received = self.monitor.sensors();
            for ((loss, received), handed) in tally.sensors.iter_mut().zip(received).zip(&*self.handed) {
                loss.queue_dropped += received.packets.saturating_sub(handed.load(Ordering::Relaxed));
            }
        }
        tally
    }
}

/// Streams that one receiver takes: those of a sensor, and those of sensors that share an address.
fn groups(listens: &[Listen], sensor_of: &[usize]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for stream in 0..listens.len() {
        let related = |other: &usize| {
            let same_address = listens[*other].address == listens[stream].address;
            sensor_of[*other] == sensor_of[stream] || (same_address && listens[stream].address.port() != 0)
        };
        let (mut mine, others): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|group| group.iter().any(related));
        let mut joined = mine.drain(..).flatten().collect::<Vec<_>>();
        joined.push(stream);
        groups = others;
        groups.push(joined);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_that_share_a_port_share_a_worker() {
        let listen = |port: u16| Listen {
            name: port.to_string(),
            address: ([127, 0, 0, 1], port).into(),
            source: None,
        };
        let listens = [7502, 7503, 7502, 7504, 2368, 0, 0].map(listen);
        assert_eq!(groups(&listens, &[0, 0, 1, 1, 2, 3, 4]), [vec![0, 1, 2, 3], vec![4], vec![5], vec![6]]);
    }
}
