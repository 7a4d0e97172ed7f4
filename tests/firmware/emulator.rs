//! An emulated board (ARM MPS2, AN386) with its serial line on a pty, and the emulator's control socket.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

/// Names the image to run.
const IMAGE: &str = "OUTRIGGER_FIRMWARE";
/// Names the image whose axes home on switches.
const SWITCH_IMAGE: &str = "OUTRIGGER_FIRMWARE_SWITCH";
const EMULATOR: &str = "qemu-system-arm";

/// Whether image and emulator are there.
pub fn is_there() -> bool {
    let runs = Command::new(EMULATOR).arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let images = [IMAGE, SWITCH_IMAGE].iter().all(|image| std::env::var_os(image).is_some());
    images && runs.is_ok_and(|status| status.success())
}

/// What is missing when [`is_there`] says no.
pub const MISSING: &str = "OUTRIGGER_FIRMWARE and OUTRIGGER_FIRMWARE_SWITCH name no images, or qemu-system-arm is not installed (.ci/run firmware has both)";

/// A running board. Dropping it ends the emulator.
pub struct Emulator {
    child: Child,
    control: BufReader<UnixStream>,
    /// The board's serial line.
    pub port: PathBuf,
    _folder: TempDir,
}

impl Emulator {
    /// Switches a board on, in real time as far as this machine keeps up: an emulator that was kept from running does
    /// not let the board's time go on.
    pub fn start() -> Self {
        Self::start_counting("shift=5,sleep=on")
    }

    /// The same with the image whose axes home on switches.
    pub fn start_with_switches() -> Self {
        Self::start_image(SWITCH_IMAGE, "shift=5,sleep=on")
    }

    /// A board of 32 ns per instruction; `icount` says what the emulator does with the time in which the board sleeps.
    pub fn start_counting(icount: &str) -> Self {
        Self::start_image(IMAGE, icount)
    }

    fn start_image(image: &str, icount: &str) -> Self {
        let image = std::env::var_os(image).expect("the case is run only with an image");
        let folder = tempfile::tempdir().unwrap();
        let socket = folder.path().join("control");
        let mut command = Command::new(EMULATOR);
        command.args([
            "-M",
            "mps2-an386",
            "-accel",
            "tcg",
            "-display",
            "none",
            "-nodefaults",
            "-no-user-config",
        ]);
        command.args(["-chardev", "pty,id=line", "-serial", "chardev:line"]);
        command.arg("-qmp").arg(format!("unix:{},server=on,wait=off", socket.display()));
        command.arg("-kernel").arg(image).args(["-icount", icount, "-nic", "none"]);
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        let end = Instant::now() + Duration::from_secs(20);
        let stream = loop {
            match UnixStream::connect(&socket) {
                Ok(stream) => break stream,
                Err(error) => assert!(Instant::now() < end, "no control socket: {error}"),
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let mut emulator =
            Self { child, control: BufReader::new(stream), port: PathBuf::new(), _folder: folder };
        emulator.answer(); // the greeting
        emulator.control("qmp_capabilities");
        let devices = emulator.control("query-chardev");
        let line = devices.as_array().unwrap().iter().find(|device| device["label"] == "line").unwrap();
        emulator.port = line["filename"].as_str().unwrap().strip_prefix("pty:").unwrap().into();
        emulator
    }

    /// Tells the emulator something: `stop`, `cont`, `system_reset`.
    pub fn control(&mut self, command: &str) -> Value {
        let line = format!("{}\n", json!({ "execute": command }));
        self.control.get_mut().write_all(line.as_bytes()).unwrap();
        loop {
            let mut answer = self.answer();
            assert!(answer.get("error").is_none(), "{command}: {answer}");
            if let Some(value) = answer.get_mut("return") {
                return value.take();
            }
        }
    }

    fn answer(&mut self) -> Value {
        let mut line = String::new();
        assert!(self.control.read_line(&mut line).unwrap() > 0, "the emulator closed its control socket");
        serde_json::from_str(&line).unwrap()
    }

    /// Ends the emulator at once: the board is gone.
    pub fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
