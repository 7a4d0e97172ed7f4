//! What the threads of the picture share.

use std::sync::Arc;

use tokio::sync::broadcast;

use super::coverage::LiveCoverage;
use super::hub::Hub;
use super::journal::Journal;
use super::site::{Motion, Site};
use super::survey::Survey;

/// What live threads share.
#[derive(Clone)]
pub(super) struct Surroundings {
    pub site: Arc<Site>,
    pub motion: Arc<Motion>,
    pub coverage: Arc<LiveCoverage>,
    pub journal: Arc<Journal>,
    /// Messages to every page.
    pub pages: broadcast::Sender<axum::body::Bytes>,
    /// Foxglove clients.
    pub hub: Arc<Hub>,
    /// The map that proposals are made from.
    pub survey: Arc<Survey>,
}
