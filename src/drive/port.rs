//! A serial device, opened for this program alone.

use std::time::Duration;

use serialport::TTYPort;

use super::LinkError;

const TRIES: u32 = 3;
const RETRY_AFTER: Duration = Duration::from_millis(20);

/// Opens a device that may have been closed just now: a process that is being started has the open files of its parent for a
/// moment, locks included.
pub(super) fn open_port(path: &str, baud: u32, timeout: Duration) -> Result<TTYPort, LinkError> {
    let open = || serialport::new(path, baud).timeout(timeout).open_native();
    let mut tries = 1;
    loop {
        match open().map_err(|error| LinkError::refused(path, &error)) {
            Err(LinkError::InUse { .. }) if tries < TRIES => std::thread::sleep(RETRY_AFTER),
            opened => return opened,
        }
        tries += 1;
    }
}
