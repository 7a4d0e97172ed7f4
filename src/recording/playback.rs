//! A recording played back: an index of its revolutions, and the points of those that are wanted, decoded when they are.
//!
//! One thread reads the recording once for the index; another reads it again from where a wanted revolution begins, and some
//! seconds ahead of it. Memory stays within [`CACHE_BYTES`] for a recording of any length.

mod points;

use std::cell::Cell;
use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use sensors::router::{Router, Sensor};
use sensors::{Decoded, Frame, Packet};
use serde::Serialize;

use points::Packer;
pub(crate) use points::{Placement, World};

/// Size of the cache of points, bytes.
const CACHE_BYTES: usize = 192 << 20;
/// Of these, what the pass for the index may fill: the beginning of the recording.
const FIRST_BYTES: usize = 48 << 20;
/// How long the pass for the index waits behind the first revolution until the page has it, and by which request for the index it
/// shows: the command asks for it once, the page first of all and again when it has drawn.
const FIRST_PICTURE: (Duration, usize) = (Duration::from_millis(700), 3);
/// How far ahead of the wanted revolution is decoded.
const AHEAD_NS: u64 = 2_000_000_000;
/// A revolution that lies farther ahead is reached by reading again, without decoding what lies between.
const FAR_PACKETS: u64 = 4000;
/// Longest wait for a revolution.
const PATIENCE: Duration = Duration::from_secs(20);

/// What takes packets, and says when it has enough.
pub(crate) type Take<'a> = dyn FnMut(&Packet<'_>) -> ControlFlow<()> + 'a;

/// A recording that can be read again and again.
pub(crate) trait Tape: Send + Sync {
    /// A router that knows the recording's sensors.
    ///
    /// # Errors
    /// In words.
    fn router(&self) -> Result<Router, String>;

    /// Hands over the packets, from the first.
    ///
    /// # Errors
    /// In words; packets before a damaged place came.
    fn packets(&self, take: &mut Take<'_>) -> Result<(), String>;

    /// Name of a sensor that is none of `names`, and is added to them.
    fn name(&self, sensor: &Sensor, names: &mut Vec<String>) -> String;

    /// Where its points lie in the rig and in the world.
    fn placement(&self, name: &str) -> Placement;
}

/// One revolution of a sensor.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Revolution {
    /// Host arrival of the first and last packet, ns.
    pub host_time_ns: [u64; 2],
    /// Returns, both of a firing.
    pub points: usize,
    /// Whether all of its packets came.
    pub is_complete: bool,
    /// Packets of the sensor known as lost so far.
    pub lost_packets: u64,
    /// Number of the packet at which it began.
    #[serde(skip)]
    first_packet: u64,
}

/// A sensor and its revolutions, as far as they are known.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Indexed {
    pub name: String,
    pub product: String,
    pub channels: usize,
    /// `body_from_sensor` by rows, metres; none where no mount is known.
    pub body_from_sensor: Option<[[f64; 4]; 3]>,
    pub revolutions: Vec<Revolution>,
}

/// What the index says.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Index {
    pub sensors: Vec<Indexed>,
    /// Whether the whole recording was read.
    pub is_whole: bool,
    /// What is odd or was lost.
    pub problems: Vec<String>,
}

/// The frame in which points are given.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum FrameOfPoints {
    /// Each sensor's own.
    Sensor,
    /// The trajectory's, each return at its own time.
    World,
}

/// A revolution, by sensor and number, both from 0.
type Place = (usize, usize);

/// Which unit it is, however often the recording is read.
type Unit = (Option<String>, String, String, Option<std::net::SocketAddr>, Option<u16>);

struct Cached {
    used: u64,
    bytes: Arc<Vec<u8>>,
}

#[derive(Default)]
struct State {
    sensors: Vec<Indexed>,
    units: Vec<Unit>,
    /// By sensor: number of the revolution by the host time of its first packet, and host times of last packets.
    numbers: Vec<HashMap<u64, usize>>,
    ends_ns: Vec<HashSet<u64>>,
    names: Vec<String>,
    is_whole: bool,
    problems: Vec<String>,
    cache: HashMap<(Place, FrameOfPoints), Cached>,
    cached_bytes: usize,
    clock: u64,
    wanted: Option<(Place, FrameOfPoints)>,
    is_stopped: bool,
    /// How often the index was asked for.
    asked: usize,
}

/// Plays a recording.
pub(crate) struct Player {
    tape: Box<dyn Tape>,
    state: Mutex<State>,
    changed: Condvar,
}

