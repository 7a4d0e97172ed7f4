//! Every stream of UDP packets in a recording, with or without a decoder for it.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

use sensors::Packet;
use sensors::ouster::wire::{Header, PacketFormat};
use sensors::router::{Family, Guess, Routed, Router, Sensor};
use serde::Serialize;

use crate::live::watch::rate_hz;

/// Streams counted separately; the packets of more are counted together.
const MOST_FLOWS: usize = 1000;

/// Streams by sender, receiver and length.
#[derive(Default)]
pub struct Flows {
    flows: BTreeMap<(SocketAddr, SocketAddr, usize), Flow>,
    others: u64,
    span_ns: Option<[u64; 2]>,
}

struct Flow {
    packets: u64,
    span_ns: [u64; 2],
    guess: Guess,
    columns: Option<ColumnWatch>,
    /// Sensors that took some.
    takers: BTreeSet<usize>,
    unassigned: u64,
}

/// What the columns of an Ouster tell without metadata.
struct ColumnWatch {
    format: PacketFormat,
    has_header: bool,
    frame_id: Option<u32>,
    frames: u64,
    max_id: u16,
}

/// A stream as it is reported.
#[derive(Serialize)]
pub struct FlowReport {
    /// Sender.
    pub source: String,
    /// Receiver.
    pub destination: String,
    /// Length of the payloads, bytes.
    pub length: usize,
    /// How many.
    pub packets: u64,
    /// Over the time from the first to the last.
    pub rate_hz: Option<f64>,
    /// What they are, as the sensor knows that took them; otherwise what they look like.
    pub looks_like: String,
    /// Sensors that they are of: their ids.
    pub sensors: Vec<String>,
    /// Metadata of these sensors, where they have some.
    pub metadata: Vec<String>,
    /// Packets that no sensor took.
    pub unassigned: u64,
    #[serde(skip)]
    lacks_metadata: bool,
    /// Serial number in them.
    pub serial: Option<u64>,
    /// Initialization id in the first of them.
    pub init_id: Option<u32>,
    /// Revolutions that begin or end in the recording (Ouster lidar).
    pub frames: Option<u64>,
    /// Lidar mode that fits, columns per revolution (Ouster lidar).
    pub columns_per_frame: Option<u16>,
}

impl Flows {
    /// Counts a packet, of which this has become.
    pub(crate) fn add(&mut self, packet: &Packet<'_>, routed: Routed) {
        let time_ns = packet.host_time_ns;
        let span_ns = self.span_ns.get_or_insert([time_ns; 2]);
        *span_ns = [span_ns[0].min(time_ns), span_ns[1].max(time_ns)];
        let key = (packet.source, packet.destination, packet.payload.len());
        if self.flows.len() >= MOST_FLOWS && !self.flows.contains_key(&key) {
            self.others += 1;
            return;
        }
        let flow = self.flows.entry(key).or_insert_with(|| Flow::new(packet));
        flow.packets += 1;
        match routed {
            Routed::Assigned(at) | Routed::Damaged(at) => {
                flow.takers.insert(at);
            }
            Routed::Unclaimed => flow.unassigned += 1,
        }
        flow.span_ns = [flow.span_ns[0].min(time_ns), flow.span_ns[1].max(time_ns)];
        if let Some(columns) = &mut flow.columns {
            columns.add(packet.payload);
        }
    }

    /// Arrival of the first and the last packet, ns.
    pub(crate) fn span_ns(&self) -> Option<[u64; 2]> {
        self.span_ns
    }

    /// Packets of streams that are not listed.
    pub(crate) fn others(&self) -> u64 {
        self.others
    }

