//! The daemon's newest state, what went wrong, and what it takes, for all lanes.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::program::Running;

/// How long an explanation may take: far more than it takes on an idle machine, far less than a lane that hangs.
pub const PATIENCE: Duration = Duration::from_secs(60);
const LOOK: Duration = Duration::from_millis(200);
/// Memory, files and threads settle within this share of the run.
const WARM_UP: f64 = 0.2;
/// Files and threads that a short run may still hold at the wrong moment; a leak has one for every fault of its kind.
const SLACK: f64 = 2.0;

/// What happened, to be judged when the daemon has ended.
#[derive(Default)]
pub struct Log {
    failures: Mutex<Vec<String>>,
    /// Faults by name: how many, and the longest time until one was explained.
    faults: Mutex<BTreeMap<&'static str, (u64, Duration)>>,
    /// Kinds of problems that were ever named, and how often they began.
    problems: Mutex<BTreeMap<String, u64>>,
    /// What `usage` says, twice a second.
    usage: Mutex<Vec<[f64; 3]>>,
    sessions: Mutex<(u64, u64)>,
    data_was_lost: AtomicBool,
    full_disks: AtomicU64,
}

/// The daemon's state for all lanes.
pub struct Watch<'a> {
    daemon: &'a Running,
    pub log: &'a Log,
    until: Instant,
    newest: Mutex<(Instant, Arc<Value>)>,
    ended: AtomicBool,
}

impl<'a> Watch<'a> {
    pub fn new(daemon: &'a Running, log: &'a Log, length: Duration) -> Self {
        Self {
            daemon,
            log,
            until: Instant::now() + length,
            newest: Mutex::new((Instant::now(), Arc::new(daemon.status()))),
            ended: AtomicBool::new(false),
        }
    }