impl Player {
    /// Begins to read.
    pub(crate) fn start(tape: Box<dyn Tape>) -> Arc<Self> {
        let player = Arc::new(Self { tape, state: Mutex::default(), changed: Condvar::new() });
        for run in [Self::index_all, Self::play] {
            let player = Arc::clone(&player);
            std::thread::spawn(move || run(&player));
        }
        player
    }

    /// Ends both threads.
    pub(crate) fn stop(&self) {
        self.state().is_stopped = true;
        self.changed.notify_all();
    }

    /// The index so far, of each sensor without its first `known` revolutions.
    pub(crate) fn index(&self, known: &[usize]) -> Index {
        let mut state = self.state();
        state.asked += 1;
        self.changed.notify_all();
        let rest = |(number, sensor): (usize, &Indexed)| {
            let known = known.get(number).copied().unwrap_or(0).min(sensor.revolutions.len());
            Indexed { revolutions: sensor.revolutions[known..].to_vec(), ..sensor.clone() }
        };
        Index {
            sensors: state.sensors.iter().enumerate().map(rest).collect(),
            is_whole: state.is_whole,
            problems: state.problems.clone(),
        }
    }

    /// Waits until there is something to see, or it is known that there is nothing.
    pub(crate) fn wait_for_first(&self) {
        let is_empty = |state: &mut State| {
            !state.is_whole
                && !state.is_stopped
                && state.sensors.iter().all(|sensor| sensor.revolutions.is_empty())
        };
        drop(self.changed.wait_while(self.state(), is_empty).unwrap_or_else(PoisonError::into_inner));
    }

