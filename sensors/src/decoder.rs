//! What every decoder of a sensor's packets does, and what it counts.

use crate::{Completed, Decoded, Packet, SensorModel};

/// Turns one sensor's packets into frames. Two families live behind it: `ouster::OusterDecoder` and
/// `velodyne::VelodyneDecoder`.
///
/// [`take`](Self::take) puts a packet in; its results are read from
/// [`completed`](Self::completed), where they can be read while the decoder is borrowed. [`push`](Self::push) and
/// [`finish`](Self::finish) do both.
pub trait Decoder {
    /// Takes one packet. A packet that this decoder does not take is counted and returned as [`Rejected`]; decoding
    /// goes on.
    fn take(&mut self, packet: &Packet<'_>) -> Result<(), Rejected>;

    /// Completes the frame under construction, marked incomplete where it is.
    fn end(&mut self);

    /// What is complete.
    fn completed(&self) -> &Completed;

    /// What is complete, to go on to the next.
    fn completed_mut(&mut self) -> &mut Completed;

    /// Everything counted so far.
    fn stats(&self) -> &DecodeStats;

    /// Beams that its frames are measured along, once they are known.
    fn model(&self) -> Option<&SensorModel>;

    /// Takes one packet and hands everything it completed to `out`.
    fn push(&mut self, packet: &Packet<'_>, out: &mut dyn FnMut(Decoded<'_>)) -> Result<(), Rejected> {
        let outcome = self.take(packet);
        self.hand_out(out);
        outcome
    }

    /// Hands out the frame under construction, marked incomplete where it is.
    fn finish(&mut self, out: &mut dyn FnMut(Decoded<'_>)) {
        self.end();
        self.hand_out(out);
    }

    /// Hands out everything that is complete.
    fn hand_out(&mut self, out: &mut dyn FnMut(Decoded<'_>)) {
        while self.completed_mut().advance() {
            if let Some(decoded) = self.completed().current() {
                out(decoded);
            }
        }
    }
}

/// Why a packet was rejected. Each is counted too.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Rejected {
    /// Not from this sensor or not of its format.
    #[error("foreign packet: {reason}")]
    Foreign {
        /// What was found and what was expected.
        reason: String,
    },
    /// From this sensor, but damaged.
    #[error("malformed packet: {reason}")]
    Malformed {
        /// What was found and what was expected.
        reason: String,
    },
    /// The checksum in the packet does not match its bytes.
    #[error("checksum mismatch: packet says {stored:#018x}, bytes give {computed:#018x}")]
    Checksum {
        /// In the packet.
        stored: u64,
        /// Over the bytes.
        computed: u64,
    },
}

/// Counters of one decoder; every loss has a name.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct DecodeStats {
    /// Packets accepted.
    pub packets: u64,
    /// Packets of this sensor that were too short or contradicted themselves.
    pub malformed: u64,
    /// Packets with a wrong checksum.
    pub crc_errors: u64,
    /// Packets that the sensor must have sent (by column or time gap) and that never came. Packets before the first
    /// and after the last one are not known to have been sent; packets that came damaged or late have their own
    /// counters.
    pub lost_packets: u64,
    /// Packets that came twice.
    pub duplicated: u64,
    /// Packets that came after a later one, in time to be used.
    pub reordered: u64,
    /// Packets that came after their frame was closed, and were dropped.
    pub late: u64,
    /// Times the sensor was re-initialised; where packets name no initialization (Ouster LEGACY), times its frame
    /// counter started over.
    pub init_id_changes: u64,
    /// Packets of another sensor or format.
    pub foreign: u64,
    /// Packets with a time stamp that contradicts those before and after it; they are dated by these.
    pub odd_stamps: u64,
    /// Damaged blocks in accepted packets (Velodyne); the rest of the packet was decoded.
    pub bad_blocks: u64,
    /// Pauses of seconds and more that the host's clock saw too: nothing is known to have been sent meanwhile.
    pub pauses: u64,
    /// Frames handed out.
    pub frames: u64,
    /// Of these, frames with every expected packet.
    pub complete_frames: u64,
}
