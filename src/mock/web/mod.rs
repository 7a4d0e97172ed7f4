//! A sensor's web server on this host: what an operator's set-up talks to, with what may go wrong in it.

use std::io::{self, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

mod mdns;
mod ouster;
mod velodyne;

pub use mdns::{Announced, Announcer};
pub use ouster::OusterWeb;
pub use velodyne::VelodyneWeb;

/// What may go wrong with a web server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WebFault {
    /// Connections are closed without a word.
    Refuses,
    /// Every answer comes a byte in a while.
    Slow,
    /// Half of each answer comes.
    Half,
    /// Answers are no JSON.
    WrongJson,
    /// Answers are JSON of another kind.
    OtherJson,
    /// The answer has no end.
    Endless,
    /// It sends the client elsewhere.
    Elsewhere,
    /// It says that it is broken.
    ServerError,
    /// Accepted settings go back to what they were.
    Reverts,
    /// It never runs again after a change.
    NeverReady,
}

/// Names that [`WebFault::from_str`] knows.
const FAULTS: [(&str, WebFault); 10] = [
    ("refuses", WebFault::Refuses),
    ("slow", WebFault::Slow),
    ("half", WebFault::Half),
    ("wrong-json", WebFault::WrongJson),
    ("other-json", WebFault::OtherJson),
    ("endless", WebFault::Endless),
    ("elsewhere", WebFault::Elsewhere),
    ("server-error", WebFault::ServerError),
    ("reverts", WebFault::Reverts),
    ("never-ready", WebFault::NeverReady),
];

impl FromStr for WebFault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let names = || FAULTS.map(|(name, _)| name).join(", ");
        FAULTS
            .iter()
            .find(|(name, _)| *name == text)
            .map(|(_, fault)| *fault)
            .ok_or_else(|| format!("{text:?}; known are {}", names()))
    }
}

/// What stands behind a server.
#[derive(Debug)]
pub enum Behind {
    /// The API of an Ouster.
    Ouster(Box<OusterWeb>),
    /// The forms of a Velodyne.
    Velodyne(VelodyneWeb),
}

impl Behind {
    fn answer(&mut self, request: &Request) -> Answer {
        match self {
            Self::Ouster(web) => web.answer(request),
            Self::Velodyne(web) => web.answer(request),
        }
    }

    /// Its destination: host, port of lidar packets, port of auxiliary packets.
    pub(crate) fn destination(&self) -> (String, Option<u16>, Option<u16>) {
        match self {
            Self::Ouster(web) => web.destination(),
            Self::Velodyne(web) => web.destination(),
        }
    }
}

/// One question.
#[derive(Debug)]
struct Request {
    method: String,
    path: String,
    query: String,
    body: String,
    from: IpAddr,
    fault: Option<WebFault>,
}

impl Request {
    /// A field of a form or of a query, decoded.
    fn field(text: &str, name: &str) -> Option<String> {
        text.split('&').find_map(|pair| pair.strip_prefix(name)?.strip_prefix('=')).map(decoded)
    }
}

/// `%2F` and `+` undone.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'+' => b' ',
            b'%' => {
                let digits: Vec<u8> = rest.by_ref().take(2).collect();
                let digits = std::str::from_utf8(&digits).unwrap_or_default();
                u8::from_str_radix(digits, 16).unwrap_or(b'?')
            }
            other => other,
        });
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[derive(Debug)]
struct Answer {
    status: u16,
    body: String,
}

impl Answer {
    fn json(document: &serde_json::Value) -> Self {
        Self { status: 200, body: document.to_string() }
    }

    fn text(body: &str) -> Self {
        Self { status: 200, body: body.to_owned() }
    }

    fn error(status: u16, why: &str) -> Self {
        Self { status, body: serde_json::json!({ "error": { "msg": why } }).to_string() }
    }
}

/// A running server. Dropping it ends it.
#[derive(Debug)]
pub struct MockWeb {
    address: SocketAddr,
    behind: Arc<Mutex<Behind>>,
    fault: Arc<Mutex<Option<WebFault>>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl MockWeb {
    /// Serves at an address; port 0 is any free one.
    pub fn start(address: SocketAddr, behind: Behind, fault: Option<WebFault>) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let mut web = Self {
            address,
            behind: Arc::new(Mutex::new(behind)),
            fault: Arc::new(Mutex::new(fault)),
            ends: Arc::default(),
            thread: None,
        };
        let (behind, fault, ends) = (web.behind.clone(), web.fault.clone(), web.ends.clone());
        let thread = std::thread::Builder::new().name("mock web".into()).spawn(move || {
            for stream in listener.incoming() {
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                let fault = *lock(&fault);
                if let Ok(stream) = stream {
                    // one question at a time, as the small servers of sensors do
                    let _ = serve(stream, &behind, fault, &ends); // a client that went away wants no answer
                }
            }
        })?;
        web.thread = Some(thread);
        Ok(web)
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Breaks it, or mends it.
    pub fn set_fault(&self, fault: Option<WebFault>) {
        *lock(&self.fault) = fault;
    }

    /// Of lidar and auxiliary packets, as last set.
    pub(crate) fn destinations(&self) -> [Option<SocketAddr>; 2] {
        let (host, port, auxiliary_port) = self.behind().destination();
        let host: Option<IpAddr> = host.parse().ok();
        [port, auxiliary_port].map(|port| Some(SocketAddr::new(host?, port?)))
    }

    /// What stands behind it.
    pub fn behind(&self) -> MutexGuard<'_, Behind> {
        lock(&self.behind)
    }
}