    /// All streams; the sensors of the router have these ids.
    pub(crate) fn reports(&self, router: &Router, ids: &[String]) -> Vec<FlowReport> {
        let has_metadata = router.sensors().iter().any(|sensor| matches!(sensor.family(), Family::Ouster(_)));
        let report = |((source, destination, length), flow): (&(SocketAddr, SocketAddr, usize), &Flow)| {
            let takers: Vec<&Sensor> = flow.takers.iter().map(|at| &router.sensors()[*at]).collect();
            let known = takers.first().and_then(|sensor| flow.as_known(sensor, *length));
            FlowReport {
                source: source.to_string(),
                destination: destination.to_string(),
                length: *length,
                packets: flow.packets,
                rate_hz: rate_hz(flow.packets, flow.span_ns),
                looks_like: known.as_ref().map_or_else(|| flow.guess.to_string(), |(what, _)| what.clone()),
                sensors: flow.takers.iter().map(|at| ids[*at].clone()).collect(),
                metadata: takers.iter().filter_map(|sensor| sensor.metadata_name.clone()).collect(),
                unassigned: flow.unassigned,
                lacks_metadata: takers.is_empty() && has_metadata && flow.guess.is_ouster(),
                serial: flow.guess.serial(),
                init_id: flow.header().map(|header| header.init_id),
                frames: flow.columns.as_ref().map(|columns| columns.frames),
                columns_per_frame: known
                    .map(|(_, columns)| columns)
                    .or_else(|| flow.columns.as_ref().and_then(ColumnWatch::columns_per_frame)),
            }
        };
        self.flows.iter().map(report).collect()
    }
}

impl FlowReport {
    /// The sensors of the packets, in words; nothing where unknown.
    pub(crate) fn assignment(&self) -> String {
        if self.sensors.is_empty() {
            let of_none = ", of no sensor with metadata";
            return if self.lacks_metadata { of_none.into() } else { String::new() };
        }
        let files = match self.metadata.is_empty() {
            true => String::new(),
            false => format!(" ({})", self.metadata.join(", ")),
        };
        let rest = match self.unassigned {
            0 => String::new(),
            packets => format!(", {packets} unassigned"),
        };
        format!(", of {}{files}{rest}", self.sensors.join(" and "))
    }
}

impl Flow {
    fn new(packet: &Packet<'_>) -> Self {
        let guess = Guess::of(packet.payload);
        let columns = match &guess {
            Guess::OusterLidar { header, formats } => {
                formats.first().map(|format| ColumnWatch::new(*format, header.is_some()))
            }
            _ => None,
        };
        let span_ns = [packet.host_time_ns; 2];
        Self { packets: 0, span_ns, guess, columns, takers: BTreeSet::new(), unassigned: 0 }
    }

    /// What the lidar packets of an Ouster are by its metadata, and its columns per revolution.
    fn as_known(&self, sensor: &Sensor, length: usize) -> Option<(String, u16)> {
        let Family::Ouster(decoder) = sensor.family() else { return None };
        let metadata = decoder.metadata();
        let format = metadata.packet_format();
        if length != format.packet_bytes() {
            return None;
        }
        let what =
            format!("Ouster lidar packet ({} x {} pixels)", format.profile.name(), format.pixels_per_column);
        Some((what, u16::try_from(metadata.columns_per_frame).ok()?))
    }

    fn header(&self) -> Option<Header> {
        match &self.guess {
            Guess::OusterLidar { header, .. } | Guess::OusterImu { header } => *header,
            Guess::OusterZone { header } => Some(*header),
            _ => None,
        }
    }
}

impl ColumnWatch {
    fn new(format: PacketFormat, has_header: bool) -> Self {
        Self { format, has_header, frame_id: None, frames: 0, max_id: 0 }
    }

    fn add(&mut self, payload: &[u8]) {
        let column = self.format.column(payload, 0);
        let head = self.format.read_column(column);
        let frame_id = match self.has_header {
            true => Header::read(self.format.header, payload).map(|header| header.frame_id),
            false => Some(self.format.legacy_frame_id(column)),
        };
        if frame_id.is_some() && frame_id != self.frame_id {
            self.frames += 1;
            self.frame_id = frame_id;
        }
        self.max_id = self.max_id.max(head.measurement_id);
    }

    /// The lidar mode that the column numbers need; a part of one revolution does not show it.
    fn columns_per_frame(&self) -> Option<u16> {
        let mode = [512, 1024, 2048].into_iter().find(|columns| self.max_id < *columns).unwrap_or(4096);
        (self.frames > 1).then_some(mode)
    }
}
