//! A serial line: an own thread reads, every read and write has a time limit, a hang-up is an error once and for ever.

use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use firmware_protocol::{Frame, LinkCounters, Receiver as FrameReceiver};
use serialport::{SerialPort, TTYPort};

use super::framing::Framing;
use super::port::open_port;
use super::slcan::{self, BitRate, SlcanReceiver};
use super::{Link, LinkError, Received};
use crate::live::clocks::host::steady_now_ns;

/// Bits per second of the rig's own firmware; a USB device or a pty ignores it.
pub const BAUD: u32 = 1_000_000;
const READ_TIMEOUT: Duration = Duration::from_millis(50);
const WRITE_TIMEOUT: Duration = Duration::from_millis(200);
/// Frames that wait for the reader of this line; a rig sends about 200 a second.
const WAITING_FRAMES: usize = 4096;

/// A serial line to a rig.
pub struct SerialLink {
    path: String,
    port: TTYPort,
    frames: Receiver<Result<Received, LinkError>>,
    slcan: bool,
    counters: Arc<Mutex<LinkCounters>>,
    quit: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    dead: Option<LinkError>,
}

impl SerialLink {
    /// Opens a device file, for this program alone.
    pub fn open(path: &Path) -> Result<Self, LinkError> {
        let mut link = Self::open_framed(path, None)?;
        link.write(&[0])?; // ends what another program left half sent
        Ok(link)
    }

    /// Opens a CAN adapter that speaks the LAWICEL text protocol, and its channel.
    pub(super) fn open_slcan(path: &Path, rate: BitRate) -> Result<Self, LinkError> {
        Self::open_framed(path, Some(rate))
    }

    fn open_framed(path: &Path, slcan: Option<BitRate>) -> Result<Self, LinkError> {
        let path = path.display().to_string();
        let failed = |error| LinkError::refused(&path, &error);
        let mut port = open_port(&path, BAUD, READ_TIMEOUT)?;
        let mut input = port.try_clone_native().map_err(failed)?;
        port.set_timeout(WRITE_TIMEOUT).map_err(failed)?;
        input.set_timeout(READ_TIMEOUT).map_err(failed)?;
        if let Some(rate) = slcan {
            slcan::open_channel(&mut port, &path, rate)?;
        }
        // what the rig sent before is old
        port.clear(serialport::ClearBuffer::Input).map_err(failed)?;
        let (sender, frames) = sync_channel(WAITING_FRAMES);
        let counters = Arc::new(Mutex::new(LinkCounters::default()));
        let quit = Arc::new(AtomicBool::new(false));
        let framing = match slcan {
            Some(_) => Framing::Slcan(SlcanReceiver::default()),
            None => Framing::Stuffed(FrameReceiver::default()),
        };
        let slcan = slcan.is_some();
        let reader = Reader {
            path: path.clone(),
            input,
            framing,
            sender,
            counters: counters.clone(),
            quit: quit.clone(),
        };
        let reader = std::thread::Builder::new()
            .name("rig serial".into())
            .spawn(move || reader.run())
            .map_err(|error| LinkError::Open { path: path.clone(), reason: error.to_string() })?;
        Ok(Self { path, port, frames, slcan, counters, quit, reader: Some(reader), dead: None })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        if let Some(error) = &self.dead {
            return Err(error.clone());
        }
        // a partial write is a damaged frame to the rig, and the order is repeated
        match self.port.write_all(bytes) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == ErrorKind::TimedOut => {
                Err(LinkError::WriteTimeout { path: self.path.clone(), after: WRITE_TIMEOUT })
            }
            Err(error) => {
                let hung_up = LinkError::HungUp { path: self.path.clone(), reason: error.to_string() };
                Err(self.die(hung_up))
            }
        }
    }

    fn die(&mut self, error: LinkError) -> LinkError {
        self.dead.get_or_insert(error).clone()
    }
}

impl Link for SerialLink {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        if self.slcan { self.write(&slcan::encode(frame)) } else { self.write(frame.encode().bytes()) }
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        if let Some(error) = &self.dead {
            return Err(error.clone());
        }
        match self.frames.recv_timeout(wait) {
            Ok(Ok(received)) => Ok(Some(received)),
            Ok(Err(error)) => Err(self.die(error)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => {
                let gone = LinkError::HungUp { path: self.path.clone(), reason: "its reader ended".into() };
                Err(self.die(gone))
            }
        }
    }

    fn now_ns(&self) -> u64 {
        steady_now_ns()
    }

    fn counters(&self) -> LinkCounters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn device_errors(&self, _axis: usize) -> Vec<String> {
        Vec::new()
    }

    fn is_busy(&self) -> bool {
        false
    }

    fn name(&self) -> &str {
        &self.path
    }
}

impl Drop for SerialLink {
    fn drop(&mut self) {
        if self.slcan {
            let _ = self.write(slcan::CLOSE); // an adapter that is gone needs no closing
        }
        self.quit.store(true, Ordering::Relaxed);
        if let Some(reader) = self.reader.take() {
            let _ = reader.join(); // ends within one read timeout
        }
    }
}

struct Reader {
    path: String,
    input: TTYPort,
    framing: Framing,
    sender: SyncSender<Result<Received, LinkError>>,
    counters: Arc<Mutex<LinkCounters>>,
    quit: Arc<AtomicBool>,
}

impl Reader {
    fn run(mut self) {
        let mut bytes = [0; 1024];
        while !self.quit.load(Ordering::Relaxed) {
            let reason = match self.input.read(&mut bytes) {
                // some drivers say end of file for ever instead of an error
                Ok(0) => "end of file".to_owned(),
                Ok(count) => {
                    let time_ns = steady_now_ns();
                    for frame in bytes[..count].iter().filter_map(|byte| self.framing.push(*byte)) {
                        // a full queue drops: the host does not read, and positions come again
                        if let Err(TrySendError::Disconnected(_)) =
                            self.sender.try_send(Ok(Received { time_ns, frame }))
                        {
                            return;
                        }
                    }
                    *self.counters.lock().unwrap_or_else(PoisonError::into_inner) = self.framing.counters();
                    if let Framing::Slcan(receiver) = &self.framing
                        && let Err(refused) = receiver.refuse_refusals(&self.path)
                    {
                        let _ = self.sender.send(Err(refused)); // the host may be gone
                        return;
                    }
                    continue;
                }
                Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                    continue;
                }
                Err(error) => error.to_string(),
            };
            let _ = self.sender.send(Err(LinkError::HungUp { path: self.path.clone(), reason }));
            return;
        }
    }
}
