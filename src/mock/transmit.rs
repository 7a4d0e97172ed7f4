//! Sends payloads at their time, or as fast as the receiver takes them.

use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// When packets leave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace {
    /// At their own times, this many times faster.
    Rate(f64),
    /// As fast as possible: to this host as fast as the receiving program empties its socket, to others at
    /// 50 MB/s, which a gigabit link carries.
    Max,
}

impl std::str::FromStr for Pace {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        let rate = text.parse().ok().filter(|rate: &f64| rate.is_finite() && *rate > 0.0);
        rate.map(Self::Rate).ok_or_else(|| format!("{text:?}: give a factor above 0, or `max`"))
    }
}

/// Payload bytes to this host between two looks at how full the receiving socket is.
const LOOK_EVERY_BYTES: usize = 32 << 10;
/// Bytes (as the kernel counts them) that may wait there: a third of Linux's default receive buffer.
const MAY_WAIT_BYTES: u64 = 64 << 10;
/// How long a full receiving socket is waited for before sending goes on all the same: a real sensor never waits.
const PATIENCE: Duration = Duration::from_secs(2);
/// Bytes per second to other hosts when nothing else sets the pace.
const FASTEST_BYTES_PER_S: f64 = 50e6;

/// Sockets that send at one pace.
#[derive(Debug)]
pub struct Transmitter {
    socket: UdpSocket,
    /// Further ones, for packets that are to come from elsewhere.
    others: Vec<UdpSocket>,
    clock: Clock,
}

/// Times of a stream on this host's clock; one for several transmitters keeps their streams in step.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    pace: Pace,
    begun: Instant,
    first_ns: Option<u64>,
    sent_bytes: f64,
    unlooked_bytes: usize,
    is_patient: bool,
}

impl Clock {
    /// Starts to run with the first packet, or with `first_ns`, if that is given, at once.
    pub fn new(pace: Pace, first_ns: Option<u64>) -> Self {
        Self { pace, begun: Instant::now(), first_ns, sent_bytes: 0.0, unlooked_bytes: 0, is_patient: false }
    }

    /// The same clock, started so much later.
    pub(crate) fn starting_in(self, wait: Duration) -> Self {
        Self { begun: self.begun + wait, ..self }
    }

    /// The same clock, which goes slower where a receiver on this host cannot keep up.
    pub(crate) fn patient(self) -> Self {
        Self { is_patient: true, ..self }
    }

    /// Waits until a packet of this time may leave for a receiver.
    fn wait(&mut self, time_ns: u64, bytes: usize, to: SocketAddr) {
        if to.ip().is_loopback() && (self.is_patient || self.pace == Pace::Max) {
            self.unlooked_bytes += bytes;
            if self.unlooked_bytes >= LOOK_EVERY_BYTES {
                self.unlooked_bytes = 0;
                wait_for_room(to.port());
            }
        }
        let elapsed_s = match self.pace {
            Pace::Rate(rate) => {
                let first_ns = match self.first_ns {
                    Some(first_ns) => first_ns,
                    None => {
                        self.begun = Instant::now();
                        *self.first_ns.insert(time_ns)
                    }
                };
                time_ns.saturating_sub(first_ns) as f64 * 1e-9 / rate
            }
            Pace::Max if to.ip().is_loopback() => return,
            Pace::Max => {
                self.sent_bytes += bytes as f64;
                self.sent_bytes / FASTEST_BYTES_PER_S
            }
        };
        let due = Duration::from_secs_f64(elapsed_s);
        let ahead = (self.begun + due).saturating_duration_since(Instant::now());
        // the kernel's timer slack is 50 us: shorter waits would only add system calls
        if ahead > Duration::from_micros(50) {
            std::thread::sleep(ahead);
        }
    }
}

impl Transmitter {
    /// Sends from a port of its own, or from `from`.
    pub fn new(from: Option<SocketAddr>, to: SocketAddr, clock: Clock) -> io::Result<Self> {
        let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = match from {
            Some(from) => UdpSocket::bind(from)?,
            None if to.ip().is_loopback() => UdpSocket::bind(SocketAddr::new(to.ip(), 0))?,
            None => UdpSocket::bind(any)?,
        };
        socket.set_broadcast(true)?;
        Ok(Self { socket, others: Vec::new(), clock })
    }

