//! Pages that come, look, stall and go, and requests that are none.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use outrigger::base::rng::Rng;

use super::program::exchange_bytes;
use super::sensors_lane::pause;
use super::watch::Watch;

fn page(address: SocketAddr) -> tungstenite::WebSocket<TcpStream> {
    let stream = TcpStream::connect(address).unwrap();
    tungstenite::client(format!("ws://{address}/api/v1/stream"), stream).unwrap().0
}

pub fn lane(watch: &Watch, address: SocketAddr, seed: u64) {
    let mut rng = Rng::new(seed, 14);
    while watch.goes_on() {
        pause(&mut rng, [0.5, 4.0]);
        let name = match rng.below(6) {
            0 => {
                let mut pages: Vec<_> = (0..1 + rng.below(4)).map(|_| page(address)).collect();
                for _ in 0..rng.below(200) {
                    pages.iter_mut().for_each(|page| drop(page.read().unwrap()));
                }
                "pages look and go" // without a word
            }
            1 => {
                let mut stalled = page(address);
                pause(&mut rng, [2.0, 10.0]); // nothing is read, and the daemon goes on
                let _ = stalled.close(None);
                "a page stalls"
            }
            2 => {
                let length = rng.below(3000) as usize;
                let bytes: Vec<u8> = (0..length).map(|_| rng.bits() as u8).collect();
                exchange_bytes(address, &bytes);
                "nonsense"
            }
            3 => {
                let mut stream = TcpStream::connect(address).unwrap();
                let whole = format!(
                    "POST /api/v1/recording/start HTTP/1.1\r\nHost: {address}\r\nContent-Length: 50\r\n\r\n{{\"la"
                );
                let cut = rng.below(whole.len() as u64) as usize;
                stream.write_all(&whole.as_bytes()[..cut]).unwrap();
                pause(&mut rng, [0.0, 2.0]);
                "half a request" // and the cable is out
            }
            4 => {
                let body = "x".repeat(1 << 16);
                let (code, answer) = watch.daemon().post("/api/v1/recording/start", &body);
                if !matches!(code, 0 | 400..=422) {
                    watch.log.fail(format!("64 KiB of nonsense are answered with {code} {answer}"));
                }
                "a large body"
            }
            _ => {
                let mut streams: Vec<_> = (0..20).map(|_| TcpStream::connect(address).unwrap()).collect();
                for stream in &mut streams {
                    stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
                    let _ = stream.read(&mut [0]);
                }
                "idle connections"
            }
        };
        watch.explained(name, "a page", |_| watch.daemon().get("/healthz").0 == 200);
    }
}
