//! Messages and frames against vectors made by other code, and against any bytes at all.

use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use proptest::prelude::*;

use crate::can::{BROADCAST, MAJOR};
use crate::command::PAIR_RANGE_URAD;
use crate::crc::crc32c;
use crate::link::{LINK_VERSION, LinkCounters, MAX_DATA, MAX_WIRE};
use crate::{
    AckCode, Command, DecodeError, Direction, Fault, Faults, Frame, Limit, MessageId, Order, Receiver,
    Report, ResetCause, Source, State,
};

const GOLDEN: &str = include_str!("../golden/messages.txt");

fn hex(text: &str) -> Vec<u8> {
    (0..text.len()).step_by(2).map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap()).collect()
}

#[test]
fn speaks_as_the_golden_vectors() {
    let mut count = 0;
    for line in GOLDEN.lines().filter(|line| !line.starts_with('#')) {
        let mut parts = line.splitn(5, ' ');
        let mut next = || parts.next().unwrap();
        let (direction, sequence, node) = (next(), next().parse().unwrap(), next().parse().unwrap());
        let (wire, text) = (hex(next()), next());
        let mut receiver = Receiver::default();
        let frames: Vec<Frame> = wire.iter().filter_map(|byte| receiver.push(*byte)).collect();
        let [frame] = frames[..] else { panic!("{line}: {:?}", receiver.counters()) };
        assert_eq!((frame.sequence, frame.id.node), (sequence, node), "{line}");
        let (encoded, again) = if direction == "device" {
            assert_eq!(frame.id.direction, Direction::ToDevice);
            let command = Command::decode(frame.id.message, frame.data()).unwrap();
            (format!("{command:?}"), Frame::command(sequence, node, &command))
        } else {
            assert_eq!(frame.id.direction, Direction::ToHost);
            let report = Report::decode(frame.id.message, frame.data()).unwrap();
            (format!("{report:?}"), Frame::report(sequence, node, &report))
        };
        assert_eq!(encoded, text);
        assert_eq!(again.encode().bytes(), wire, "{line}");
        count += 1;
    }
    assert_eq!(count, 29);
}

fn limit() -> impl Strategy<Value = Limit> {
    proptest::sample::select(Limit::ALL)
}

fn order() -> impl Strategy<Value = Order> {
    let pair = -PAIR_RANGE_URAD..=PAIR_RANGE_URAD;
    prop_oneof![
        (any::<u8>(), any::<i32>()).prop_map(|(axis, position_urad)| Order::MoveTo { axis, position_urad }),
        (any::<u8>(), any::<u16>(), any::<u16>()).prop_map(|(axis, speed_mrad_s, acceleration_mrad_s2)| {
            Order::Profile { axis, speed_mrad_s, acceleration_mrad_s2 }
        }),
        (pair.clone(), pair).prop_map(|(a_urad, b_urad)| Order::MovePair { a_urad, b_urad }),
        Just(Order::Hold),
        Just(Order::EStop),
        any::<u16>().prop_map(|deceleration_mrad_s2| Order::Stop { deceleration_mrad_s2 }),
        any::<u8>().prop_map(|axis| Order::Home { axis }),
        any::<bool>().prop_map(|armed| Order::Arm { armed }),
        (proptest::sample::select(&Fault::ALL[..]), any::<u32>())
            .prop_map(|(fault, key)| Order::ClearFault { fault, key }),
        (any::<u8>(), limit(), any::<i32>()).prop_map(|(axis, limit, value)| Order::SetLimit {
            axis,
            limit,
            value
        }),
    ]
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        (any::<[u8; 2]>(), any::<u16>(), any::<u32>()).prop_map(|(protocol, heartbeat_timeout_ms, nonce)| {
            Command::Hello {
                protocol_min: protocol[0],
                protocol_max: protocol[1],
                heartbeat_timeout_ms,
                nonce,
            }
        }),
        any::<[u32; 2]>().prop_map(|[session, time_ms]| Command::Heartbeat { session, time_ms }),
        any::<u16>().prop_map(|sequence| Command::TimeSync { sequence }),
        (any::<u8>(), limit()).prop_map(|(axis, limit)| Command::GetLimit { axis, limit }),
        (any::<u16>(), order()).prop_map(|(id, order)| Command::Order { id, order }),
    ]
}