impl Drop for MockWeb {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        let _ = TcpStream::connect(self.address); // wakes the thread
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Longest question.
const LONGEST_BYTES: usize = 1 << 20;

fn serve(
    mut stream: TcpStream,
    behind: &Mutex<Behind>,
    fault: Option<WebFault>,
    ends: &AtomicBool,
) -> io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(5)))?;
    stream.set_write_timeout(Some(Duration::from_secs(5)))?;
    if fault == Some(WebFault::Refuses) {
        return Ok(());
    }
    let Some(request) = read_request(&mut stream, fault)? else { return Ok(()) };
    let answer = match fault {
        Some(WebFault::WrongJson) => Answer::text("<html>It works!</html>"),
        Some(WebFault::OtherJson) => Answer::text("[1, 2]"),
        Some(WebFault::ServerError) => Answer { status: 503, body: "starting".into() },
        Some(WebFault::Elsewhere) => Answer { status: 302, body: String::new() },
        _ => lock(behind).answer(&request),
    };
    let endless = fault == Some(WebFault::Endless);
    let length = if endless { u64::MAX } else { answer.body.len() as u64 };
    let elsewhere = if answer.status == 302 { "Location: http://192.0.2.1/\r\n" } else { "" };
    let head = format!(
        "HTTP/1.1 {} mock\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n{elsewhere}Connection: close\r\n\r\n",
        answer.status
    );
    stream.write_all(head.as_bytes())?;
    let body = answer.body.as_bytes();
    match fault {
        Some(WebFault::Half) => stream.write_all(&body[..body.len() / 2]),
        Some(WebFault::Slow) => {
            for byte in body {
                if ends.load(Ordering::Relaxed) {
                    break;
                }
                stream.write_all(&[*byte])?;
                std::thread::sleep(Duration::from_millis(100));
            }
            Ok(())
        }
        Some(WebFault::Endless) => loop {
            stream.write_all(&[b' '; 4096])?;
        },
        _ => stream.write_all(body),
    }
}

fn read_request(stream: &mut TcpStream, fault: Option<WebFault>) -> io::Result<Option<Request>> {
    let from = stream.peer_addr()?.ip();
    let mut bytes = Vec::new();
    let mut part = [0; 4096];
    let head_end = loop {
        if let Some(at) = bytes.windows(4).position(|window| window == b"\r\n\r\n") {
            break at;
        }
        let count = stream.read(&mut part)?;
        if count == 0 || bytes.len() > LONGEST_BYTES {
            return Ok(None);
        }
        bytes.extend_from_slice(&part[..count]);
    };
    let head = String::from_utf8_lossy(&bytes[..head_end]).into_owned();
    let header = |name: &str| {
        let value = |line: &str| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim().to_owned())
        };
        head.lines().find_map(value)
    };
    let mut body = bytes[head_end + 4..].to_vec();
    let length = header("content-length").and_then(|text| text.parse().ok()).unwrap_or(0);
    if header("expect").is_some() {
        stream.write_all(b"HTTP/1.1 100 Continue\r\n\r\n")?;
    }
    let chunked = header("transfer-encoding").is_some_and(|value| value.eq_ignore_ascii_case("chunked"));
    while if chunked { !body.ends_with(b"0\r\n\r\n") } else { body.len() < length } {
        let count = stream.read(&mut part)?;
        if count == 0 || body.len() > LONGEST_BYTES {
            return Ok(None);
        }
        body.extend_from_slice(&part[..count]);
    }
    if chunked {
        body = unchunked(&body);
    }
    let mut first = head.lines().next().unwrap_or_default().split(' ');
    let (Some(method), Some(target)) = (first.next(), first.next()) else { return Ok(None) };
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let body = String::from_utf8_lossy(&body).into_owned();
    Ok(Some(Request { method: method.into(), path: path.into(), query: query.into(), body, from, fault }))
}

fn unchunked(bytes: &[u8]) -> Vec<u8> {
    let (mut rest, mut whole) = (bytes, Vec::new());
    while let Some(at) = rest.windows(2).position(|window| window == b"\r\n") {
        let length = usize::from_str_radix(String::from_utf8_lossy(&rest[..at]).trim(), 16).unwrap_or(0);
        let Some(chunk) = rest.get(at + 2..at + 2 + length).filter(|_| length > 0) else { break };
        whole.extend_from_slice(chunk);
        rest = rest.get(at + 4 + length..).unwrap_or_default();
    }
    whole
}
