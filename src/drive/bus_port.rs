//! A serial bus on which one side asks and the other answers: time limits on everything.

use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

use super::LinkError;
use super::port::open_port;

const WRITE_TIMEOUT: Duration = Duration::from_millis(100);

/// A serial adapter on a bus.
pub(super) struct BusPort {
    path: String,
    port: TTYPort,
}

impl BusPort {
    /// Opens an adapter, for this program alone.
    pub(crate) fn open(path: &Path, baud: u32) -> Result<Self, LinkError> {
        let path = path.display().to_string();
        let port = open_port(&path, baud, WRITE_TIMEOUT)?;
        port.clear(serialport::ClearBuffer::Input).map_err(|error| LinkError::refused(&path, &error))?;
        Ok(Self { path, port })
    }

    /// The adapter's path.
    pub(crate) fn path(&self) -> &str {
        &self.path
    }

    /// The port itself.
    pub(crate) fn tty(&mut self) -> &mut TTYPort {
        &mut self.port
    }

    /// Drops what came and was not read.
    pub(crate) fn forget(&mut self) -> Result<(), LinkError> {
        self.port.clear(serialport::ClearBuffer::Input).map_err(|error| self.hung_up(&error.to_string()))
    }

    /// Sends one question.
    pub(crate) fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        let _ = self.port.set_timeout(WRITE_TIMEOUT); // cannot fail: it is stored in memory
        self.port.write_all(bytes).map_err(|error| match error.kind() {
            ErrorKind::TimedOut => LinkError::WriteTimeout { path: self.path.clone(), after: WRITE_TIMEOUT },
            _ => self.hung_up(&error.to_string()),
        })
    }

    fn hung_up(&self, reason: &str) -> LinkError {
        LinkError::HungUp { path: self.path.clone(), reason: reason.to_owned() }
    }

    /// What came; `None` when nothing came before `end`.
    pub(crate) fn read(&mut self, end: Instant) -> Result<Option<Vec<u8>>, LinkError> {
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let _ = self.port.set_timeout(left); // cannot fail: it is stored in memory
            let mut bytes = [0; 256];
            let count = match self.port.read(&mut bytes) {
                Ok(0) => return Err(self.hung_up("end of file")),
                Ok(count) => count,
                Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                    continue;
                }
                Err(error) => return Err(self.hung_up(&error.to_string())),
            };
            return Ok(Some(bytes[..count].to_vec()));
        }
    }
}
