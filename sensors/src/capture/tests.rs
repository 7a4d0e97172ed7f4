//! The reader against captures made by hand and by the writers.

use std::io::{Read, Write};

use proptest::prelude::*;

use super::*;
use crate::Packet;

const TIME_NS: u64 = 1_697_084_088_551_168_123;

fn packet(payload: &[u8]) -> Packet<'_> {
    Packet {
        host_time_ns: TIME_NS,
        source: "10.5.6.101:40000".parse().unwrap(),
        destination: "10.5.6.1:7502".parse().unwrap(),
        link: Default::default(),
        payload,
    }
}

fn written(payloads: &[&[u8]]) -> Vec<u8> {
    let mut writer = PcapngWriter::new(Vec::new()).unwrap();
    let interface = writer.add_interface("left").unwrap();
    for payload in payloads {
        writer.write(interface, &packet(payload)).unwrap();
    }
    writer.close(&[5]).unwrap()
}

/// One Ethernet frame as the writers make it.
fn frame(packet: &Packet<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    headers::append_frame(packet, 9, &mut bytes).unwrap();
    bytes
}

/// A classic pcap in either byte order with one frame per record: (link type, frame, original length).
fn classic(big: bool, nanoseconds: bool, link_type: u32, frames: &[(Vec<u8>, usize)]) -> Vec<u8> {
    let word = |value: u32| if big { value.to_be_bytes() } else { value.to_le_bytes() };
    let mut bytes = Vec::new();
    bytes.extend(word(if nanoseconds { 0xa1b2_3c4d } else { 0xa1b2_c3d4 }));
    bytes.extend(word(if big { 2 << 16 | 4 } else { 4 << 16 | 2 }));
    bytes.extend([0; 8]);
    bytes.extend(word(65535));
    bytes.extend(word(link_type));
    for (frame, original) in frames {
        let fraction = if nanoseconds { 551_168_123 } else { 551_168 };
        for value in [1_697_084_088, fraction, frame.len() as u32, *original as u32] {
            bytes.extend(word(value));
        }
        bytes.extend(frame);
    }
    bytes
}

type Read1 = (u64, String, Vec<u8>);

fn read_all(bytes: Vec<u8>) -> (Vec<Read1>, CaptureCounters) {
    let mut reader = CaptureReader::new(std::io::Cursor::new(bytes), "test").unwrap();
    let mut packets = Vec::new();
    while let Some(packet) = reader.next().unwrap() {
        let addresses = format!("{} {}", packet.source, packet.destination);
        packets.push((packet.host_time_ns, addresses, packet.payload.to_vec()));
    }
    assert!(reader.next().unwrap().is_none(), "the end stays the end");
    (packets, reader.counters().clone())
}

const ADDRESSES: &str = "10.5.6.101:40000 10.5.6.1:7502";

#[test]
fn what_the_writers_write_is_read_again() {
    let long = vec![7; 65507];
    let (packets, counters) = read_all(written(&[b"one", &long, b""]));
    assert_eq!(packets.iter().map(|(_, _, payload)| payload.len()).collect::<Vec<_>>(), [3, 65507, 0]);
    assert!(packets.iter().all(|(time, addresses, _)| *time == TIME_NS && addresses == ADDRESSES));
    assert_eq!((counters.datagrams, counters.dropped_by_recorder), (3, 5));
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    writer.write(&packet(&long)).unwrap();
    let (packets, _) = read_all(writer.close().unwrap());
    assert_eq!(packets, [(TIME_NS, ADDRESSES.to_owned(), long)]);
}

#[test]
fn addresses_of_version_6_survive() {
    let source = "[fe80::1]:7503".parse().unwrap();
    let destination = "[ff02::5]:7502".parse().unwrap();
    let mut writer = PcapWriter::new(Vec::new()).unwrap();
    writer.write(&Packet { source, destination, ..packet(b"six") }).unwrap();
    let (packets, _) = read_all(writer.close().unwrap());
    assert_eq!(packets[0].1, "[fe80::1]:7503 [ff02::5]:7502");
}

