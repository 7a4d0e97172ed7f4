//! Many connections, and requests that never come to an end: who asks for a stop is heard all the same.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, Ipv4Addr, TcpStream};
use std::time::{Duration, Instant};

use outrigger::mock::rig::{MockConfig, MockRig};

use super::crowd::Crowd;
use super::program::{Bench, PATIENCE, Running};

const STOPS: usize = 20;
/// Far more than an idle machine needs, less than a stop that waits for slow connections to run out of time.
const HEARD: Duration = Duration::from_millis(500);

fn crowd_and_stops(addresses: &[u8]) {
    let rig = MockRig::start(MockConfig::default(), 3).unwrap();
    let bench = Bench::new(&["left"], &format!("[rig]\nport = \"{}\"\n", rig.path().display()));
    let daemon = bench.start(&[]);
    daemon.wait("the rig is there", |status| status["rig"]["connected"] == true);
    let from: Vec<IpAddr> = addresses.iter().map(|last| Ipv4Addr::new(127, 0, 0, *last).into()).collect();
    let crowd = Crowd::gather(200, &from, daemon.address);
    let mut times: Vec<Duration> = (0..STOPS).map(|_| stop(&daemon)).collect();
    times.sort();
    let (median, most) = (times[STOPS / 2], times[STOPS - 1]);
    println!("200 slow connections from {} addresses: stop in {median:.1?}, at most {most:.1?}", from.len());
    assert!(median < HEARD, "{times:?}");
    assert_eq!(daemon.get("/healthz").0, 200, "others are heard, too");
    assert_eq!(
        daemon.status()["components"].as_array().unwrap().iter().filter(|of| of["state"] == "dead").count(),
        0
    );
    assert!(crowd.opened() >= 200);
    drop(crowd);
    assert_eq!(daemon.end().0, Some(0));
}

fn stop(daemon: &Running) -> Duration {
    std::thread::sleep(Duration::from_millis(50));
    let begun = Instant::now();
    daemon.order("/api/v1/rig/e-stop", "");
    begun.elapsed()
}

pub fn a_stop_comes_through_a_crowd_of_one_address() {
    crowd_and_stops(&[1]);
}

pub fn a_stop_comes_through_crowds_of_four_addresses() {
    crowd_and_stops(&[1, 2, 3, 4]);
}

pub fn a_body_is_short_and_comes_in_time() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&[]);
    let address = daemon.address;
    // the connection stays open: whatever is answered is answered to what was sent so far
    let answer = |headers: &str, body: &[u8]| {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let head = format!("POST /api/v1/recording/start HTTP/1.1\r\nHost: {address}\r\n{headers}\r\n\r\n");
        stream.write_all(head.as_bytes()).unwrap();
        let _ = stream.write_all(body); // a daemon that had enough may close before the end
        let mut bytes = [0; 4096];
        let length = stream.read(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    let large = answer("Content-Length: 10000000", b"");
    assert!(large.starts_with("HTTP/1.1 413 ") && large.contains("at most 16384 bytes"), "{large}");
    let waiting = answer("Content-Length: 10000000\r\nExpect: 100-continue", b"");
    assert!(waiting.starts_with("HTTP/1.1 413 "), "nobody asks for a body that is too large: {waiting}");
    let chunked =
        answer("Transfer-Encoding: chunked", &[b"1000\r\n", &[b' '; 4096][..], b"\r\n"].concat().repeat(5));
    assert!(chunked.starts_with("HTTP/1.1 413 "), "{chunked}");
    let slow = answer("Content-Length: 100", b"{");
    assert!(slow.starts_with("HTTP/1.1 408 ") && slow.contains("within 2 s"), "{slow}");
    assert_eq!(daemon.status()["recorder"]["recording"], false);
    assert_eq!(daemon.end().0, Some(0));
}
