//! `outrigger stand`: what each servo really does, from a rig that stands still.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, ensure};
use serde::Serialize;

use super::recorded::feed::Taken;
use super::recorded::{Recorded, RecordedArgs};
use super::stage::Stage;
use super::{Context, Outcome, output};
use crate::drive::ServoReport;
use crate::recording::Session;
use crate::verify::calibrate::{Estimate, FoundSetting, Reached, Setting, StandTest, stand_test};
use crate::verify::compare::{FramePitch, Thinning};

/// Returns that are kept of each setting.
const RAYS: usize = 400_000;
/// An axis that says it holds may still swing for so long, ns.
const SETTLE_NS: u64 = 300_000_000;
/// Shorter settings are left out, ns.
const LEAST_HELD_NS: u64 = 500_000_000;
/// What is beyond so many standard deviations and so many degrees is called off.
const SURE: f64 = 3.0;
const NOTABLE_DEG: f64 = 0.1;
/// What turns by less of what its axis measures hangs on no gear at all.
const STANDS: f64 = 0.05;

/// Arguments of `stand`.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Put the rig on firm ground where floor and walls are in sight, record with the daemon, and drive each axis \
                  through settings over its range and back, two to five seconds each. The points of every setting are laid \
                  into the planes of the middle one: by how much the sensor turned beside what its axis measured, how far it \
                  lags when it comes from the other side, and where the servo's axis lies. Nothing is changed.\n\
                  Exit codes: 0 the axes do as they measure, 1 failed, 3 they do not, it cannot be told, or data was lost."
)]
pub struct Args {
    /// Session folder, recorded while the rig stood still.
    session: PathBuf,
    /// Where the sensors sit, in the order of the axes; without it the session's own.
    #[arg(long, value_name = "FILE")]
    mount: Option<PathBuf>,
}

/// The document that `stand` prints.
#[derive(Debug, Serialize)]
struct Document {
    format: &'static str,
    verdict: &'static str,
    words: Vec<String>,
    sensors: Vec<StandTest>,
    /// What is odd or was lost.
    problems: Vec<String>,
    wall_s: f64,
}

/// A stretch in which an axis held, on the host's clock.
struct Hold {
    from_ns: u64,
    to_ns: u64,
    measured_rad: f64,
    reached: Option<Reached>,
    rays: Thinning,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    let name = args.session.display();
    std::fs::metadata(&args.session).with_context(|| name.to_string())?;
    ensure!(
        Session::is_session(&args.session),
        "{name} is no session: the angles of the axes are in none but those"
    );
    // no zeros: turns alone do not tell them
    let of =
        RecordedArgs { recording: args.session.clone(), mount: args.mount.clone(), ..Default::default() };
    let recorded = Recorded::open(&of, context)?;
    let reports = recorded.servo()?;
    ensure!(
        reports.iter().any(|report| report.source == "measured"),
        "{name}: the session holds no angle that an axis measured, and this test is about those{}",
        recorded.notices.iter().map(|notice| format!("; {notice}")).collect::<String>()
    );
    let mut sensors = recorded.rig.sensors.clone();
    let mut holds: Vec<Vec<Hold>> = (0..sensors.len()).map(|axis| holds(&reports, axis)).collect();
    let fed = recorded.feed(&mut |taken| {
        let Taken { sensor, model, frame, .. } = taken;
        taken.tell_model(&mut sensors);
        let [first_ns, last_ns] = frame.host_time_ns;
        let hold = holds[sensor].iter_mut().find(|hold| hold.from_ns <= first_ns && last_ns <= hold.to_ns);
        if let Some(hold) = hold {
            hold.rays.add_frame(sensor, model, &FramePitch::constant(hold.measured_rad), 0, frame);
        }
    })?;
    let revolution_ns = if fed.revolution_ns > 0 { fed.revolution_ns } else { 100_000_000 };
    let bar = Stage::begin("laying the settings into one another");
    bar.counts(sensors.len() as u64, 0);
    let tests: Vec<StandTest> = sensors
        .iter()
        .zip(holds)
        .map(|(sensor, holds)| {
            let settings: Vec<Setting> = holds.into_iter().map(Hold::setting).collect();
            bar.say(format!("{}: laying {} settings into one another", sensor.name, settings.len()));
            let test = stand_test(sensor, &settings, revolution_ns);
            bar.more(1);
            test
        })
        .collect();
    drop(bar);
    let whole = fed.losses.is_empty();
    let problems = recorded.notices.iter().cloned().chain(fed.losses).collect();
    let document = Document {
        format: "outrigger-stand/1",
        verdict: verdict(&tests),
        words: tests.iter().map(words).collect(),
        sensors: tests,
        problems,
        wall_s: start.elapsed().as_secs_f64(),
    };
    output::print_result(context.json, &document, || text(&document), &document.problems)?;
    Ok(if document.verdict == "as_measured" && whole { Outcome::Done } else { Outcome::DataLost })
}

/// The stretches in which an axis held one target, in order of time.
fn holds(reports: &[ServoReport], axis: usize) -> Vec<Hold> {
    let mut own: Vec<&ServoReport> =
        reports.iter().filter(|report| report.axis == axis && report.source == "measured").collect();
    own.sort_by_key(|report| report.time_ns);
    let mut holds: Vec<Hold> = Vec::new();
    for run in own.chunk_by(|a, b| (&a.state, a.target_urad) == (&b.state, b.target_urad)) {
        let (first, last) = (run[0], run[run.len() - 1]);
        let from_ns = first.time_ns + SETTLE_NS;
        if first.state != "holding" || last.time_ns < from_ns + LEAST_HELD_NS {
            continue;
        }
        let settled = run.iter().filter(|report| report.time_ns >= from_ns);
        let urad: Vec<f64> = settled.map(|report| f64::from(report.position_urad)).collect();
        let measured_rad = 1e-6 * urad.iter().sum::<f64>() / urad.len() as f64;
        let reached = holds.last().map(|before| Reached::between(before.measured_rad, measured_rad));
        holds.push(Hold { from_ns, to_ns: last.time_ns, measured_rad, reached, rays: Thinning::new(RAYS) });
    }
    holds
}