    /// Points of a revolution, as [`points`] lays them out; none where there is no such revolution.
    pub(crate) fn points(&self, place: Place, frame: FrameOfPoints) -> Option<Arc<Vec<u8>>> {
        let mut state = self.state();
        state.sensors.get(place.0)?.revolutions.get(place.1)?;
        let key = (place, frame);
        let until = std::time::Instant::now() + PATIENCE;
        loop {
            state.clock += 1;
            let clock = state.clock;
            state.wanted = Some(key);
            if let Some(cached) = state.cache.get_mut(&key) {
                cached.used = clock;
                let bytes = Arc::clone(&cached.bytes);
                self.changed.notify_all();
                return (!bytes.is_empty()).then_some(bytes);
            }
            self.changed.notify_all();
            let left =
                until.checked_duration_since(std::time::Instant::now()).filter(|_| !state.is_stopped)?;
            state = self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads everything once.
    fn index_all(&self) {
        let ended = self.tape.router().and_then(|mut router| {
            let mut packer = Packer::default();
            let (mut packets, mut begun) = (0, HashMap::new());
            let mut add = |packets: u64, at: usize, sensor: &Sensor, decoded: Decoded<'_>| {
                if let Decoded::Frame(frame) = decoded {
                    let first_packet = begun.insert(at, packets).unwrap_or(0);
                    self.add(sensor, frame, first_packet, &mut packer);
                }
            };
            let read = self.tape.packets(&mut |packet| {
                router.push(packet, &mut |at, sensor, decoded| add(packets, at, sensor, decoded));
                packets += 1;
                if packets.is_multiple_of(256) && self.state().is_stopped {
                    return ControlFlow::Break(());
                }
                ControlFlow::Continue(())
            });
            router.finish(&mut |at, sensor, decoded| add(packets, at, sensor, decoded));
            read
        });
        let mut state = self.state();
        state.is_whole = true;
        state.problems.extend(ended.err());
        self.changed.notify_all();
    }

    fn add(&self, sensor: &Sensor, frame: &Frame, first_packet: u64, packer: &mut Packer) {
        let Some(model) = sensor.model() else { return };
        let mut state = self.state();
        let unit = unit(sensor);
        let at = state.units.iter().position(|known| *known == unit).unwrap_or_else(|| {
            let name = self.tape.name(sensor, &mut state.names);
            let body_from_sensor = self.tape.placement(&name).body_from_sensor_rows();
            let (product, channels) = (sensor.product(), frame.channels);
            state.sensors.push(Indexed {
                name,
                product,
                channels,
                body_from_sensor,
                revolutions: Vec::new(),
            });
            state.units.push(unit);
            state.numbers.push(HashMap::new());
            state.ends_ns.push(HashSet::new());
            state.units.len() - 1
        });
        let number = state.sensors[at].revolutions.len();
        let revolution = Revolution {
            host_time_ns: frame.host_time_ns,
            points: frame.first.points() + frame.second.as_ref().map_or(0, sensors::Layer::points),
            is_complete: frame.complete,
            lost_packets: sensor.stats().lost_packets,
            first_packet,
        };
        state.sensors[at].revolutions.push(revolution);
        state.numbers[at].entry(frame.host_time_ns[0]).or_insert(number);
        state.ends_ns[at].insert(frame.host_time_ns[1]);
        let wants_points = state.cached_bytes < FIRST_BYTES;
        drop(state);
        if wants_points {
            let bytes = packer.pack(sensor, model, frame, at, number, None);
            self.keep((at, number), FrameOfPoints::Sensor, bytes);
        }
        self.changed.notify_all();
        if (at, number) == (0, 0) {
            let is_awaited = |state: &mut State| state.asked < FIRST_PICTURE.1 && !state.is_stopped;
            drop(self.changed.wait_timeout_while(self.state(), FIRST_PICTURE.0, is_awaited));
        }
    }

    fn keep(&self, place: Place, frame: FrameOfPoints, bytes: Vec<u8>) {
        let mut state = self.state();
        state.clock += 1;
        let cached = Cached { used: state.clock, bytes: Arc::new(bytes) };
        state.cached_bytes += cached.bytes.len();
        if let Some(old) = state.cache.insert((place, frame), cached) {
            state.cached_bytes -= old.bytes.len();
        }
        while state.cached_bytes > CACHE_BYTES {
            let wanted = state.wanted;
            let oldest = state
                .cache
                .iter()
                .filter(|(key, _)| Some(**key) != wanted)
                .min_by_key(|(_, cached)| cached.used);
            let Some(key) = oldest.map(|(key, _)| *key) else { break };
            if let Some(old) = state.cache.remove(&key) {
                state.cached_bytes -= old.bytes.len();
            }
        }
        self.changed.notify_all();
    }

    /// Decodes what is wanted, again and again.
    fn play(&self) {
        loop {
            let is_content = |state: &mut State| {
                !state.is_stopped && state.wanted.is_none_or(|wanted| state.cache.contains_key(&wanted))
            };
            let state =
                self.changed.wait_while(self.state(), is_content).unwrap_or_else(PoisonError::into_inner);
            let (false, Some(wanted)) = (state.is_stopped, state.wanted) else { return };
            let mut start = Start::at(&state, wanted.0, &HashSet::new());
            drop(state);
            let is_missing = |state: &State| {
                state.wanted == Some(wanted) && !state.cache.contains_key(&wanted) && !state.is_stopped
            };
            let mut early = HashSet::new();
            while is_missing(&self.state()) {
                let off = self.pass(&start, wanted.1);
                let Some(unit) = self.report(off).flatten() else { break };
                // otherwise cut from here on: from a packet earlier on, or as from the beginning on
                start = match early.insert(unit) {
                    true => Start::at(&self.state(), wanted.0, &early),
                    false => Start::default(),
                };
            }
            if is_missing(&self.state()) {
                self.keep(wanted.0, wanted.1, Vec::new()); // no caller waits for it for ever
            }
        }
    }

    fn report<T>(&self, ended: Result<T, String>) -> Option<T> {
        let problem = match ended {
            Ok(outcome) => return Some(outcome),
            Err(problem) => problem,
        };
        let mut state = self.state();
        if !state.problems.contains(&problem) {
            state.problems.push(problem);
        }
        None
    }

    /// Decodes from a place on, until something else is wanted; a unit whose revolutions end elsewhere than those of the index.
    fn pass(&self, start: &Start, frame_of_points: FrameOfPoints) -> Result<Option<Unit>, String> {
        let mut router = self.tape.router()?;
        let mut packer = Packer::default();
        let (mut off, is_off) = (None, Cell::new(false));
        let mut keep = |sensor: &Sensor, decoded: Decoded<'_>| {
            let (Decoded::Frame(frame), Some(model)) = (decoded, sensor.model()) else { return };
            if start.is_inside() && !self.is_end(sensor, frame) {
                off = Some(unit(sensor));
                is_off.set(true);
            }
            let Some((place, name)) = self.place_of(sensor, frame) else { return };
            if self.state().cache.contains_key(&(place, frame_of_points)) {
                return;
            }
            let placement = (frame_of_points == FrameOfPoints::World).then(|| self.tape.placement(&name));
            let bytes = packer.pack(sensor, model, frame, place.0, place.1, placement.as_ref());
            self.keep(place, frame_of_points, bytes);
        };
        let mut packets = 0_u64;
        let read = self.tape.packets(&mut |packet| {
            packets += 1;
            if start.is_before(packet) {
                return ControlFlow::Continue(());
            }
            router.push(packet, &mut |_, sensor, decoded| keep(sensor, decoded));
            match is_off.get() {
                true => ControlFlow::Break(()),
                false if !packets.is_multiple_of(32) => ControlFlow::Continue(()),
                false => self.is_still_wanted(start, packets, packet.host_time_ns, frame_of_points),
            }
        });
        read?;
        if !is_off.get() {
            router.finish(&mut |_, sensor, decoded| keep(sensor, decoded));
        }
        Ok(off)
    }

