//! Playing a recording on a page.

use std::net::TcpListener;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use sensors::router::{Router, Sensor};

use super::Args;
use crate::commands::output::say_notice;
use crate::commands::recording::Recording;
use crate::commands::{Context, Outcome, output, scene_args, sensor_ids, signals};
use crate::recording::Session;
use crate::recording::playback::{Placement, Player, Take, Tape, World};
use crate::report::viewer::{self, Heading};
use crate::rig::MountFile;
use crate::world::trajectory::Trajectory;

/// Positions of the trajectory on the page.
const TRACK: usize = 1000;

/// The document that `view` prints when the page is there.
#[derive(serde::Serialize)]
struct Document {
    format: &'static str,
    url: String,
}

/// What is played.
struct Reels {
    recording: Recording,
    mount: Option<MountFile>,
    world: Option<Arc<World>>,
}

impl Tape for Reels {
    fn router(&self) -> Result<Router, String> {
        self.recording.router().map_err(|error| format!("{error:#}"))
    }

    fn packets(&self, take: &mut Take<'_>) -> Result<(), String> {
        let mut is_enough = false;
        let ended = self.recording.each_packet_until(&mut |packet| {
            is_enough = take(packet) == ControlFlow::Break(());
            Ok(!is_enough)
        });
        match ended {
            Ok(ending) if !is_enough => ending.losses().into_iter().next().map_or(Ok(()), Err),
            Ok(_) => Ok(()),
            Err(error) => Err(format!("{error:#}")),
        }
    }

    fn name(&self, sensor: &Sensor, names: &mut Vec<String>) -> String {
        sensor_ids::next_id(sensor, names)
    }

    fn placement(&self, name: &str) -> Placement {
        let mut entries = self.mount.iter().flat_map(|mount| &mount.sensors);
        let entry = entries.find(|entry| entry.name == name);
        Placement {
            body_from_sensor: entry.map(|entry| entry.mount().body_from_sensor()),
            world: self.world.clone(),
        }
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    if !args.listen.ip().is_loopback() {
        refuse!(
            "--listen {}: expected an address of this host (127.0.0.1): the page has no password",
            args.listen
        );
    }
    let sensors = args.sensors.or_of(context, &args.recording);
    let recording = Recording::open_to_reread(&args.recording, &sensors)?.without_progress();
    let (mount, trajectory, source) = whereabouts(args)?;
    let world = trajectory.map(|trajectory| {
        let first = trajectory.stamped().next().map_or(glam::DVec3::ZERO, |(_, pose)| pose.translation_m);
        Arc::new(World { trajectory, origin_m: first.round() })
    });
    let heading = heading(&args.recording, world.as_deref(), source);
    let listener = TcpListener::bind(args.listen).with_context(|| {
        format!("{}: cannot be listened on; give another address with --listen", args.listen)
    })?;
    let url = format!("http://{}/", listener.local_addr()?);
    let player = Player::start(Box::new(Reels { recording, mount, world }));
    player.wait_for_first();
    let index = player.index(&[]);
    if index.is_whole && index.sensors.is_empty() {
        let why = index.problems.first().map_or(String::new(), |problem| format!(": {problem}"));
        anyhow::bail!(
            "{}: nothing of it was decoded{why}; `outrigger inspect` says what it holds",
            args.recording.display()
        );
    }
    let document = Document { format: "outrigger-view/1", url: url.clone() };
    output::print_result(context.json, &document, || format!("{url}\n"), &[])?;
    if !args.no_open && !open(&url) {
        say_notice("no browser could be started: open the address by hand");
    }
    let runtime = signals::runtime()?;
    runtime.block_on(async {
        let mut signals = signals::StopRequests::new()?;
        tokio::select! {
            served = viewer::serve(listener, Arc::clone(&player), heading) => served.map_err(anyhow::Error::from),
            () = signals.next() => Ok(()),
        }
    })?;
    player.stop();
    runtime.shutdown_timeout(Duration::from_millis(200));
    Ok(Outcome::Done)
}

/// Mounts and trajectory: as given, or the session's own; and what to call the trajectory.
fn whereabouts(args: &Args) -> anyhow::Result<(Option<MountFile>, Option<Trajectory>, Option<String>)> {
    let session = Session::is_session(&args.recording).then(|| Session::open(&args.recording)).transpose()?;
    let mount = match &args.mount {
        Some(path) => Some(MountFile::read(path)?),
        None => session.as_ref().map(Session::mount).transpose()?.flatten(),
    };
    let (trajectory, source) = match &args.trajectory {
        Some(path) => {
            let (trajectory, notes) = scene_args::read_trajectory(path, None)?;
            notes.iter().for_each(|note| say_notice(note));
            (Some(trajectory), Some(path.display().to_string()))
        }
        None => {
            let own = session.as_ref().map(Session::trajectory).transpose()?.flatten();
            let source = own.is_some().then(|| "trajectory of the session".to_owned());
            (own, source)
        }
    };
    Ok((mount, trajectory, source))
}

fn heading(recording: &Path, world: Option<&World>, source: Option<String>) -> Heading {
    let Some(world) = world else {
        return Heading { recording: recording.display().to_string(), ..Heading::default() };
    };
    let poses: Vec<_> = world.trajectory.stamped().collect();
    let step = poses.len().div_ceil(TRACK).max(1);
    let positions = poses
        .iter()
        .step_by(step)
        .map(|(_, pose)| (pose.translation_m - world.origin_m).as_vec3().to_array());
    Heading {
        recording: recording.display().to_string(),
        trajectory: source,
        track_m: positions.collect(),
        origin_m: world.origin_m.to_array(),
    }
}

/// Whether a browser was started.
fn open(url: &str) -> bool {
    let opener = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let started = Command::new(opener)
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    started.is_ok_and(|mut child| {
        std::thread::spawn(move || child.wait()); // no zombie
        true
    })
}
