//! Messages with 11-bit identifiers on a CAN bus: through SocketCAN, or through a serial adapter with the LAWICEL text
//! protocol.

use std::io::ErrorKind;
use std::path::Path;
use std::time::{Duration, Instant};

use socketcan::{
    CanDataFrame, CanFrame, CanSocket, EmbeddedFrame, Frame as _, Socket, SocketOptions, StandardId,
};

use crate::drive::LinkError;
use crate::drive::bus_port::BusPort;
use crate::drive::can_queue;
use crate::drive::slcan::{self, BitRate, Message, SlcanReceiver};

const WRITE_TIMEOUT: Duration = Duration::from_millis(100);
/// Bits per second of a serial adapter that is none of USB.
const ADAPTER_BAUD: u32 = 1_000_000;

#[derive(Clone, Copy, Debug)]
pub enum BusAddress<'a> {
    /// A CAN interface; its bit rate is the system's business.
    Interface(&'a str),
    /// A serial adapter with the LAWICEL text protocol.
    Adapter(&'a str, BitRate),
}

enum Port {
    Socket(CanSocket),
    Adapter(BusPort, SlcanReceiver, Vec<Message>),
}

pub struct CanBus {
    name: String,
    port: Port,
    /// Messages received.
    pub received: u32,
    /// Last error report of the CAN controller.
    pub trouble: Option<String>,
}

impl CanBus {
    pub(crate) fn open(address: BusAddress) -> Result<Self, LinkError> {
        let name = match address {
            BusAddress::Interface(interface) => format!("cia402:{interface}"),
            BusAddress::Adapter(path, _) => format!("cia402:slcan:{path}"),
        };
        let failed =
            |error: std::io::Error| LinkError::Open { path: name.clone(), reason: error.to_string() };
        let port = match address {
            BusAddress::Adapter(path, bit_rate) => {
                let mut port = BusPort::open(Path::new(path), ADAPTER_BAUD)?;
                slcan::open_channel(port.tty(), &name, bit_rate)?;
                Port::Adapter(port, SlcanReceiver::default(), Vec::new())
            }
            BusAddress::Interface(interface) => {
                let socket = CanSocket::open(interface).map_err(failed)?;
                socket.set_write_timeout(WRITE_TIMEOUT).map_err(failed)?;
                socket.set_error_filter_accept_all().map_err(failed)?;
                Port::Socket(socket)
            }
        };
        Ok(Self { name, port, received: 0, trouble: None })
    }

    /// Its name in errors.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Sends one message.
    pub(crate) fn send(&mut self, identifier: u16, data: &[u8]) -> Result<(), LinkError> {
        let hung_up = |reason: String| LinkError::HungUp { path: self.name.clone(), reason };
        match &mut self.port {
            Port::Adapter(port, ..) => port.send(&slcan::encode_standard(identifier, data)),
            Port::Socket(socket) => {
                let frame = StandardId::new(identifier).and_then(|id| CanDataFrame::new(id, data));
                let frame = frame.ok_or_else(|| hung_up("a message over 8 bytes".into()))?;
                can_queue::send(&self.name, WRITE_TIMEOUT, || socket.write_frame(&frame))
            }
        }
    }

    /// Waits for one message; `None` when none came before `end`.
    pub(crate) fn receive(&mut self, end: Instant) -> Result<Option<(u16, Vec<u8>)>, LinkError> {
        loop {
            let message = match &mut self.port {
                Port::Adapter(port, receiver, waiting) => {
                    if waiting.is_empty() {
                        let Some(bytes) = port.read(end)? else { return Ok(None) };
                        waiting.extend(bytes.into_iter().filter_map(|byte| receiver.push(byte)));
                        waiting.reverse(); // the oldest is popped from the end
                        receiver.refuse_refusals(&self.name)?;
                    }
                    waiting.pop().filter(|message| !message.extended)
                }
                Port::Socket(socket) => {
                    let left = end.saturating_duration_since(Instant::now());
                    if left.is_zero() {
                        return Ok(None);
                    }
                    match socket.read_frame_timeout(left) {
                        Ok(CanFrame::Data(frame)) if !frame.is_extended() => Some(Message {
                            identifier: frame.raw_id(),
                            extended: false,
                            data: frame.data().to_vec(),
                        }),
                        Ok(CanFrame::Error(frame)) => {
                            self.trouble = Some(frame.into_error().to_string());
                            None
                        }
                        Ok(_) => None,
                        Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock) => {
                            return Ok(None);
                        }
                        Err(error) if error.kind() == ErrorKind::Interrupted => None,
                        // the interface is down: the next write says so
                        Err(error) if error.raw_os_error() == Some(nix::libc::ENETDOWN) => None,
                        Err(error) => {
                            return Err(LinkError::HungUp {
                                path: self.name.clone(),
                                reason: error.to_string(),
                            });
                        }
                    }
                }
            };
            if let Some(message) = message {
                self.received = self.received.wrapping_add(1);
                return Ok(Some((message.identifier as u16, message.data)));
            }
        }
    }
}
