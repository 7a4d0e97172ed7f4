//! `outrigger mount`: a mount as data, as a drawing, as URDF, tf and OpenSCAD; and extrinsics read back into a mount file.

mod reading;

use std::path::PathBuf;

use anyhow::Context as _;

use super::{Context, Outcome, output};
use crate::base::files;
use crate::report::mount::report;
use crate::rig::{UnitChoice, describe, framed};
use reading::{drawn, read, servos};

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
    #[arg(long, value_name = "FILE.svg|FILE.dxf", value_parser = drawing, help_heading = "Output")]
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
    let document = describe(&file, &sensors, &servos, problems, written);
    output::print_result(context.json, &document, &report(&document), &document.problems)?;
    let can_be_built = document.conflicts.touching.is_empty() && document.conflicts.violations.is_empty();
    Ok(if can_be_built { Outcome::Done } else { Outcome::DataLost })
}

fn limits(text: &str) -> Result<(f64, f64), String> {
    let wrong = || "expected LOW,HIGH in degrees, LOW below HIGH, within -360 to 360".to_owned();
    let (low, high) = text.split_once(',').ok_or_else(wrong)?;
    let number =
        |text: &str| text.trim().parse().ok().filter(|angle: &f64| angle.abs() <= 360.0).ok_or_else(wrong);
    let (low, high) = (number(low)?, number(high)?);
    if low < high { Ok((low, high)) } else { Err(wrong()) }
}

fn drawing(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match files::ending(&path).as_str() {
        "svg" | "dxf" => Ok(path),
        _ => Err("expected a name that ends in .svg or .dxf".into()),
    }
}
