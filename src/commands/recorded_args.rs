//! Which recording, and where its sensors sit.

use std::path::PathBuf;

use anyhow::ensure;

use super::sensor_args::SensorArgs;
use super::{Context, output};
use crate::base::files::is_same;
use crate::recording::mounted::{AxisZeros, MountedSpec};

/// Which recording, and where its sensors sit: the arguments that `compare`, `boresight` and `odometry` share.
#[derive(clap::Args, Debug, Default)]
pub struct RecordedArgs {
    /// Session folder, capture (pcap or pcapng; plain, gzip, zstd or lz4), bag (ROS 1, MCAP, db3, or the folder of one), or -
    /// for standard input.
    pub recording: PathBuf,
    #[command(flatten)]
    pub sensors: SensorArgs,
    /// Where the sensors sit; without it the session's own, and a single sensor level at the origin. A session's sensors are
    /// identified by name; those of a capture by their order: that of --meta, then of their first packets.
    #[arg(long, value_name = "FILE")]
    pub mount: Option<PathBuf>,
    /// What the angles that an axis measured lack, degrees, as `compare` found it for the axis of this sensor; once per
    /// sensor. Of the recording alone: the servo itself is not changed.
    #[arg(long = "axis-zero", value_name = "SENSOR=DEG", value_parser = axis_zero)]
    zeros_deg: Vec<(String, f64)>,
}

fn axis_zero(text: &str) -> Result<(String, f64), String> {
    let (sensor, degrees) = text.split_once('=').ok_or("expected SENSOR=DEG")?;
    let degrees: f64 = degrees.parse().map_err(|error| format!("{degrees:?}: {error}"))?;
    if degrees.is_nan() || degrees.abs() > 180.0 {
        return Err(format!("{degrees}: expected degrees within 180 of nothing"));
    }
    Ok((sensor.into(), degrees))
}

impl RecordedArgs {
    /// What is opened.
    pub(crate) fn spec(&self, context: Context) -> MountedSpec {
        MountedSpec {
            recording: self.sensors.of(context, &self.recording),
            mount: self.mount.clone(),
            zeros: AxisZeros(self.zeros_deg.clone()),
        }
    }

    /// Looks, before the work is done, whether the files that were asked for could be written, and are none that is read.
    pub(crate) fn check_places<'a>(
        &self,
        outs: impl IntoIterator<Item = &'a Option<PathBuf>> + Clone,
    ) -> anyhow::Result<()> {
        output::check_places(outs.clone())?;
        for out in outs.into_iter().flatten() {
            let metadata = self.sensors.meta.iter().map(|file| &file.path);
            let mut inputs = [&self.recording].into_iter().chain(&self.mount).chain(metadata);
            let is_read = inputs.any(|input| is_same(out, input));
            ensure!(!is_read, "{}: this file is read; write to another", out.display());
        }
        Ok(())
    }
}
