//! A servo rig behind a pty: the real state machine on a simulated plant, in real time, with faults on demand.
//!
//! [`MockRig`] is what a program connects to as if it were a device; [`SimulatedLink`] is the same rig without a pty, a
//! thread or a clock, with a line that damages what it carries.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Instant;

use super::pty::Pty;

mod can;
mod device;
mod fault;
mod link;
mod proxy;

pub use can::run as run_on_can;
pub use device::{AxisKind, MockAxis, MockConfig, MockDevice};
pub use fault::MockFault;
pub(crate) use fault::ScheduledFault;
pub use link::{SimulatedLink, Truth};
pub use proxy::{Damage, Proxy};

enum Message {
    Inject(MockFault),
    Truth(Sender<[Option<i32>; 2]>),
    Close,
}

/// A mock rig in its own thread.
pub struct MockRig {
    path: PathBuf,
    messages: Sender<Message>,
    thread: Option<JoinHandle<()>>,
}

impl MockRig {
    /// Opens a pty and starts the rig behind it. Noise and starting angles come from the seed.
    pub fn start(config: MockConfig, seed: u64) -> io::Result<Self> {
        let pty = Pty::open()?;
        let path = pty.path.clone();
        let (messages, inbox) = channel();
        let line = PtyLink { pty, inbox };
        let device = MockDevice::new(config, seed, 0);
        let thread = std::thread::Builder::new().name("mock rig".into()).spawn(move || line.run(device))?;
        Ok(Self { path, messages, thread: Some(thread) })
    }

    /// The device file to connect to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Breaks something now.
    pub fn inject(&self, fault: MockFault) {
        let _ = self.messages.send(Message::Inject(fault)); // a rig that hung up has nothing left to break
    }

    /// Where the axes really are, rad: what a sensor on them sees by, and no encoder knows. None once the rig hung up.
    pub fn true_positions_rad(&self) -> Option<[f64; 2]> {
        let (reply, answer) = channel();
        self.messages.send(Message::Truth(reply)).ok()?;
        let [first, second] = answer.recv().ok()?;
        Some([f64::from(first?) * 1e-6, f64::from(second?) * 1e-6])
    }

    /// Whether the rig still runs: it ends when it hangs up.
    pub(crate) fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Closes the pty: the other end sees a hang-up.
    pub fn close(mut self) {
        self.end();
    }

    fn end(&mut self) {
        let _ = self.messages.send(Message::Close);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for MockRig {
    fn drop(&mut self) {
        self.end();
    }
}

struct PtyLink {
    pty: Pty,
    inbox: Receiver<Message>,
}

impl PtyLink {
    fn run(mut self, mut device: MockDevice) {
        let started = Instant::now();
        let mut bytes = [0; 1024];
        let mut out = Vec::new();
        loop {
            let now_us = started.elapsed().as_micros() as u64;
            for message in self.inbox.try_iter() {
                match message {
                    Message::Close | Message::Inject(MockFault::HangUp) => return,
                    Message::Inject(fault) => device.inject(now_us, fault),
                    Message::Truth(reply) => {
                        // who asked may have gone
                        let _ = reply.send(device.true_positions_urad());
                    }
                }
            }
            match self.pty.read(&mut bytes) {
                Ok(count) => device.take(now_us, &bytes[..count]),
                Err(_) => return,
            }
            device.step(now_us, &mut out);
            for frame in out.drain(..) {
                self.pty.write(&frame);
            }
            self.pty.wait_a_millisecond();
        }
    }
}