#[test]
fn both_byte_orders_and_both_resolutions() {
    for (big, nanoseconds) in [(false, false), (false, true), (true, false), (true, true)] {
        let frame = frame(&packet(b"abc"));
        let (packets, _) = read_all(classic(big, nanoseconds, 1, &[(frame.clone(), frame.len())]));
        let expected = if nanoseconds { TIME_NS } else { TIME_NS / 1000 * 1000 };
        assert_eq!(packets, [(expected, ADDRESSES.to_owned(), b"abc".to_vec())]);
    }
}

#[test]
fn every_link_type_leads_to_the_same_datagram() {
    let ethernet = frame(&packet(b"abc"));
    let ip = &ethernet[14..];
    let behind = |head: &[u8]| [head, ip].concat();
    let tagged = |tags: &[u8]| [&ethernet[..12], tags, &ethernet[12..]].concat();
    let mut cooked = [0; 16];
    cooked[14] = 8;
    let mut cooked_2 = [0; 20];
    cooked_2[0] = 8;
    let cases: Vec<(u32, Vec<u8>)> = vec![
        (1, ethernet.clone()),
        (1, [&ethernet[..], &[0; 6]].concat()), // padded to the least Ethernet length
        (1, tagged(&[0x81, 0, 0, 5])),
        (1, tagged(&[0x88, 0xa8, 0, 5, 0x81, 0, 0, 6])),
        (113, behind(&cooked)),
        (276, behind(&cooked_2)),
        (101, ip.to_vec()),
        (228, ip.to_vec()),
        (0, behind(&[2, 0, 0, 0])),
        (108, behind(&[0, 0, 0, 2])),
    ];
    for (link_type, frame) in cases {
        let length = frame.len();
        let (packets, _) = read_all(classic(false, true, link_type, &[(frame, length)]));
        assert_eq!(packets, [(TIME_NS, ADDRESSES.to_owned(), b"abc".to_vec())], "link type {link_type}");
    }
}

#[test]
fn what_is_no_datagram_is_counted_as_what_it_is() {
    let good = frame(&packet(&[9; 100]));
    let mut arp = good.clone();
    arp[13] = 6;
    let mut tcp = good.clone();
    tcp[23] = 6;
    let mut contradicts = good.clone();
    contradicts[14 + 20 + 4..][..2].copy_from_slice(&[0xff, 0xff]); // the UDP length
    let mut not_a_header = good.clone();
    not_a_header[14] = 0x41;
    let cut = good[..60].to_vec();
    let frames = [(arp, 142), (tcp, 142), (contradicts, 142), (not_a_header, 142), (cut, 142), (good, 142)];
    let (packets, counters) = read_all(classic(true, false, 1, &frames));
    assert_eq!(packets.len(), 1);
    assert_eq!((counters.frames, counters.not_ip, counters.not_udp), (6, 1, 1));
    assert_eq!((counters.malformed, counters.cut_by_snap_length), (2, 1));
    let (_, counters) = read_all(classic(true, false, 147, &[(vec![1; 9], 9)]));
    assert_eq!(counters.other_link_type, 1);
}

#[test]
fn a_wrong_ip_length_does_not_matter_where_udp_knows_better() {
    let mut frame = frame(&packet(b"abc"));
    frame[14 + 2..14 + 4].copy_from_slice(&1234_u16.to_be_bytes());
    let length = frame.len();
    let (packets, counters) = read_all(classic(false, true, 1, &[(frame, length)]));
    assert_eq!((packets.len(), counters.malformed), (1, 0));
    assert_eq!(packets[0].2, b"abc");
}

#[test]
fn a_cut_file_keeps_what_came_before_and_says_where() {
    let whole = written(&[b"first", &[1; 500]]);
    let (_, counters) = read_all(whole.clone());
    assert_eq!(counters.truncated, None);
    for length in 28..whole.len() {
        let mut reader = CaptureReader::new(std::io::Cursor::new(whole[..length].to_vec()), "cut").unwrap();
        let mut payloads = Vec::new();
        while let Some(packet) = reader.next().unwrap() {
            payloads.push(packet.payload.len());
        }
        assert!([5, 500].starts_with(&payloads), "{payloads:?}");
        if let Some(cut) = reader.counters().truncated {
            assert_eq!(cut.offset + cut.found_bytes, length as u64);
            assert!(cut.expected_bytes > cut.found_bytes);
        }
    }
}

