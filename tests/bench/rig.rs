//! What the conversation with a rig costs: time from an order to its acknowledgement over a pty, and the share of a core
//! that telemetry of two axes at 100 Hz takes from this process. The rig is a process of its own.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use outrigger::drive::{Options, Rig};

/// Ends the rig with the bench.
struct Mock(Child);

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn main() {
    let mut mock = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    mock.args(["mock", "rig", "--position-hz", "100"]).stdout(Stdio::piped());
    let mut mock = Mock(mock.spawn().expect("the mock rig starts"));
    let mut port = String::new();
    let stdout = mock.0.stdout.take().expect("it is piped");
    BufReader::new(stdout).read_line(&mut port).expect("the mock rig says its port");
    let options = Options { report_every: Duration::ZERO, ..Options::new_session() };
    let rig = Rig::connect_with(port.trim(), options).expect("the mock rig answers");
    acknowledgements(&rig);
    telemetry(&rig);
}

fn acknowledgements(rig: &Rig) {
    let mut times_us: Vec<u128> = (0..1000)
        .map(|_| {
            let begun = Instant::now();
            rig.hold().expect("an order that changes nothing");
            begun.elapsed().as_micros()
        })
        .collect();
    times_us.sort_unstable();
    println!("order to acknowledgement over a pty: p50 {} us, p99 {} us", times_us[500], times_us[990]);
}

fn telemetry(rig: &Rig) {
    let reports = rig.reports();
    let (begun, cpu_before_ns) = (Instant::now(), cpu_ns());
    let mut count = 0;
    while begun.elapsed() < Duration::from_secs(10) {
        count += usize::from(reports.recv_timeout(Duration::from_millis(100)).is_ok());
    }
    let wall_s = begun.elapsed().as_secs_f64();
    let share = (cpu_ns() - cpu_before_ns) as f64 * 1e-9 / wall_s;
    println!(
        "telemetry: {:.0} positions/s of two axes cost {:.2} % of a core",
        count as f64 / wall_s,
        share * 100.0
    );
}

/// Processor time of every thread of this process, ns (proc(5): the first field of schedstat).
fn cpu_ns() -> u64 {
    let tasks = std::fs::read_dir("/proc/self/task").expect("procfs is there");
    tasks
        .flatten()
        .filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split_whitespace().next()?.parse::<u64>().ok())
        .sum()
}
