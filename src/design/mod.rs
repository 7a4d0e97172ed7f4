//! From what mounts see to the mount: objective, search methods, fidelity, robustness, registration quality.

pub mod registration;
pub mod objective;
pub mod robustness;
pub mod fidelity;
pub mod optimize;
pub mod reconfigure;
pub(crate) mod scene_search;
