//! What HDL-64Es say of themselves, read before their packets are decoded: a whole status takes over a second.

use std::net::IpAddr;

use crate::Packet;
use crate::velodyne::calibration::UnitStatus;
use crate::velodyne::{StatusReader, status_bytes};

/// Statuses by sender and port.
#[derive(Default)]
pub(super) struct Ahead {
    units: Vec<Unit>,
}

struct Unit {
    source: IpAddr,
    port: u16,
    reader: StatusReader,
    status: Option<UnitStatus>,
}

impl Ahead {
    /// Looks at a packet of whatever sensor; of more units than `most`, the rest is passed over.
    pub(crate) fn read(&mut self, packet: &Packet<'_>, most: usize) {
        let Some([kind, value]) = status_bytes(packet.payload) else { return };
        let (source, port) = (packet.source.ip(), packet.destination.port());
        let known = self.units.iter().position(|unit| unit.source == source && unit.port == port);
        let at = match known {
            Some(at) => at,
            None if self.units.len() >= most => return,
            None => {
                self.units.push(Unit { source, port, reader: StatusReader::default(), status: None });
                self.units.len() - 1
            }
        };
        let unit = &mut self.units[at];
        if unit.status.is_none() {
            unit.status = unit.reader.push(kind, value);
        }
    }

    /// Every unit found so far has sent its whole status.
    pub(crate) fn is_done(&self) -> bool {
        self.units.iter().all(|unit| unit.status.is_some())
    }

    /// The status that the unit of this sender and port sent.
    pub(crate) fn status(&self, source: IpAddr, port: u16) -> Option<UnitStatus> {
        self.units.iter().find(|unit| unit.source == source && unit.port == port)?.status.clone()
    }
}