#[test]
fn gzip_is_recognised_also_when_cut() {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(&written(&[b"first", &[1; 500]])).unwrap();
    let packed = packed.finish().unwrap();
    assert_eq!(read_all(packed.clone()).0.len(), 2);
    let (packets, counters) = read_all(packed[..packed.len() - 9].to_vec());
    assert!(packets.len() <= 2 && counters.truncated.is_some());
}

/// A pcapng block in big-endian order.
fn block(kind: u32, body: &[u8]) -> Vec<u8> {
    let length = (body.len() as u32 + 12).to_be_bytes();
    [&kind.to_be_bytes()[..], &length, body, &length].concat()
}

#[test]
fn big_endian_pcapng_with_its_own_clocks() {
    let section = [&[0x1a, 0x2b, 0x3c, 0x4d, 0, 1, 0, 0][..], &[0xff; 8]].concat();
    // stamps in 2^-10 s, counted from second 1000; name "a"
    let first = [
        &[0, 1, 0, 0, 0, 0, 0, 0][..],
        &[0, 2, 0, 1, b'a', 0, 0, 0],
        &[0, 9, 0, 1, 0x8a, 0, 0, 0],
        &[0, 14, 0, 8, 0, 0, 0, 0, 0, 0, 0x03, 0xe8],
        &[0; 4],
    ]
    .concat();
    let second = [0, 1, 0, 0, 0, 0, 0, 0]; // microseconds by default
    let mut frame = frame(&packet(b"ab"));
    let length = frame.len() as u32;
    frame.resize(frame.len().next_multiple_of(4), 0);
    let enhanced = |interface: u32, ticks: u32| {
        let numbers = [interface, 0, ticks, length, length].map(u32::to_be_bytes);
        block(
            6,
            &[numbers.as_flattened(), &frame, &[0, 4, 0, 8, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0]].concat(),
        )
    };
    let simple = block(3, &[&length.to_be_bytes()[..], &frame].concat());
    let unknown = block(0x0bad, &[0; 200_000]);
    let bytes = [
        block(0x0a0d_0d0a, &section),
        block(1, &first),
        unknown,
        block(1, &second),
        enhanced(0, 512),
        enhanced(1, 7),
        simple,
    ]
    .concat();
    let (packets, counters) = read_all(bytes);
    let times: Vec<u64> = packets.iter().map(|(time, _, _)| *time).collect();
    assert_eq!(times, [1_000_500_000_000, 7_000, 0]);
    assert!(packets.iter().all(|(_, _, payload)| payload == b"ab"));
    assert_eq!(counters.dropped_by_recorder, 4);
}

#[test]
fn damage_names_the_byte_and_what_stands_there() {
    let start = written(&[]);
    let at = written(&[b"x"]).len();
    for (bad, names) in [
        ([6_u32, 13, 0, 0].map(u32::to_le_bytes), "length 13"),
        ([6, 0x7fff_fff0, 0, 0].map(u32::to_le_bytes), "2147483632 bytes"),
    ] {
        let mut bytes = written(&[b"x"]);
        bytes.extend(bad.as_flattened());
        let mut reader = CaptureReader::new(std::io::Cursor::new(bytes), "bad.pcapng").unwrap();
        assert!(reader.next().unwrap().is_some());
        let error = reader.next().unwrap_err().to_string();
        assert!(error.contains(names) && error.contains(&format!("byte {at}")), "{error}");
        assert!(reader.next().unwrap().is_none());
    }
    let mut no_interface = PcapngWriter::new(Vec::new()).unwrap();
    no_interface.add_interface("a").unwrap();
    no_interface.write(0, &packet(b"x")).unwrap();
    let bytes = no_interface.close(&[]).unwrap();
    let head = 28 + bytes[28..].windows(4).position(|word| word == 1_u32.to_le_bytes()).unwrap();
    let length = u32::from_le_bytes(bytes[head + 4..head + 8].try_into().unwrap()) as usize;
    let bytes = [&bytes[..head], &bytes[head + length..]].concat();
    let mut reader = CaptureReader::new(std::io::Cursor::new(bytes), "bad.pcapng").unwrap();
    let error = reader.next().unwrap_err().to_string();
    assert!(error.contains("interface 0") && error.contains(&format!("byte {head}")), "{error}");
    assert!(start.len() < at);
}

