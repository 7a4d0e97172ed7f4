//! The sampling of beams along a trajectory.

pub(crate) mod baselines;
pub mod column;
pub mod detection;
pub mod fan;
pub mod frames;
pub(crate) mod ideal;
pub mod occluder;
pub(crate) mod prediction;
pub mod published;
pub mod quality;
pub(crate) mod rounds;
pub mod scan;
pub mod sweep;
pub mod view;
pub(crate) mod walk;

/// Progress of a long computation, for whoever shows it.
pub(crate) enum Progress {
    /// There is so much to do from here on.
    Total(u64),
    /// So much more is done.
    Done(u64),
    /// So much is done in all.
    At(u64),
}
