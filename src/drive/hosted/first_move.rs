//! The first move of a rig: in small steps, each held against what was measured, and back again.
//!
//! A position unit that is wrong shows in nothing that a device says at rest. So the first time a pair is ordered to go
//! somewhere it goes the first degree in steps that begin small; where it went farther than ordered, in the other direction,
//! or much less, it is left where it stands and driven no more.

use std::sync::mpsc::TryRecvError;
use std::time::{Duration, Instant};

use firmware_protocol::{Command, Order, Reading};

use super::{Actuators, ROUND, Worker};
use crate::drive::LinkError;

/// How long each step is watched, and how long the last may take to come to rest.
const STEP: Duration = Duration::from_millis(40);
const REST_WITHIN: Duration = Duration::from_millis(600);
/// Readings of both axes after each step, at least.
const FRESH: u32 = 3;

/// Part of the first move that is gone in steps, µrad: one degree.
const FIRST_URAD: i32 = 17_453;
/// Smallest step, and how much farther each next one leads, so that a scale that is wrong by any factor shows early.
const SMALLEST_URAD: f64 = FIRST_URAD as f64 / 64.0;
const GROWTH: f64 = 1.5;
/// Farther than this times what was ordered is too far; less than its inverse is too little.
const TOO_FAR: f64 = 1.5;
/// Motion that is none: readings at rest scatter by this much, µrad.
const REST_URAD: i32 = 2500;

/// Where a shaft stands by a source that the unit of the goals has no part in.
#[derive(Clone, Copy, Debug)]
pub(in crate::drive) struct Witness {
    /// Its name.
    pub what: &'static str,
    /// Its count, from anywhere, wrapping.
    pub counts: i32,
    /// One count, µrad.
    pub urad_per_count: f64,
}

impl Witness {
    /// How far it went since another count, µrad.
    fn moved_urad(&self, before: &Self) -> i32 {
        (f64::from(self.counts.wrapping_sub(before.counts)) * self.urad_per_count) as i32
    }
}

/// Shares of the travel, from the first step to the last.
fn shares(longest_urad: i32) -> Vec<f64> {
    let whole = f64::from(longest_urad.unsigned_abs().min(FIRST_URAD.unsigned_abs()));
    let steps = std::iter::successors(Some(SMALLEST_URAD), |step| Some(step * GROWTH));
    let mut shares: Vec<f64> =
        steps.take_while(|step| *step < whole).map(|step| step / f64::from(longest_urad.max(1))).collect();
    shares.push(whole / f64::from(longest_urad.max(1)));
    shares
}

/// Whether a shaft went much farther than ordered, or in the other direction, beyond what play and noise may be.
fn went_astray(ordered_urad: i32, moved_urad: i32, noise_urad: i32) -> bool {
    let noise = f64::from(noise_urad.max(REST_URAD));
    let (ordered, moved) = (f64::from(ordered_urad), f64::from(moved_urad));
    let moved = if ordered_urad == 0 { moved.abs() } else { moved * ordered.signum() };
    moved > TOO_FAR * ordered.abs() + noise || moved < -noise
}

/// Whether a shaft that came to rest moved, and much less than ordered. One that did not move at all is stuck, which
/// is another's business.
fn fell_short(ordered_urad: i32, moved_urad: i32, noise_urad: i32) -> bool {
    let noise = f64::from(noise_urad.max(REST_URAD));
    let (ordered, moved) = (f64::from(ordered_urad).abs(), f64::from(moved_urad).abs());
    moved > noise / 2.0 && moved < ordered / TOO_FAR - noise
}

/// Where a move begins and how far it leads, µrad.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlannedMove {
    from_urad: [i32; 2],
    travel_urad: [i32; 2],
}

/// What was measured before the first step.
struct Before {
    readings_urad: [Option<i32>; 2],
    witnesses: [Option<Witness>; 2],
}

impl<A: Actuators> Worker<A> {
    /// What an order that moves asks for.
    pub(super) fn planned_move(&mut self, command: &Command) -> Option<PlannedMove> {
        let mut from_urad = [0; 2];
        for (axis, from_urad) in from_urad.iter_mut().enumerate() {
            *from_urad = self.controller.servo_mut(axis)?.setpoint?.position_urad;
        }
        let mut to_urad = from_urad;
        match *command {
            Command::Order { order: Order::MovePair { a_urad, b_urad }, .. } => to_urad = [a_urad, b_urad],
            Command::Order { order: Order::MoveTo { axis, position_urad }, .. } => {
                *to_urad.get_mut(usize::from(axis))? = position_urad;
            }
            _ => return None,
        }
        Some(PlannedMove {
            from_urad,
            travel_urad: [0, 1].map(|axis| to_urad[axis].saturating_sub(from_urad[axis])),
        })
    }

    /// Goes the first part of a move in steps and back again; an error where a shaft moved otherwise than ordered. Ends early,
    /// to be tried again, when an axis is silent, which the state machine finds, or a command to stop came.
    pub(super) fn try_scale(&mut self, planned: PlannedMove) -> Result<(), LinkError> {
        self.go_in_steps(planned)?;
        // the state machine read nothing meanwhile: its next look is to find something, or that time counts as silence
        self.hear_both()?;
        Ok(())
    }

