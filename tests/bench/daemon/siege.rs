//! What crowds around a daemon under load: slow connections, streams of which some are never read, and somebody who asks for
//! an emergency stop again and again.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use outrigger::base::rng::Rng;

use super::crowd::Crowd;

const SLOW: usize = 200;
const STREAMS: usize = 50;
/// Of these, streams that nobody reads.
const UNREAD: usize = 10;

/// What became of it.
pub struct Outcome {
    /// From the first byte of a connection to the last one of its answer, ms, in order.
    pub stops_ms: Vec<f64>,
    /// How late this program woke from its sleeps, ms, in order: what the machine adds by itself.
    pub late_ms: Vec<f64>,
    pub refused_stops: usize,
    pub slow_opened: u64,
    pub streams_opened: usize,
    pub refused_streams: usize,
    pub stream_bytes: u64,
}

/// Besieges a daemon until told to stop.
pub fn lay(address: SocketAddr, stop: &AtomicBool) -> Outcome {
    let four: Vec<IpAddr> = (1..=4).map(|last| Ipv4Addr::new(127, 0, 0, last).into()).collect();
    let crowd = Crowd::gather(SLOW, &four, address);
    std::thread::scope(|scope| {
        let streams = scope.spawn(|| watch_streams(address, stop));
        let (mut stops_ms, mut late_ms, mut refused_stops) = (Vec::new(), Vec::new(), 0);
        let mut rng = Rng::new(1, 0);
        while !stop.load(Ordering::Relaxed) {
            let (asleep, pause) = (Instant::now(), Duration::from_millis(20 + rng.below(280)));
            std::thread::sleep(pause);
            late_ms.push((asleep.elapsed() - pause).as_secs_f64() * 1e3);
            let begun = Instant::now();
            match ask_to_stop(address) {
                Ok(text) if text.starts_with("HTTP/1.1 200") => {
                    stops_ms.push(begun.elapsed().as_secs_f64() * 1e3)
                }
                answer => {
                    println!("a stop was answered with {answer:?}");
                    refused_stops += 1;
                }
            }
        }
        stops_ms.sort_by(f64::total_cmp);
        late_ms.sort_by(f64::total_cmp);
        let (streams_opened, refused_streams, stream_bytes) = streams.join().unwrap();
        let slow_opened = crowd.opened();
        Outcome {
            stops_ms,
            late_ms,
            refused_stops,
            slow_opened,
            streams_opened,
            refused_streams,
            stream_bytes,
        }
    })
}

fn ask_to_stop(address: SocketAddr) -> std::io::Result<String> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(10)))?;
    write!(
        stream,
        "POST /api/v1/rig/e-stop HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
    )?;
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    Ok(text)
}

fn open(address: SocketAddr) -> std::io::Result<TcpStream> {
    let mut stream = TcpStream::connect(address)?;
    write!(
        stream,
        "GET /api/v1/stream HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    )?;
    let mut head = [0; 12];
    stream.read_exact(&mut head)?;
    if &head != b"HTTP/1.1 101" {
        return Err(std::io::Error::other(String::from_utf8_lossy(&head).into_owned()));
    }
    stream.set_nonblocking(true)?;
    Ok(stream)
}

/// Streams opened, streams refused, bytes read.
fn watch_streams(address: SocketAddr, stop: &AtomicBool) -> (usize, usize, u64) {
    let mut streams: Vec<Option<TcpStream>> = (0..STREAMS).map(|_| None).collect();
    let (mut opened, mut refused, mut bytes) = (0, 0, 0);
    let mut scratch = vec![0; 1 << 18];
    while !stop.load(Ordering::Relaxed) {
        for (number, place) in streams.iter_mut().enumerate() {
            let Some(stream) = place else {
                *place = open(address).ok();
                *if place.is_some() { &mut opened } else { &mut refused } += 1;
                continue;
            };
            if number < UNREAD {
                // what was cut off shows when something is said
                if stream.write(&[0x89, 0x80, 0, 0, 0, 0]).is_err() {
                    *place = None;
                }
                continue;
            }
            loop {
                match stream.read(&mut scratch) {
                    Ok(0) => *place = None,
                    Ok(length) => {
                        bytes += length as u64;
                        continue;
                    }
                    Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => {}
                    Err(_) => *place = None,
                }
                break;
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    (opened, refused, bytes)
}
