//! An hour of the board's time: the emulator counts instructions and skips sleep, so the hour takes minutes, and the host
//! lives by the board's clock.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use firmware_protocol::{Direction, Frame, LinkCounters, Report};
use outrigger::drive::{Link, LinkError, Options, Received, RigController, RigError, SerialLink};

use super::emulator::{Emulator, MISSING, is_there};
use crate::support::{Case, with_machine};

pub const LONG: Case = with_machine("moves_for_long_without_a_fault", MISSING, is_there, moves_for_long);

const MINUTE_NS: u64 = 60_000_000_000;
/// Moves in a minute of the board's time, at least.
const LEAST_MOVES: u64 = 3;

/// Minutes of the board's time.
fn minutes() -> u64 {
    let said = std::env::var("OUTRIGGER_FIRMWARE_MINUTES").ok();
    said.map_or(10, |minutes| minutes.parse().expect("OUTRIGGER_FIRMWARE_MINUTES is a number"))
}

/// What was seen on the line.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    positions: u64,
    furthest_urad: i32,
    inwards_urad: i32,
    restarts: u32,
}

/// A serial line whose clock is the board's: positions carry its milliseconds.
struct BoardTime {
    line: SerialLink,
    now_ms: u64,
    at_urad: [i32; 2],
    connected: bool,
    seen: Arc<Mutex<Seen>>,
}

impl BoardTime {
    fn note(&mut self, frame: &Frame) {
        let report = Report::decode(frame.id.message, frame.data());
        let mut seen = self.seen.lock().unwrap();
        match report {
            Ok(Report::Position { axis, time_ms, position_urad, .. }) => {
                self.now_ms += u64::from(time_ms.wrapping_sub(self.now_ms as u16));
                self.at_urad[usize::from(axis)] = position_urad;
                seen.positions += 1;
                seen.furthest_urad = seen.furthest_urad.max(position_urad.abs());
                seen.inwards_urad = seen.inwards_urad.max(self.at_urad[1] - self.at_urad[0]);
            }
            Ok(Report::Info { session: 0, .. }) => seen.restarts += u32::from(self.connected),
            Ok(Report::Info { .. }) => self.connected = true,
            _ => {}
        }
    }
}

impl Link for BoardTime {
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError> {
        assert_eq!(frame.id.direction, Direction::ToDevice);
        self.line.send(frame)
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, LinkError> {
        let until_ns = self.now_ns() + wait.as_nanos() as u64;
        let patience = Instant::now() + Duration::from_secs(30);
        loop {
            let received = self.line.receive(Duration::from_millis(if wait.is_zero() { 0 } else { 100 }))?;
            if let Some(received) = received {
                self.note(&received.frame);
                return Ok(Some(Received { time_ns: self.now_ns(), ..received }));
            }
            if wait.is_zero() || self.now_ns() >= until_ns {
                return Ok(None);
            }
            assert!(Instant::now() < patience, "the board fell silent after {} ms of its time", self.now_ms);
        }
    }

    fn now_ns(&self) -> u64 {
        self.now_ms * 1_000_000
    }

    fn counters(&self) -> LinkCounters {
        self.line.counters()
    }

    fn device_errors(&self, _axis: usize) -> Vec<String> {
        Vec::new()
    }

    fn is_busy(&self) -> bool {
        false
    }

    fn name(&self) -> &str {
        self.line.name()
    }
}

fn moves_for_long() {
    let minutes = minutes();
    let board = Emulator::start_counting("shift=5,sleep=off");
    let begun = Instant::now();
    let seen = Arc::new(Mutex::new(Seen::default()));
    let line = SerialLink::open(&board.port).unwrap();
    let link = BoardTime { line, now_ms: 0, at_urad: [0; 2], connected: false, seen: seen.clone() };
    let options = Options {
        heartbeat_timeout: Duration::from_secs(5),
        link_timeout: Duration::from_secs(60),
        answer_within: Duration::from_secs(60),
        retry: Duration::from_secs(2),
        // the board runs ahead of this program: its moves pause whenever it hears nothing for 150 ms of its time
        settle_within: Duration::from_secs(300),
        ..Options::new_session()
    };
    let mut rig = RigController::connect(link, options).unwrap();
    let (mut moves, mut late) = (0u32, 0u32);
    let mut homed = false;
    while rig.link().now_ns() < minutes * MINUTE_NS {
        match lap(&mut rig, &mut homed, &mut moves) {
            Ok(()) => {}
            // this program was away for more than five seconds of the board's time, and the board held as it must
            Err(RigError::Fault { faults, .. }) if faults == ["watchdog"] => {
                late += 1;
                while rig.clear_faults().is_err() {}
            }
            Err(error) => panic!("after {} s: {error}", rig.link().now_ns() / 1_000_000_000),
        }
    }
    let seen = *seen.lock().unwrap();
    let counters = rig.link().counters();
    let (passed_min, wall_s) = (rig.link().now_ns() as f64 / MINUTE_NS as f64, begun.elapsed().as_secs());
    println!(
        "{passed_min:.1} min of the board's time in {wall_s} s: {moves} moves, {late} watchdog stops, {seen:?}, {counters:?}"
    );
    assert!(u64::from(moves) >= LEAST_MOVES * minutes, "{moves} moves");
    assert_eq!((seen.restarts, counters.checksum_errors, counters.malformed), (0, 0, 0));
    assert!(seen.furthest_urad <= 1_047_198 + 5236, "{seen:?}");
    assert!(seen.inwards_urad < 1_396_263, "{seen:?}");
    assert!(seen.positions as f64 > 0.9 * 2.0 * 50.0 * 60.0 * passed_min, "{seen:?}");
}

fn lap(rig: &mut RigController<BoardTime>, homed: &mut bool, moves: &mut u32) -> Result<(), RigError> {
    rig.arm()?;
    if !*homed {
        rig.home()?;
        *homed = true;
    }
    for pitches in [[0.8, -0.8], [-0.6, 0.6], [1.04, 1.04], [0.0, -1.04]] {
        rig.apply(&pitches, |_| {})?;
        *moves += 1;
        rig.idle(Duration::from_secs(1))?;
    }
    Ok(())
}
