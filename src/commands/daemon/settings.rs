//! From flags and rig.toml to what the daemon runs by.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, bail};

use super::Args;
use super::surroundings::read_site;
use crate::commands::defaults::section;
use crate::commands::{Context, Verb, ensure_consistent, record, rig_args};
use crate::daemon::{RecorderSettings, RigSettings, SensorSettings, Settings, Token};
use crate::live::config::Config;
use crate::live::receive;
use crate::rig::MountFile;

pub(super) fn settings(args: &Args, config: &'static Config, context: Context) -> anyhow::Result<Settings> {
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
    let (stop, warn) = (args.stop_below_mib, args.warn_below_mib);
    let words = format!("--stop-below-mib {stop} is above --warn-below-mib {warn}");
    ensure_consistent([(stop > warn, words)])?;
    let of_record: record::Args = section(config, &["record"], |verb| match verb {
        Verb::Record(args) => Some(args),
        _ => None,
    })?;
    let axes = rig_args::axes_of(config)?;
    let site = read_site(&args.site, &axes, context)?;
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
        rig: rig_settings(args, config, site.mount.as_ref(), &axes)?,
        site,
        config: Some(config_text),
        supervision: Arc::default(),
        log: None,
    })
}

/// `axes` are the sensors that axis 0, 1, ... turn, where that is configured.
fn rig_settings(
    args: &Args,
    config: &'static Config,
    mount: Option<&MountFile>,
    axes: &[String],
) -> anyhow::Result<Option<RigSettings>> {
    let of_rig: rig_args::Args = section(config, &["rig", "status"], |verb| match verb {
        Verb::Rig(args) => Some(args),
        _ => None,
    })?;
    let Some(port) = of_rig.port.clone() else { return Ok(None) };
    let mount_pitches_deg = mount.map_or_else(Vec::new, |mount| mount.axis_pitches_deg(axes));
    let options = rig_args::options(&of_rig, mount_pitches_deg.len().max(2))?;
    Ok(Some(RigSettings { port, options, mount_pitches_deg, disarm_after: args.disarm_minutes }))
}

pub(super) fn token(args: &Args) -> anyhow::Result<Option<Token>> {
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