#[test]
fn what_is_no_capture_is_named() {
    let error = CaptureReader::new(&b"{\"prod_line\": \"OS-1-64\"}"[..], "meta.json").err().unwrap();
    assert!(error.to_string().contains("meta.json is no capture") && error.to_string().contains("JSON"));
    let error = CaptureReader::open("/no/such/file".as_ref()).err().unwrap().to_string();
    assert!(error.starts_with("/no/such/file: "), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    /// Damaged captures end in an error or a note, never in a panic, and memory follows the bytes that are there.
    #[test]
    fn no_damage_panics(changes in prop::collection::vec((0_usize..2400, any::<u8>()), 0..12), cut in 0_usize..2400, ng in any::<bool>()) {
        let ethernet = frame(&packet(&[3; 700]));
        let mut fragment = ethernet.clone();
        fragment[14 + 6] = 0x20; // more fragments follow
        let mut bytes = match ng {
            true => written(&[&[1; 300], &[2; 900], b"x"]),
            false => classic(false, false, 1, &[(ethernet.clone(), 742), (fragment, 742), (ethernet, 742)]),
        };
        for (at, value) in changes {
            let length = bytes.len();
            bytes[at % length] = value;
        }
        bytes.truncate(cut.max(4));
        if let Ok(mut reader) = CaptureReader::new(std::io::Cursor::new(bytes), "damaged") {
            while let Ok(Some(packet)) = reader.next() {
                prop_assert!(packet.payload.len() <= 2400);
            }
        }
    }
}

/// A stream of endless zeros behind a record that claims to be long: nothing is taken that the limit forbids.
#[test]
fn a_claimed_length_is_not_believed() {
    let mut bytes = classic(false, false, 1, &[]);
    bytes.extend([0; 8]);
    bytes.extend(u32::MAX.to_le_bytes());
    bytes.extend(u32::MAX.to_le_bytes());
    let endless = std::io::Cursor::new(bytes).chain(std::io::repeat(0));
    let mut reader = CaptureReader::new(endless, "endless").unwrap();
    assert!(reader.next().unwrap_err().to_string().contains("4294967295 bytes"));
    assert!(reader.position() < 1 << 20);
}

/// 80,000 interfaces, statistics of the last one after each: drops are summed as they come, and once.
#[test]
fn many_interfaces_cost_no_more_each() {
    let block = |kind: u32, body: &[u8]| {
        let length = (12 + body.len() as u32).to_le_bytes();
        [&kind.to_le_bytes(), &length[..], body, &length].concat()
    };
    let mut bytes =
        block(0x0a0d_0d0a, &[0x4d, 0x3c, 0x2b, 0x1a, 1, 0, 0, 0, 255, 255, 255, 255, 255, 255, 255, 255]);
    for number in 0..80_000_u32 {
        bytes.extend(block(1, &[1, 0, 0, 0, 0, 0, 0, 0]));
        // interface, stamp, then the option isb_ifdrop
        let drops =
            [&number.to_le_bytes()[..], &[0; 8], &[5, 0, 8, 0], &3_u64.to_le_bytes(), &[0; 4]].concat();
        bytes.extend(block(5, &drops));
    }
    let mut reader = CaptureReader::new(std::io::Cursor::new(bytes), "test").unwrap();
    assert!(reader.next().unwrap().is_none());
    assert_eq!(reader.interfaces().len(), 80_000);
    assert_eq!(reader.counters().dropped_by_recorder, 240_000);
}
