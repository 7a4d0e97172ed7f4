//! The receiving thread: one task per socket, one queue to the consumer.

use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;

use tokio::io::Interest;
use tokio::net::UdpSocket;
use tokio::sync::{mpsc, watch};

use super::buffer::{Datagram, Pool};
use super::counters::{Monitor, SensorCells, SocketCells, SocketReport};
use super::socket::{self, Scratch};
use super::{Listen, Options, ReceiveError};

/// Datagrams read before another socket gets its turn.
const BATCH: usize = 64;

/// Receives until it is stopped or dropped.
#[derive(Debug)]
pub struct Receiver {
    queue: mpsc::Receiver<Datagram>,
    monitor: Monitor,
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

/// Ends a receiver from anywhere.
#[derive(Clone, Debug)]
pub struct Stop(Arc<watch::Sender<bool>>);

impl Stop {
    /// Receiving ends with what the kernel holds now; the consumer still gets everything queued.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

impl Receiver {
    /// Binds every socket and starts to receive. A socket shared by several sensors tells them apart by source.
    pub fn start(listens: &[Listen], options: Options) -> Result<Self, ReceiveError> {
        let groups = by_address(listens)?;
        crate::base::files::ensure_descriptors().map_err(ReceiveError::Thread)?;
        let mut sockets = Vec::new();
        let mut cells = Vec::new();
        let mut socket_of_sensor = vec![0; listens.len()];
        for (address, members) in groups {
            let name = &listens[members[0]].name;
            let opened = socket::open(address, options.receive_buffer_bytes)
                .and_then(|opened| {
                    let granted = socket::granted_buffer_bytes(opened.as_fd())?;
                    Ok((opened.local_addr()?, granted, opened))
                })
                .map_err(|source| bind_error(name, address, source))?;
            let (address, granted_buffer_bytes, opened) = opened;
            for member in &members {
                socket_of_sensor[*member] = sockets.len();
            }
            let about = SocketReport {
                address,
                sensors: members.iter().map(|member| listens[*member].name.clone()).collect(),
                asked_buffer_bytes: options.receive_buffer_bytes,
                granted_buffer_bytes,
                counters: Default::default(),
            };
            cells.push(SocketCells::new(about, members[0]));
            let routes = members.iter().map(|member| (*member, listens[*member].source)).collect::<Vec<_>>();
            sockets.push((opened, routes));
        }
        let sensor_cells =
            socket_of_sensor.into_iter().map(|socket| SensorCells { socket, ..Default::default() }).collect();
        let pool = Pool::new(options.queue_datagrams.max(1));
        let monitor = Monitor {
            sockets: Arc::new(cells),
            sensors: Arc::new(sensor_cells),
            held: pool.held(),
            waiting: Arc::default(),
        };
        let (sender, queue) = mpsc::channel(options.queue_datagrams.max(1));
        let (stop, stopped) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .build()
            .map_err(ReceiveError::Thread)?;
        let mut tasks = Vec::new();
        for (index, (opened, routes)) in sockets.into_iter().enumerate() {
            let socket = {
                let _inside = runtime.enter();
                UdpSocket::from_std(opened).map_err(ReceiveError::Thread)?
            };
            tasks.push(Task {
                socket,
                routes,
                index,
                monitor: monitor.clone(),
                sender: sender.clone(),
                stopped: stopped.clone(),
                pool: Arc::clone(&pool),
                queue_bytes: options.queue_bytes,
                dropped_before: 0,
            });
        }
        let thread = std::thread::Builder::new()
            .name("receive".into())
            .spawn(move || {
                let tasks: Vec<_> = tasks.into_iter().map(|task| runtime.spawn(task.run())).collect();
                runtime.block_on(async {
                    for task in tasks {
                        // a task ends by itself; a panic in it would be a defect and is not passed on to the consumer
                        let _ = task.await;
                    }
                });
            })
            .map_err(ReceiveError::Thread)?;
        Ok(Self { queue, monitor, stop: Stop(Arc::new(stop)), thread: Some(thread) })
    }

    /// The next datagram, waiting for it on this thread (not inside a tokio runtime); `None` after the stop.
    pub fn recv_blocking(&mut self) -> Option<Datagram> {
        let datagram = self.queue.blocking_recv();
        self.count_received(datagram.as_slice());
        datagram
    }

    /// Appends up to `limit` waiting datagrams, waiting for the first; 0 after the stop.
    pub(crate) fn recv_many_blocking(&mut self, into: &mut Vec<Datagram>, limit: usize) -> usize {
        let count = self.queue.blocking_recv_many(into, limit);
        self.count_received(&into[into.len() - count..]);
        count
    }

    fn count_received(&self, datagrams: &[Datagram]) {
        self.monitor.waiting.take(datagrams.iter().map(Datagram::held_bytes).sum());
    }

    /// The counters, to be read at any time, also after the receiver is gone.
    pub fn monitor(&self) -> Monitor {
        self.monitor.clone()
    }

    /// A handle that ends this receiver.
    pub fn stop_handle(&self) -> Stop {
        self.stop.clone()
    }

