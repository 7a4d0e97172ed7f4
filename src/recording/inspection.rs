//! What a recording holds: the JSON document.

use sensors::Decoded;
use sensors::capture::{CaptureCounters, Interface};
use sensors::router::{Router, Sensor, Unclaimed};
use serde::Serialize;

use super::bags::TopicCount;
use super::flows::{FlowReport, Flows};
use super::mounted::host_clock::inferred;
use super::source::{Ending, Recording, RecordingError};
use super::{Session, SessionError, sensor_ids, unread};
use crate::live::watch::{SensorReport, Watch};

/// The document.
#[derive(Serialize)]
pub(crate) struct Document {
    pub(crate) capture: String,
    pub(crate) first_host_time_ns: Option<u64>,
    pub(crate) last_host_time_ns: Option<u64>,
    pub(crate) duration_s: Option<f64>,
    /// Every time that the host's clock was set meanwhile.
    pub(crate) host_clock: Vec<HostClockStep>,
    pub(crate) interfaces: Vec<Interface>,
    /// Topics of a bag.
    pub(crate) topics: Vec<TopicCount>,
    pub(crate) sensors: Vec<SensorReport>,
    pub(crate) flows: Vec<FlowReport>,
    pub(crate) packets_of_other_flows: u64,
    pub(crate) unclaimed: Vec<Unclaimed>,
    pub(crate) fragments_incomplete: u64,
    pub(crate) capture_counters: CaptureCounters,
    pub(crate) losses: Vec<String>,
    /// What differs from the specification or from what one expects, and costs nothing.
    pub(crate) notes: Vec<String>,
    pub(crate) advice: Vec<String>,
}

/// One step of the host's clock.
#[derive(Serialize)]
pub(crate) struct HostClockStep {
    /// When, by the stamps of the recording, ns.
    pub(crate) host_ns: u64,
    /// How far forward, s.
    pub(crate) step_s: f64,
    /// The stamps of the recording go on steadily all the same.
    pub(crate) is_undone: bool,
    pub(crate) words: String,
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
