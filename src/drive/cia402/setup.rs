//! Looking at a drive, configuring it, starting it; what would let it move otherwise than ordered is refused here.

use std::time::{Duration, Instant};

use firmware_protocol::config::Home;

use super::drive::Zero;
use super::object::{self, Answer};
use super::unit::{Factors, Ratio};
use super::{Cia402, HEARTBEAT_EVERY, HOMING_US, HOST};
use crate::drive::LinkError;

/// How long after a drive another of the same number may answer.
const TWIN_WITHIN: Duration = Duration::from_millis(50);
/// How long a started drive may take to say where it stands.
const POSITION_WITHIN: Duration = Duration::from_secs(2);
const HALF_TURN_URAD: i32 = 3_141_592;

impl Cia402 {
    /// Looks at a drive, configures and starts it; its range, µrad, and how its position comes to be trusted.
    pub(super) fn start(&mut self, axis: usize) -> Result<((i32, i32), Home), LinkError> {
        let node = self.drives[axis].node;
        (self.questions, self.drives[axis].kinds) = (0, 0);
        self.bus.send(0, &[0x80, node])?; // configuration is for the pre-operational
        self.identify(axis)?;
        self.take_units(axis)?;
        let limits = self.limits(axis, object::SOFTWARE_LIMITS, "software position limits")?;
        let wraps = self.limits(axis, object::RANGE_LIMITS, "position range limits")?;
        for (object, value) in object::process_data(node) {
            self.write(axis, object, value)?;
        }
        self.write(axis, object::MODE, object::CYCLIC_POSITION)?;
        self.watch_each_other(axis)?;
        let home = self.home_of(axis)?;
        self.poll_slowly(axis)?;
        self.refuse_a_second(axis)?; // or after a while
        let drive = &mut self.drives[axis];
        (drive.restarted, drive.zero, drive.position) = (false, Zero::Idle, None);
        self.bus.send(0, &[0x01, node])?;
        self.refuse_no_angle(axis, home, wraps)?;
        let drive = &self.drives[axis];
        let mut range = (-HALF_TURN_URAD, HALF_TURN_URAD);
        for (low, high) in [limits, wraps].into_iter().flatten() {
            range = (range.0.max(drive.urad(low)), range.1.min(drive.urad(high)));
        }
        Ok((range, home))
    }

    /// Refuses what is no drive of the kind that is driven here.
    fn identify(&mut self, axis: usize) -> Result<(), LinkError> {
        let Some(kind) = self.read(axis, object::DEVICE_TYPE)? else {
            return Err(self.wrong(axis, "it has no device type".into()));
        };
        // its twin's answer comes right after
        let end = Instant::now() + TWIN_WITHIN;
        while self.hear(end)?.is_some() {}
        self.refuse_a_second(axis)?;
        if kind & 0xFFFF != 402 {
            return Err(self.wrong(axis, format!("device type {}, expected 402 (a drive)", kind & 0xFFFF)));
        }
        let modes = self.read(axis, object::SUPPORTED_MODES)?;
        if modes.is_some_and(|modes| modes >> (object::CYCLIC_POSITION - 1) & 1 == 0) {
            return Err(self.wrong(axis, "it has no cyclic synchronous position mode".into()));
        }
        Ok(())
    }

    /// Two nodes of one number both answer.
    fn refuse_a_second(&self, axis: usize) -> Result<(), LinkError> {
        if self.drives[axis].kinds > self.questions {
            return Err(self.wrong(axis, "two devices answer with this node number".into()));
        }
        Ok(())
    }

    /// An object of numerator and denominator, which is 1 where it is left out.
    fn ratio(&mut self, axis: usize, index: u16) -> Result<Option<Ratio>, LinkError> {
        let Some(numerator) = self.read(axis, (index, 1, 4))? else { return Ok(None) };
        Ok(Some(Ratio(numerator, self.read(axis, (index, 2, 4))?.unwrap_or(1))))
    }

    /// Learns what a position unit is.
    fn take_units(&mut self, axis: usize) -> Result<(), LinkError> {
        let factors = Factors {
            encoder: self.ratio(axis, object::ENCODER)?,
            gear: self.ratio(axis, object::GEAR)?,
            feed: self.ratio(axis, object::FEED)?,
            factor: self.ratio(axis, object::POSITION_FACTOR)?,
            si: self.read(axis, object::POSITION_UNIT)?,
        };
        let unit = factors.unit().map_err(|reason| self.wrong(axis, reason))?;
        if let Some(offset) = self.read(axis, object::POSITION_OFFSET)?.filter(|offset| *offset != 0) {
            let reason = format!(
                "object 0x60b0 (position offset) adds {} units to each target, expected 0: set it to 0",
                offset as i32
            );
            return Err(self.wrong(axis, reason));
        }
        // increments tell apart from position units what a turn is
        let has_increments = self.read(axis, object::INCREMENTS)?.is_some();
        let drive = &mut self.drives[axis];
        drive.counts_per_turn = unit.per_turn;
        drive.increments_per_turn = unit.increments_per_turn.filter(|_| has_increments);
        drive.units = factors.to_string();
        Ok(())
    }

