//! The daemon's start, run and end.

use std::net::SocketAddr;
use std::os::fd::AsFd as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use tokio::sync::watch;

use super::surroundings::place;
use super::{Args, LogFormat, service};
use crate::commands::defaults::section;
use crate::commands::signals::Wishes;
use crate::commands::{Context, Outcome, Verb, output, record, rig};
use crate::daemon::{
    Daemon, Ending, Log, RecorderSettings, RigSettings, SensorSettings, Settings, Supervision, Token, Web,
    WebSettings, words,
};
use crate::live::config::Config;
use crate::live::receive;
use crate::rig::MountFile;

/// How long the last lines of the log may take: a reader that stands still holds up no end.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    let Some(config) = context.config else {
        refuse!("which sensors? --config RIG.toml (`outrigger init` writes one)");
    };
    let log = start_log(args)?;
    let supervision = Arc::new(Supervision::new(args.break_component.clone()));
    say_panics(&supervision);
    let ended = run_logged(args, config, context, &log, supervision);
    if !log.flush(LAST_WORDS) && ended.is_err() {
        std::process::exit(1); // the error cannot be written either
    }
    ended
}

fn run_logged(
    args: &Args,
    config: &'static Config,
    context: Context,
    log: &Log,
    supervision: Arc<Supervision>,
) -> anyhow::Result<Outcome> {
    let settings = Settings { supervision, log: Some(log.clone()), ..settings(args, config, context)? };
    let web = Web::bind(WebSettings {
        listen: args.listen,
        token: token(args)?,
        host_names: args.host_name.clone(),
        listeners: args.foxglove_origin.clone(),
    })?;
    crate::base::files::ensure_descriptors()?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .thread_name("web")
        .enable_all()
        .build()
        .context("no runtime")?;
    // before anything is opened: a signal that comes early is not lost
    let wishes = runtime.block_on(async { Wishes::new() }).context("signals cannot be caught")?;
    let daemon = Arc::new(Daemon::start(settings)?);
    let ending = runtime.block_on(serve(web, Arc::clone(&daemon), wishes, context));
    runtime.shutdown_timeout(Duration::from_secs(1)); // a thread may still wait for a stdout without a reader
    Ok(conclude(&ending?))
}

async fn serve(
    web: Web,
    daemon: Arc<Daemon>,
    mut wishes: Wishes,
    context: Context,
) -> anyhow::Result<Ending> {
    let address = web.address();
    let (stop, stopped) = watch::channel(false);
    let mut serving = tokio::spawn(web.serve(Arc::clone(&daemon), stopped));
    announce(&daemon, address, context).await;
    service::ready(&format!("http://{address}/"));
    let watchdog = tokio::spawn(service::feed_watchdog(Arc::clone(&daemon)));
    let served = tokio::select! {
        () = wishes.next() => None,
        served = &mut serving => Some(served),
        death = daemon.death() => {
            tracing::error!(event = "component_dead", "the daemon ends: {death}");
            None
        }
    };
    service::stopping();
    tokio::spawn(async move {
        wishes.next().await;
        std::process::exit(130); // who asks twice does not want to wait for a disk
    });
    // data first: the page may wait
    let ending =
        tokio::task::spawn_blocking(move || daemon.stop()).await.context("the daemon did not end")?;
    watchdog.abort();
    stop.send_replace(true);
    match served {
        Some(served) => {
            served.context("the page broke")??;
            bail!("the page ended though nobody had told it to");
        }
        None => serving.await.context("the page broke")??,
    }
    Ok(ending)
}

/// Says where the page is once everything runs. A stdout that takes nothing is no reason to stop, nor to wait.
async fn announce(daemon: &Daemon, address: SocketAddr, context: Context) {
    let mut states = daemon.states();
    let _ = states.changed().await; // the supervision reports what died meanwhile
    let status = states.borrow().clone();
    tracing::info!("the page is at http://{address}/");
    for sensor in &status.sensors {
        if let Some(address) = sensor.address {
            tracing::info!(sensor = sensor.name, "listening on {address}");
        }
    }
    let line = if context.json {
        let sensors: Vec<_> = status
            .sensors
            .iter()
            .map(|sensor| {
                serde_json::json!({
                    "name": sensor.name, "address": sensor.address, "address_aside": sensor.address_aside,
                })
            })
            .collect();
        let url = format!("http://{address}/");
        format!("{:#}\n", serde_json::json!({ "url": url, "sensors": sensors }))
    } else {
        format!("http://{address}/\n")
    };
    tokio::task::spawn_blocking(move || {
        if let Err(error) = output::print_text(&line) {
            tracing::warn!("{error:#}");
        }
    });
}

fn conclude(ending: &Ending) -> Outcome {
    let recorder = &ending.recorder;
    match &recorder.last {
        Some(last) if last.packets == 0 => tracing::warn!(
            sessions = recorder.sessions,
            "the last session has no packets: nothing came from any sensor; {}",
            last.dir.display()
        ),
        Some(last) => tracing::info!(
            sessions = recorder.sessions,
            lost = recorder.lost,
            "the last session is {}",
            last.dir.display()
        ),
        None => tracing::info!("nothing was recorded"),
    }
    if !ending.deaths.is_empty() {
        tracing::error!("the daemon ended in order after a part of it died: {}", ending.deaths.join("; "));
        return Outcome::Defect;
    }
    if ending.data_lost { Outcome::DataLost } else { Outcome::Done }
}