    /// Looks at the daemon until the end.
    pub fn run(&self) {
        let (mut present, mut looked) = (Vec::new(), Instant::now());
        while !self.ended.load(Ordering::Relaxed) {
            let asked = Instant::now();
            let status = Arc::new(self.daemon.status());
            let now: Vec<String> = problems(&status).map(|(about, kind)| format!("{about} {kind}")).collect();
            let mut named = self.log.problems.lock().unwrap();
            for problem in now.iter().filter(|problem| !present.contains(*problem)) {
                *named.entry(problem.clone()).or_default() += 1;
            }
            drop(named);
            present = now;
            *self.newest.lock().unwrap() = (asked, status);
            if looked.elapsed() >= Duration::from_millis(500) {
                looked = Instant::now();
                let sample = usage(self.daemon.child.id(), &self.newest.lock().unwrap().1);
                self.log.usage.lock().unwrap().push(sample);
            }
            std::thread::sleep(LOOK);
        }
    }

    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }

    pub fn goes_on(&self) -> bool {
        Instant::now() < self.until
    }

    pub fn daemon(&self) -> &Running {
        self.daemon
    }

    /// A state that was asked for after now.
    pub fn fresh(&self) -> Arc<Value> {
        let now = Instant::now();
        loop {
            let (asked, status) = self.newest.lock().unwrap().clone();
            if asked > now {
                return status;
            }
            if self.ended.load(Ordering::Relaxed) {
                return Arc::new(self.daemon.status());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits for a state; whether it came in time. In vain is a failure.
    pub fn wait(&self, what: &str, mut is_so: impl FnMut(&Value) -> bool) -> bool {
        let begun = Instant::now();
        loop {
            let status = self.fresh();
            if is_so(&status) {
                return true;
            }
            if begun.elapsed() > PATIENCE {
                self.log.fail(format!("waited in vain: {what}; {}", said(&status)));
                return false;
            }
        }
    }

    /// A fault was just injected: waits until the state explains it.
    pub fn explained(&self, fault: &'static str, subject: &str, is_so: impl FnMut(&Value) -> bool) {
        let begun = Instant::now();
        self.wait(&format!("{fault} of {subject} is explained"), is_so);
        let mut faults = self.log.faults.lock().unwrap();
        let entry = faults.entry(fault).or_default();
        *entry = (entry.0 + 1, entry.1.max(begun.elapsed()));
    }

    /// Waits until a subject has none of these problems any more.
    pub fn forgotten(&self, subject: &str, kinds: &[&str]) {
        let named = |status: &Value| kinds.iter().any(|kind| has(status, subject, kind));
        self.wait(&format!("{kinds:?} of {subject} is over"), |status| !named(status));
    }
}

impl Log {
    pub fn fail(&self, words: String) {
        println!("FAILED: {words}");
        self.failures.lock().unwrap().push(words);
    }

    pub fn count_session(&self, packets: u64) {
        let mut sessions = self.sessions.lock().unwrap();
        *sessions = (sessions.0 + 1, sessions.1 + packets);
    }

    pub fn lose_data(&self) {
        self.data_was_lost.store(true, Ordering::Relaxed);
    }

    pub fn data_was_lost(&self) -> bool {
        self.data_was_lost.load(Ordering::Relaxed)
    }

    /// A recording ended early because the disk was filled: data is lost, and the daemon's log must call it an error.
    pub fn fill_disk(&self) {
        self.lose_data();
        self.full_disks.fetch_add(1, Ordering::Relaxed);
    }

    /// Judges what the daemon wrote: one error for each disk that was filled, and nothing else of that weight.
    pub fn read(&self, said: &str) {
        let (full, others): (Vec<&str>, Vec<&str>) = said
            .lines()
            .filter(|line| line.contains("panicked") || line.contains("ERROR"))
            .partition(|line| line.contains("event=\"disk_full\""));
        for line in others {
            self.fail(format!("the daemon's log: {line}"));
        }
        let filled = self.full_disks.load(Ordering::Relaxed);
        if full.len() as u64 != filled {
            self.fail(format!(
                "the disk was filled {filled} times, the daemon's log says so {} times",
                full.len()
            ));
        }
    }

    /// Says how it went; whether all was well.
    pub fn conclude(&self, ran: Duration, growth_mib: f64) -> bool {
        println!("{:>6.0} s; faults, and how long the longest took to be explained:", ran.as_secs_f64());
        for (name, (count, longest)) in &*self.faults.lock().unwrap() {
            println!("{count:>7} {name:<18} {:>5.1} s", longest.as_secs_f64());
        }
        println!("problems that were named, and how often they began:");
        for (problem, count) in &*self.problems.lock().unwrap() {
            println!("{count:>7} {problem}");
        }
        let (sessions, packets) = *self.sessions.lock().unwrap();
        println!("{sessions} sessions verified, {packets} packets in them");
        if sessions == 0 {
            self.fail("not one session was verified".into());
        }
        let usage = self.usage.lock().unwrap();
        let settled = &usage[(usage.len() as f64 * WARM_UP) as usize..];
        let (early, late) = (&settled[..settled.len() / 4], &settled[settled.len() * 3 / 4..]);
        let median = |part: &[[f64; 3]], which: usize| {
            let mut values: Vec<f64> = part.iter().map(|sample| sample[which]).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        // pages come and go: what is left between two of them is the least
        let least = |part: &[[f64; 3]], which: usize| {
            part.iter().map(|sample| sample[which]).fold(f64::INFINITY, f64::min)
        };
        let memory = [early, late].map(|part| median(part, 0));
        let most_mib = usage.iter().map(|sample| sample[0]).fold(0.0, f64::max);
        let hours = ran.as_secs_f64() * (1.0 - WARM_UP) * 0.75 / 3600.0; // between the middles of the two quarters
        println!(
            "resident beside what the state names: {:.1} MiB early, {:.1} MiB late ({:+.2} MiB an hour), {most_mib:.1} MiB at most",
            memory[0],
            memory[1],
            (memory[1] - memory[0]) / hours
        );
        if memory[1] - memory[0] > growth_mib {
            self.fail(format!("memory grew from {:.1} to {:.1} MiB", memory[0], memory[1]));
        }
        for (which, name) in [(1, "open files"), (2, "threads")] {
            let [before, after] = [early, late].map(|part| least(part, which));
            println!("{name}: at least {before:.0} early, {after:.0} late");
            if after > before + SLACK {
                self.fail(format!("{name} grew from {before:.0} to {after:.0}"));
            }
        }
        let failures = self.failures.lock().unwrap();
        println!(
            "{}",
            if failures.is_empty() {
                "all of it held".into()
            } else {
                format!("{} failures", failures.len())
            }
        );
        failures.is_empty()
    }
}

/// Whom each problem of a state concerns, and its kind.
pub fn problems(status: &Value) -> impl Iterator<Item = (&str, &str)> {
    let list = status["problems"].as_array().unwrap();
    list.iter().map(|problem| (problem["about"].as_str().unwrap(), problem["kind"].as_str().unwrap()))
}

/// The problems of a state in its own words.
pub fn said(status: &Value) -> String {
    let list = status["problems"].as_array().unwrap();
    list.iter().map(|problem| problem["what"].as_str().unwrap()).collect::<Vec<_>>().join(" ")
}

pub fn has(status: &Value, subject: &str, kind: &str) -> bool {
    problems(status).any(|problem| problem == (subject, kind))
}

/// Resident memory in MiB without what the state names and bounds (buffers of packets, cells seen, the map), open files and
/// threads of the daemon (proc_pid_status(5)).
fn usage(process: u32, status: &Value) -> [f64; 3] {
    let named = ["packets", "coverage", "map"].map(|name| status["memory"][name].as_f64().unwrap());
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let of = |name: &str| -> f64 {
        let line = status.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.split_whitespace().next().unwrap().parse().unwrap()
    };
    let files = std::fs::read_dir(format!("/proc/{process}/fd")).unwrap().count();
    [of("VmRSS:") / 1024.0 - named.iter().sum::<f64>() / f64::from(1 << 20), files as f64, of("Threads:")]
}
