//! Connections that ask for nothing, or for ages.

use std::io::{Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{Domain, Socket, Type};

/// Time from one letter to the next.
const TRICKLE: Duration = Duration::from_millis(200);

/// So many slow connections at any time: each that the daemon closes is opened again.
pub struct Crowd {
    stop: Arc<AtomicBool>,
    opened: Arc<AtomicU64>,
    thread: Option<JoinHandle<()>>,
}

struct Slow {
    stream: TcpStream,
    text: Vec<u8>,
}

impl Crowd {
    /// Half of them bring their headers letter by letter, half of them their body. Returns when all are open.
    pub fn gather(count: usize, from: &[IpAddr], to: SocketAddr) -> Self {
        let open = {
            let from = from.to_vec();
            move |number: usize| Slow::open(number, from[number % from.len()], to)
        };
        let (stop, opened) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(count as u64)));
        let mut all: Vec<Option<Slow>> = (0..count).map(&open).collect();
        let (stopped, opens) = (Arc::clone(&stop), Arc::clone(&opened));
        let thread = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                for (number, slow) in all.iter_mut().enumerate() {
                    if !slow.as_mut().is_some_and(Slow::goes_on) {
                        *slow = open(number);
                        opens.fetch_add(1, Ordering::Relaxed);
                    }
                }
                std::thread::sleep(TRICKLE);
            }
        });
        Self { stop, opened, thread: Some(thread) }
    }

    /// Connections opened so far.
    pub fn opened(&self) -> u64 {
        self.opened.load(Ordering::Relaxed)
    }
}

impl Drop for Crowd {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let _ = self.thread.take().unwrap().join(); // it has said why it panicked
    }
}

impl Slow {
    fn open(number: usize, from: IpAddr, to: SocketAddr) -> Option<Self> {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.bind(&SocketAddr::new(from, 0).into()).unwrap();
        socket.connect(&to.into()).ok()?;
        let mut stream = TcpStream::from(socket);
        let head = format!("POST /api/v1/recording/start HTTP/1.1\r\nHost: {to}\r\nContent-Length: 5000\r\n");
        let at_once = if number.is_multiple_of(2) { format!("{head}\r\n{{") } else { head };
        stream.write_all(at_once.as_bytes()).ok()?;
        stream.set_nonblocking(true).ok()?;
        let text = if number.is_multiple_of(2) { b" ".repeat(4000) } else { b"X-Slow: yes\r\n".repeat(40) };
        Some(Self { stream, text })
    }

    fn goes_on(&mut self) -> bool {
        let heard = self.stream.read(&mut [0; 512]);
        let is_open = heard.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock);
        is_open && self.text.pop().is_some_and(|letter| self.stream.write_all(&[letter]).is_ok())
    }
}
