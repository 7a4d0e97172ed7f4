//! Sensors on the network: Ousters say by mDNS that they are there (`_roger._tcp.local.`), Velodynes by what they send.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, UdpSocket};
use std::time::{Duration, Instant};

use mdns_sd::{IfKind, ServiceDaemon, ServiceEvent};
use serde::Serialize;

use super::Vendor;

/// The service that Ouster sensors offer.
pub const OUSTER_SERVICE: &str = "_roger._tcp.local.";
/// Sensors of one network that are listed: more are a storm.
const MAX_FOUND: usize = 256;
/// Payloads of a Velodyne: data and position packets.
const VELODYNE_BYTES: [usize; 2] = [1206, 512];

/// A sensor that was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Found {
    /// Its maker.
    pub vendor: Vendor,
    /// Name on the network (`os-122220001234.local.`); empty where it has none.
    pub name: String,
    /// Where it can be asked.
    pub addresses: Vec<IpAddr>,
    /// Port of its web server.
    pub port: u16,
    /// Serial number, part number and firmware, where stated.
    pub serial: String,
    /// Part number.
    pub part: String,
    /// Firmware.
    pub firmware: String,
}

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum DiscoverError {
    /// No mDNS.
    #[error("mDNS cannot be asked: {0}")]
    Mdns(#[from] mdns_sd::Error),
    /// No socket for a Velodyne's packets.
    #[error("cannot listen on UDP port {port}: {source}")]
    Port {
        /// The port.
        port: u16,
        /// Why.
        source: io::Error,
    },
}

/// Asks by mDNS for Ousters for so long; on one interface only, if an address of it is given.
pub fn ousters(within: Duration, interface: Option<IpAddr>) -> Result<Vec<Found>, DiscoverError> {
    let daemon = ServiceDaemon::new()?;
    if let Some(address) = interface {
        daemon.disable_interface(IfKind::All)?;
        daemon.enable_interface(IfKind::Addr(address))?;
    }
    let events = daemon.browse(OUSTER_SERVICE)?;
    let end = Instant::now() + within;
    let mut found = BTreeMap::new();
    while let Ok(event) = events.recv_timeout(end.saturating_duration_since(Instant::now())) {
        if let ServiceEvent::ServiceResolved(service) = event
            && found.len() < MAX_FOUND
        {
            let property = |key| service.get_property_val_str(key).unwrap_or_default().to_owned();
            let mut addresses: Vec<IpAddr> =
                service.get_addresses().iter().map(|address| address.to_ip_addr()).collect();
            addresses.sort();
            let sensor = Found {
                vendor: Vendor::Ouster,
                name: service.get_hostname().to_owned(),
                addresses,
                port: service.get_port(),
                serial: property("sn"),
                part: property("pn"),
                firmware: property("fw"),
            };
            found.insert(service.get_fullname().to_owned(), sensor);
        }
    }
    let _ = daemon.shutdown(); // its thread ends with it
    Ok(found.into_values().collect())
}

/// Listens for so long on a port for packets of a Velodyne's length.
pub fn velodynes(within: Duration, address: IpAddr, port: u16) -> Result<Vec<Found>, DiscoverError> {
    let failed = |source| DiscoverError::Port { port, source };
    let socket = UdpSocket::bind((address, port)).map_err(failed)?;
    let end = Instant::now() + within;
    let mut found = BTreeMap::new();
    let mut bytes = [0; 2048];
    while let left = end.saturating_duration_since(Instant::now())
        && !left.is_zero()
    {
        socket.set_read_timeout(Some(left)).map_err(failed)?;
        match socket.recv_from(&mut bytes) {
            Ok((length, from)) if VELODYNE_BYTES.contains(&length) && found.len() < MAX_FOUND => {
                found.entry(from.ip()).or_insert_with(|| Found {
                    vendor: Vendor::Velodyne,
                    name: String::new(),
                    addresses: vec![from.ip()],
                    port: 80,
                    serial: String::new(),
                    part: String::new(),
                    firmware: String::new(),
                });
            }
            Ok(_) => {}
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {}
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(failed(error)),
        }
    }
    Ok(found.into_values().collect())
}
