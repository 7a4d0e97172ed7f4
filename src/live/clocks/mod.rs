//! How a sensor's clock stands to the host's: offset and drift with their uncertainty, jumps, and what the clock shows.
//!
//! A pure estimator over pairs of times: the host's stamp of a packet and the sensor's. Packets come late and never early, so
//! only the quickest of each second count, and of these the line below ([`envelope`]).

use std::collections::VecDeque;

use serde::Serialize;

pub mod envelope;
pub mod host;

use envelope::Line;

/// 2000-01-01 in ns since 1970: a clock that shows less counts from power-on.
const FIRST_DATE_NS: u64 = 946_684_800_000_000_000;
/// TAI is ahead of UTC by this since 2017 (IERS Bulletin C).
const TAI_AHEAD_S: f64 = 37.0;
/// Hosts without a time source are off by less than this.
const SAME_S: f64 = 1.0;
/// Shorter recordings do not show drift above the jitter of hosts.
const DRIFT_NEEDS_S: f64 = 10.0;
/// Of the pairs of one such time only the quickest counts, ns.
const WINDOW_NS: u64 = 1_000_000_000;
/// Windows of the fit: drift changes with temperature within minutes.
const MAX_WINDOWS: usize = 600;
/// Windows in a row that must be off upwards before that is a jump: a network may be slow for a while. A packet that comes
/// before it can have been sent needs no second one.
const LATE_WINDOWS: usize = 3;
/// Jumps that are remembered.
const MAX_JUMPS: usize = 64;
/// Least change that is a jump, ns.
const JUMP_NS: f64 = 10e6;
/// A change that no network makes: one such pair is enough, ns.
const SUDDEN_NS: f64 = 1e9;
/// Packets that pause for so long may be those of a sensor that was started again with a clock a little off, ns.
const PAUSE_NS: u64 = 1_000_000_000;
/// Clocks drift by less than this, ns per ns (100 ppm each).
const MAX_DRIFT: f64 = 200e-6;

/// What a clock shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ClockState {
    /// There are no host times to compare with.
    Unknown,
    /// It counts from power-on: free running.
    SincePowerOn,
    /// UTC, as by GPS or NMEA with PPS.
    Utc,
    /// TAI, as by PTP.
    Tai,
    /// A date, and none of these.
    Unsynchronised,
}

/// Pairs of host and device time of one sensor, in the order of arrival.
#[derive(Clone, Debug, Default)]
pub struct ClockWatch {
    first: Option<[u64; 2]>,
    last: Option<[u64; 2]>,
    min_offset_ns: Option<i128>,
    max_offset_ns: Option<i128>,
    steps_back: u64,
    /// Least device time so far, ns, and how often it began again there.
    least_device_ns: Option<u64>,
    replays: u64,
    /// Host time and offset of the segment's first pair: everything is counted from there, so that a double holds it.
    origin: Option<(u64, i128)>,
    windows: VecDeque<[f64; 2]>,
    open: Option<[f64; 2]>,
    opened_ns: u64,
    late: Vec<[f64; 2]>,
    jumps: Vec<Jump>,
    jump_count: u64,
    restarts: u64,
    /// The next pair is the first since a restart.
    is_restarted: bool,
    /// The open window is the first since a pause.
    is_after_pause: bool,
    /// Device time from one pair to the next, as it was last.
    period_ns: Option<i128>,
    /// The last pair at which the clocks moved apart, and which of them it was.
    parted: Option<(u64, Moved)>,
}

/// Which of two clocks was set, as far as the time between two pairs tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Moved {
    /// The sensor's.
    Device,
    /// This host's: the sensor's went on.
    Host,
    /// Either.
    Unknown,
}

/// A change of the offset that no delay explains: either clock was set, or the sensor restarted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Jump {
    /// The host's time, ns.
    pub host_ns: u64,
    /// Host minus device after it, less before, s.
    pub change_s: f64,
    /// Which clock it was.
    pub moved: Moved,
}

