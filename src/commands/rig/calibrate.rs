//! `outrigger rig calibrate`: what each servo really does, from a recording of a rig that does not move.

use std::path::Path;

use anyhow::{Context as _, ensure};
use serde::Serialize;

use crate::commands::stage::Stage;
use crate::commands::{Context, Outcome, output, stage};
use crate::recording::mounted::{MountedFrame, MountedRecording, MountedSpec};
use crate::recording::{FramePitch, RecordingSpec, Session};
use crate::report::{Report, values};
use crate::verify::calibrate::{FoundSetting, Hold, Reached, Setting, StandTest, holds, stand_test};

/// The document that it prints.
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

/// Measures and prints.
pub(super) fn run(session: &Path, mount: Option<&Path>, context: Context) -> anyhow::Result<Outcome> {
    let start = std::time::Instant::now();
    let name = session.display();
    std::fs::metadata(session).with_context(|| name.to_string())?;
    ensure!(
        Session::is_session(session),
        "{name} is no session: the angles of the axes are in none but those"
    );
    // no zeros: turns alone do not tell them
    let (path, observer) = (session.to_owned(), stage::observer());
    let recording = RecordingSpec { path, observer, ..Default::default() };
    let mount = mount.map(Path::to_owned);
    let recorded = MountedRecording::open(&MountedSpec { recording, mount, ..Default::default() })?;
    let reports = recorded.servo()?;
    ensure!(
        reports.iter().any(|report| report.source == "measured"),
        "{name}: the session holds no angle that an axis measured, and this test is about those{}",
        recorded.notices.iter().map(|notice| format!("; {notice}")).collect::<String>()
    );
    let mut sensors = recorded.rig.sensors.clone();
    let mut holds: Vec<Vec<Hold>> = (0..sensors.len()).map(|axis| holds(&reports, axis)).collect();
    let summary = recorded.feed(&mut |mounted| {
        let MountedFrame { sensor, model, frame, .. } = mounted;
        mounted.tell_model(&mut sensors);
        let [first_ns, last_ns] = frame.host_time_ns;
        let hold = holds[sensor].iter_mut().find(|hold| hold.from_ns <= first_ns && last_ns <= hold.to_ns);
        if let Some(hold) = hold {
            hold.rays.add_frame(sensor, model, &FramePitch::constant(hold.measured_rad), 0, frame);
        }
    })?;
    let revolution_ns = if summary.revolution_ns > 0 { summary.revolution_ns } else { 100_000_000 };
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
    let whole = summary.losses.is_empty();
    let problems = recorded.notices.iter().cloned().chain(summary.losses).collect();
    let document = Document {
        format: "outrigger-stand/1",
        verdict: StandTest::verdict(&tests),
        words: tests.iter().map(StandTest::words).collect(),
        sensors: tests,
        problems,
        wall_s: start.elapsed().as_secs_f64(),
    };
    output::print_result(context.json, &document, &report(&document), &document.problems)?;
    Ok(if document.verdict == "as_measured" && whole { Outcome::Done } else { Outcome::DataLost })
}

fn report(document: &Document) -> Report {
    let mut report = Report::new("Settings of a servo in a still scene", "");
    for (words, test) in document.words.iter().zip(&document.sensors) {
        report.heading("");
        report.note(words);
        let row = |found: &FoundSetting| {
            vec![format!("{:+.3}", found.measured_deg), reached(found).to_owned(), difference(found)]
        };
        report.table(&["measured, deg", "reached", "seen"], test.settings.iter().map(row).collect());
        report.figure("scale", format!("1 {}", values::estimate(test.scale_error, 4)));
        report.figure("play", format!("{} deg", values::estimate(test.play_deg, 3)));
        let axis = test.axis.zip(test.axis_off_deg).zip(test.axis_sd_deg);
        report.figures(axis.map(|(([x, y, z], off_deg), sd_deg)| {
            let off = format!("{off_deg:.3} deg off its y, sd {sd_deg:.3}");
            ("axis", format!("({x:.4}, {y:.4}, {z:.4}) in the sensor, {off}"))
        }));
    }
    report
}

fn reached(found: &FoundSetting) -> &'static str {
    match found.reached {
        None => "first",
        Some(Reached::FromBelow) => "from below",
        Some(Reached::FromAbove) => "from above",
    }
}

fn difference(found: &FoundSetting) -> String {
    match (&found.error_deg, &found.cannot_tell) {
        _ if found.is_reference => "the reference".into(),
        (Some(error), _) => format!("{} deg off it", values::estimate(Some(*error), 3)),
        (None, why) => why.clone().unwrap_or_else(|| "cannot tell here".into()),
    }
}
