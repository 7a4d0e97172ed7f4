//! From the files and flags of `mount` to what is drawn.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::Args;
use crate::base::files;
use crate::commands::ensure_consistent;
use crate::rig::{Extrinsics, FramedSensor, MountFile, Servos, draw, scad, urdf, yaml};

/// Where no flag says how far a servo turns, degrees.
const LIMITS_DEG: [f64; 2] = [-90.0, 90.0];

/// The mount file that the files are or describe, and what is odd about them.
pub(super) fn read(args: &Args) -> anyhow::Result<(MountFile, Vec<String>)> {
    let mut extrinsics = Extrinsics::default();
    for path in &args.files {
        match Extrinsics::read(path)? {
            Some(found) => extrinsics.add(found),
            None if args.files.len() > 1 => refuse!("{} is a mount file: give it alone", path.display()),
            None => return Ok((MountFile::read(path)?, Vec::new())),
        }
    }
    let models: Vec<(Option<String>, String)> = args
        .sensor
        .iter()
        .filter_map(|choice| Some((choice.sensor.clone(), choice.model.clone()?)))
        .collect();
    let names = args.files.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    extrinsics.mount_file(&models).with_context(|| names)
}

/// Which sensors servos turn, and how far.
pub(super) fn servos(
    args: &Args,
    sensors: &[FramedSensor],
    problems: &mut Vec<String>,
) -> anyhow::Result<Servos> {
    let all: Vec<&str> = sensors.iter().map(|sensor| sensor.mounted.name.as_str()).collect();
    let turned: Vec<&str> = match &args.sensors {
        None => all.clone(),
        Some(names) => names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect(),
    };
    let unknown = turned.iter().find(|name| !all.contains(name));
    let (name, given, servos) = (unknown.unwrap_or(&""), args.limits_deg.len(), turned.len());
    ensure_consistent([
        (unknown.is_some(), format!("--sensors: no sensor is called {name:?}; there are {}", all.join(", "))),
        (
            given > 1 && given != servos,
            format!("{given} --limits-deg for {servos} servos: give one for each, or one for all"),
        ),
    ])?;
    let limits = |axis: usize| {
        let given = args.limits_deg.get(axis).or(args.limits_deg.first());
        given.map_or(LIMITS_DEG, |(low, high)| [*low, *high])
    };
    let mut limits_deg = Vec::new();
    for sensor in sensors {
        let axis = turned.iter().position(|name| *name == sensor.mounted.name);
        let of_axis = axis.map(limits);
        let pitch_deg = sensor.mounted.mount.pitch_rad.to_degrees();
        if let Some([low, high]) =
            of_axis.filter(|[low, high]| pitch_deg < low - 1e-9 || pitch_deg > high + 1e-9)
        {
            problems.push(format!(
                "{}: its pitch of {pitch_deg:.1} degrees lies outside the servo's limits, {low} to {high}",
                sensor.mounted.name
            ));
        }
        limits_deg.push(of_axis);
    }
    Ok(Servos { limits_deg })
}

/// The files that were asked for, before any is written.
pub(super) fn drawn<'a>(
    args: &'a Args,
    sensors: &[FramedSensor],
    servos: &Servos,
) -> Vec<(&'a PathBuf, String)> {
    let title =
        args.files[0].file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let mut files = Vec::new();
    if !args.drawing.is_empty() {
        let sheet = draw(&title, sensors);
        for path in &args.drawing {
            let is_dxf = files::ending(path) == "dxf";
            files.push((path, if is_dxf { sheet.dxf() } else { sheet.svg() }));
        }
    }
    let name = Path::new(&title).file_stem().map_or_else(|| "rig".into(), |stem| stem.to_string_lossy());
    files.extend(args.urdf.as_ref().map(|path| (path, urdf(&name, sensors, servos))));
    files.extend(args.tf.as_ref().map(|path| (path, yaml(sensors))));
    files.extend(args.scad.as_ref().map(|path| (path, scad(sensors))));
    files
}
