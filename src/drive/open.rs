//! A line to a rig by its address.

use std::path::Path;

use super::can_bus::CanLink;
use super::cia402::BusAddress;
use super::dynamixel::Dynamixel;
use super::feetech::Feetech;
use super::link::Link;
use super::slcan::BitRate;
use super::{LinkError, SerialLink, bus_servos, cia402, usb};

/// Words before the colon of an address that [`open`] knows.
const FORMS: [&str; 6] = ["usb", "can", "slcan", "dynamixel", "feetech", "cia402"];

/// Whether an address names something else than a file.
pub(crate) fn is_no_path(address: &str) -> bool {
    address.split_once(':').is_some_and(|(word, _)| FORMS.contains(&word))
}

/// Opens a line by its address: `usb:A10K3` is the serial port of the USB device with that serial number, `can:can0` a CAN
/// interface, `slcan:/dev/ttyACM0@1000000` a CAN adapter on a serial port, `dynamixel:/dev/ttyUSB0@57600:1,2` and
/// `feetech:/dev/ttyUSB0@1000000:1,2` buses with two servos (baud rate and ids of axes 0 and 1; these are the defaults),
/// `cia402:can0@1,2` and `cia402:slcan:/dev/ttyACM0@1000000:1,2` CANopen drives (bit rate of the adapter, nodes of axes 0 and
/// 1), and anything else a serial port.
pub fn open(address: &str) -> Result<Box<dyn Link>, LinkError> {
    let wrong =
        |expected: &str| LinkError::Open { path: address.to_owned(), reason: format!("expected {expected}") };
    let word = address.split(':').next().unwrap_or_default();
    let wrong_bus =
        || wrong(&format!("{word}:PATH or {word}:PATH@BAUD:ID,ID with two different ids from 0 to 252"));
    let bus = |text, usual_baud| bus_address(text, usual_baud).ok_or_else(wrong_bus);
    Ok(match address.split_once(':') {
        Some(("usb", serial)) => Box::new(SerialLink::open(&usb::find(serial)?)?),
        Some(("can", interface)) => Box::new(CanLink::open(interface)?),
        Some(("slcan", text)) => {
            let (path, rate) = text.rsplit_once('@').map_or((text, None), |(path, rate)| (path, Some(rate)));
            Box::new(SerialLink::open_slcan(Path::new(path), bit_rate(address, rate)?)?)
        }
        Some(("dynamixel", text)) => {
            let (path, baud, ids) = bus(text, 57_600)?;
            Box::new(bus_servos::open::<Dynamixel>(Path::new(path), baud, ids)?)
        }
        Some(("feetech", text)) => {
            let (path, baud, ids) = bus(text, 1_000_000)?;
            Box::new(bus_servos::open::<Feetech>(Path::new(path), baud, ids)?)
        }
        Some(("cia402", text)) => {
            let (bus, nodes) = drives_address(address, text)?;
            Box::new(cia402::open(bus, nodes)?)
        }
        _ => Box::new(SerialLink::open(Path::new(address))?),
    })
}

/// Path, baud rate and ids of `PATH[@BAUD[:ID,ID]]`.
fn bus_address(text: &str, usual_baud: u32) -> Option<(&str, u32, [u8; 2])> {
    let Some((path, rest)) = text.split_once('@') else { return Some((text, usual_baud, [1, 2])) };
    let (baud, ids) = rest.split_once(':').unwrap_or((rest, "1,2"));
    let ids = pair(ids).filter(|ids| ids.iter().all(|id| *id <= 252))?;
    Some((path, baud.parse().ok()?, ids))
}

/// A bit rate; 1 Mbit/s where none is named.
fn bit_rate(address: &str, text: Option<&str>) -> Result<BitRate, LinkError> {
    let rate = text.map_or(Ok(BitRate::default()), str::parse);
    rate.map_err(|reason| LinkError::Open { path: address.to_owned(), reason })
}

/// Bus and nodes of `INTERFACE[@NODE,NODE]` or `slcan:PATH[@[BITRATE:]NODE,NODE]`, of which `@BITRATE` alone is one, too.
fn drives_address<'a>(address: &str, text: &'a str) -> Result<(BusAddress<'a>, [u8; 2]), LinkError> {
    let (bus, rest) = text.rsplit_once('@').unwrap_or((text, "1,2"));
    let (rate, nodes) = match rest.split_once(':') {
        Some((rate, nodes)) => (Some(rate), nodes),
        None if rest.contains(',') => (None, rest),
        None => (Some(rest), "1,2"),
    };
    let wrong = |reason: &str| LinkError::Open { path: address.to_owned(), reason: reason.to_owned() };
    let nodes = pair(nodes).filter(|nodes| nodes.iter().all(|node| (1..=126).contains(node)));
    let nodes = nodes.ok_or_else(|| {
        wrong(
            "expected cia402:INTERFACE@NODE,NODE or cia402:slcan:PATH@BITRATE:NODE,NODE with two different nodes from 1 to \
             126",
        )
    })?;
    let bus = match (bus.strip_prefix("slcan:"), rate) {
        (Some(path), rate) => BusAddress::Adapter(path, bit_rate(address, rate)?),
        (None, None) => BusAddress::Interface(bus),
        (None, Some(rate)) => {
            return Err(wrong(&format!(
                "bit rate {rate} for a CAN interface, expected cia402:INTERFACE@NODE,NODE: the system sets it \
                 (`ip link set {bus} type can bitrate {rate}`)"
            )));
        }
    };
    Ok((bus, nodes))
}

/// Two different numbers.
fn pair(text: &str) -> Option<[u8; 2]> {
    let (a, b) = text.split_once(',')?;
    let pair = [a.parse().ok()?, b.parse().ok()?];
    (pair[0] != pair[1]).then_some(pair)
}