/// State and errors of a clock.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClockReport {
    /// What it shows.
    pub state: ClockState,
    /// Host minus device by the quickest packets, at the last pair, s: the device's stamp plus this is the host's time, less
    /// what even the quickest packet takes.
    pub host_minus_device_s: f64,
    /// Half the width in which that lies, s; absent before there are three seconds.
    pub uncertainty_s: Option<f64>,
    /// How much the difference varied on the whole: jitter of the network and the host, drift, jumps, s.
    pub variation_s: f64,
    /// How fast the device's clock loses against the host's, parts per million; from 10 s on.
    pub drift_ppm: Option<f64>,
    /// Half the width in which that lies.
    pub drift_uncertainty_ppm: Option<f64>,
    /// Times that the sensor was started again; the drift is that of the time since.
    pub restarts: u64,
    /// Times that device time ran backwards, restarts not counted.
    pub steps_back: u64,
    /// Times that device time began again where it had begun: a recording that is replayed in a loop.
    pub replays: u64,
    /// Changes that no delay explains.
    pub jump_count: u64,
    /// The last of them.
    pub jumps: Vec<Jump>,
}

/// A replay begins again within this of where it began, ns: the first packet may have been lost.
const SAME_BEGIN_NS: u64 = 200_000_000;

impl ClockWatch {
    /// Takes the arrival and the device time of one packet (or of one frame's first).
    pub(crate) fn add(&mut self, host_ns: u64, device_ns: u64) {
        let offset_ns = i128::from(host_ns) - i128::from(device_ns);
        if std::mem::take(&mut self.is_restarted) {
            self.last = Some([host_ns, device_ns]);
            return self.begin_segment(host_ns, offset_ns);
        }
        let paused = self.last.is_some_and(|[last_ns, _]| host_ns.saturating_sub(last_ns) >= PAUSE_NS);
        self.note_parting(host_ns, device_ns);
        let stepped_back = self.last.is_some_and(|[_, last_ns]| device_ns < last_ns);
        self.steps_back += u64::from(stepped_back);
        let is_begun_again =
            self.least_device_ns.is_some_and(|least| device_ns.abs_diff(least) <= SAME_BEGIN_NS);
        self.replays += u64::from(stepped_back && is_begun_again);
        self.least_device_ns = Some(self.least_device_ns.map_or(device_ns, |least| least.min(device_ns)));
        self.first.get_or_insert([host_ns, device_ns]);
        self.last = Some([host_ns, device_ns]);
        self.min_offset_ns = Some(self.min_offset_ns.map_or(offset_ns, |least| least.min(offset_ns)));
        self.max_offset_ns = Some(self.max_offset_ns.map_or(offset_ns, |most| most.max(offset_ns)));
        let (origin_ns, origin_offset_ns) = *self.origin.get_or_insert((host_ns, offset_ns));
        let point = [host_ns as f64 - origin_ns as f64, (offset_ns.saturating_sub(origin_offset_ns)) as f64];
        let is_jump = self.is_sudden(point) || self.is_early(point) || (stepped_back && self.is_off(point));
        if host_ns < origin_ns || is_jump {
            return self.restart_fit(host_ns, offset_ns, point);
        }
        if host_ns.abs_diff(self.opened_ns) >= WINDOW_NS || self.open.is_none() {
            self.close_window(host_ns, offset_ns);
            self.opened_ns = host_ns;
            self.is_after_pause |= paused;
        }
        let origin = self.origin.unwrap_or((host_ns, offset_ns));
        let point = [host_ns as f64 - origin.0 as f64, (offset_ns - origin.1) as f64];
        self.open = Some(self.open.filter(|open| open[1] <= point[1]).unwrap_or(point));
    }

    /// The quickest of a window joins the others; late ones wait until it is clear what they are.
    fn close_window(&mut self, host_ns: u64, offset_ns: i128) {
        let Some(point) = self.open.take() else { return };
        if self.windows.len() >= 3 && self.is_off(point) {
            self.late.push(point);
            if self.late.len() >= LATE_WINDOWS {
                self.restart_fit(host_ns, offset_ns, point);
            }
            return;
        }
        // who paused may have been started again: its clock may stand elsewhere by less than a jump, which is no drift
        if std::mem::take(&mut self.is_after_pause) {
            self.windows.clear();
            self.late.clear();
        }
        for point in self.late.drain(..).chain([point]) {
            if self.windows.len() == MAX_WINDOWS {
                self.windows.pop_front();
            }
            self.windows.push_back(point);
        }
    }

    /// The sensor was started again: the fit starts again with the next pair.
    pub(crate) fn restart(&mut self) {
        self.restarts += 1;
        self.is_restarted = true;
    }

