//! Every stream of UDP packets in a recording, with or without a decoder for it.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use sensors::Packet;
use sensors::ouster::wire::{Header, PacketFormat};
use sensors::router::Guess;
use serde::Serialize;

use crate::watch::rate_hz;

/// Streams kept apart; the packets of more are counted together.
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
}

/// What the columns of an Ouster tell without metadata.
struct ColumnWatch {
    format: PacketFormat,
    has_header: bool,
    frame_id: Option<u32>,
    frames: u64,
    greatest_id: u16,
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
    /// What they look like.
    pub looks_like: String,
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
    /// Counts a packet.
    pub fn add(&mut self, packet: &Packet<'_>) {
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
        flow.span_ns = [flow.span_ns[0].min(time_ns), flow.span_ns[1].max(time_ns)];
        if let Some(columns) = &mut flow.columns {
            columns.add(packet.payload);
        }
    }

    /// Arrival of the first and the last packet, ns.
    pub fn span_ns(&self) -> Option<[u64; 2]> {
        self.span_ns
    }

    /// Packets of streams that are not listed.
    pub fn others(&self) -> u64 {
        self.others
    }

    /// Serial numbers of Ouster sensors.
    pub fn serials(&self) -> Vec<u64> {
        let mut serials: Vec<u64> = self.flows.values().filter_map(|flow| flow.guess.serial()).collect();
        serials.sort_unstable();
        serials.dedup();
        serials
    }

    /// All streams.
    pub fn reports(&self) -> Vec<FlowReport> {
        self.flows
            .iter()
            .map(|((source, destination, length), flow)| FlowReport {
                source: source.to_string(),
                destination: destination.to_string(),
                length: *length,
                packets: flow.packets,
                rate_hz: rate_hz(flow.packets, flow.span_ns),
                looks_like: flow.guess.to_string(),
                serial: flow.guess.serial(),
                init_id: flow.header().map(|header| header.init_id),
                frames: flow.columns.as_ref().map(|columns| columns.frames),
                columns_per_frame: flow.columns.as_ref().and_then(ColumnWatch::columns_per_frame),
            })
            .collect()
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
        Self { packets: 0, span_ns: [packet.host_time_ns; 2], guess, columns }
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
        Self { format, has_header, frame_id: None, frames: 0, greatest_id: 0 }
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
        self.greatest_id = self.greatest_id.max(head.measurement_id);
    }

    /// The lidar mode that the column numbers need; a part of one revolution does not show it.
    fn columns_per_frame(&self) -> Option<u16> {
        let mode = [512, 1024, 2048].into_iter().find(|columns| self.greatest_id < *columns).unwrap_or(4096);
        (self.frames > 1).then_some(mode)
    }
}
