//! What is timed on our side: one pass over a capture file, or over its packets in memory.

use std::hint::black_box;
use std::path::Path;

use sensors::capture::CaptureReader;
use sensors::ouster::OusterDecoder;
use sensors::projection::Projector;
use sensors::router::Router;
use sensors::velodyne::{Options, VelodyneDecoder};
use sensors::{Decoded, Decoder, Frame, SensorModel};

use crate::recording::{Datagram, Sensor};

/// How far a pass goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// File to datagrams.
    Read,
    /// File to frames.
    Frames,
    /// File to points in single precision, every return.
    Single,
    /// The same in double precision.
    Double,
    /// Packets in memory to points in single precision.
    CoreSingle,
    /// The same in double precision.
    CoreDouble,
}

/// What a pass met.
#[derive(Clone, Copy, Debug, Default)]
pub struct Met {
    /// Samples with a range, every return.
    pub points: u64,
    /// Places for one: samples of valid columns, every return.
    pub samples: u64,
}

/// Buffers that live longer than a pass.
#[derive(Default)]
pub struct Points {
    projector: Option<Projector>,
    single: Vec<[f32; 3]>,
    double: Vec<[f64; 3]>,
}

impl Points {
    fn project(&mut self, way: Way, model: &SensorModel, frame: &Frame) {
        if matches!(way, Way::Read | Way::Frames) {
            black_box(frame);
            return;
        }
        let projector = self.projector.get_or_insert_with(|| Projector::new(model));
        projector.follow(model);
        for layer in [Some(&frame.first), frame.second.as_ref()].into_iter().flatten() {
            if matches!(way, Way::Single | Way::CoreSingle) {
                projector.points_f32(frame, layer, &mut self.single);
                black_box(&self.single);
            } else {
                projector.points_f64(frame, layer, &mut self.double);
                black_box(&self.double);
            }
        }
    }
}

/// One pass over a file.
pub fn file(way: Way, path: &Path, sensor: &Sensor, points: &mut Points) {
    each_frame(way == Way::Read, path, sensor, &mut |model, frame| points.project(way, model, frame));
}

/// Counts what a file holds.
pub fn count(path: &Path, sensor: &Sensor) -> Met {
    let mut met = Met::default();
    each_frame(false, path, sensor, &mut |_, frame| {
        for layer in [Some(&frame.first), frame.second.as_ref()].into_iter().flatten() {
            met.points += layer.points() as u64;
            met.samples += (frame.valid_columns() * frame.channels) as u64;
        }
    });
    met
}

fn each_frame(read_only: bool, path: &Path, sensor: &Sensor, take: &mut dyn FnMut(&SensorModel, &Frame)) {
    let mut reader = CaptureReader::open(path).expect("a capture");
    let mut router = Router::new();
    if let Sensor::Ouster { metadata, .. } = sensor {
        router.add_ouster((**metadata).clone(), "metadata");
    }
    let mut out = |_: usize, sensor: &sensors::router::Sensor, decoded: Decoded<'_>| {
        if let (Decoded::Frame(frame), Some(model)) = (decoded, sensor.model()) {
            take(model, frame);
        }
    };
    while let Some(packet) = reader.next().expect("a whole capture") {
        if read_only {
            black_box(packet);
        } else {
            router.push(&packet, &mut out);
        }
    }
    router.finish(&mut out);
}

/// One pass over packets in memory, straight into their decoder.
pub fn core(way: Way, packets: &[Datagram], sensor: &Sensor, points: &mut Points) {
    match sensor {
        Sensor::Ouster { metadata, .. } => {
            let model = &metadata.model;
            let mut decoder = OusterDecoder::new((**metadata).clone());
            let mut out = |decoded: Decoded<'_>| {
                if let Decoded::Frame(frame) = decoded {
                    points.project(way, model, frame);
                }
            };
            for packet in packets {
                // packets of another kind (position, IMU of another sensor) are no matter here
                let _ = decoder.push(&packet.packet(), &mut out);
            }
            decoder.finish(&mut out);
        }
        Sensor::Velodyne(_) => {
            let mut decoder = VelodyneDecoder::new(Options::default());
            for packet in packets {
                let _ = decoder.take(&packet.packet());
                project_completed(&mut decoder, way, points);
            }
            decoder.end();
            project_completed(&mut decoder, way, points);
        }
    }
}

fn project_completed(decoder: &mut VelodyneDecoder, way: Way, points: &mut Points) {
    while decoder.completed_mut().advance() {
        if let (Some(Decoded::Frame(frame)), Some(model)) = (decoder.completed().current(), decoder.model()) {
            points.project(way, model, frame);
        }
    }
}
