//! Which recording, and where its sensors sit.

use std::path::PathBuf;

use anyhow::ensure;

use super::axis_zeros::AxisZeros;
use crate::base::files::is_same;
use crate::commands::output;
use crate::commands::sensor_args::SensorArgs;

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
    #[command(flatten)]
    pub zeros: AxisZeros,
}

impl RecordedArgs {
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
