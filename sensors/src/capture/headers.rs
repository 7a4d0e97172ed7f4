//! Ethernet, IP and UDP headers in front of a payload that was received without them: capture files hold frames,
//! sockets deliver payloads.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use etherparse::{EtherType, Ethernet2Header, IpFragOffset, IpNumber, Ipv4Header, Ipv6Header, UdpHeader};

use crate::Packet;

/// Longest frame [`append_frame`] makes: Ethernet (14 bytes) and an IPv6 header (40) before 65535 bytes of UDP.
pub(crate) const MAX_FRAME: usize = 14 + 40 + 65535;

/// What a UDP payload may have at most over IPv4: 65535 minus the IP and UDP headers.
const MAX_PAYLOAD_IPV4: usize = 65535 - 20 - 8;
/// Over IPv6 the length field leaves out the IP header.
const MAX_PAYLOAD_IPV6: usize = 65535 - 8;

/// Appends the frame of a packet to `frame`: MAC addresses made from the IP addresses (locally administered), IP and
/// UDP checksums computed. `identification` goes into the IPv4 header.
pub(crate) fn append_frame(packet: &Packet<'_>, identification: u16, frame: &mut Vec<u8>) -> io::Result<()> {
    match one_family(packet)? {
        Family::V4(source, destination) => {
            check_length(packet, MAX_PAYLOAD_IPV4)?;
            let udp_length = (8 + packet.payload.len()) as u16; // checked above
            let mut ip =
                Ipv4Header::new(udp_length, 64, IpNumber::UDP, source.octets(), destination.octets())
                    .map_err(io::Error::other)?;
            ip.identification = identification;
            ip.fragment_offset = IpFragOffset::ZERO;
            ip.header_checksum = ip.calc_header_checksum();
            let udp = UdpHeader::with_ipv4_checksum(
                packet.source.port(),
                packet.destination.port(),
                &ip,
                packet.payload,
            )
            .map_err(io::Error::other)?;
            append_ethernet(packet, EtherType::IPV4, frame);
            frame.extend_from_slice(&ip.to_bytes());
            frame.extend_from_slice(&udp.to_bytes());
        }
        Family::V6(source, destination) => {
            check_length(packet, MAX_PAYLOAD_IPV6)?;
            let ip = Ipv6Header {
                payload_length: (8 + packet.payload.len()) as u16, // checked above
                next_header: IpNumber::UDP,
                hop_limit: 64,
                source: source.octets(),
                destination: destination.octets(),
                ..Default::default()
            };
            let udp = UdpHeader::with_ipv6_checksum(
                packet.source.port(),
                packet.destination.port(),
                &ip,
                packet.payload,
            )
            .map_err(io::Error::other)?;
            append_ethernet(packet, EtherType::IPV6, frame);
            frame.extend_from_slice(&ip.to_bytes());
            frame.extend_from_slice(&udp.to_bytes());
        }
    }
    frame.extend_from_slice(packet.payload);
    Ok(())
}

enum Family {
    V4(Ipv4Addr, Ipv4Addr),
    V6(Ipv6Addr, Ipv6Addr),
}

/// Both addresses in one family; IPv4 mapped into IPv6 is IPv4, and the unspecified address (of a socket bound to any)
/// belongs to either.
fn one_family(packet: &Packet<'_>) -> io::Result<Family> {
    use IpAddr::{V4, V6};
    match (packet.source.ip().to_canonical(), packet.destination.ip().to_canonical()) {
        (V4(source), V4(destination)) => Ok(Family::V4(source, destination)),
        (V6(source), V6(destination)) => Ok(Family::V6(source, destination)),
        (V4(source), V6(any)) if any.is_unspecified() => Ok(Family::V4(source, Ipv4Addr::UNSPECIFIED)),
        (V6(any), V4(destination)) if any.is_unspecified() => {
            Ok(Family::V4(Ipv4Addr::UNSPECIFIED, destination))
        }
        (V6(source), V4(any)) if any.is_unspecified() => Ok(Family::V6(source, Ipv6Addr::UNSPECIFIED)),
        (V4(any), V6(destination)) if any.is_unspecified() => {
            Ok(Family::V6(Ipv6Addr::UNSPECIFIED, destination))
        }
        (source, destination) => Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("a packet from {source} to {destination}: one is IPv4, one IPv6"),
        )),
    }
}

fn check_length(packet: &Packet<'_>, most: usize) -> io::Result<()> {
    if packet.payload.len() <= most {
        return Ok(());
    }
    let reason = format!("a UDP payload of {} bytes: at most {most} fit", packet.payload.len());
    Err(io::Error::new(io::ErrorKind::InvalidInput, reason))
}

fn append_ethernet(packet: &Packet<'_>, ether_type: EtherType, frame: &mut Vec<u8>) {
    let header = Ethernet2Header {
        source: mac_of(packet.source),
        destination: mac_of(packet.destination),
        ether_type,
    };
    frame.extend_from_slice(&header.to_bytes());
}

/// A locally administered MAC address that tells hosts apart as their IP addresses do.
fn mac_of(host: SocketAddr) -> [u8; 6] {
    let [a, b, c, d] = match host.ip().to_canonical() {
        IpAddr::V4(address) => address.octets(),
        IpAddr::V6(address) => {
            let o = address.octets();
            [o[12], o[13], o[14], o[15]]
        }
    };
    if [a, b, c, d] == [255; 4] { [255; 6] } else { [0x02, 0x00, a, b, c, d] }
}