    /// Reads on until the latest answer of each axis is a reading; false where one stays away. On a busy machine an answer is late,
    /// and the move is not to go on untried for that.
    fn hear_both(&mut self) -> Result<bool, LinkError> {
        let end = Instant::now() + REST_WITHIN;
        while self.readings_urad().contains(&None) {
            if Instant::now() >= end {
                return Ok(false);
            }
            std::thread::sleep(ROUND);
            self.listen(1)?;
        }
        Ok(true)
    }

    fn go_in_steps(&mut self, planned: PlannedMove) -> Result<(), LinkError> {
        self.listen(0)?;
        if !self.hear_both()? {
            return Ok(());
        }
        let before = Before { readings_urad: self.readings_urad(), witnesses: self.actuators.witnesses()? };
        let longest_urad = planned.travel_urad.map(i32::saturating_abs).into_iter().max().unwrap_or(0);
        let ordered_by = |share: f64| planned.travel_urad.map(|travel| (f64::from(travel) * share) as i32);
        let shares = shares(longest_urad);
        for share in &shares {
            let ordered_urad = ordered_by(*share);
            self.step_to(&planned, ordered_urad)?;
            self.watch_for(STEP, &before, ordered_urad)?;
            if self.is_stop_ordered() || !self.hear_both()? {
                return Ok(());
            }
        }
        let ordered_urad = ordered_by(shares.last().copied().unwrap_or(0.0));
        self.come_to_rest(&before, ordered_urad)?;
        for share in shares.iter().rev().skip(1).chain([&0.0]) {
            self.step_to(&planned, ordered_by(*share))?;
            std::thread::sleep(ROUND);
            self.listen(1)?;
        }
        // a shorter move proves little
        self.is_tried = longest_urad >= FIRST_URAD / 2;
        Ok(())
    }

    fn step_to(&mut self, planned: &PlannedMove, ordered_urad: [i32; 2]) -> Result<(), LinkError> {
        for (axis, ordered_urad) in ordered_urad.into_iter().enumerate() {
            let setpoint = self.controller.servo_mut(axis).and_then(|servo| servo.setpoint.as_mut());
            setpoint.into_iter().for_each(|setpoint| {
                setpoint.position_urad = planned.from_urad[axis].saturating_add(ordered_urad);
            });
        }
        self.tell()
    }

    /// What was just read of each axis.
    fn readings_urad(&mut self) -> [Option<i32>; 2] {
        [0, 1].map(|axis| match self.controller.servo_mut(axis)?.sense.reading {
            Reading::Measured(urad) => Some(urad),
            _ => None,
        })
    }

    /// Waits until the shafts are at their goals or stand elsewhere, and refuses what fell short.
    fn come_to_rest(&mut self, before: &Before, ordered_urad: [i32; 2]) -> Result<(), LinkError> {
        let end = Instant::now() + REST_WITHIN;
        let mut earlier = self.moved_urad(before);
        loop {
            self.watch_for(STEP, before, ordered_urad)?;
            let moved = self.moved_urad(before);
            let all = |holds: &dyn Fn(usize, i32) -> bool| {
                (0..2).all(|axis| moved[axis].is_some_and(|moved| holds(axis, moved)))
            };
            let noise = |axis: usize| self.noise_urad[axis].max(REST_URAD) / 2;
            let stands = all(&|axis, now| {
                earlier[axis].is_some_and(|before| (now - before).abs() <= ordered_urad[axis].abs() / 50)
            });
            if all(&|axis, now| (now - ordered_urad[axis]).abs() <= noise(axis)) {
                return self.refuse_witnessed(before, ordered_urad, fell_short);
            }
            if Instant::now() >= end {
                // one that still moves is slow, and the state machine's
                return if stands {
                    self.refuse_moved(moved, ordered_urad, fell_short)?;
                    self.refuse_witnessed(before, ordered_urad, fell_short)
                } else {
                    Ok(())
                };
            }
            earlier = moved;
        }
    }

    /// Reads on for a while, and refuses what went astray.
    fn watch_for(
        &mut self,
        time: Duration,
        before: &Before,
        ordered_urad: [i32; 2],
    ) -> Result<(), LinkError> {
        let (end, latest) = (Instant::now() + time, Instant::now() + REST_WITHIN);
        let mut fresh = 0;
        // a late answer tells of before the step: only some later show what it did
        while Instant::now() < end || (fresh < FRESH && Instant::now() < latest) {
            std::thread::sleep(ROUND);
            self.listen(1)?;
            let moved = self.moved_urad(before);
            fresh += u32::from(!moved.contains(&None));
            self.refuse_moved(moved, ordered_urad, went_astray)?;
        }
        self.refuse_witnessed(before, ordered_urad, went_astray)
    }

    /// How far each went by its readings.
    fn moved_urad(&mut self, before: &Before) -> [Option<i32>; 2] {
        let now = self.readings_urad();
        [0, 1].map(|axis| Some(now[axis]?.saturating_sub(before.readings_urad[axis]?)))
    }

