//! What `inspect` reports: the JSON document and the text.

use std::fmt::Write as _;

use sensors::capture::{CaptureCounters, Interface};
use sensors::router::{Router, Sensor, Unclaimed};
use sensors::{DecodeStats, Decoded};
use serde::Serialize;

use super::bags::TopicCount;
use super::flows::{FlowReport, Flows};
use super::mounted::host_clock::inferred;
use super::source::{Ending, Recording, RecordingError};
use super::{Session, SessionError, sensor_ids, unread};
use crate::base::numbers::counted;
use crate::live::watch::{SensorReport, Watch};

/// The document.
#[derive(Serialize)]
pub(crate) struct Document {
    capture: String,
    first_host_time_ns: Option<u64>,
    last_host_time_ns: Option<u64>,
    duration_s: Option<f64>,
    /// Every time that the host's clock was set meanwhile.
    host_clock: Vec<HostClockStep>,
    interfaces: Vec<Interface>,
    /// Topics of a bag.
    topics: Vec<TopicCount>,
    sensors: Vec<SensorReport>,
    flows: Vec<FlowReport>,
    packets_of_other_flows: u64,
    unclaimed: Vec<Unclaimed>,
    fragments_incomplete: u64,
    capture_counters: CaptureCounters,
    losses: Vec<String>,
    /// What differs from the specification or from what one expects, and costs nothing.
    notes: Vec<String>,
    advice: Vec<String>,
}

/// One step of the host's clock.
#[derive(Serialize)]
struct HostClockStep {
    /// When, by the stamps of the recording, ns.
    host_ns: u64,
    /// How far forward, s.
    step_s: f64,
    /// The stamps of the recording go on steadily all the same.
    is_undone: bool,
    words: String,
}

/// Goes through a recording.
pub(crate) fn inspect(recording: &Recording) -> Result<Document, RecordingError> {
    let mut router = recording.router()?;
    let mut flows = Flows::default();
    let mut watches: Vec<Watch> = Vec::new();
    let mut take = |at: usize, _: &Sensor, decoded: Decoded<'_>| {
        if watches.len() <= at {
            watches.resize_with(at + 1, Watch::default);
        }
        watches[at].take(&decoded);
    };
    let ending = recording.each_packet(&mut |packet| {
        let routed = router.push(packet, &mut take);
        flows.add(packet, routed);
    })?;
    router.finish(&mut take);
    Recording::ensure_calibrations_fit(&router)?;
    Ok(Document::new(recording, &router, &flows, &watches, &ending))
}

impl Document {
    /// Puts together what was seen.
    fn new(
        recording: &Recording,
        router: &Router,
        flows: &Flows,
        watches: &[Watch],
        ending: &Ending,
    ) -> Self {
        let none = Watch::default();
        let ids = sensor_ids::ids(router);
        let sensors: Vec<SensorReport> = router
            .sensors()
            .iter()
            .enumerate()
            .map(|(at, sensor)| {
                let mut report = watches.get(at).unwrap_or(&none).report(ids[at].clone(), sensor);
                report.source = sensor.source().map(|source| ending.source(source));
                report
            })
            .collect();
        let mut losses = ending.losses();
        // a session knows what its files held
        let session = recording.checked_session();
        let problems = |session: &Session| [session.problems(), &session.unrecorded()].concat();
        let damage = session.iter().flat_map(problems);
        losses.extend(damage.filter(|words| !ending.losses().contains(words)));
        let mut notes = Vec::new();
        for (id, sensor) in ids.iter().zip(router.sensors()) {
            losses.extend(unread::sensor_losses(id, sensor));
            notes.extend(unread::sensor_notes(id, sensor));
        }
        let span_ns = flows.span_ns();
        let host_clock = host_clock(session.as_ref(), &sensors, span_ns).unwrap_or_else(|error| {
            losses.push(error.to_string());
            Vec::new()
        });
        Self {
            capture: recording.name(),
            first_host_time_ns: span_ns.map(|[first, _]| first),
            last_host_time_ns: span_ns.map(|[_, last]| last),
            duration_s: span_ns.map(|[first, last]| (last - first) as f64 * 1e-9),
            host_clock,
            interfaces: ending.interfaces.clone(),
            topics: ending.topics.clone(),
            flows: flows_of(flows.reports(router, &ids), ending),
            packets_of_other_flows: flows.others(),
            unclaimed: router.unclaimed().cloned().collect(),
            fragments_incomplete: ending.counters.fragments_incomplete,
            capture_counters: ending.counters.clone(),
            losses,
            notes,
            advice: ending.notices.iter().cloned().chain(advice(recording, router)).collect(),
            sensors,
        }
    }

