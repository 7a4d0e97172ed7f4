//! How late this machine runs a thread whose time has come, and carries a byte through a pseudo terminal: the kernel's workers
//! do that, and wait for their turn apart from all threads. A device that is mocked here falls silent when the machine stands
//! still, and what tells of silent devices is right to say so.

use std::io::{Read as _, Write as _};
use std::sync::Mutex;
use std::thread::sleep;
use std::time::{Duration, Instant};

use serialport::{SerialPort as _, TTYPort};

const BEAT: Duration = Duration::from_millis(5);
/// Later than this nothing runs in real time: servos are asked every 10 ms.
const STANDS_STILL: Duration = Duration::from_millis(25);

/// When the machine had stood still, and for how long.
static STOOD_STILL: Mutex<Vec<(Instant, Duration)>> = Mutex::new(Vec::new());

/// Watches on every processor until the program ends.
pub fn watch() {
    for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
        std::thread::spawn(|| {
            let (mut host, mut device) = TTYPort::pair().expect("pseudo terminals, which the cases use, too");
            host.set_timeout(Duration::MAX).expect("any time is a timeout");
            loop {
                let due = Instant::now() + BEAT;
                sleep(BEAT);
                device.write_all(&[0]).expect("its other end is open");
                host.read_exact(&mut [0]).expect("its other end is open");
                let late = due.elapsed();
                if late > STANDS_STILL {
                    STOOD_STILL.lock().expect("held for a push only").push((Instant::now(), late));
                }
            }
        });
    }
}

/// The longest that the machine stood still since then.
pub fn stood_still_since(start: Instant) -> Option<Duration> {
    let all = STOOD_STILL.lock().expect("held for a push only");
    all.iter().filter(|(end, _)| *end >= start).map(|(_, late)| *late).max()
}