fn report() -> impl Strategy<Value = Report> {
    let (state, source) = (proptest::sample::select(State::ALL), proptest::sample::select(Source::ALL));
    let (ack, reset) = (proptest::sample::select(AckCode::ALL), proptest::sample::select(ResetCause::ALL));
    prop_oneof![
        (any::<[u8; 3]>(), reset, any::<u32>()).prop_map(
            |([protocol, axes, capabilities], reset, session)| {
                Report::Info { protocol, axes, capabilities, reset, session }
            }
        ),
        any::<u64>().prop_map(|uid| Report::Identity { uid }),
        any::<[u32; 2]>().prop_map(|[firmware, revision]| Report::Build { firmware, revision }),
        (state.clone(), any::<[bool; 2]>(), any::<u16>(), any::<u32>()).prop_map(
            |(state, [armed, homed], faults, session)| {
                Report::Heartbeat { state, armed, homed, faults: Faults(faults), session }
            }
        ),
        (any::<u16>(), 0u64..1 << 48)
            .prop_map(|(sequence, device_us)| Report::TimeSync { sequence, device_us }),
        (any::<u16>(), any::<u8>(), ack, any::<i32>()).prop_map(|(id, message, code, detail)| Report::Ack {
            id,
            message,
            code,
            detail
        }),
        (any::<u8>(), limit(), any::<i32>()).prop_map(|(axis, limit, value)| Report::Limit {
            axis,
            limit,
            value
        }),
        (any::<u8>(), source, any::<u16>(), any::<i32>()).prop_map(
            |(axis, source, time_ms, position_urad)| {
                Report::Position { axis, source, time_ms, position_urad }
            }
        ),
        (any::<u8>(), any::<i8>(), any::<[i16; 2]>(), any::<u16>()).prop_map(
            |(axis, temperature_c, [current_ma, speed_mrad_s], supply_mv)| {
                Report::Effort { axis, temperature_c, current_ma, supply_mv, speed_mrad_s }
            }
        ),
        (proptest::sample::select(&Fault::ALL[..]), any::<u8>(), any::<u16>(), any::<i32>())
            .prop_map(|(fault, axis, time_ms, detail)| Report::Fault { fault, axis, time_ms, detail }),
        (any::<u16>(), any::<u8>(), any::<i32>()).prop_map(|(id, axis, error_urad)| Report::Done {
            id,
            axis,
            error_urad
        }),
        (any::<u8>(), state, any::<bool>(), any::<u16>(), any::<i32>()).prop_map(
            |(axis, state, homed, id, target_urad)| Report::Target { axis, state, homed, id, target_urad }
        ),
    ]
}

proptest! {
    #[test]
    fn every_command_round_trips(command in command()) {
        let payload = command.encode();
        prop_assert_eq!(Command::decode(payload.message(), payload.bytes()), Ok(command));
    }

    #[test]
    fn every_report_round_trips(report in report()) {
        let payload = report.encode();
        prop_assert_eq!(Report::decode(payload.message(), payload.bytes()), Ok(report));
    }

    /// Whatever decodes says the same when it is encoded and decoded again; nothing panics.
    #[test]
    fn any_bytes_are_a_message_or_an_error(message: u8, data in proptest::collection::vec(any::<u8>(), 0..12)) {
        if let Ok(command) = Command::decode(message, &data) {
            let payload = command.encode();
            prop_assert_eq!(payload.message(), message);
            if !matches!(command, Command::Order { order: Order::MovePair { .. }, .. }) {
                prop_assert_eq!(Command::decode(message, payload.bytes()), Ok(command));
            }
        }
        match Report::decode(message, &data) {
            Ok(report) => prop_assert_eq!(Report::decode(message, report.encode().bytes()), Ok(report)),
            Err(error) => prop_assert!(!std::string::ToString::to_string(&error).is_empty()),
        }
    }

    /// A receiver takes garbage between frames; a frame after a zero is decoded whatever came before.
    #[test]
    fn frames_are_found_in_garbage(
        garbage in proptest::collection::vec(any::<u8>(), 0..400),
        command in command(),
        sequence: u8,
    ) {
        let frame = Frame::command(sequence, 1, &command);
        let wire = frame.encode();
        prop_assert!(wire.bytes().len() <= MAX_WIRE);
        let mut receiver = Receiver::default();
        for byte in garbage.iter().chain(&[0]) {
            prop_assert_eq!(receiver.push(*byte), None); // one in 2^32 would pass by chance
        }
        let decoded: Vec<Frame> = wire.bytes().iter().filter_map(|byte| receiver.push(*byte)).collect();
        prop_assert_eq!(decoded, [frame]);
    }

    /// One flipped bit, one lost byte or one byte too many: the frame is dropped and counted.
    #[test]
    fn damaged_frames_are_dropped_and_counted(command in command(), at: proptest::sample::Index, bit in 0u8..8, kind in 0..3) {
        let frame = Frame::command(9, 1, &command);
        let mut wire = frame.encode().bytes().to_vec();
        let place = at.index(wire.len() - 1);
        match kind {
            0 => wire[place] ^= 1 << bit,
            1 => drop(wire.remove(place)),
            _ => wire.insert(place, 1 << bit),
        }
        let mut receiver = Receiver::default();
        let decoded: Vec<Frame> = wire.iter().chain(&[0]).filter_map(|byte| receiver.push(*byte)).collect();
        prop_assert_eq!(decoded, []);
        let counters = receiver.counters();
        prop_assert!(counters.checksum_errors + counters.malformed + counters.overlong > 0);
    }
}

