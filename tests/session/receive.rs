//! The receiver's counters add up to what was sent.

use std::net::UdpSocket;

use outrigger::live::receive::{Listen, Options, Receiver};

use super::{any_port, sender, wait_until};

fn listen(name: &str) -> Listen {
    Listen { name: name.into(), address: any_port(), source: None }
}

pub fn long_and_empty_datagrams_are_whole() {
    let mut receiver = Receiver::start(&[listen("a")], Options::default()).unwrap();
    let (to, from) = (receiver.address(0), sender());
    let lengths = [0, 1, 1536, 1537, 65_507, 24_896, 0, 65_507, 1206];
    let before_ns = outrigger::live::receive::now_ns();
    for (number, length) in lengths.into_iter().enumerate() {
        let payload: Vec<u8> = (0..length).map(|byte| (byte + number) as u8).collect();
        from.send_to(&payload, to).unwrap();
    }
    for (number, length) in lengths.into_iter().enumerate() {
        let datagram = receiver.recv_blocking().unwrap();
        let packet = datagram.packet();
        assert_eq!(packet.payload.len(), length);
        assert!(packet.payload.iter().enumerate().all(|(byte, value)| *value == (byte + number) as u8));
        assert_eq!((packet.source, packet.destination), (from.local_addr().unwrap(), to));
        assert!(
            packet.host_time_ns >= before_ns && packet.host_time_ns <= outrigger::live::receive::now_ns()
        );
    }
    let counters = receiver.monitor().sockets().remove(0).counters;
    assert_eq!((counters.stamped_late, counters.kernel_dropped, counters.socket_errors), (0, 0, 0));
}

/// A burst into a buffer that holds a few datagrams: each one arrives or is counted, also those dropped last.
pub fn what_the_kernel_drops_is_counted() {
    let options = Options { receive_buffer_bytes: 4096, ..Options::default() };
    let receiver = Receiver::start(&[listen("a")], options).unwrap();
    let (to, from, monitor) = (receiver.address(0), sender(), receiver.monitor());
    let mut sent = 0;
    wait_until("the kernel drops", || {
        for _ in 0..200 {
            from.send_to(&[5; 30_000], to).unwrap();
            sent += 1;
        }
        monitor.kernel_drops()[0] > 0
    });
    receiver.stop_handle().stop();
    let monitor = receiver.monitor();
    let mut receiver = receiver;
    let mut arrived = 0;
    while receiver.recv_blocking().is_some() {
        arrived += 1;
    }
    let (sensor, socket) = (monitor.sensors()[0], monitor.sockets().remove(0));
    assert_eq!(sensor.packets, arrived);
    assert_eq!(arrived + sensor.queue_dropped + socket.counters.kernel_dropped, sent, "{socket:?}");
}

pub fn what_the_queue_drops_is_counted() {
    let options = Options { queue_datagrams: 10, ..Options::default() };
    let mut receiver = Receiver::start(&[listen("a")], options).unwrap();
    let (to, from, monitor) = (receiver.address(0), sender(), receiver.monitor());
    for number in 0..100u8 {
        from.send_to(&[number], to).unwrap();
    }
    wait_until("all were received", || {
        let sensor = monitor.sensors()[0];
        sensor.packets + sensor.queue_dropped == 100
    });
    assert_eq!(monitor.sensors()[0].queue_dropped, 90, "nobody took any of them");
    for number in 0..10u8 {
        assert_eq!(receiver.recv_blocking().unwrap().packet().payload, [number]);
    }
}

pub fn what_waits_is_bounded_in_bytes() {
    let options = Options { queue_bytes: 100_000, ..Options::default() };
    let mut receiver = Receiver::start(&[listen("a")], options).unwrap();
    let (to, from, monitor) = (receiver.address(0), sender(), receiver.monitor());
    let counted = || monitor.sensors()[0].packets + monitor.sensors()[0].queue_dropped;
    for sent in 1..=50 {
        from.send_to(&[1; 9_000], to).unwrap();
        wait_until("it was received", || counted() == sent);
    }
    let memory = monitor.memory();
    assert!(memory.waiting_bytes <= 100_000 && memory.waiting_bytes > 90_000, "{memory:?}");
    assert!(memory.held_bytes <= memory.waiting_bytes + 2 * 9_216, "one more is being read into: {memory:?}");
    let waiting = monitor.sensors()[0].packets;
    for _ in 0..waiting {
        receiver.recv_blocking().unwrap();
    }
    let after = monitor.memory();
    assert_eq!((after.waiting_bytes, after.max_waiting_bytes), (0, memory.max_waiting_bytes));
    for sent in 51..=60 {
        from.send_to(&[1; 9_000], to).unwrap();
        wait_until("it was received", || counted() == sent);
    }
    let again = monitor.memory().held_bytes;
    // the very first buffer was short and grew by what did not fit
    assert!(
        again <= memory.held_bytes.next_multiple_of(9_216),
        "the same buffers again: {again}, {memory:?}"
    );
}

pub fn sensors_on_one_port_are_distinguished_by_source() {
    // all of 127.0.0.0/8 is this host
    let first = Receiver::start(&[listen("probe")], Options::default()).unwrap().address(0);
    let address = format!("0.0.0.0:{}", first.port()).parse().unwrap();
    let known = |name: &str, source: &str| Listen {
        name: name.into(),
        address,
        source: Some(source.parse().unwrap()),
    };
    let listens = [known("left", "127.0.0.2"), known("right", "127.0.0.3")];
    let mut receiver = Receiver::start(&listens, Options::default()).unwrap();
    let to = ("127.0.0.1", receiver.address(0).port());
    for (from, payload) in [("127.0.0.3:0", 3u8), ("127.0.0.4:0", 4), ("127.0.0.2:0", 2), ("127.0.0.4:0", 4)]
    {
        UdpSocket::bind(from).unwrap().send_to(&[payload], to).unwrap();
    }
    let mut seen = Vec::new();
    for _ in 0..2 {
        let datagram = receiver.recv_blocking().unwrap();
        seen.push((datagram.sensor, datagram.packet().payload[0]));
    }
    assert_eq!(seen, [(1, 3), (0, 2)]);
    let monitor = receiver.monitor();
    wait_until("the strangers are counted", || monitor.sockets()[0].counters.foreign_source == 2);
    let socket = monitor.sockets().remove(0);
    assert_eq!(socket.sensors, ["left", "right"]);
    assert_eq!(socket.counters.first_foreign_source.unwrap().ip().to_string(), "127.0.0.4");
}

pub fn sockets_that_cannot_be_had_are_named() {
    let taken = sender();
    let address = taken.local_addr().unwrap();
    let busy = Listen { address, ..listen("front") };
    let error = Receiver::start(std::slice::from_ref(&busy), Options::default()).unwrap_err().to_string();
    assert!(error.contains("front") && error.contains(&address.to_string()), "{error}");
    assert!(error.contains("another program"), "{error}");
    let twins = [Listen { name: "left".into(), ..busy.clone() }, Listen { name: "right".into(), ..busy }];
    let error = Receiver::start(&twins, Options::default()).unwrap_err().to_string();
    assert!(error.contains("left and right") && error.contains("source"), "{error}");
    assert!(Receiver::start(&[], Options::default()).is_err());
}
