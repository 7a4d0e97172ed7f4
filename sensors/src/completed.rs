//! Frames and auxiliary data that a decoder completed and its caller has not read yet.

use std::collections::VecDeque;

use crate::Frame;
use crate::ouster::{ImuSample, ZoneReport};
use crate::velodyne::Position;

/// A queue that lends one thing at a time. Frames go round: in with their samples, out to be looked at, back to be
/// filled again; once every buffer has its size nothing is allocated and no sample is copied.
#[derive(Debug, Default)]
pub struct Completed {
    waiting: VecDeque<Owned>,
    in_sight: Option<Owned>,
    spent: Vec<Frame>,
}

#[derive(Debug)]
enum Owned {
    Frame(Frame),
    Imu(ImuSample),
    Position(Position),
    Zones(ZoneReport),
}

impl Completed {
    /// Brings the next thing into sight; what was there before is given up. False when nothing is left.
    pub fn advance(&mut self) -> bool {
        if let Some(Owned::Frame(frame)) = self.in_sight.take() {
            self.spent.push(frame);
        }
        self.in_sight = self.waiting.pop_front();
        self.in_sight.is_some()
    }

    /// The thing in sight.
    pub fn current(&self) -> Option<Decoded<'_>> {
        Some(match self.in_sight.as_ref()? {
            Owned::Frame(frame) => Decoded::Frame(frame),
            Owned::Imu(sample) => Decoded::Imu(sample),
            Owned::Position(position) => Decoded::Position(position),
            Owned::Zones(report) => Decoded::Zones(report),
        })
    }

    pub(crate) fn add_frame(&mut self, frame: Frame) {
        self.waiting.push_back(Owned::Frame(frame));
    }

    pub(crate) fn add_imu(&mut self, sample: ImuSample) {
        self.waiting.push_back(Owned::Imu(sample));
    }

    pub(crate) fn add_position(&mut self, position: Position) {
        self.waiting.push_back(Owned::Position(position));
    }

    pub(crate) fn add_zones(&mut self, report: ZoneReport) {
        self.waiting.push_back(Owned::Zones(report));
    }

    /// A frame that was looked at, as it was: its buffers are there to be filled again.
    pub(crate) fn spent_frame(&mut self) -> Option<Frame> {
        self.spent.pop()
    }
}

/// One complete thing. Borrowed: the decoder reuses its buffers, so memory does not grow with the recording.
#[derive(Clone, Copy, Debug)]
pub enum Decoded<'a> {
    /// One revolution.
    Frame(&'a Frame),
    /// One inertial sample.
    Imu(&'a crate::ouster::ImuSample),
    /// One position packet of a Velodyne (GPS sentence and pulse state).
    Position(&'a crate::velodyne::Position),
    /// One zone-monitor packet of an Ouster.
    Zones(&'a crate::ouster::ZoneReport),
}
