//! A running `outrigger daemon`, and requests to it.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use outrigger::recording::Session;
use serde_json::Value;

/// How long a test waits for what must come: only a daemon that never does it fails.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A folder with a rig.toml.
pub struct Bench {
    pub folder: tempfile::TempDir,
}

impl Bench {
    /// With sensors `left` (an Ouster of `sensor::metadata`) and, where asked, `right` (a VLP-16).
    pub fn new(sensors: &[&str], sections: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut text = "format = \"outrigger-rig/1\"\n".to_owned();
        for sensor in sensors {
            let model = match *sensor {
                "left" => "model = \"os1-16\"\nmetadata = \"left.json\"",
                _ => "model = \"vlp-16\"",
            };
            text += &format!("[[sensor]]\nname = \"{sensor}\"\n{model}\nlisten = \"127.0.0.1:0\"\n");
        }
        text += sections;
        std::fs::write(folder.path().join("rig.toml"), text).unwrap();
        let metadata = super::sensor::metadata(super::sensor::SERIAL, 1);
        std::fs::write(folder.path().join("left.json"), metadata.to_json()).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A command that runs the daemon with these further arguments.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.args(self.arguments(&self.path("sessions"), arguments));
        command
    }

    /// What every daemon of a test is told unless these arguments say otherwise, with the folder of its sessions.
    pub fn arguments(&self, sessions: &Path, more: &[&str]) -> Vec<String> {
        let (config, sessions) =
            (self.path("rig.toml").display().to_string(), sessions.display().to_string());
        let mut all = vec!["--json", "daemon", "--config", &config, "--out", &sessions];
        for usual in [["--listen", "127.0.0.1:0"], ["--warn-below-mib", "1"], ["--stop-below-mib", "1"]] {
            if !more.contains(&usual[0]) {
                all.extend(usual);
            }
        }
        all.iter().chain(more).map(|argument| (*argument).to_owned()).collect()
    }

    /// Starts the daemon and waits until it is ready.
    pub fn start(&self, arguments: &[&str]) -> Running {
        Running::start(self.command(arguments))
    }

    /// Every session, oldest first.
    pub fn sessions(&self) -> Vec<Session> {
        sessions_in(&self.path("sessions"))
    }
}

/// Every session of a folder, oldest first.
pub fn sessions_in(folder: &Path) -> Vec<Session> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut sessions: Vec<_> = entries.map(|entry| Session::open(&entry.unwrap().path()).unwrap()).collect();
    sessions.sort_by_key(|session| session.manifest().created_ns);
    sessions
}

/// A daemon that says it is ready.
pub struct Running {
    pub child: Child,
    pub address: SocketAddr,
    pub ready: Value,
    log: Option<std::thread::JoinHandle<String>>,
}

impl Running {
    pub fn start(command: Command) -> Self {
        Self::start_with(command, Stdio::piped())
    }

    /// With this for its log.
    pub fn start_with(mut command: Command, stderr: Stdio) -> Self {
        command.env_remove("OUTRIGGER_RIG_PORT").env_remove("OUTRIGGER_CONFIG");
        let mut child = command.stdout(Stdio::piped()).stderr(stderr).spawn().unwrap();
        let stderr = child.stderr.take();
        let log = std::thread::spawn(move || {
            let mut text = String::new();
            if let Some(mut stderr) = stderr {
                stderr.read_to_string(&mut text).unwrap();
            }
            text
        });
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        let mut document = String::new();
        let ready = loop {
            let mut line = String::new();
            if lines.read_line(&mut line).unwrap() == 0 {
                panic!("the daemon ended before it was ready: {}", log.join().unwrap());
            }
            document += &line;
            if let Ok(ready) = serde_json::from_str::<Value>(&document) {
                break ready;
            }
        };
        let url = ready["url"].as_str().unwrap();
        let address = url.trim_start_matches("http://").trim_end_matches('/').parse().unwrap();
        Self { child, address, ready, log: Some(log) }
    }

    /// Where a sensor's packets go.
    pub fn sensor(&self, number: usize) -> SocketAddr {
        self.ready["sensors"][number]["address"].as_str().unwrap().parse().unwrap()
    }

    /// The state.
    pub fn status(&self) -> Value {
        let (code, body) = self.get("/api/v1/status");
        assert_eq!(code, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    /// Waits for a state, longer than the busiest machine needs; the state.
    pub fn wait(&self, what: &str, mut is_so: impl FnMut(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let status = self.status();
            if is_so(&status) {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain until {what}: {status:#}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Waits for a problem of a kind; what the page says.
    pub fn wait_for_problem(&self, kind: &str) -> String {
        let status = self.wait(&format!("problem {kind}"), |status| has_problem(status, kind));
        let problems = status["problems"].as_array().unwrap();
        let problem = problems.iter().find(|problem| problem["kind"] == kind).unwrap();
        assert!(problem["advice"].as_str().unwrap().len() > 10, "{problem}");
        problem["what"].as_str().unwrap().to_owned()
    }

    pub fn get(&self, path: &str) -> (u16, String) {
        let host = self.address;
        exchange(self.address, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"))
    }

    pub fn post(&self, path: &str, body: &str) -> (u16, Value) {
        let host = self.address;
        let length = body.len();
        let (code, text) = exchange(
            self.address,
            &format!(
                "POST {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Type: application/json\r\n\
                 Content-Length: {length}\r\n\r\n{body}"
            ),
        );
        (code, serde_json::from_str(&text).unwrap_or(Value::Null))
    }

    /// Does what must work.
    pub fn order(&self, path: &str, body: &str) -> Value {
        let (code, answer) = self.post(path, body);
        assert_eq!(code, 200, "{path}: {answer}");
        answer
    }

    pub fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id() as i32), signal).unwrap();
    }

    /// Ends it in peace: exit code and log.
    pub fn end(self) -> (Option<i32>, String) {
        self.signal(Signal::SIGTERM);
        self.ended()
    }

    /// Waits until it ends by itself: exit code and log.
    pub fn ended(mut self) -> (Option<i32>, String) {
        let code = self.child.wait().unwrap().code();
        (code, self.log.take().unwrap().join().unwrap())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill(); // it may have ended
        let _ = self.child.wait();
    }
}

pub fn has_problem(status: &Value, kind: &str) -> bool {
    status["problems"].as_array().unwrap().iter().any(|problem| problem["kind"] == kind)
}

/// One request as it stands; code and body of the answer, code 0 where none came.
pub fn exchange(address: SocketAddr, request: &str) -> (u16, String) {
    exchange_bytes(address, request.as_bytes())
}

pub fn exchange_bytes(address: SocketAddr, request: &[u8]) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let _ = stream.write_all(request); // a daemon that had enough closes before the end
    let _ = stream.shutdown(std::net::Shutdown::Write);
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer); // cut off is an answer too
    let text = String::from_utf8_lossy(&answer).into_owned();
    let code = text.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
    let body = text.split_once("\r\n\r\n").map_or(String::new(), |(head, body)| {
        if head.to_ascii_lowercase().contains("transfer-encoding: chunked") {
            unchunked(body)
        } else {
            body.into()
        }
    });
    (code, body)
}

fn unchunked(body: &str) -> String {
    let (mut rest, mut whole) = (body, String::new());
    while let Some((length, after)) = rest.split_once("\r\n") {
        let Ok(length) = usize::from_str_radix(length, 16) else { break };
        if length == 0 {
            break;
        }
        whole += &after[..length];
        rest = after[length..].trim_start_matches("\r\n");
    }
    whole
}