    /// Nothing is missing.
    pub(crate) fn is_whole(&self) -> bool {
        self.losses.is_empty()
    }

    /// The same for people.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{}: ", self.capture);
        let counters = &self.capture_counters;
        let _ = match self.duration_s {
            Some(duration_s) => writeln!(text, "{} datagrams in {duration_s:.3} s", counters.datagrams),
            None if !self.topics.is_empty() => writeln!(text, "no packets in {} messages", counters.frames),
            None => writeln!(text, "no UDP datagrams in {} frames", counters.frames),
        };
        for TopicCount { topic, kind, messages, packets, .. } in &self.topics {
            let packets = if *packets > 0 { format!(", {packets} packets") } else { String::new() };
            let _ = writeln!(text, "  {topic} ({kind}): {messages} messages{packets}");
        }
        for step in &self.host_clock {
            let _ = writeln!(text, "{}", step.words);
        }
        for sensor in &self.sensors {
            sensor.append_to(&mut text);
        }
        if !self.flows.is_empty() {
            text.push_str("streams:\n");
        }
        for flow in &self.flows {
            let rate = flow.rate_hz.map_or(String::new(), |rate_hz| format!(", {rate_hz:.1}/s"));
            let serial = flow.serial.map_or(String::new(), |serial| format!(", sensor {serial}"));
            let mode = flow.columns_per_frame.map_or(String::new(), |columns| format!(", {columns} columns"));
            let assignment = flow.assignment();
            let FlowReport { source, length, packets, looks_like, .. } = flow;
            let destination = match flow.destination.as_str() {
                "" => String::new(),
                receiver => format!(" -> {receiver}"),
            };
            let _ = writeln!(
                text,
                "  {source}{destination}: {packets} x {length} bytes{rate}: {looks_like}{serial}{mode}{assignment}"
            );
        }
        for (title, lines) in
            [("missing", &self.losses), ("to note", &self.notes), ("what would help", &self.advice)]
        {
            if !lines.is_empty() {
                let _ = writeln!(text, "{title}:");
            }
            for line in lines {
                let _ = writeln!(text, "  {line}");
            }
        }
        if unread::oddities(counters).next().is_some() {
            text.push_str("also in the file:\n");
        }
        for (count, what) in unread::oddities(counters) {
            let _ = writeln!(text, "  {count} {what}");
        }
        text
    }
}

impl SensorReport {
    fn append_to(&self, text: &mut String) {
        let about = [
            (!self.serial.is_empty()).then(|| format!("serial {}", self.serial)),
            (!self.firmware.is_empty()).then(|| format!("firmware {}", self.firmware)),
            self.source.as_ref().map(|source| format!("from {source}")),
        ];
        let about: Vec<String> = about.into_iter().flatten().collect();
        let _ = writeln!(
            text,
            "{}: {} {}, {}, {}",
            self.id,
            self.vendor,
            self.model,
            self.format,
            about.join(", ")
        );
        let rate = self.frame_rate_hz.map_or(String::new(), |rate_hz| format!(", {rate_hz:.2} Hz"));
        let points =
            self.points_per_frame.map_or(String::new(), |points| format!(", {points:.0} points each"));
        let second = self
            .points_second_per_frame
            .map_or(String::new(), |points| format!(" and {points:.0} second returns"));
        let _ = writeln!(
            text,
            "    {}, {} whole{rate}{points}{second}",
            counted(self.frames, "frame"),
            self.complete_frames
        );
        let _ = writeln!(text, "    beams {}", self.beams);
        let counters = &self.counters;
        let _ = writeln!(
            text,
            "    {} packets: {}, {} foreign; {} restarts",
            counters.packets,
            losses(counters),
            counters.foreign,
            counters.init_id_changes,
        );
        for (count, what) in [
            (self.imu_samples, "inertial samples"),
            (self.position_packets, "position packets"),
            (self.zone_reports, "zone reports"),
        ] {
            if count > 0 {
                let _ = writeln!(text, "    {count} {what}");
            }
        }
        if let Some(clock) = &self.clock {
            let mode = self.timestamp_mode.as_ref().map_or(String::new(), |mode| format!(" ({mode})"));
            let _ = writeln!(text, "    clock{mode} {}", clock.text());
        }
        if let Some(pulse) = self.pulse {
            let _ = writeln!(text, "    pulse per second: {}", format!("{pulse:?}").to_lowercase());
        }
        if let Some(hours) = self.hours_in_use {
            let _ = writeln!(text, "    {hours} hours in use");
        }
        if let Some(sentence) = &self.gps_sentence {
            let valid = match self.gps_valid {
                Some(true) => "valid",
                Some(false) => "no fix",
                None => "unreadable",
            };
            let _ = writeln!(text, "    GPS ({valid}): {sentence}");
        }
        if !self.silent_beams.is_empty() {
            let rings: Vec<String> = self.silent_beams.iter().map(u16::to_string).collect();
            let _ = writeln!(
                text,
                "    beams that never return, and their neighbours do: ring {}",
                rings.join(", ")
            );
        }
        for remark in self.remark.iter().chain(&self.warnings) {
            let _ = writeln!(text, "    {remark}");
        }
    }
}

