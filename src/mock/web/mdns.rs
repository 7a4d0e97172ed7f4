//! An Ouster's announcement by mDNS (RFC 6762, DNS-SD: RFC 6763), written byte by byte.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};

const GROUP: Ipv4Addr = Ipv4Addr::new(224, 0, 0, 251);
const PORT: u16 = 5353;
const SERVICE: [&str; 3] = ["_roger", "_tcp", "local"];

/// What is announced.
#[derive(Clone, Debug)]
pub struct Announced {
    /// Serial number, which also names the sensor.
    pub serial: String,
    /// Part number.
    pub part: String,
    /// Firmware.
    pub firmware: String,
    /// Where its web server is.
    pub address: Ipv4Addr,
    /// Its port.
    pub port: u16,
}

/// Answers questions for Ousters on one interface until it is dropped.
#[derive(Debug)]
pub struct Announcer {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Announcer {
    /// On the interface with this address.
    pub fn start(announced: Announced, interface: Ipv4Addr) -> io::Result<Self> {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
        socket.set_reuse_address(true)?;
        socket.set_reuse_port(true)?;
        socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, PORT)).into())?;
        socket.join_multicast_v4(&GROUP, &interface)?;
        socket.set_multicast_if_v4(&interface)?;
        socket.set_multicast_loop_v4(true)?;
        socket.set_read_timeout(Some(Duration::from_millis(100)))?;
        let socket = UdpSocket::from(socket);
        let ends: Arc<AtomicBool> = Arc::default();
        let seen = ends.clone();
        let thread = std::thread::Builder::new().name("mock mdns".into()).spawn(move || {
            let mut bytes = [0; 4096];
            while !seen.load(Ordering::Relaxed) {
                let Ok((count, _)) = socket.recv_from(&mut bytes) else { continue };
                if asks_for_service(&bytes[..count]) {
                    let _ = socket.send_to(&announcement(&announced), SocketAddrV4::new(GROUP, PORT)); // asked again
                }
            }
        })?;
        Ok(Self { ends, thread: Some(thread) })
    }
}

impl Drop for Announcer {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn name(labels: &[&str]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for label in labels {
        bytes.push(label.len() as u8);
        bytes.extend_from_slice(label.as_bytes());
    }
    bytes.push(0);
    bytes
}

/// A question (not an answer) that names the service.
fn asks_for_service(bytes: &[u8]) -> bool {
    let wanted = name(&SERVICE);
    bytes.get(2).is_some_and(|flags| flags & 0x80 == 0)
        && bytes.windows(wanted.len()).any(|window| window.eq_ignore_ascii_case(&wanted))
}

/// Pointer, service, text and address record in one answer.
fn announcement(announced: &Announced) -> Vec<u8> {
    let instance_label = format!("Ouster Sensor {}", announced.serial);
    let host_label = format!("os-{}", announced.serial);
    let instance = name(&[&instance_label, SERVICE[0], SERVICE[1], SERVICE[2]]);
    let host = name(&[&host_label, "local"]);
    let mut service = vec![0, 0, 0, 0]; // priority, weight
    service.extend(announced.port.to_be_bytes());
    service.extend(&host);
    let mut texts = Vec::new();
    for (key, value) in [("sn", &announced.serial), ("pn", &announced.part), ("fw", &announced.firmware)] {
        let text = format!("{key}={value}");
        texts.push(text.len() as u8);
        texts.extend(text.as_bytes());
    }
    let mut bytes = vec![0, 0, 0x84, 0, 0, 0, 0, 4, 0, 0, 0, 0]; // an authoritative answer with four records
    for (owner, kind, class, data) in [
        (name(&SERVICE), 12u16, 1u16, instance.clone()),
        (instance.clone(), 33, 0x8001, service),
        (instance, 16, 0x8001, texts),
        (host, 1, 0x8001, announced.address.octets().to_vec()),
    ] {
        bytes.extend(owner);
        bytes.extend(kind.to_be_bytes());
        bytes.extend(class.to_be_bytes());
        bytes.extend(120u32.to_be_bytes());
        bytes.extend((data.len() as u16).to_be_bytes());
        bytes.extend(data);
    }
    bytes
}