fn settings(args: &Args, config: &'static Config, context: Context) -> anyhow::Result<Settings> {
    let sensors: Vec<SensorSettings> = config
        .sensors
        .iter()
        .filter(|sensor| sensor.listen.is_some())
        .map(|sensor| {
            let lidar = sensor.streams().next();
            let metadata = lidar.map(|lidar| record::metadata_of(&lidar)).transpose()?.flatten();
            Ok(SensorSettings { config: sensor.clone(), metadata })
        })
        .collect::<anyhow::Result<_>>()?;
    if sensors.is_empty() {
        bail!("{}: no [[sensor]] has a `listen`", config.path.display());
    }
    if args.stop_below_mib > args.warn_below_mib {
        refuse!("--stop-below-mib {} is above --warn-below-mib {}", args.stop_below_mib, args.warn_below_mib);
    }
    let of_record: record::Args = section(config, &["record"], |verb| match verb {
        Verb::Record(args) => Some(args),
        _ => None,
    })?;
    let axes = rig::axes_of(config)?;
    let place = place(&args.place, &axes, context)?;
    let config_text = crate::base::files::read_text(&config.path)
        .with_context(|| format!("cannot read {}", config.path.display()))?;
    Ok(Settings {
        sensors,
        receive: receive::Options {
            receive_buffer_bytes: usize::from(of_record.receive_buffer) << 20,
            ..receive::Options::default()
        },
        recorder: RecorderSettings {
            folder: args.out.clone(),
            at_start: args.record,
            rotate_bytes: args.rotate_mib.map(|mib| mib << 20),
            rotate_after: args.rotate_minutes,
            warn_below_bytes: args.warn_below_mib << 20,
            stop_below_bytes: args.stop_below_mib << 20,
            held_up: Duration::from_millis(args.hold_up_writes_ms),
        },
        rig: rig_settings(args, config, place.mount.as_ref(), &axes)?,
        place,
        config: Some(config_text),
        supervision: Arc::default(),
        log: None,
    })
}

/// `axes` are the sensors that axis 0, 1, ... turn, where that is said.
fn rig_settings(
    args: &Args,
    config: &'static Config,
    mount: Option<&MountFile>,
    axes: &[String],
) -> anyhow::Result<Option<RigSettings>> {
    let of_rig: rig::Args = section(config, &["rig", "status"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    let Some(port) = of_rig.port.clone() else { return Ok(None) };
    let mount_pitches_deg = mount.map_or_else(Vec::new, |mount| mount.axis_pitches_deg(axes));
    let options = rig::options(&of_rig, mount_pitches_deg.len().max(2))?;
    Ok(Some(RigSettings { port, options, mount_pitches_deg, disarm_after: args.disarm_minutes }))
}

fn token(args: &Args) -> anyhow::Result<Option<Token>> {
    let text = match (&args.token_file, &args.token) {
        (Some(path), _) => {
            let text =
                crate::base::files::read_text(path).with_context(|| format!("token {}", path.display()))?;
            if let Some(warning) = open_to_others(path) {
                tracing::warn!(event = "token_readable", "{warning}");
            }
            Some((text, path.display().to_string()))
        }
        (None, Some(token)) => Some((token.clone(), "OUTRIGGER_DAEMON_TOKEN".into())),
        (None, None) => None,
    };
    text.map(|(text, name)| Token::new(&text).map_err(|reason| anyhow::anyhow!("{name}: {reason}")))
        .transpose()
}

/// What is wrong with a file of a token that others may read or replace.
fn open_to_others(path: &Path) -> Option<String> {
    let mode = std::fs::metadata(path).ok()?.permissions().mode() & 0o777;
    (mode & 0o077 != 0).then(|| {
        let path = path.display();
        format!(
            "the token file {path} has mode {mode:04o}: other users of this computer can use it; expected 0600: \
             chmod 600 {path}"
        )
    })
}

fn start_log(args: &Args) -> anyhow::Result<Log> {
    // not through the standard library's handle: its lock would be held by a write that waits
    let stderr = std::io::stderr().as_fd().try_clone_to_owned().context("stderr")?;
    let log = Log::start(std::fs::File::from(stderr)).context("no thread for the log")?;
    let writer = log.clone();
    let lines = tracing_subscriber::fmt()
        .with_writer(move || writer.clone())
        .with_ansi(false)
        .with_target(false)
        .with_max_level(args.log_level);
    // a program that has a log already keeps it
    let _ = match args.log_format {
        LogFormat::Text => lines.try_init(),
        LogFormat::Json => lines.json().flatten_event(true).try_init(),
    };
    Ok(log)
}

/// Panics go into the log, which nobody waits for, and to whoever watches the daemon's threads.
fn say_panics(supervision: &Arc<Supervision>) {
    let supervision = Arc::clone(supervision);
    std::panic::set_hook(Box::new(move |panic| {
        let thread = std::thread::current().name().unwrap_or("unnamed").to_owned();
        let place = panic.location().map(ToString::to_string).unwrap_or_default();
        let what = words(panic.payload());
        tracing::error!(event = "panic", thread, "a defect of the program: panicked at {place}: {what}");
        supervision.panicked(&thread, &format!("{what} ({place})"));
    }));
}