    /// The local address of a sensor, with the port that was really count_received.
    pub fn address(&self, sensor: usize) -> SocketAddr {
        self.monitor.address(sensor)
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        self.stop.stop();
        self.queue.close();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Sensors of each address, in order of first mention. Two that cannot be distinguished are refused.
fn by_address(listens: &[Listen]) -> Result<Vec<(SocketAddr, Vec<usize>)>, ReceiveError> {
    if listens.is_empty() {
        return Err(ReceiveError::Nothing);
    }
    let mut groups: Vec<(SocketAddr, Vec<usize>)> = Vec::new();
    let mut place: HashMap<SocketAddr, usize> = HashMap::new();
    for (index, listen) in listens.iter().enumerate() {
        // port 0 means "any free one", so two of them are never the same
        let known = place.get(&listen.address).copied().filter(|_| listen.address.port() != 0);
        let Some(group) = known else {
            place.insert(listen.address, groups.len());
            groups.push((listen.address, vec![index]));
            continue;
        };
        let members = &mut groups[group].1;
        if let Some(twin) = members.iter().find(|member| listens[**member].source == listen.source) {
            return Err(ReceiveError::SameAddress {
                first: listens[*twin].name.clone(),
                second: listen.name.clone(),
                address: listen.address,
                from: listen.source.map_or("any source".into(), |source| source.to_string()),
            });
        }
        members.push(index);
    }
    Ok(groups)
}

fn bind_error(name: &str, address: SocketAddr, source: io::Error) -> ReceiveError {
    let hint = match source.kind() {
        io::ErrorKind::AddrInUse => " (another program already listens there)",
        io::ErrorKind::AddrNotAvailable => " (no network interface of this host has that address)",
        io::ErrorKind::PermissionDenied => " (ports below 1024 need a privilege)",
        _ => "",
    };
    ReceiveError::Bind { name: name.to_owned(), address, hint, source }
}

/// One socket's share of the work.
struct Task {
    socket: UdpSocket,
    /// Sensor and the source it is known by.
    routes: Vec<(usize, Option<std::net::IpAddr>)>,
    index: usize,
    monitor: Monitor,
    sender: mpsc::Sender<Datagram>,
    stopped: watch::Receiver<bool>,
    pool: Arc<Pool>,
    /// Bytes of buffers that may wait.
    queue_bytes: usize,
    dropped_before: u32,
}

impl Task {
    async fn run(mut self) {
        let mut scratch = Scratch::new();
        let mut stopped = self.stopped.clone();
        loop {
            let readable = tokio::select! {
                biased;
                _ = stopped.wait_for(|stopped| *stopped) => false,
                ready = self.socket.readable() => ready.is_ok(),
            };
            if !readable {
                break;
            }
            self.read(&mut scratch, BATCH);
            // the other sockets' turn, also when this one never runs dry
            tokio::task::yield_now().await;
        }
        // what arrived before the stop is in the kernel's buffer, which holds no more datagrams than bytes
        let held = self.monitor.sockets[self.index].about.granted_buffer_bytes;
        self.read(&mut scratch, held);
        if let Ok(total) = socket::dropped_so_far(self.socket.as_fd()) {
            self.count_kernel_drops(total);
        }
    }

    /// Reads until the kernel has no more, or `limit` datagrams.
    fn read(&mut self, scratch: &mut Scratch, limit: usize) {
        for _ in 0..limit {
            let mut buffer = self.pool.take();
            let descriptor = self.socket.as_fd();
            let arrival =
                match self.socket.try_io(Interest::READABLE, || scratch.receive(descriptor, &mut buffer)) {
                    Ok(arrival) => arrival,
                    Err(error) if error.kind() == io::ErrorKind::WouldBlock => return,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                    Err(_) => {
                        let cells = &self.monitor.sockets[self.index];
                        cells.socket_errors.fetch_add(1, Ordering::Relaxed);
                        return;
                    }
                };
            self.pool.grow(buffer.filled());
            if let Some(total) = arrival.dropped {
                self.count_kernel_drops(total);
            }
            let cells = &self.monitor.sockets[self.index];
            let Some(sensor) = self.sensor_of(arrival.source) else {
                cells.count_foreign(arrival.source);
                continue;
            };
            let host_time_ns = arrival.time_ns.unwrap_or_else(|| {
                cells.stamped_late.fetch_add(1, Ordering::Relaxed);
                super::now_ns()
            });
            let local = cells.about.address;
            let destination = SocketAddr::new(arrival.destination.unwrap_or(local.ip()), local.port());
            let counters = &self.monitor.sensors[sensor];
            let (length, held) = (buffer.filled() as u64, buffer.held());
            let datagram =
                Datagram { sensor, host_time_ns, source: arrival.source, destination, payload: buffer };
            let waiting = &self.monitor.waiting;
            let fits = waiting.bytes() + held <= self.queue_bytes;
            if fits {
                waiting.add(held); // before it is sent: the consumer may have it at once
            }
            if fits && self.sender.try_send(datagram).is_ok() {
                counters.packets.fetch_add(1, Ordering::Relaxed);
                counters.bytes.fetch_add(length, Ordering::Relaxed);
            } else {
                counters.queue_dropped.fetch_add(1, Ordering::Relaxed);
                waiting.take(if fits { held } else { 0 });
            }
            counters.last_time_ns.store(host_time_ns, Ordering::Relaxed);
        }
    }

    fn sensor_of(&self, source: SocketAddr) -> Option<usize> {
        let by_name = self.routes.iter().find(|(_, known)| *known == Some(source.ip()));
        by_name.or_else(|| self.routes.iter().find(|(_, known)| known.is_none())).map(|(sensor, _)| *sensor)
    }

    fn count_kernel_drops(&mut self, total: u32) {
        let new = total.wrapping_sub(self.dropped_before);
        // a total read a moment earlier than the last one would look like 2^32 drops
        if new < u32::MAX / 2 {
            self.dropped_before = total;
            self.monitor.sockets[self.index].kernel_dropped.fetch_add(u64::from(new), Ordering::Relaxed);
        }
    }
}