    /// A pair of limits, position units; `None` where the drive has none.
    fn limits(&mut self, axis: usize, index: u16, what: &str) -> Result<Option<(i32, i32)>, LinkError> {
        let low = self.read(axis, (index, 1, 4))?.map_or(i32::MIN, |value| value as i32);
        let high = self.read(axis, (index, 2, 4))?.map_or(i32::MAX, |value| value as i32);
        match (low, high) {
            // both zero is the makers' sign for none (Novanta Summit and Nanotec manuals, 607Dh; Kollmorgen, 607Bh)
            (0, 0) | (i32::MIN, i32::MAX) => Ok(None),
            (low, high) if low < high => Ok(Some((low, high))),
            (low, high) => {
                let reason = format!(
                    "object 0x{index:04x} ({what}) is {low} to {high}, expected the lower one first, or 0 and 0 for none: \
                     correct it"
                );
                Err(self.wrong(axis, reason))
            }
        }
    }

    /// Sets up the heartbeats, and what the drive does when the host's stays away: it brakes and holds.
    fn watch_each_other(&mut self, axis: usize) -> Result<(), LinkError> {
        self.write(axis, object::HEARTBEAT_PERIOD, HEARTBEAT_EVERY.as_millis() as u32)?;
        // a drive without them does what its maker thought best
        for (object, value) in
            [(object::ON_LOST_HOST, object::QUICK_STOP), (object::ON_QUICK_STOP, object::BRAKE_AND_HOLD)]
        {
            self.ask(axis, object, object::download(object, value))?;
        }
        // one that an earlier run left with torque may count from the last heartbeat of that run
        self.heartbeat = None;
        let (host, within_ms) = HOST;
        let watched = object::download(object::WATCHED_HEARTBEAT, u32::from(host) << 16 | within_ms);
        let answer = self.ask(axis, object::WATCHED_HEARTBEAT, watched)?;
        self.watched[axis] = answer == Some(Answer::Written);
        if !self.watched[axis] {
            self.drives[axis].refused = Some("it does not watch this program's heartbeat".into());
        }
        Ok(())
    }

    /// How this drive's position comes to be trusted: by its own homing where its owner set a method that looks for
    /// something, else by an absolute encoder.
    fn home_of(&mut self, axis: usize) -> Result<Home, LinkError> {
        let modes = self.read(axis, object::SUPPORTED_MODES)?.unwrap_or(0);
        let method = self.read(axis, object::HOMING_METHOD)?.unwrap_or(0) as u8;
        let seeks =
            modes >> (object::HOMING - 1) & 1 == 1 && !object::METHODS_WITHOUT_MOTION.contains(&method);
        Ok(if seeks { Home::ByServo { longest_us: HOMING_US } } else { Home::Absolute })
    }

    /// Slow readings at the start: waited for.
    fn poll_slowly(&mut self, axis: usize) -> Result<(), LinkError> {
        for object in [object::RATED_CURRENT, object::CURRENT, object::SUPPLY] {
            if let Some(answer) = self.ask(axis, object, object::upload(object))? {
                self.drives[axis].take_slow(object, answer);
            }
        }
        Ok(())
    }

    /// Refuses a drive that stands where no goal can lead it from: its count of turns would have it turn on and on, or begin
    /// again at the other end.
    fn refuse_no_angle(
        &mut self,
        axis: usize,
        home: Home,
        wraps: Option<(i32, i32)>,
    ) -> Result<(), LinkError> {
        let end = Instant::now() + POSITION_WITHIN;
        while self.drives[axis].position.is_none() && Instant::now() < end {
            self.exchange()?;
        }
        let drive = &self.drives[axis];
        let Some(counts) = drive.position else {
            let reason = format!(
                "no position within {POSITION_WITHIN:?} of its start, expected one with every SYNC (TPDO 1, object 0x6064)"
            );
            return Err(self.wrong(axis, reason));
        };
        let (low, high) = wraps.unwrap_or((i32::MIN, i32::MAX));
        let per_turn = drive.counts_per_turn;
        // a drive that homes itself counts from anywhere until it did, but neither may it wrap while it moves
        let (reach, what) = match home {
            Home::ByServo { .. } => (f64::from(i32::MAX) - per_turn, "a turn before 32 bits wrap"),
            _ => (per_turn / 2.0, "half a turn from zero"),
        };
        let is_inside = (low..=high).contains(&counts) && f64::from(counts).abs() <= reach;
        if is_inside {
            return Ok(());
        }
        let range = wraps.map_or(String::new(), |(low, high)| format!(" and inside 0x607b, {low} to {high}"));
        let reason = format!(
            "it stands at {counts} units (object 0x6064), {:.3} deg at {per_turn} units a turn; expected at most {reach:.0} units, \
             {what}{range}: turn the shaft back or set the drive's zero (home it with its own tool), then connect again",
            f64::from(counts) * 360.0 / per_turn
        );
        Err(self.wrong(axis, reason))
    }
}
