//! `outrigger mock sensor`: a sensor that measures a scene and sends real packets.

mod args;
mod build;
mod parse;

use std::io::Write as _;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::Context as _;

pub use self::args::Args;
use super::web::Web;
use crate::commands::{Context, Outcome, output, signals};
use crate::live::receive::now_ns;
use crate::mock::sensor::{Ended, MockSensor, Output, Sender, Surroundings};
use crate::mock::transmit::{Clock, Transmitter};

/// Time after Ctrl-C in which a packet may still be waited for.
const TO_END_WITHIN: Duration = Duration::from_secs(1);

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let mut sensor = build::sensor(args)?;
    let loaded = build::scene(args, context)?;
    let scene = loaded.scene;
    let mount = build::mount(args)?;
    let trajectory = loaded.origin.local_trajectory(build::trajectory(args)?);
    let [start_ns, end_ns] = trajectory.time_span_ns();
    let body_from_sensor = mount.body_from_sensor();
    let surroundings = Surroundings {
        scene: &scene,
        trajectory: &trajectory,
        body_from_sensor: &|_| body_from_sensor,
        noise_m: args.noise_m,
        seed: args.seed,
    };
    if let (Some(metadata), Some(path)) = (sensor.metadata(), &args.metadata) {
        std::fs::write(path, metadata.to_json()).with_context(|| format!("metadata {}", path.display()))?;
    }
    let transmitter = transmitter(args, start_ns)?;
    let web = Web::start(&args.web, &args.model, sensor.metadata(), args.to, args.aside_to)?;
    announce(args, &sensor, &transmitter, web.as_ref(), [start_ns, end_ns], context)?;
    let output = Output {
        transmitter,
        web: web.as_ref().map(Web::server),
        to: [Some(args.to), args.aside_to],
        sent: [0; 3],
        unreachable: None,
        on_unreachable: |to, error| output::say_notice(&format!("what is sent to {to} is lost: {error}")),
    };
    let mut sender = Sender {
        output,
        injector: build::injector(args),
        start_ns,
        silent_after_s: args.silent_after,
        die_after_s: args.die_after,
    };
    let stop = signals::stop_within(TO_END_WITHIN, "interrupted")?;
    let begun = Instant::now();
    let outcome = sensor.run_both(&surroundings, |time_ns, stream, payload| {
        if stop.load(Ordering::Relaxed) {
            Err(Ended::Interrupted)
        } else {
            sender.send(stream, time_ns, payload)
        }
    });
    let until_ns = match outcome {
        Err(Ended::Died) => return Ok(Outcome::Done),
        Err(Ended::Interrupted) => start_ns, // what is held back goes now
        Err(Ended::Unsent(error)) => return Err(error.into()),
        Ok(()) => end_ns,
    };
    let faults = sender.finish(until_ns)?;
    let seconds = begun.elapsed().as_secs_f64();
    let [packets, bytes, auxiliary] = sender.output.sent;
    let document = serde_json::json!({
        "sent_packets": packets, "sent_bytes": bytes, "sent_aside": auxiliary, "wall_s": seconds, "faults": faults
    });
    say(context, &document, || format!("sent {packets} packets, {bytes} bytes, in {seconds:.1} s"))?;
    Ok(Outcome::Done)
}

fn transmitter(args: &Args, start_ns: u64) -> anyhow::Result<Transmitter> {
    let clock = if args.on_time {
        let wait = Duration::from_nanos(start_ns.saturating_sub(now_ns()));
        Clock::new(args.rate, Some(start_ns)).starting_in(wait)
    } else {
        Clock::new(args.rate, None)
    };
    Transmitter::new(args.from, args.to, clock).with_context(|| {
        format!("cannot send from {}", args.from.map_or("any port".into(), |from| from.to_string()))
    })
}

fn announce(
    args: &Args,
    sensor: &MockSensor,
    transmitter: &Transmitter,
    web: Option<&Web>,
    time_span_ns: [u64; 2],
    context: Context,
) -> anyhow::Result<()> {
    let from = transmitter.local_addr().context("the socket has no address")?;
    let serial = sensor.metadata().map(|metadata| metadata.serial.clone());
    let written = sensor.metadata().and(args.metadata.as_ref());
    let document = serde_json::json!({
        "ready": true, "model": args.model.to_lowercase(), "serial": serial, "from": from, "to": args.to,
        "metadata": written, "time_span_ns": time_span_ns, "http": web.map(|web| web.server().address()),
    });
    say(context, &document, || {
        let metadata = written.map_or(String::new(), |path| format!(", metadata in {}", path.display()));
        let http = web.map_or(String::new(), |web| format!(", web interface at {}", web.server().address()));
        format!("{} sends from {from} to {}{metadata}{http}", args.model, args.to)
    })
}

/// One line on stdout.
fn say(context: Context, document: &serde_json::Value, text: impl FnOnce() -> String) -> anyhow::Result<()> {
    let line = if context.json { document.to_string() } else { text() };
    match writeln!(std::io::stdout(), "{line}").and_then(|()| std::io::stdout().flush()) {
        // a reader that went away is no reason to stop sending
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("stdout"),
        _ => Ok(()),
    }
}
