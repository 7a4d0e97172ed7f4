//! Which Velodyne a packet is of. None carries a serial number: the address, the port, the path that packets take and, as a last
//! resort, their clock tell sensors apart.

use super::paths::Paths;
use super::sensor::{Family, GivenModel, Sensor};
use super::source_filter::SourceFilter;
use super::streams::stream_of;
use super::{MOST_SENSORS, Router, explain};
use crate::Packet;
use crate::velodyne::{Options, VelodyneDecoder};

impl Router {
    /// The Velodyne of this sender and port, and, where several have one address, of this path.
    pub(super) fn velodyne(&mut self, packet: &Packet<'_>, data: bool) -> Result<usize, Option<String>> {
        let (address, port) = stream_of(packet);
        let data_port = if data { Some(port) } else { self.data_port_of(packet)? };
        if data {
            self.note_velodyne(packet);
        }
        let is_candidate = |sensor: &Sensor| {
            matches!(sensor.family, Family::Velodyne(_))
                && !sensor.is_twin
                && sensor.first_source.is_some_and(|source| source.ip() == address)
                && (data_port.is_none() || sensor.data_port.is_none() || sensor.data_port == data_port)
        };
        let found = match data {
            true => self.velodyne_by_path(packet, &is_candidate),
            false => self.velodyne_of_position(packet, &is_candidate)?,
        };
        let at = match found {
            Some(at) => at,
            None if self.sensors.len() >= MOST_SENSORS => return Err(Some(explain::too_many(MOST_SENSORS))),
            None => self.add_velodyne(packet, data_port.unwrap_or(port)),
        };
        let sensor = &mut self.sensors[at];
        sensor.first_source.get_or_insert(packet.source);
        sensor.data_port = sensor.data_port.or(data_port);
        match data {
            true => sensor.paths.note(packet),
            false => {
                sensor.paths.auxiliary.get_or_insert(packet.link);
                sensor.position_packets += 1;
            }
        }
        Ok(at)
    }

    /// The one that sends its data packets by this path.
    fn velodyne_by_path(
        &mut self,
        packet: &Packet<'_>,
        is_candidate: &dyn Fn(&Sensor) -> bool,
    ) -> Option<usize> {
        let first = |sensors: &[Sensor], fits: &dyn Fn(&Paths) -> bool| {
            sensors.iter().position(|sensor| is_candidate(sensor) && fits(&sensor.paths))
        };
        let known = first(&self.sensors, &|paths| paths.has(packet));
        if let Some(at) = known.or_else(|| first(&self.sensors, &|paths| paths.is_open_to(packet))) {
            return Some(at);
        }
        if let Some(at) = first(&self.sensors, &|paths| paths.knows(packet)) {
            self.sensors[at].paths.note_copy(packet);
            return Some(at);
        }
        first(&self.sensors, &|paths| paths.is_gone(packet))
    }

    /// The one that a position packet is of.
    fn velodyne_of_position(
        &self,
        packet: &Packet<'_>,
        is_candidate: &dyn Fn(&Sensor) -> bool,
    ) -> Result<Option<usize>, Option<String>> {
        let all: Vec<usize> = (0..self.sensors.len()).filter(|at| is_candidate(&self.sensors[*at])).collect();
        let comes_by = |at: &&usize| {
            let paths = &self.sensors[**at].paths;
            paths.current().map(|path| path.link).or(paths.auxiliary) == Some(packet.link)
        };
        match (&all[..], all.iter().find(comes_by)) {
            (_, Some(at)) => Ok(Some(*at)),
            ([] | [_], None) => Ok(all.first().copied()),
            (several, None) => {
                let stream = |at: &usize| {
                    let sensor = &self.sensors[*at];
                    Some((sensor.first_source?.ip(), sensor.data_port.unwrap_or(0)))
                };
                let streams: Vec<_> = several.iter().filter_map(stream).collect();
                Err(Some(explain::position_of_several(&streams)))
            }
        }
    }

    fn add_velodyne(&mut self, packet: &Packet<'_>, data_port: u16) -> usize {
        let address = packet.source.ip();
        let status = self.ahead.status(address, data_port);
        let is_meant = |given: &&GivenModel| match given.source_filter {
            None => true,
            Some(SourceFilter::Sender(sender)) => sender == address,
            Some(SourceFilter::Port(port)) => port == data_port,
            Some(SourceFilter::Stream(stream)) => stream.ip() == address && stream.port() == data_port,
        };
        let product = self.models.iter().find(is_meant).map(|given| given.product);
        let options = Options { source: Some(address), status, product, ..Options::default() };
        let decoder = Family::Velodyne(Box::new(VelodyneDecoder::new(options)));
        let mut sensor = Sensor::new(decoder, None);
        sensor.first_source = Some(packet.source);
        self.sensors.push(sensor);
        self.sensors.len() - 1
    }

    /// The second sensor of a stream that no single one could send: packets of two clocks.
    pub(super) fn twin_of(&mut self, at: usize, packet: &Packet<'_>) -> Option<usize> {
        let Family::Velodyne(decoder) = &self.sensors[at].family else { return None };
        if !decoder.has_second_clock() || self.sensors[at].is_twin {
            return None;
        }
        if let Some(twin) = self.sensors[at].twin {
            return Some(twin);
        }
        if self.sensors.len() >= MOST_SENSORS {
            return None;
        }
        let twin = self.add_velodyne(packet, packet.destination.port());
        self.sensors[twin].is_twin = true;
        self.sensors[twin].data_port = self.sensors[at].data_port;
        self.sensors[at].twin = Some(twin);
        Some(twin)
    }
}