    fn refuse_moved(
        &mut self,
        moved_urad: [Option<i32>; 2],
        ordered_urad: [i32; 2],
        is_wrong: fn(i32, i32, i32) -> bool,
    ) -> Result<(), LinkError> {
        for axis in 0..2 {
            let wrong = |moved: &i32| is_wrong(ordered_urad[axis], *moved, self.noise_urad[axis]);
            if let Some(moved) = moved_urad[axis].filter(wrong) {
                return Err(self.wrong_scale(axis, ordered_urad[axis], "its readings", moved));
            }
        }
        Ok(())
    }

    /// The same by the witnesses, which may count the other planned.
    fn refuse_witnessed(
        &mut self,
        before: &Before,
        ordered_urad: [i32; 2],
        is_wrong: fn(i32, i32, i32) -> bool,
    ) -> Result<(), LinkError> {
        let now = self.actuators.witnesses()?;
        for axis in 0..2 {
            let (Some(now), Some(before)) = (now[axis], before.witnesses[axis]) else { continue };
            let moved = now.moved_urad(&before);
            if is_wrong(ordered_urad[axis].abs(), moved.abs(), self.noise_urad[axis]) {
                return Err(self.wrong_scale(axis, ordered_urad[axis], now.what, moved));
            }
        }
        Ok(())
    }

    /// The goal that was given last stands: the shafts hold there, or go there and no farther.
    fn wrong_scale(
        &mut self,
        axis: usize,
        ordered_urad: i32,
        by: &'static str,
        moved_urad: i32,
    ) -> LinkError {
        self.actuators.leave();
        let degrees = |urad: i32| f64::from(urad).to_degrees() / 1e6;
        let units = self.actuators.units(axis);
        LinkError::WrongScale {
            path: self.name.clone(),
            axis,
            ordered_deg: degrees(ordered_urad),
            by,
            moved_deg: degrees(moved_urad),
            units: if units.is_empty() { units } else { format!(" ({units})") },
        }
    }

    /// Whether a command came that is not to wait; commands stay in their order.
    fn is_stop_ordered(&mut self) -> bool {
        loop {
            match self.commands.try_recv() {
                Ok(frame) => self.waiting.push_back(frame),
                Err(TryRecvError::Empty) => break,
                Err(TryRecvError::Disconnected) => return true,
            }
        }
        self.waiting.iter().any(|frame| {
            matches!(
                Command::decode(frame.id.message, frame.data()),
                Ok(Command::Order {
                    order: Order::EStop | Order::Stop { .. } | Order::Hold | Order::Arm { armed: false },
                    ..
                })
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_begin_small_and_end_with_a_degree_or_the_whole_distance() {
        for (longest_urad, last) in [(209_440, 17_453.0 / 209_440.0), (17_453, 1.0), (9000, 1.0), (100, 1.0)]
        {
            let shares = shares(longest_urad);
            assert!(shares.windows(2).all(|pair| pair[0] < pair[1]), "{shares:?}");
            assert!((shares.last().unwrap() - last).abs() < 1e-9, "{longest_urad}: {shares:?}");
            assert!(shares[0] * f64::from(longest_urad) <= SMALLEST_URAD + 1e-6);
        }
        assert_eq!(shares(0), [0.0]);
    }

    #[test]
    fn eleven_times_too_far_shows_within_two_degrees() {
        // noise of a fine encoder, of one of 4096 counts with some play, and of a servo with a degree of it
        for noise_urad in [60, 12_000, 25_000] {
            let ordered = shares(209_440).into_iter().map(|share| (share * 209_440.0) as i32);
            let mut before_stopped =
                ordered.take_while(|ordered| !went_astray(*ordered, 11 * ordered, noise_urad));
            let last = before_stopped.by_ref().last().unwrap_or(0);
            let stopped_deg = f64::from(last) * GROWTH * 11.0 * 360.0 / (std::f64::consts::TAU * 1e6);
            assert!(stopped_deg < 2.0, "noise {noise_urad}: {stopped_deg:.2} deg");
        }
    }

    #[test]
    fn a_move_as_ordered_passes() {
        for ordered in [-17_453, -300, 0, 300, 17_453] {
            assert!(!went_astray(ordered, ordered, 0) && !fell_short(ordered, ordered, 0));
        }
        assert!(!went_astray(17_453, 0, 0), "still moving");
        assert!(!fell_short(17_453, 0, 0), "stuck");
        assert!(went_astray(17_453, -17_453, 12_000), "the other direction");
        assert!(went_astray(0, 30_000, 12_000), "the axis that was to stand");
        assert!(fell_short(-17_453, -1745, 60));
        assert!(!fell_short(17_453, 12_500, 25_000), "play");
    }

    #[test]
    fn a_witness_counts_across_the_end_of_its_range() {
        let at = |counts| Witness { what: "", counts, urad_per_count: 10.0 };
        assert_eq!(at(i32::MIN + 4).moved_urad(&at(i32::MAX - 5)), 100);
    }
}