#[test]
fn counters_tell_what_was_dropped() {
    let mut receiver = Receiver::default();
    let hear =
        |receiver: &mut Receiver, bytes: &[u8]| bytes.iter().filter_map(|byte| receiver.push(*byte)).count();
    let frame = |sequence| Frame::command(sequence, 1, &Command::TimeSync { sequence: 1 }).encode();
    assert_eq!(hear(&mut receiver, frame(1).bytes()), 1);
    assert_eq!(hear(&mut receiver, frame(2).bytes()), 1);
    assert_eq!(hear(&mut receiver, frame(3).bytes()), 1);
    assert_eq!(hear(&mut receiver, frame(5).bytes()), 1);
    assert_eq!(hear(&mut receiver, &[7; 100]), 0);
    assert_eq!(hear(&mut receiver, &[0]), 0);
    let counters = receiver.counters();
    assert_eq!((counters.frames, counters.gaps, counters.overlong), (4, 1, 1));
    let _: String = format!("{counters:?}");
}

/// A frame as another program might make it, and what a receiver says about it.
fn receive(version: u8, identifier: u32, data: &[u8]) -> (Option<Frame>, LinkCounters) {
    let mut plain = vec![version, 1];
    plain.extend(identifier.to_le_bytes());
    plain.extend(data);
    plain.extend(crc32c(&plain).to_le_bytes());
    receive_plain(&plain)
}

fn receive_plain(plain: &[u8]) -> (Option<Frame>, LinkCounters) {
    let mut wire = [0; 2 * MAX_WIRE];
    let length = crate::cobs::encode(plain, &mut wire).unwrap();
    let mut receiver = Receiver::default();
    let decoded = wire[..=length].iter().filter_map(|byte| receiver.push(*byte)).last();
    (decoded, receiver.counters())
}

#[test]
fn frames_are_as_long_as_the_layout_allows() {
    let id = MessageId::new(0x05, Direction::ToHost, 1);
    for length in [0, MAX_DATA] {
        let data = vec![0xAB; length];
        let (decoded, counters) = receive(LINK_VERSION, id.encode(), &data);
        let decoded = decoded.unwrap();
        assert_eq!((decoded.id, decoded.data(), counters.frames), (id, &data[..], 1));
        let mut receiver = Receiver::default();
        let again: Vec<_> = decoded.encode().bytes().iter().filter_map(|byte| receiver.push(*byte)).collect();
        assert_eq!(again, [decoded]);
        assert_eq!(decoded.encode().bytes().len(), MAX_WIRE - MAX_DATA + length);
    }
    let malformed = LinkCounters { malformed: 1, ..LinkCounters::default() };
    assert_eq!(receive(LINK_VERSION, id.encode(), &[0xAB; MAX_DATA + 1]), (None, malformed));
    for length in 1..10 {
        assert_eq!(receive_plain(&vec![LINK_VERSION; length]), (None, malformed), "{length} bytes");
    }
}

#[test]
fn other_versions_are_counted_and_their_greetings_decoded() {
    let other = LinkCounters { other_version: 1, ..LinkCounters::default() };
    let id =
        |message| MessageId { major: MAJOR + 1, ..MessageId::new(message, Direction::ToDevice, BROADCAST) };
    assert_eq!(receive(LINK_VERSION + 1, id(0x01).encode(), &[0; 8]), (None, other));
    assert_eq!(receive(LINK_VERSION, id(0x03).encode(), &[0; 8]), (None, other));
    assert_eq!(Frame::from_can(id(0x03).encode(), &[0; 8]), None);
    for message in [0x01, 0x02] {
        let decoded = receive(LINK_VERSION, id(message).encode(), &[5; 8]).0.unwrap();
        assert_eq!(decoded.id, id(message));
        assert_eq!(Frame::from_can(id(message).encode(), &[5; 8]).unwrap().data(), decoded.data());
    }
    let malformed = LinkCounters { malformed: 1, ..LinkCounters::default() };
    let valid = id(0x01).encode();
    for foreign in [valid | 1 << 29, valid | 1 << 31, valid ^ 1 << 21] {
        assert_eq!(receive(LINK_VERSION, foreign, &[0; 8]), (None, malformed));
        assert_eq!(Frame::from_can(foreign, &[0; 8]), None);
    }
    assert_eq!(Frame::from_can(valid, &[0; MAX_DATA + 1]), None);
}

#[test]
fn angles_of_a_pair_beyond_three_bytes_keep_their_sign() {
    let encoded = |a_urad, b_urad| {
        let bytes = Command::Order { id: 7, order: Order::MovePair { a_urad, b_urad } }.encode();
        match Command::decode(bytes.message(), bytes.bytes()) {
            Ok(Command::Order { order: Order::MovePair { a_urad, b_urad }, .. }) => [a_urad, b_urad],
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(encoded(8_388_607, -8_388_607), [8_388_607, -8_388_607]);
    assert_eq!(encoded(8_388_608, -8_388_609), [8_388_607, -8_388_607]);
    assert_eq!(encoded(i32::MAX, i32::MIN), [8_388_607, -8_388_607]);
}

#[test]
fn a_heartbeat_has_two_flags() {
    let flags = |flags| Report::decode(0x04, &[1, flags, 0, 0, 0, 0, 0, 0]);
    assert!(matches!(flags(3), Ok(Report::Heartbeat { armed: true, homed: true, .. })));
    assert_eq!(flags(4), Err(DecodeError::Value { message: 0x04, found: 4 }));
}