    /// Notes which clock was set where the times since the last pair are not alike: the other's is as usual.
    fn note_parting(&mut self, host_ns: u64, device_ns: u64) {
        let Some([last_host_ns, last_device_ns]) = self.last else { return };
        let since_ns = i128::from(host_ns) - i128::from(last_host_ns);
        let device_since_ns = i128::from(device_ns) - i128::from(last_device_ns);
        if ((since_ns - device_since_ns) as f64).abs() > JUMP_NS {
            let is_usual = |time_ns: i128| {
                let period_ns = self.period_ns?;
                Some(((time_ns - period_ns) as f64).abs() <= JUMP_NS)
            };
            let moved = match (is_usual(since_ns), is_usual(device_since_ns)) {
                (Some(false), Some(true)) => Moved::Host,
                (Some(true), Some(false)) => Moved::Device,
                _ if device_since_ns < 0 && since_ns >= 0 => Moved::Device,
                _ => Moved::Unknown,
            };
            self.parted = Some((host_ns, moved));
        } else if device_since_ns > 0 {
            self.period_ns = Some(device_since_ns);
        }
    }

    fn restart_fit(&mut self, host_ns: u64, offset_ns: i128, point: [f64; 2]) {
        let change_ns = point[1] - self.expected_ns().unwrap_or(0.0);
        self.jump_count += 1;
        if self.jumps.len() == MAX_JUMPS {
            self.jumps.remove(0);
        }
        // what is seen to be no delay after some seconds was when the clocks last parted
        let late_ns = WINDOW_NS * (LATE_WINDOWS as u64 + 2);
        let parted = self.parted.filter(|(at_ns, _)| host_ns.abs_diff(*at_ns) <= late_ns);
        let (host_ns_then, moved) = parted.unwrap_or((host_ns, Moved::Unknown));
        self.jumps.push(Jump { host_ns: host_ns_then, change_s: change_ns * 1e-9, moved });
        self.begin_segment(host_ns, offset_ns);
    }

    fn begin_segment(&mut self, host_ns: u64, offset_ns: i128) {
        self.is_after_pause = false;
        self.windows.clear();
        self.late.clear();
        self.origin = Some((host_ns, offset_ns));
        self.open = Some([0.0, 0.0]);
        self.opened_ns = host_ns;
    }

    fn line(&self) -> Option<Line> {
        let (older, newer) = self.windows.as_slices();
        if newer.is_empty() { envelope::below(older) } else { envelope::below(&[older, newer].concat()) }
    }

    /// The offset that the last window leads to expect, ns.
    fn expected_ns(&self) -> Option<f64> {
        self.windows.back().or(self.open.as_ref()).map(|last| last[1])
    }

    fn margin_ns(&self, at_ns: f64) -> f64 {
        let since_ns = self.windows.back().or(self.open.as_ref()).map_or(0.0, |last| at_ns - last[0]);
        JUMP_NS + MAX_DRIFT * since_ns.max(0.0) + self.jitter_ns()
    }

    /// How much the quickest packets of the last windows differ.
    fn jitter_ns(&self) -> f64 {
        let recent = || self.windows.iter().rev().take(20).map(|window| window[1]);
        let (low, high) =
            (recent().fold(f64::INFINITY, f64::min), recent().fold(f64::NEG_INFINITY, f64::max));
        if low <= high { high - low } else { 0.0 }
    }

    fn is_off(&self, point: [f64; 2]) -> bool {
        self.expected_ns().is_some_and(|expected| (point[1] - expected).abs() > self.margin_ns(point[0]))
    }

    fn is_sudden(&self, point: [f64; 2]) -> bool {
        let margin_ns = SUDDEN_NS + self.margin_ns(point[0]);
        self.expected_ns().is_some_and(|expected| (point[1] - expected).abs() > margin_ns)
    }

    /// Whether a packet came before it can have been sent. The first seconds are too few to tell a slow start.
    fn is_early(&self, point: [f64; 2]) -> bool {
        self.windows.len() >= 3
            && self.expected_ns().is_some_and(|expected| expected - point[1] > self.margin_ns(point[0]))
    }

    /// Host time of a device stamp, and half the width in which it lies, ns, by what was seen since the last jump; nothing
    /// before there are three seconds.
    #[cfg(test)]
    pub(crate) fn host_ns(&self, device_ns: u64) -> Option<(u64, u64)> {
        let (origin_ns, origin_offset_ns) = self.origin?;
        let line = self.line()?;
        let guess_ns = (i128::from(device_ns) + origin_offset_ns - i128::from(origin_ns)) as f64;
        let offset_ns = line.height_ns(guess_ns);
        let host_ns = i128::from(device_ns) + origin_offset_ns + offset_ns.round() as i128;
        Some((u64::try_from(host_ns).ok()?, line.uncertainty_ns(guess_ns).ceil() as u64))
    }

