//! What is off about a servo, in words.

use super::{Estimate, SHORTEST_HOLD_S, StandTest};

/// What is beyond so many standard deviations and so many degrees is called off.
const SURE: f64 = 3.0;
const NOTABLE_DEG: f64 = 0.1;
/// What turns by less of what its axis measures hangs on no gear at all.
const STANDS: f64 = 0.05;

impl StandTest {
    pub(crate) fn verdict(tests: &[Self]) -> &'static str {
        if tests.iter().any(|test| !test.faults().is_empty()) {
            "differs"
        } else if tests.iter().all(|test| test.scale_error.is_some()) {
            "as_measured"
        } else {
            "cannot_tell"
        }
    }

    pub(crate) fn words(&self) -> String {
        let known = self.settings.iter().filter(|found| found.error_deg.is_some()).count();
        let faults = self.faults();
        if !faults.is_empty() {
            return format!("{}: {}", self.sensor, faults.join("; "));
        }
        match self.scale_error {
            Some(_) => {
                format!("{}: does as it measures, as far as {} settings can tell", self.sensor, known + 1)
            }
            None if self.settings.len() < 4 => format!(
                "{}: cannot tell from {} settings that held for {:.1} s or more: four are needed",
                self.sensor,
                self.settings.len(),
                SHORTEST_HOLD_S
            ),
            None => {
                let why = self.settings.iter().find_map(|found| found.cannot_tell.as_deref());
                format!("{}: {}", self.sensor, why.unwrap_or("cannot tell here"))
            }
        }
    }

    /// What is off about a servo, each in words.
    fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let measured = || self.settings.iter().map(|found| found.measured_deg);
        let span_deg =
            measured().fold(f64::NEG_INFINITY, f64::max) - measured().fold(f64::INFINITY, f64::min);
        if let Some(scale) = self.scale_error.filter(|scale| is_off(scale, scale.value.abs() * span_deg)) {
            faults.push(turning(&scale));
        }
        if let Some(play) = self.play_deg.filter(|play| is_off(play, play.value.abs())) {
            faults.push(format!("{:.2} ± {:.2} degrees of play behind its reading", play.value, play.u95));
        }
        if let (Some(off_deg), Some(sd_deg)) = (self.axis_off_deg, self.axis_sd_deg)
            && off_deg > (SURE * sd_deg).max(NOTABLE_DEG)
        {
            let [x, _, z] = self.axis.unwrap_or_default().map(f64::to_degrees);
            faults.push(format!(
                "its axis lies {off_deg:.2} degrees off the sensor's y axis ({x:+.2} to x, {z:+.2} to z): the sensor does not sit square"
            ));
        }
        if let Some(left_deg) = self.left_over_deg.filter(|left_deg| *left_deg > NOTABLE_DEG) {
            faults.push(format!(
                "settings are off by {left_deg:.2} degrees (rms) that neither scale nor play explain"
            ));
        }
        faults
    }
}

fn is_off(found: &Estimate, in_degrees: f64) -> bool {
    found.value.abs() > SURE * found.sd && in_degrees > NOTABLE_DEG
}

/// By how much a sensor turns that does not turn as its axis measures.
fn turning(scale: &Estimate) -> String {
    let turns = format!("turns {:.4} ± {:.4} degrees for each that", 1.0 + scale.value, scale.u95);
    if (1.0 + scale.value).abs() < STANDS {
        return format!(
            "{turns} its axis measures: it does not turn with this axis (are the sensors of the mount file in the order \
             of the axes, does it sit on the servo, is the horn loose?)"
        );
    }
    format!("{turns} it measures: wrong gear or scale")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_that_does_not_turn_hangs_on_no_gear() {
        for (factor, fault) in [(0.0, "does not turn with this axis"), (1.03, "wrong gear or scale")] {
            let scale = Estimate { value: factor - 1.0, sd: 1e-4, u95: 2e-4, p_value: 0.0 };
            assert!(turning(&scale).contains(fault), "{}", turning(&scale));
        }
    }
}
