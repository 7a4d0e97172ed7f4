//! Numerics and files that know nothing of LiDAR.

pub(crate) mod errors;
pub mod features;
pub mod files;
pub(crate) mod text;
pub(crate) mod times;
pub mod questions;
pub mod instructions;
pub mod statistics;
pub mod numbers;
pub mod rng;
pub mod geometry;