    /// Opens one more socket on this address; its number is for [`Self::send_from`].
    pub(crate) fn add_socket(&mut self, from: IpAddr) -> io::Result<usize> {
        self.others.push(UdpSocket::bind(SocketAddr::new(from, 0))?);
        Ok(self.others.len())
    }

    /// Goes on by another clock, from the same port.
    pub(crate) fn set_clock(&mut self, clock: Clock) {
        self.clock = clock;
    }

    /// The address packets come from.
    pub(crate) fn local_addr(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Sends one payload when its time has come.
    pub fn send(&mut self, time_ns: u64, payload: &[u8], to: SocketAddr) -> io::Result<()> {
        self.send_from(0, time_ns, payload, to)
    }

    /// The same from a socket that was added; 0 is the first.
    pub(crate) fn send_from(
        &mut self,
        socket: usize,
        time_ns: u64,
        payload: &[u8],
        to: SocketAddr,
    ) -> io::Result<()> {
        self.clock.wait(time_ns, payload.len(), to);
        let socket = socket.checked_sub(1).and_then(|at| self.others.get(at)).unwrap_or(&self.socket);
        loop {
            match socket.send_to(payload, to) {
                Ok(_) => return Ok(()),
                // a device queue that is full empties by itself
                Err(error) if error.raw_os_error() == Some(nix::libc::ENOBUFS) => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                // no receiver yet: a sensor does not care
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

/// Waits until a UDP port of this host has little waiting to be read. Where the system does not say, this is one short
/// pause.
fn wait_for_room(port: u16) {
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE {
        match waiting_bytes(port) {
            Some(waiting) if waiting <= MAY_WAIT_BYTES => return,
            Some(_) => std::thread::sleep(Duration::from_micros(200)),
            None => return std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

/// Bytes waiting in the receive queues of a UDP port, as the kernel counts them (proc_net(5): `rx_queue`).
fn waiting_bytes(port: u16) -> Option<u64> {
    let mut total = None;
    for table in ["/proc/net/udp", "/proc/net/udp6"] {
        let Ok(text) = std::fs::read_to_string(table) else { continue };
        for line in text.lines().skip(1) {
            let mut fields = line.split_ascii_whitespace();
            let (Some(local), Some(queues)) = (fields.nth(1), fields.nth(2)) else { continue };
            let same =
                local.rsplit_once(':').and_then(|(_, text)| u16::from_str_radix(text, 16).ok()) == Some(port);
            if let (true, Some((_, receive))) = (same, queues.split_once(':')) {
                *total.get_or_insert(0) += u64::from_str_radix(receive, 16).unwrap_or(0);
            }
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_says_how_much_waits() {
        let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = receiver.local_addr().unwrap();
        assert_eq!(waiting_bytes(to.port()), Some(0));
        let mut transmitter = Transmitter::new(None, to, Clock::new(Pace::Rate(1.0), None)).unwrap();
        transmitter.send(5, &[1; 1000], to).unwrap();
        assert!(waiting_bytes(to.port()).unwrap() >= 1000);
    }

    #[test]
    fn at_most_a_little_waits_for_a_slow_receiver() {
        // as fast as possible, and at times that are over already
        for clock in [Clock::new(Pace::Max, None), Clock::new(Pace::Rate(1e9), None).patient()] {
            let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
            let to = receiver.local_addr().unwrap();
            let reader = std::thread::spawn(move || {
                let mut buffer = [0; 2000];
                std::thread::sleep(Duration::from_millis(300));
                (0..5000).map(|_| receiver.recv(&mut buffer).unwrap()).sum::<usize>()
            });
            let mut transmitter = Transmitter::new(None, to, clock).unwrap();
            for time_ns in 0..5000 {
                transmitter.send(time_ns, &[7; 1206], to).unwrap();
            }
            assert_eq!(reader.join().unwrap(), 5000 * 1206, "all came, though the buffer holds far less");
        }
    }

    #[test]
    fn paces_are_words_or_factors() {
        assert_eq!("max".parse(), Ok(Pace::Max));
        assert_eq!("2.5".parse(), Ok(Pace::Rate(2.5)));
        for wrong in ["0", "-1", "inf", "fast"] {
            assert!(wrong.parse::<Pace>().unwrap_err().contains(wrong));
        }
    }
}