impl Hold {
    fn setting(self) -> Setting {
        Setting {
            measured_rad: self.measured_rad,
            reached: self.reached,
            rays: Thinning::joined([self.rays]),
        }
    }
}

fn is_off(found: &Estimate, in_degrees: f64) -> bool {
    found.value.abs() > SURE * found.sd && in_degrees > NOTABLE_DEG
}

/// By how much a sensor turns that does not turn as its axis measures.
fn turning(scale: &Estimate) -> String {
    let turns = format!("turns {:.4} +- {:.4} degrees for each that", 1.0 + scale.value, scale.u95);
    if (1.0 + scale.value).abs() < STANDS {
        return format!(
            "{turns} its axis measures: it does not turn with this axis (are the sensors of the mount file in the order \
             of the axes, does it sit on the servo, is the horn loose?)"
        );
    }
    format!("{turns} it measures: wrong gear or scale")
}

/// What is off about a servo, each in words.
fn faults(test: &StandTest) -> Vec<String> {
    let mut faults = Vec::new();
    let measured = || test.settings.iter().map(|found| found.measured_deg);
    let span_deg = measured().fold(f64::NEG_INFINITY, f64::max) - measured().fold(f64::INFINITY, f64::min);
    if let Some(scale) = test.scale_error.filter(|scale| is_off(scale, scale.value.abs() * span_deg)) {
        faults.push(turning(&scale));
    }
    if let Some(play) = test.play_deg.filter(|play| is_off(play, play.value.abs())) {
        faults.push(format!("{:.2} +- {:.2} degrees of play behind its reading", play.value, play.u95));
    }
    if let (Some(off_deg), Some(sd_deg)) = (test.axis_off_deg, test.axis_sd_deg)
        && off_deg > (SURE * sd_deg).max(NOTABLE_DEG)
    {
        let [x, _, z] = test.axis.unwrap_or_default().map(f64::to_degrees);
        faults.push(format!(
            "its axis lies {off_deg:.2} degrees off the sensor's y axis ({x:+.2} to x, {z:+.2} to z): the sensor does not sit square"
        ));
    }
    if let Some(left_deg) = test.left_over_deg.filter(|left_deg| *left_deg > NOTABLE_DEG) {
        faults.push(format!(
            "settings are off by {left_deg:.2} degrees (rms) that neither scale nor play explain"
        ));
    }
    faults
}

fn verdict(tests: &[StandTest]) -> &'static str {
    if tests.iter().any(|test| !faults(test).is_empty()) {
        "differs"
    } else if tests.iter().all(|test| test.scale_error.is_some()) {
        "as_measured"
    } else {
        "cannot_tell"
    }
}

fn words(test: &StandTest) -> String {
    let told = test.settings.iter().filter(|found| found.error_deg.is_some()).count();
    let faults = faults(test);
    if !faults.is_empty() {
        return format!("{}: {}", test.sensor, faults.join("; "));
    }
    match test.scale_error {
        Some(_) => format!("{}: does as it measures, as far as {} settings can tell", test.sensor, told + 1),
        None if test.settings.len() < 4 => format!(
            "{}: cannot tell from {} settings that held for {:.1} s or more: four are needed",
            test.sensor,
            test.settings.len(),
            (SETTLE_NS + LEAST_HELD_NS) as f64 * 1e-9
        ),
        None => {
            let why = test.settings.iter().find_map(|found| found.cannot_tell.as_deref());
            format!("{}: {}", test.sensor, why.unwrap_or("cannot tell here"))
        }
    }
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    for (words, test) in document.words.iter().zip(&document.sensors) {
        let _ = writeln!(text, "{words}");
        for found in &test.settings {
            let _ =
                writeln!(text, "  {:+8.3} deg {:<10}  {}", found.measured_deg, reached(found), beside(found));
        }
        let _ = writeln!(text, "  scale     1 {}", output::estimate(test.scale_error, 4));
        let _ = writeln!(text, "  play      {} deg", output::estimate(test.play_deg, 3));
        if let (Some([x, y, z]), Some(off_deg), Some(sd_deg)) =
            (test.axis, test.axis_off_deg, test.axis_sd_deg)
        {
            let _ = writeln!(
                text,
                "  axis      ({x:.4}, {y:.4}, {z:.4}) in the sensor, {off_deg:.3} deg off its y, sd {sd_deg:.3}"
            );
        }
    }
    text
}

fn reached(found: &FoundSetting) -> &'static str {
    match found.reached {
        None => "first",
        Some(Reached::FromBelow) => "from below",
        Some(Reached::FromAbove) => "from above",
    }
}

fn beside(found: &FoundSetting) -> String {
    match (&found.error_deg, &found.cannot_tell) {
        _ if found.is_reference => "the reference".into(),
        (Some(error), _) => format!("{} deg beside it", output::estimate(Some(*error), 3)),
        (None, why) => why.clone().unwrap_or_else(|| "cannot tell here".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sensor_that_does_not_turn_hangs_on_no_gear() {
        for (factor, said) in [(0.0, "does not turn with this axis"), (1.03, "wrong gear or scale")] {
            let scale = Estimate { value: factor - 1.0, sd: 1e-4, u95: 2e-4, p_value: 0.0 };
            assert!(turning(&scale).contains(said), "{}", turning(&scale));
        }
    }
}
