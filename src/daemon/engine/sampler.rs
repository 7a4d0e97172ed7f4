//! One sample of everything: counters become rates, and what changed becomes an event.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::Core;
use super::memory::memory;
use crate::daemon::live::Numbers;
use crate::daemon::problems::{OFF_MOUNT_DEG, problems};
use crate::daemon::status::{
    LogStatus, MemoryStatus, Reconfiguration, RecorderStatus, RigState, SensorLosses, SensorState,
    SensorStatus, Status,
};
use crate::daemon::steady::HostClock;
use crate::drive::AxisStatus;
use crate::live::receive::{DataTimeouts, SensorCounters, SocketReport, Tally, now_ns};

/// Rates are means over this time.
const RATE_OVER: Duration = Duration::from_millis(1000);
/// What counts as recent.
const RECENT: Duration = Duration::from_secs(15);

/// What is remembered from sample to sample.
pub(super) struct Sampler {
    begun: Instant,
    timeouts: DataTimeouts,
    ports: Vec<u16>,
    sensors: Vec<Past>,
    host_clock: HostClock,
    host_jump: Option<(Instant, f64)>,
}

/// Counters of a sensor at earlier samples.
#[derive(Default)]
struct Past(VecDeque<Moment>);

#[derive(Clone, Copy)]
struct Moment {
    at: Instant,
    packets: u64,
    bytes: u64,
    points: u64,
    decoded: u64,
    picture_dropped: u64,
    losses: SensorLosses,
    restarts: u64,
    clock_jumps: u64,
}

/// The state before the first sample.
pub(super) fn empty(recorder: &RecorderStatus) -> Status {
    Status {
        program: concat!("outrigger ", env!("CARGO_PKG_VERSION")),
        time_ns: now_ns(),
        age_ms: 0.0,
        as_of: Instant::now(),
        uptime_s: 0.0,
        host_clock_jump_s: None,
        sensors: Vec::new(),
        rig: None,
        recorder: recorder.clone(),
        components: Vec::new(),
        log: LogStatus::default(),
        memory: MemoryStatus::default(),
        coverage: None,
        reconfiguration: Reconfiguration::default(),
        problems: Vec::new(),
        events: Vec::new(),
    }
}

impl Sampler {
    pub(crate) fn new(core: &Core) -> Self {
        let streams = core.streams.iter().map(Vec::len).sum();
        Self {
            begun: Instant::now(),
            timeouts: DataTimeouts::new(streams, Instant::now()),
            ports: (0..streams).map(|stream| core.intake.address(stream).port()).collect(),
            sensors: core.sensors.iter().map(|_| Past::default()).collect(),
            host_clock: HostClock::new(Instant::now(), now_ns()),
            host_jump: None,
        }
    }

    /// The state now.
    pub(crate) fn sample(&mut self, core: &Core, mut recorder: RecorderStatus) -> Status {
        let now = Instant::now();
        if let Some(jump_s) = self.host_clock.sample(now, now_ns()) {
            self.host_jump = Some((now, jump_s));
            core.journal.tell("host_clock_jump", format!("this host's clock was set by {jump_s:.3} s"));
        }
        let (counters, tally) = (core.intake.counters(), core.intake.tally());
        self.report_timeouts(core, &counters, now);
        let decode_queues = core.decode_queues();
        let mut sensors = Vec::new();
        for (sensor, decode_queue) in decode_queues.iter().enumerate() {
            sensors.push(self.sensor(
                core,
                sensor,
                &decode_queue.numbers(),
                decode_queue.dropped(),
                &counters,
                &tally,
                now,
            ));
        }
        drop(decode_queues);
        recorder.stalled_s = core.intake.stalled_s();
        let rig = core.rig.as_ref().map(|rig| rig.state());
        let mut coverage = core.coverage.status();
        if coverage.predicted.is_some() && rig.as_ref().is_some_and(stands_elsewhere) {
            coverage.about +=
                " The prediction is for the pitches of the configured mount, and the rig stands at others.";
        }
        let mut status = Status {
            uptime_s: self.begun.elapsed().as_secs_f64(),
            host_clock_jump_s: self
                .host_jump
                .filter(|(at, _)| at.elapsed() < RECENT)
                .map(|(_, jump_s)| jump_s),
            sensors,
            rig,
            memory: memory(core),
            coverage: Some(coverage),
            reconfiguration: Reconfiguration {
                thinking: core.proposals.is_thinking(),
                proposal: core.proposals.newest(),
            },
            events: core.journal.newest(),
            ..empty(&recorder)
        };
        status.problems = problems(&status);
        status
    }