/// Streams of a bag come from topics; the addresses of their packets are made up.
fn flows_of(mut flows: Vec<FlowReport>, ending: &Ending) -> Vec<FlowReport> {
    for flow in &mut flows {
        let topic =
            ending.topics.iter().find(|count| count.from.is_some_and(|from| from.to_string() == flow.source));
        if let Some(count) = topic {
            (flow.source, flow.destination) = (count.topic.clone(), String::new());
        }
    }
    flows
}

/// What the recorder tells of the host's clock, otherwise what the clocks of the sensors show of it.
fn host_clock(
    session: Option<&Session>,
    sensors: &[SensorReport],
    span_ns: Option<[u64; 2]>,
) -> Result<Vec<HostClockStep>, SessionError> {
    let step = |host_ns, step_s, is_undone, words| HostClockStep { host_ns, step_s, is_undone, words };
    if let Some((session, steps)) =
        session.map(|session| Ok((session, session.clock_steps()?))).transpose()?
        && let Some(steps) = steps
    {
        let begin_ns = session.manifest().created_ns;
        let recorded = steps.iter().map(|made| {
            let words = format!("{}: everything is stamped as if it had not been", made.words(begin_ns));
            step(made.between_ns[1], made.step_ns as f64 * 1e-9, true, words)
        });
        return Ok(recorded.collect());
    }
    let clocks = sensors.iter().filter_map(|sensor| Some((sensor.id.as_str(), sensor.clock.as_ref()?)));
    let jumps = clocks.flat_map(|(id, clock)| clock.host_jumps().map(move |jump| (id, jump)));
    let begin_ns = span_ns.map_or(0, |[first_ns, _]| first_ns);
    let inferred = inferred(jumps);
    Ok(inferred.iter().map(|made| step(made.host_ns, made.step_s, false, made.words(begin_ns))).collect())
}

/// Why something does not decode, and what would help.
fn advice(recording: &Recording, router: &Router) -> Vec<String> {
    let mut advice: Vec<String> = router
        .unclaimed()
        .map(|entry| {
            let Unclaimed { port, length, packets, reason, .. } = entry;
            format!("{packets} packets of {length} bytes to port {port}: {reason}")
        })
        .collect();
    for path in unread::nearby_metadata(recording, router) {
        advice.push(format!("{} lies next to the recording: try --meta {}", path.display(), path.display()));
    }
    advice.extend(recording.ensure_given_fits(router).err().map(|error| error.to_string()));
    advice.extend(unread::beam_notices(router));
    for sensor in router.sensors() {
        let name = sensor.metadata_name.as_deref().unwrap_or("a sensor");
        if let Some(words) = sensor.only_positions() {
            advice.push(words);
        } else if let Some(damage) = sensor.first_damage() {
            advice.push(format!("{}: the first malformed packet: {damage}", sensor.product()));
        } else if sensor.stats().packets == 0
            && sensor.source_filter().is_none()
            && sensor.one_of_several().is_none()
        {
            advice.push(format!("{name}: it fits no packet of the recording"));
        }
    }
    advice
}

/// What happened to the packets of a sensor, for the screen.
pub(super) fn losses(counters: &DecodeStats) -> String {
    format!(
        "{} lost, {} duplicated, {} reordered, {} late, {} malformed, {} with a wrong checksum",
        counters.lost_packets,
        counters.duplicated,
        counters.reordered,
        counters.late,
        counters.malformed,
        counters.crc_errors,
    )
}