    /// Says what the clock shows; nothing without pairs.
    pub(crate) fn report(&self) -> Option<ClockReport> {
        let [host_ns, device_ns] = self.last?;
        let (origin_ns, origin_offset_ns) = self.origin?;
        let at_ns = host_ns as f64 - origin_ns as f64;
        let line = self.line();
        let over_origin_ns =
            line.map_or_else(|| self.open.map_or(0.0, |open| open[1]), |line| line.height_ns(at_ns));
        let host_minus_device_s = origin_offset_ns as f64 * 1e-9 + over_origin_ns * 1e-9;
        let span_s = match (self.windows.front(), self.windows.back()) {
            (Some(first), Some(last)) => (last[0] - first[0] + WINDOW_NS as f64) * 1e-9,
            _ => 0.0,
        };
        let drift = line.filter(|_| span_s >= DRIFT_NEEDS_S);
        Some(ClockReport {
            state: if host_ns == 0 { ClockState::Unknown } else { state(device_ns, host_minus_device_s) },
            host_minus_device_s,
            uncertainty_s: line.map(|line| line.uncertainty_ns(at_ns) * 1e-9),
            variation_s: (self.max_offset_ns? - self.min_offset_ns?) as f64 * 1e-9,
            drift_ppm: drift.map(|line| line.slope * 1e6),
            drift_uncertainty_ppm: drift.map(|line| line.slope_uncertainty * 1e6),
            restarts: self.restarts,
            steps_back: self.steps_back,
            replays: self.replays,
            jump_count: self.jump_count,
            jumps: self.jumps.clone(),
        })
    }
}

fn state(device_ns: u64, host_minus_device_s: f64) -> ClockState {
    if device_ns < FIRST_DATE_NS {
        ClockState::SincePowerOn
    } else if host_minus_device_s.abs() < SAME_S {
        ClockState::Utc
    } else if (host_minus_device_s + TAI_AHEAD_S).abs() < SAME_S {
        ClockState::Tai
    } else {
        ClockState::Unsynchronised
    }
}

impl ClockReport {
    /// Jumps of this host's clock, not the sensor's.
    pub(crate) fn host_jumps(&self) -> impl Iterator<Item = &Jump> {
        self.jumps.iter().filter(|jump| jump.moved == Moved::Host)
    }

    /// In words.
    pub(crate) fn text(&self) -> String {
        let offset_s = self.host_minus_device_s;
        let side = if offset_s > 0.0 { "behind" } else { "ahead of" };
        let mut text = match self.state {
            ClockState::SincePowerOn => "counts from power-on; not synchronised".to_owned(),
            ClockState::Utc => format!("shows UTC ({:.3} ms {side} the host)", offset_s.abs() * 1e3),
            ClockState::Tai => {
                format!("shows TAI by PTP ({:.3} s ahead of the host): subtract 37 s for UTC", -offset_s)
            }
            ClockState::Unknown => "the recording has no host times to compare with".to_owned(),
            ClockState::Unsynchronised => format!("is {:.3} s {side} the host", offset_s.abs()),
        };
        if let Some(drift_ppm) = self.drift_ppm {
            let uncertainty_ppm = self.drift_uncertainty_ppm.unwrap_or(0.0);
            text.push_str(&format!("; drifts by {drift_ppm:.1} ±{uncertainty_ppm:.1} ppm"));
        }
        let of_host = self.host_jumps().count() as u64;
        let last = self.jumps.iter().rfind(|jump| jump.moved != Moved::Host);
        if let (Some(last), count @ 1..) = (last, self.jump_count - of_host) {
            let times = if count == 1 { "once" } else { &format!("{count} times") };
            let direction = if last.change_s > 0.0 { "back" } else { "ahead" }; // host less device
            text.push_str(&format!("; jumped {times}, last {direction} by {:.3} s", last.change_s.abs()));
        }
        if self.restarts > 0 {
            let times = if self.restarts == 1 { "once" } else { &format!("{} times", self.restarts) };
            text.push_str(&format!("; started again {times}, this is since"));
        }
        if self.steps_back > 0 {
            text.push_str(&format!("; ran backwards {} times", self.steps_back));
        }
        text
    }
}

#[cfg(test)]
mod tests;