    fn report_timeouts(&mut self, core: &Core, counters: &[SensorCounters], now: Instant) {
        for news in self.timeouts.check(counters, &self.ports, now) {
            let owner = core.streams.iter().position(|streams| streams.contains(&news.sensor));
            let Some(owner) = owner else { continue };
            let is_lidar = core.streams[owner].first() == Some(&news.sensor);
            let words = if is_lidar { news.words } else { format!("auxiliary packets: {}", news.words) };
            core.journal.tell_of(&core.sensors[owner].config.name, news.event, words);
        }
    }

    #[expect(clippy::too_many_arguments, reason = "one sample of everything")]
    fn sensor(
        &mut self,
        core: &Core,
        sensor: usize,
        numbers: &Numbers,
        picture_dropped: u64,
        counters: &[SensorCounters],
        tally: &Tally,
        now: Instant,
    ) -> SensorStatus {
        let config = &core.sensors[sensor].config;
        let streams = &core.streams[sensor];
        let sum =
            |count: fn(&SensorCounters) -> u64| streams.iter().map(|stream| count(&counters[*stream])).sum();
        let (packets, bytes): (u64, u64) = (sum(|of| of.packets), sum(|of| of.bytes));
        let address = |place: usize| streams.get(place).map(|stream| core.intake.address(*stream));
        let socket = |socket: &&SocketReport| {
            streams.iter().any(|stream| socket.address == core.intake.address(*stream))
        };
        let sockets: Vec<&SocketReport> = tally.sockets.iter().filter(socket).collect();
        let report = numbers.report.as_ref();
        let decoder = report.map(|report| report.counters.clone()).unwrap_or_default();
        let here = |count: fn(&crate::live::receive::ReceiveLoss) -> u64| -> u64 {
            streams.iter().map(|stream| count(&tally.sensors[*stream])).sum()
        };
        let (kernel_dropped, queue_dropped) =
            (here(|loss| loss.kernel_dropped), here(|loss| loss.queue_dropped));
        let losses = SensorLosses {
            kernel_dropped,
            queue_dropped,
            // what was dropped on this host is missing in the sensor's own counting too
            in_network: decoder.lost_packets.saturating_sub(kernel_dropped + queue_dropped + picture_dropped),
            malformed: decoder.malformed,
            crc_errors: decoder.crc_errors,
            late: decoder.late,
            duplicated: decoder.duplicated,
            reordered: decoder.reordered,
            foreign_source: sockets.iter().map(|socket| socket.counters.foreign_source).sum(),
            first_foreign_source: sockets.iter().find_map(|socket| socket.counters.first_foreign_source),
            not_its_own: numbers.not_its_own,
        };
        let clock = report.and_then(|report| report.clock.clone());
        let moment = Moment {
            at: now,
            packets,
            bytes,
            points: numbers.points,
            decoded: decoder.packets,
            picture_dropped,
            losses,
            restarts: decoder.init_id_changes,
            clock_jumps: clock.as_ref().map_or(0, |clock| clock.jump_count),
        };
        let (second_ago, before) = self.sensors[sensor].add(moment);
        let over_s = now.duration_since(second_ago.at).as_secs_f64().max(1e-3);
        let rate = |count: fn(&Moment) -> u64| (count(&moment) - count(&second_ago)) as f64 / over_s;
        let text = |of: fn(&crate::live::watch::SensorReport) -> &String| {
            report.map(of).cloned().unwrap_or_default()
        };
        let last_ns = streams.first().map_or(0, |stream| counters[*stream].last_time_ns);
        let strange = |moment: &Moment| moment.losses.not_its_own + moment.losses.malformed;
        let is_read =
            moment.decoded > second_ago.decoded || moment.picture_dropped > second_ago.picture_dropped;
        let state = match streams.first() {
            Some(stream) if counters[*stream].packets == 0 => SensorState::Waiting,
            Some(stream) if self.timeouts.is_silent(*stream) => SensorState::Silent,
            _ if !is_read && strange(&moment) > strange(&second_ago) => SensorState::NotDecoded,
            _ => SensorState::Ok,
        };
        SensorStatus {
            name: config.name.clone(),
            model: config.model.clone(),
            product: text(|report| &report.model),
            serial: text(|report| &report.serial),
            firmware: text(|report| &report.firmware),
            format: text(|report| &report.format),
            state,
            address: address(0),
            auxiliary_address: address(1),
            source: report.and_then(|report| report.source.clone()),
            packets,
            packets_per_s: rate(|moment| moment.packets),
            bytes_per_s: rate(|moment| moment.bytes),
            points_per_s: rate(|moment| moment.points),
            last_packet_age_s: (last_ns > 0).then(|| now_ns().saturating_sub(last_ns) as f64 * 1e-9),
            decoded_age_ms: numbers.as_of.map(|as_of| as_of.elapsed().as_secs_f64() * 1e3),
            frames: report.map_or(0, |report| report.frames),
            complete_frames: report.map_or(0, |report| report.complete_frames),
            frame_rate_hz: report.and_then(|report| report.frame_rate_hz),
            imu_samples: report.map_or(0, |report| report.imu_samples),
            position_packets: report.map_or(0, |report| report.position_packets),
            losses,
            recent_losses: losses.since(&before.losses),
            recent_restarts: moment.restarts - before.restarts,
            recent_clock_jumps: moment.clock_jumps - before.clock_jumps,
            restarts: moment.restarts,
            picture_dropped,
            frames_not_drawn: numbers.frames_not_drawn,
            clock,
            timestamp_mode: report.and_then(|report| report.timestamp_mode.clone()),
            gps_valid: report.and_then(|report| report.gps_valid),
            hours_in_use: report.and_then(|report| report.hours_in_use),
            warnings: report.map(|report| report.warnings.clone()).unwrap_or_default(),
            unclaimed: numbers.unclaimed.clone(),
            first_damage: numbers.first_damage.clone(),
            buffer_warning: sockets.iter().find_map(|socket| socket.buffer_warning()),
            is_other_model: numbers.is_other_model,
            unseated: core.site.unseated(&config.name).map(|error| error.to_string()),
        }
    }
}

/// Whether an axis stands at another pitch than the configured mount's.
fn stands_elsewhere(rig: &RigState) -> bool {
    let axes = rig.status.iter().flat_map(|status| &status.axes);
    let is_off =
        |(axis, pitch_deg): (&AxisStatus, &f64)| (axis.position_deg - pitch_deg).abs() > OFF_MOUNT_DEG;
    rig.connected && axes.zip(&rig.mount_pitches_deg).any(is_off)
}

impl Past {
    /// Keeps a moment; those of about a second ago and of the beginning of what is recent.
    fn add(&mut self, moment: Moment) -> (Moment, Moment) {
        while self.0.front().is_some_and(|oldest| moment.at.duration_since(oldest.at) > RECENT) {
            self.0.pop_front();
        }
        self.0.push_back(moment);
        let second_ago = self.0.iter().rev().find(|other| moment.at.duration_since(other.at) >= RATE_OVER);
        let oldest = self.0.front().copied().unwrap_or(moment);
        (second_ago.copied().unwrap_or(oldest), oldest)
    }
}