    /// Whether a revolution of the index ends where this one does.
    fn is_end(&self, sensor: &Sensor, frame: &Frame) -> bool {
        let (state, unit) = (self.state(), unit(sensor));
        let at = state.units.iter().position(|known| *known == unit);
        at.is_some_and(|at| state.ends_ns[at].contains(&frame.host_time_ns[1]))
    }

    /// Which revolution a frame is: the one of the same packets.
    fn place_of(&self, sensor: &Sensor, frame: &Frame) -> Option<(Place, String)> {
        let state = self.state();
        let unit = unit(sensor);
        let at = state.units.iter().position(|known| *known == unit)?;
        let number = *state.numbers[at].get(&frame.host_time_ns[0])?;
        let indexed = &state.sensors[at];
        (indexed.revolutions[number].host_time_ns == frame.host_time_ns)
            .then(|| ((at, number), indexed.name.clone()))
    }

    /// Waits while enough is decoded; whether what is wanted next lies just ahead.
    fn is_still_wanted(
        &self,
        start: &Start,
        packets: u64,
        host_time_ns: u64,
        frame: FrameOfPoints,
    ) -> ControlFlow<()> {
        let mut state = self.state();
        loop {
            let Some((place, wanted_frame)) = state.wanted else { return ControlFlow::Break(()) };
            let wanted = &state.sensors[place.0].revolutions[place.1];
            let is_near = match start.is_inside() {
                true => (start.first_packet..packets + FAR_PACKETS).contains(&wanted.first_packet),
                false => true, // nothing else is left
            };
            if state.is_stopped || wanted_frame != frame || !is_near {
                return ControlFlow::Break(());
            }
            let is_there = state.cache.contains_key(&(place, frame));
            let is_passed = host_time_ns > wanted.host_time_ns[1].saturating_add(AHEAD_NS);
            match (is_there, is_passed) {
                (false, true) => return ControlFlow::Break(()),
                (_, false) => return ControlFlow::Continue(()),
                (true, true) => state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}

/// From where a pass decodes: of each unit, by sender and port, the first packet of a revolution. A Velodyne's revolutions
/// are whole packets, counted from its first: only so they are cut as before.
#[derive(Default)]
struct Start {
    units: Vec<(std::net::SocketAddr, u16, u64)>,
    first_packet: u64,
}

impl Start {
    /// A revolution ahead of the place; of some units a packet earlier. The first revolution of a pass is measured from the
    /// first packet, later ones from the end of the packet before: one of the two starts ends it where the index does.
    fn at(state: &State, (sensor, number): Place, early: &HashSet<Unit>) -> Self {
        let before = &state.sensors[sensor].revolutions[number.saturating_sub(1)];
        let time_ns = before.host_time_ns[0];
        let of_unit = |(unit, indexed): (&Unit, &Indexed)| {
            let begun =
                indexed.revolutions.partition_point(|revolution| revolution.host_time_ns[0] <= time_ns);
            let [first, last] =
                [1, 2].map(|back| Some(indexed.revolutions[begun.checked_sub(back)?].host_time_ns));
            let from_ns = if early.contains(unit) { last.map(|[_, last_ns]| last_ns) } else { None };
            Some((unit.3?, unit.4?, from_ns.or(first.map(|[first_ns, _]| first_ns))?))
        };
        Self {
            units: state.units.iter().zip(&state.sensors).filter_map(of_unit).collect(),
            first_packet: before.first_packet,
        }
    }

    /// Whether it is not the beginning of the recording.
    fn is_inside(&self) -> bool {
        self.first_packet > 0
    }

    fn is_before(&self, packet: &Packet<'_>) -> bool {
        let is_unit = |(source, port, _): &&(std::net::SocketAddr, u16, u64)| {
            packet.source == *source && packet.destination.port() == *port
        };
        self.units.iter().find(is_unit).is_some_and(|(_, _, time_ns)| packet.host_time_ns < *time_ns)
    }
}

fn unit(sensor: &Sensor) -> Unit {
    let serial = sensor.serial().to_owned();
    (sensor.name.clone(), sensor.product(), serial, sensor.source(), sensor.data_port())
}
