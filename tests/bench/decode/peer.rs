//! The peer, in a process of its own that runs a way whenever it is told to.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use crate::recording::Sensor;

pub struct Peer {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    /// Points with a range, as the peer counts them.
    pub points: u64,
}

impl Peer {
    /// Starts the peer that reads this sensor's packets; `Err` says why there is none.
    pub fn start(path: &Path, sensor: &Sensor) -> Result<Self, String> {
        let python = std::env::var("PYTHON").unwrap_or("python3".into());
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/bench/decode_peers.py");
        let mut command = Command::new(python);
        match sensor {
            Sensor::Ouster { meta, .. } => command.arg(script).arg("ouster").arg(path).arg(meta),
            Sensor::Velodyne(model) => command.arg(script).arg("velodyne").arg(path).arg(model),
        };
        for threads in ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"] {
            command.env(threads, "1");
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = command.spawn().map_err(|error| error.to_string())?;
        let (Some(input), Some(output)) = (process.stdin.take(), process.stdout.take()) else {
            return Err("no pipe".into());
        };
        let mut output = BufReader::new(output);
        let mut line = String::new();
        output.read_line(&mut line).map_err(|error| error.to_string())?;
        match line.strip_prefix("ready ").and_then(|count| count.trim().parse().ok()) {
            Some(points) => Ok(Self { process, input, output, points }),
            None => {
                drop(input);
                let said = process.wait_with_output().map(|ended| ended.stderr).unwrap_or_default();
                let said = String::from_utf8_lossy(&said);
                Err(said.lines().rfind(|line| !line.starts_with(' ')).unwrap_or("it ended").to_owned())
            }
        }
    }

    /// Seconds of one run.
    pub fn run_s(&mut self, way: &str) -> f64 {
        writeln!(self.input, "{way}").and_then(|()| self.input.flush()).expect("the peer listens");
        let mut line = String::new();
        self.output.read_line(&mut line).expect("the peer answers");
        line.trim().parse().unwrap_or_else(|_| panic!("the peer cannot run {way}"))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
