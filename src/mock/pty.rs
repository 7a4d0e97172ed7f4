//! A pseudo terminal that looks like a serial device to whoever opens its path.

use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;
use std::time::Duration;

use nix::fcntl::{FcntlArg, FdFlag, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};

/// The device's side of the line.
pub struct Pty {
    master: File,
    /// Open for ever: without a slave, reading the master is an error.
    _slave: OwnedFd,
    /// The path to open as a serial device.
    pub path: PathBuf,
}

impl Pty {
    /// A new line that passes every byte as it is.
    pub(crate) fn open() -> io::Result<Self> {
        let pty = nix::pty::openpty(None, None)?;
        let mut settings = tcgetattr(&pty.slave)?;
        cfmakeraw(&mut settings); // a line discipline would echo the device's own words back to it
        tcsetattr(&pty.slave, SetArg::TCSANOW, &settings)?;
        let path = nix::unistd::ttyname(&pty.slave)?;
        fcntl(&pty.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
        // a program started meanwhile would keep the line open after it was closed here
        fcntl(&pty.master, FcntlArg::F_SETFD(FdFlag::FD_CLOEXEC))?;
        fcntl(&pty.slave, FcntlArg::F_SETFD(FdFlag::FD_CLOEXEC))?;
        Ok(Self { master: pty.master.into(), _slave: pty.slave, path })
    }

    /// What came since the last call; 0 when nothing did.
    pub(crate) fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self.master.read(bytes) {
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
            result => result,
        }
    }

    /// Sends bytes. A host that does not read loses what a serial line would lose.
    pub(crate) fn write(&mut self, bytes: &[u8]) {
        let _ = self.master.write_all(bytes);
    }

    /// Waits about a millisecond, less when bytes come meanwhile.
    pub(crate) fn wait_a_millisecond(&self) {
        let mut interest = [PollFd::new(self.master.as_fd(), PollFlags::POLLIN)];
        let _ = poll(&mut interest, PollTimeout::from(1u8)); // an interrupted wait is a short wait
        std::thread::sleep(Duration::from_micros(100)); // a host that never stops talking leaves time for others
    }
}
