//! A link-layer frame down to its UDP datagram or IP fragment.
//!
//! Link types: <https://www.tcpdump.org/linktypes.html>. IP and UDP are etherparse's.

use std::net::{IpAddr, SocketAddr};

use etherparse::{IpNumber, Ipv6ExtensionSlice, LaxIpSlice, UdpSlice};

use super::reassembly::{Fragment, Key};
use crate::Link;

/// What a frame carries.
pub(super) enum Carried<'a> {
    Udp {
        source: SocketAddr,
        destination: SocketAddr,
        payload: &'a [u8],
    },
    Fragment(Fragment<'a>),
    NotIp,
    NotUdp,
    OtherLinkType,
    /// Its headers say that more follows than was captured.
    Cut,
    Malformed,
}

/// Takes a frame of a link type apart; what its link says of the sender goes into `link`.
pub(super) fn dissect<'a>(link_type: u16, frame: &'a [u8], link: &mut Link) -> Carried<'a> {
    match network(link_type, frame, link) {
        Network::Ip(packet) => ip(packet, *link),
        Network::Other => Carried::NotIp,
        Network::Unsupported => Carried::OtherLinkType,
        Network::Short => Carried::Cut,
    }
}

/// A whole UDP datagram, header first.
pub(super) fn udp(source: IpAddr, destination: IpAddr, datagram: &[u8]) -> Carried<'_> {
    match UdpSlice::from_slice(datagram) {
        Ok(udp) => Carried::Udp {
            source: SocketAddr::new(source, udp.source_port()),
            destination: SocketAddr::new(destination, udp.destination_port()),
            payload: udp.payload(),
        },
        Err(error) if error.required_len > datagram.len() => Carried::Cut,
        Err(_) => Carried::Malformed,
    }
}

enum Network<'a> {
    Ip(&'a [u8]),
    Other,
    Unsupported,
    Short,
}

fn network<'a>(link_type: u16, frame: &'a [u8], link: &mut Link) -> Network<'a> {
    // the sender's hardware address: of Ethernet, of Linux cooked v1 and v2 (of 6 bytes, as their headers say)
    let hardware = match link_type {
        1 => frame.get(6..12),
        113 if frame.get(4..6) == Some(&[0, 6]) => frame.get(6..12),
        276 if frame.get(11) == Some(&6) => frame.get(12..18),
        _ => None,
    };
    link.hardware = hardware.and_then(|bytes| bytes.try_into().ok()).unwrap_or_default();
    // Linux cooked v2 knows the interface of each packet of a capture of all of them
    if let (276, Some(&[_, _, high, low])) = (link_type, frame.get(4..8)) {
        link.interface = u16::from_be_bytes([high, low]);
    }
    // null, Ethernet, raw (as registered and as BSDs wrote it), loop, Linux cooked v1, IPv4, IPv6, Linux cooked v2
    let (ether_type, skip) = match link_type {
        1 => (frame.get(12..14), 14),
        113 => (frame.get(14..16), 16),
        276 => (frame.get(0..2), 20),
        0 | 108 => return frame.get(4..).map_or(Network::Short, by_version),
        12 | 14 | 101 | 228 | 229 => return by_version(frame),
        _ => return Network::Unsupported,
    };
    let Some(&[high, low]) = ether_type else { return Network::Short };
    let Some(rest) = frame.get(skip..) else { return Network::Short };
    by_ether_type(u16::from_be_bytes([high, low]), rest, link)
}

/// Passes over VLAN tags (one, two, or as many as there are).
fn by_ether_type<'a>(mut ether_type: u16, mut rest: &'a [u8], link: &mut Link) -> Network<'a> {
    loop {
        match ether_type {
            0x0800 | 0x86dd => return Network::Ip(rest),
            0x8100 | 0x88a8 | 0x9100 | 0x9200 => {
                let Some((&[tag_high, tag_low, high, low], inner)) = rest.split_first_chunk() else {
                    return Network::Short;
                };
                link.vlan = u16::from_be_bytes([tag_high, tag_low]) & 0x0fff;
                ether_type = u16::from_be_bytes([high, low]);
                rest = inner;
            }
            _ => return Network::Other,
        }
    }
}

fn by_version(packet: &[u8]) -> Network<'_> {
    match packet.first().map(|byte| byte >> 4) {
        Some(4 | 6) => Network::Ip(packet),
        Some(_) => Network::Other,
        None => Network::Short,
    }
}

fn ip(packet: &[u8], link: Link) -> Carried<'_> {
    let Ok((ip, stopped)) = LaxIpSlice::from_slice(packet) else {
        return if packet.len() < 20 { Carried::Cut } else { Carried::Malformed };
    };
    let payload = ip.payload();
    if stopped.is_some() {
        return Carried::Malformed;
    }
    if payload.ip_number != IpNumber::UDP {
        return Carried::NotUdp;
    }
    let (source, destination) = (ip.source_addr(), ip.destination_addr());
    if !payload.fragmented {
        // position packets of a VLP-16 of 2014 claim a wrong IP length: what counts is that of UDP
        return udp(source, destination, payload.payload);
    }
    if payload.incomplete {
        return Carried::Cut;
    }
    let place = match &ip {
        LaxIpSlice::Ipv4(ip) => {
            let header = ip.header();
            let offset = usize::from(header.fragments_offset().value()) * 8;
            Some((u32::from(header.identification()), offset, header.more_fragments()))
        }
        LaxIpSlice::Ipv6(ip) => ip.extensions().clone().into_iter().find_map(|header| match header {
            Ipv6ExtensionSlice::Fragment(header) => {
                let offset = usize::from(header.fragment_offset().value()) * 8;
                Some((header.identification(), offset, header.more_fragments()))
            }
            _ => None,
        }),
    };
    let Some((identification, offset, more)) = place else { return Carried::Malformed };
    let key = Key { source, destination, link, identification };
    Carried::Fragment(Fragment { key, offset, more, payload: payload.payload })
}
