//! Predicted against recorded: three coverages by one line of code, and every recorded ray told apart.
//!
//! *Planned* is the optimal mount on the planned path. *As driven* is cast here, for exactly the columns that were
//! recorded, from the measured mounts and the recorded trajectory. *Recorded* is what the packets say. Planned against
//! as driven is execution error, as driven against recorded is model error; planned against recorded would mix them.

mod agreement;
mod rays;
mod tilt;

pub use agreement::{Agreement, CellKinds, CoverageCounts, Verdict, cell_kinds, surface_cells};
pub use rays::{RayClasses, Replay};
pub use tilt::TiltHistory;
