//! Where a sensor's packets come from.

use crate::decoder::Rejected;
use crate::ouster::Claim;
use crate::packet::Packet;

use super::checks::{check, check_unknown, foreign};
use super::decoder::VelodyneDecoder;
use super::wire::{DATA_PACKET_BYTES, DATA_PORT, DataPacket, POSITION_PACKET_BYTES, POSITION_PORT};

impl VelodyneDecoder {
    /// How surely a packet comes from this sensor: by its length, flags and model byte, and by where earlier ones came
    /// from. Velodyne packets carry no serial number.
    pub fn claim(&self, packet: &Packet<'_>) -> Claim {
        let usual_port = match packet.payload.len() {
            POSITION_PACKET_BYTES => POSITION_PORT,
            DATA_PACKET_BYTES => DATA_PORT,
            _ => return Claim::No,
        };
        if let Ok(payload) = <&[u8; DATA_PACKET_BYTES]>::try_from(packet.payload) {
            let data = DataPacket::of(payload);
            let refused = match &self.stream {
                Some(stream) => check(data, stream, self.model_byte).is_err(),
                None => check_unknown(data).is_err(),
            };
            if refused {
                return Claim::No;
            }
        }
        if self.check_source(packet).is_err() {
            return Claim::No;
        }
        let port = packet.destination.port();
        match (self.source, self.data_port) {
            (Some(source), _) if !source.is_loopback() => Claim::Familiar,
            (Some(_), Some(data_port)) if data_port == port => Claim::Familiar,
            _ if port == usual_port => Claim::Likely,
            _ => Claim::Possible,
        }
    }

    /// Whether a packet may come from where this sensor's packets come from. Behind one loopback address there can be
    /// several sensors: there the port of data packets counts as well.
    pub(super) fn check_source(&self, packet: &Packet<'_>) -> Result<(), Rejected> {
        let from = packet.source.ip();
        let port = packet.destination.port();
        match (self.source, self.data_port) {
            (Some(known), _) if known != from => {
                Err(foreign(format!("sent by {from}, this sensor's packets come from {known}")))
            }
            (Some(_), Some(known)) if from.is_loopback() && known != port && is_data(packet) => {
                Err(foreign(format!("sent to port {port}, this sensor's data packets go to {known}")))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn remember_source(&mut self, packet: &Packet<'_>) {
        self.source = Some(packet.source.ip());
        if is_data(packet) {
            self.data_port = Some(packet.destination.port());
        }
    }
}

fn is_data(packet: &Packet<'_>) -> bool {
    packet.payload.len() == DATA_PACKET_BYTES
}
