//! `outrigger mount`: a mount as data, as a drawing, as URDF, tf and OpenSCAD; and extrinsics read back into a mount file.

mod document;

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::{Context, Outcome, output};
use crate::base::files;
use crate::rig::{Extrinsics, FramedSensor, MountFile, Servos, UnitChoice, draw, framed, scad, urdf, yaml};
use document::{document, text};

/// Where no flag says how far a servo turns, degrees.
const LIMITS_DEG: [f64; 2] = [-90.0, 90.0];

const AFTER: &str = "\
FILE is a mount file, or says where sensors sit as other programs write it: URDF, tf as YAML (what `ros2 topic echo --once \
/tf_static` prints), 4x4 matrices as text or JSON (row by row, metres, base_link from sensor, x forward, y left, z up), Ouster \
metadata with an extrinsic, or Ouster's list of transforms. Several such files make one rig. --out writes the mount file.

The drawing has top, front and side in millimetres; as .dxf it is release 12 at full size. In URDF and tf, base_link is the \
platform's origin, and frames are named as drivers name them: NAME_os_sensor, NAME_os_lidar, NAME_os_imu, NAME_velodyne. A \
joint's position is the pitch of its sensor in radians: positive tips its top to the right.

Exit codes: 0 done, 1 failed, 2 usage, 3 the mount cannot be built as it is: housings touch.";

/// Arguments of `mount`.
#[derive(clap::Args, Debug)]
#[command(after_help = AFTER)]
pub struct Args {
    /// Mount file, or files with the extrinsics of sensors.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Another model or the calibration of a sensor (of every one without NAME=): a name of the catalogue, Ouster
    /// metadata (.json), Velodyne calibration (.xml, .yaml), or MODEL:FILE. May be given several times.
    #[arg(long, value_name = "[NAME=]MODEL", help_heading = "Input")]
    sensor: Vec<UnitChoice>,
    /// Names of the sensors that servos turn, on axis 0, 1, ...: all when not given, none when empty.
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Model")]
    sensors: Option<Vec<String>>,
    /// Limits of a servo in degrees, for URDF [default: -90,90]; once for every axis, or once for all.
    #[arg(long, value_name = "LOW,HIGH", value_parser = limits, allow_hyphen_values = true, help_heading = "Model")]
    limits_deg: Vec<(f64, f64)>,
    /// Write the mount file.
    #[arg(short, long, value_name = "FILE.json", help_heading = "Output")]
    out: Option<PathBuf>,
    /// Write a drawing, as SVG (A3) or DXF (release 12, full size) by its ending. May be given several times.
    #[arg(long, value_name = "FILE.svg|FILE.dxf", help_heading = "Output")]
    drawing: Vec<PathBuf>,
    /// Write URDF.
    #[arg(long, value_name = "FILE.urdf", help_heading = "Output")]
    urdf: Option<PathBuf>,
    /// Write the frames for tf as YAML, with lines for static_transform_publisher.
    #[arg(long, value_name = "FILE.yaml", help_heading = "Output")]
    tf: Option<PathBuf>,
    /// Write the housings for OpenSCAD.
    #[arg(long, value_name = "FILE.scad", help_heading = "Output")]
    scad: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: &Args, context: Context) -> anyhow::Result<Outcome> {
    for path in &args.drawing {
        if !["svg", "dxf"].contains(&files::ending(path).as_str()) {
            refuse!("--drawing {}: expected a name that ends in .svg or .dxf", path.display());
        }
    }
    if args.urdf.is_none() {
        context.ensure_not_typed(&["limits_deg"], "is about --urdf, which is not asked for")?;
    }
    let (mut file, mut problems) = read(args)?;
    for choice in &args.sensor {
        for entry in &mut file.sensors {
            if let Some(model) =
                choice.model.as_ref().filter(|_| choice.sensor.as_ref().is_none_or(|n| *n == entry.name))
            {
                entry.model.clone_from(model);
            }
        }
    }
    let units = file.units(&args.sensor)?;
    problems.extend(units.iter().filter_map(|unit| unit.notice.clone()));
    problems.extend(file.doubts());
    let sensors = framed(&file, &units).map_err(|reason| anyhow::anyhow!("{reason}"))?;
    let servos = servos(args, &sensors, &mut problems)?;
    let files = drawn(args, &sensors, &servos);
    let paths = files.iter().map(|(path, _)| Some((*path).clone())).chain([args.out.clone()]);
    output::check_places(&paths.collect::<Vec<_>>())?;
    let mut written = Vec::new();
    for (path, content) in files {
        files::write_whole(path, content.as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
        written.push(path.clone());
    }
    if let Some(path) = &args.out {
        file.write(path)?;
        written.push(path.clone());
    }
    let document = document(&file, &sensors, &servos, problems, written);
    output::print_result(context.json, &document, || text(&document), &document.problems)?;
    let can_be_built = document.conflicts.touching.is_empty() && document.conflicts.violations.is_empty();
    Ok(if can_be_built { Outcome::Done } else { Outcome::DataLost })
}

/// The mount file that the files are or describe, and what is odd about them.
fn read(args: &Args) -> anyhow::Result<(MountFile, Vec<String>)> {
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
fn servos(args: &Args, sensors: &[FramedSensor], problems: &mut Vec<String>) -> anyhow::Result<Servos> {
    let all: Vec<&str> = sensors.iter().map(|sensor| sensor.mounted.name.as_str()).collect();
    let turned: Vec<&str> = match &args.sensors {
        None => all.clone(),
        Some(names) => names.iter().map(String::as_str).filter(|name| !name.is_empty()).collect(),
    };
    if let Some(unknown) = turned.iter().find(|name| !all.contains(name)) {
        refuse!("--sensors: no sensor is called {unknown:?}; there are {}", all.join(", "));
    }
    if args.limits_deg.len() > 1 && args.limits_deg.len() != turned.len() {
        refuse!(
            "{} --limits-deg for {} servos: give one for each, or one for all",
            args.limits_deg.len(),
            turned.len()
        );
    }
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
fn drawn<'a>(args: &'a Args, sensors: &[FramedSensor], servos: &Servos) -> Vec<(&'a PathBuf, String)> {
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

fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || "expected LOW,HIGH in degrees, LOW below HIGH, within -360 to 360".to_owned();
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    let number =
        |text: &str| text.trim().parse().ok().filter(|angle: &f64| angle.abs() <= 360.0).ok_or_else(wrong);
    let (low, high) = (number(low)?, number(high)?);
    if low < high { Ok((low, high)) } else { Err(wrong()) }
}
