//! Predicted against recorded: three coverages by one line of code, and a class for every recorded ray.
//!
//! *Planned* is the optimal mount on the planned path. *As driven* is cast here, for exactly the columns that were
//! recorded, from the measured mounts and the recorded trajectory. *Recorded* is where the recorded rays end as
//! predicted: snapped to the prediction, so that noise, blur and wrong poses can only make it less. Planned against
//! as driven is execution error, as driven against recorded is model error; planned against recorded would mix them.

mod agreement;
mod classes;
mod conflicts;
mod faults;
mod intervals;
mod nulls;
mod ray_sample;
mod rays;
mod recorded_ray;
mod replaying;
mod surface;
mod time_offset;

pub use agreement::{Agreement, CellKinds, CoverageCounts, Table};
pub(crate) use agreement::{cell_kinds, surface_cells};
pub use classes::{Breakdown, INCIDENCE_BINS, RayClass, RayClasses, SECTORS};
pub use conflicts::{Conflicts, Found};
pub(crate) use faults::misread;
pub use intervals::PatchAgreement;
pub use nulls::{Calibration, Field, Healthy, NullTest};
pub(crate) use ray_sample::RaySample;
pub use rays::{Gate, Replay, Replayed};
pub use recorded_ray::{PlacedRay, RecordedRay, Thinning};
pub(crate) use replaying::{Replaying, ReplayingError, cover_planned, grid_over, seen_patches};
pub(crate) use surface::box_points;
pub use surface::{
    COVERED_WITHIN_M, PATCH_M, Patches, SurfaceAdder, SurfaceCovered, SurfaceShare, SurfaceTally,
};
pub use time_offset::{NoTimeOffset, TimeOffset, time_offset};
