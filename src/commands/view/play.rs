//! Playing a recording on a page.

use std::net::TcpListener;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;

use super::Args;
use super::heading::{ground, heading};
use super::reels::Reels;
use crate::commands::output::say_notice;
use crate::commands::{Context, Outcome, output, scene_file, signals};
use crate::recording::playback::{Player, World};
use crate::recording::{Recording, Session};
use crate::report::{Report, viewer};
use crate::rig::MountFile;
use crate::world::scene::LoadedScene;
use crate::world::trajectory::Trajectory;

/// The document that `view` prints when the page is there.
#[derive(serde::Serialize)]
struct Document {
    format: &'static str,
    url: String,
}

/// Runs the verb.
pub(crate) fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let spec = args.sensors.or_of(context, &args.recording).reread();
    let recording = Recording::open(&spec.without_progress())?;
    let (mount, trajectory, source) = whereabouts(args)?;
    let scene = scene(args, context, trajectory.is_some())?;
    let world = trajectory.map(|trajectory| {
        let first = trajectory.stamped().next().map_or(glam::DVec3::ZERO, |(_, pose)| pose.translation_m);
        Arc::new(World { trajectory, origin_m: first.round() })
    });
    let heading = heading(args, world.as_deref(), source);
    let ground = scene.zip(world.as_deref()).map(|(scene, world)| ground(&scene, world));
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
    output::print_result(context.json, &document, &Report::new("A recording in the browser", &url), &[])?;
    if !args.no_open && !open(&url) {
        say_notice("no browser could be started: open the address by hand");
    }
    let runtime = signals::runtime()?;
    runtime.block_on(async {
        let mut signals = signals::StopRequests::new()?;
        tokio::select! {
            served = viewer::serve(listener, Arc::clone(&player), heading, ground) => served.map_err(anyhow::Error::from),
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
            let (trajectory, notes) = crate::recording::read_trajectory(path, None)?;
            notes.iter().for_each(|note| say_notice(note));
            (Some(trajectory), Some(path.display().to_string()))
        }
        None => {
            let own = session.as_ref().map(Session::trajectory).transpose()?.flatten();
            own.iter().flat_map(|own| &own.notes).for_each(|note| say_notice(note));
            let source = own.is_some().then(|| "trajectory of the session".to_owned());
            (own.map(|own| own.trajectory), source)
        }
    };
    Ok((mount, trajectory, source))
}

/// What lies under the points, read.
fn scene(args: &Args, context: Context, has_world: bool) -> anyhow::Result<Option<LoadedScene>> {
    let Some(path) = &args.scene else {
        scene_file::ensure_none_typed(context, "no --scene is given")?;
        return Ok(None);
    };
    if !has_world {
        refuse!("--scene {}: points are in the scene by a trajectory; add --trajectory FILE", path.display());
    }
    let loaded = scene_file::read(path, &args.mesh, &args.map, context)?;
    loaded.warnings.iter().for_each(|warning| say_notice(warning));
    Ok(Some(loaded))
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
