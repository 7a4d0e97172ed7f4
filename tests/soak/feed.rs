//! Packets to the daemon, every one of them counted, with faults on the way.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec3;
use outrigger::base::geometry::Pose;
use outrigger::live::receive::now_ns;
use outrigger::mock::sensor::{FaultCounts, FaultInjector, Faults, MockSensor, Surroundings};
use outrigger::world::scene::{BoxScene, Scene};
use outrigger::world::trajectory::Trajectory;

/// While it is held for writing nothing is sent, and what was sent is counted.
pub type Gate = Arc<RwLock<()>>;

/// The way of one sensor's packets to the daemon.
pub struct Feed {
    pub number: usize,
    pub to: SocketAddr,
    road: Arc<Road>,
    sensor: Mutex<Option<Sender>>,
}

struct Road {
    gate: Gate,
    /// Datagrams that the daemon is to receive, of whatever kind.
    sent: AtomicU64,
    /// Nothing passes: the cable is out.
    silent: AtomicBool,
    faults: Mutex<Option<FaultInjector>>,
}

struct Sender {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Road {
    /// Sends what the faults make of a packet.
    fn pass(&self, payload: &[u8], send: &mut dyn FnMut(&[u8])) {
        let _open = self.gate.read().unwrap();
        if self.silent.load(Ordering::Relaxed) {
            return;
        }
        let mut counted = |bytes: &[u8]| -> Result<(), ()> {
            send(bytes);
            self.sent.fetch_add(1, Ordering::Relaxed);
            Ok(())
        };
        match &mut *self.faults.lock().unwrap() {
            Some(injector) => injector.apply(0.0, payload, &mut counted).unwrap(),
            None => counted(payload).unwrap(),
        }
    }
}

impl Feed {
    pub fn new(number: usize, to: SocketAddr, gate: &Gate) -> Self {
        let road = Road {
            gate: Arc::clone(gate),
            sent: AtomicU64::new(0),
            silent: AtomicBool::new(false),
            faults: Mutex::new(None),
        };
        Self { number, to, road: Arc::new(road), sensor: Mutex::new(None) }
    }

    /// Datagrams sent so far: exact while the gate is held.
    pub fn sent(&self) -> u64 {
        self.road.sent.load(Ordering::Relaxed)
    }

    pub fn set_silent(&self, silent: bool) {
        self.road.silent.store(silent, Ordering::Relaxed);
    }

    pub fn begin_faults(&self, faults: Faults) {
        *self.road.faults.lock().unwrap() = Some(FaultInjector::new(faults, self.number as u64));
    }

    /// Ends the faults; what they did. The packet they dropped last stays dropped: packets follow.
    pub fn end_faults(&self) -> FaultCounts {
        let _closed = self.road.gate.write().unwrap();
        let Some(mut injector) = self.road.faults.lock().unwrap().take() else {
            return FaultCounts::default();
        };
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        // what was held back to come late; it may have been sent from another port, which no sensor minds
        injector
            .finish(&mut |bytes| -> Result<(), ()> {
                socket.send_to(bytes, self.to).unwrap();
                self.road.sent.fetch_add(1, Ordering::Relaxed);
                Ok(())
            })
            .unwrap()
    }

    /// Sends something that the sensor never sent.
    pub fn send_beside(&self, socket: &UdpSocket, bytes: &[u8]) {
        let _open = self.road.gate.read().unwrap();
        socket.send_to(bytes, self.to).unwrap();
        self.road.sent.fetch_add(1, Ordering::Relaxed);
    }

    /// A sensor of this process whose clock is so many ns ahead, in the place of the one before.
    pub fn plug(&self, mut sensor: MockSensor, ahead_ns: i64) {
        self.unplug();
        let (road, to) = (Arc::clone(&self.road), self.to);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let start_ns = now_ns().checked_add_signed(ahead_ns).unwrap();
            let day_ns = 86_400_000_000_000;
            let still = vec![(start_ns, Pose::IDENTITY), (start_ns + day_ns, Pose::IDENTITY)];
            let trajectory = Trajectory::new(still).unwrap();
            let scene = Scene::Box(BoxScene::closed(DVec3::new(-6.0, -4.0, -1.5), DVec3::new(6.0, 4.0, 2.0)));
            let around = Surroundings {
                scene: &scene,
                trajectory: &trajectory,
                body_from_sensor: &|_| Pose::IDENTITY,
                noise_m: 0.0,
                seed: 0,
            };
            let (line, begun) = (UdpSocket::bind("127.0.0.1:0").unwrap(), Instant::now());
            let _ = sensor.run(&around, |time_ns, payload| {
                if stopped.load(Ordering::Relaxed) {
                    return Err(());
                }
                // at its time, whether it passes or not, and outside the gate
                let due = begun + Duration::from_nanos(time_ns.saturating_sub(start_ns));
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
                road.pass(payload, &mut |bytes| {
                    line.send_to(bytes, to).unwrap();
                });
                Ok(())
            });
        });
        *self.sensor.lock().unwrap() = Some(Sender { stop, thread });
    }

    /// An address for a sensor of another process, whose packets go on from here.
    pub fn relay(&self) -> SocketAddr {
        let inlet = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = inlet.local_addr().unwrap();
        inlet.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let (road, to) = (Arc::clone(&self.road), self.to);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let outlet = UdpSocket::bind("127.0.0.1:0").unwrap();
            let mut bytes = [0; 65_536];
            while !stopped.load(Ordering::Relaxed) {
                let Ok(length) = inlet.recv(&mut bytes) else { continue };
                road.pass(&bytes[..length], &mut |bytes| {
                    outlet.send_to(bytes, to).unwrap();
                });
            }
        });
        *self.sensor.lock().unwrap() = Some(Sender { stop, thread });
        address
    }

    pub fn unplug(&self) {
        let sensor = self.sensor.lock().unwrap().take();
        if let Some(sensor) = sensor {
            sensor.stop.store(true, Ordering::Relaxed);
            sensor.thread.join().unwrap();
        }
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.unplug();
    }
}
