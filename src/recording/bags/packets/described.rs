//! What a bag says of its sensors: their names and their metadata.

use std::net::IpAddr;

use sensors::ouster::Metadata;
use sensors::router::{Named, SourceFilter};

use super::{BagPackets, BagSensor, TopicCount};

/// Metadata of a sensor of a bag.
pub(crate) struct BagMetadata {
    pub metadata: Metadata,
    /// As the bag holds them.
    pub text: String,
    /// What messages call them.
    pub name: String,
    /// Where the packets of their sensor seem to come from, where its namespace says which it is.
    pub address: Option<IpAddr>,
}

impl BagMetadata {
    /// Which packets they are of.
    pub fn source_filter(&self) -> Option<SourceFilter> {
        self.address.map(SourceFilter::Sender)
    }
}

/// The metadata of a bag, of sensors for which none are given (those of these serial numbers); and what of them cannot be read.
pub(crate) fn metadata_in(
    bag: &BagPackets,
    name: &str,
    given: &[Option<u64>],
) -> (Vec<BagMetadata>, Vec<String>) {
    let ousters = bag.sensors().iter().filter(|sensor| sensor.is_ouster()).count();
    if !given.is_empty() && given.len() >= ousters {
        return Default::default();
    }
    let of_sensor = |sensor: &BagSensor| Some((sensor.metadata.clone()?, Some(sensor.address)));
    let lacks_some = bag.sensors().iter().any(|sensor| sensor.is_ouster() && sensor.metadata.is_none());
    let others = bag.unassigned_metadata().iter().filter(|_| lacks_some);
    let all = bag.sensors().iter().filter_map(of_sensor).chain(others.map(|text| (text.clone(), None)));
    let (mut found, mut unreadable) = (Vec::new(), Vec::new());
    for ((text, topic), address) in all {
        let name = format!("{name}:{topic}");
        match Metadata::parse(&text, &name) {
            Ok(metadata) => {
                let serial = metadata.serial_number();
                if serial.is_none() || !given.contains(&serial) {
                    found.push(BagMetadata { metadata, text, name, address });
                }
            }
            Err(error) => unreadable.push(error.to_string()),
        }
    }
    (found, unreadable)
}

/// How the sensors of a bag are called: by their namespaces.
pub(crate) fn names_in(bag: &BagPackets, own: &[BagMetadata]) -> Vec<Named> {
    let named = |sensor: &BagSensor| Named {
        name: sensor.name.clone(),
        metadata: own.iter().find(|of| of.address == Some(sensor.address)).map(|of| of.name.clone()),
        source: Some(sensor.address),
        port: Some(sensor.port),
        auxiliary_port: Some(sensor.auxiliary_port()),
    };
    bag.sensors().iter().map(named).collect()
}

/// What a bag holds of other makers' sensors.
pub(crate) fn notices_of(bag: &BagPackets) -> Vec<String> {
    let other = bag.other_packets().map(|(count, maker)| {
        let TopicCount { topic, kind, messages, .. } = count;
        format!("{topic}: {messages} messages of {maker} packets ({kind}), which are not decoded here")
    });
    other.collect()
}
