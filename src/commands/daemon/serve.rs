//! The daemon's start, run and end.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};
use tokio::sync::watch;

use super::logging::{conclude, say_panics, start_log};
use super::settings::{settings, token};
use super::{Args, service};
use crate::commands::signals::StopRequests;
use crate::commands::{Context, Outcome, output};
use crate::daemon::{Daemon, Ending, Log, Settings, Supervision, Web, WebSettings};
use crate::live::config::Config;

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
    let stop_requests =
        runtime.block_on(async { StopRequests::new() }).context("signals cannot be caught")?;
    let daemon = Arc::new(Daemon::start(settings)?);
    let ending = runtime.block_on(serve(web, Arc::clone(&daemon), stop_requests, context));
    runtime.shutdown_timeout(Duration::from_secs(1)); // a thread may still wait for a stdout without a reader
    Ok(conclude(&ending?))
}

async fn serve(
    web: Web,
    daemon: Arc<Daemon>,
    mut stop_requests: StopRequests,
    context: Context,
) -> anyhow::Result<Ending> {
    let address = web.address();
    let (stop, stopped) = watch::channel(false);
    let mut serving = tokio::spawn(web.serve(Arc::clone(&daemon), stopped));
    announce(&daemon, address, context).await;
    service::ready(&format!("http://{address}/"));
    let watchdog = tokio::spawn(service::feed_watchdog(Arc::clone(&daemon)));
    let served = tokio::select! {
        () = stop_requests.next() => None,
        served = &mut serving => Some(served),
        death = daemon.death() => {
            tracing::error!(event = "component_dead", "the daemon ends: {death}");
            None
        }
    };
    service::stopping();
    tokio::spawn(async move {
        stop_requests.next().await;
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
            bail!("the page ended without an order");
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
                    "name": sensor.name, "address": sensor.address, "address_aside": sensor.auxiliary_address,
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
