//! The daemon over HTTP: a page for people, REST and a WebSocket for programs, metrics for Prometheus.
//!
//! What comes in is checked in this order: time and size of a request, number of requests in progress (stops of the rig go
//! first and need no slot), the `Host` it asks for (a name that points here by DNS tricks is refused), the page it comes
//! from (`Origin`), the rate, the token. Nothing in a request names a file.

mod api;
mod doors;
mod foxglove;
mod guard;
mod metrics;
mod page;
mod page_files;
mod refusal;
mod server;
mod stream;

pub use guard::Token;

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::middleware;
use tokio::sync::watch;

use super::Daemon;
use guard::Guard;

/// Where and for whom to serve.
#[derive(Clone, Debug)]
pub struct WebSettings {
    /// Local address and port; port 0 takes any free one.
    pub listen: SocketAddr,
    /// What a request must know; needed for any address but loopback.
    pub token: Option<Token>,
    /// Host names by which this machine may be asked for, besides its addresses and `localhost`.
    pub host_names: Vec<String>,
    /// Other sites with pages that may connect as Foxglove clients: `https://app.foxglove.dev`.
    pub listeners: Vec<String>,
}

/// Why nothing can be served.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The address cannot be had.
    #[error("the page cannot listen on {address}: {source}{hint}")]
    Bind {
        /// Where.
        address: SocketAddr,
        /// What to try, or nothing.
        hint: &'static str,
        /// Why.
        source: std::io::Error,
    },
    /// Anybody could move the rig.
    #[error(
        "the page on {0} could be reached from other machines: give it a token of at least 16 letters \
         (--token-file, or OUTRIGGER_DAEMON_TOKEN), or listen on 127.0.0.1"
    )]
    NeedsToken(SocketAddr),
}

/// A bound server.
#[derive(Debug)]
pub struct Web {
    listener: TcpListener,
    address: SocketAddr,
    settings: WebSettings,
}

/// What every handler has.
#[derive(Clone)]
struct App {
    daemon: Arc<Daemon>,
    guard: Arc<Guard>,
    streams: Arc<stream::Streams>,
}

impl Web {
    /// Takes the address, before anything else is started.
    pub(crate) fn bind(settings: WebSettings) -> Result<Self, WebError> {
        let address = settings.listen;
        if !address.ip().is_loopback() && settings.token.is_none() {
            return Err(WebError::NeedsToken(address));
        }
        let wrong = |source: std::io::Error| WebError::Bind {
            address,
            hint: match source.kind() {
                std::io::ErrorKind::AddrInUse => {
                    " (another daemon, or another program, already listens there)"
                }
                std::io::ErrorKind::AddrNotAvailable => {
                    " (no network interface of this host has that address)"
                }
                _ => "",
            },
            source,
        };
        let listener = TcpListener::bind(address).map_err(wrong)?;
        listener.set_nonblocking(true).map_err(wrong)?;
        let address = listener.local_addr().map_err(wrong)?;
        Ok(Self { listener, address, settings })
    }

    /// Where it listens, with the port in use.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `stop` says true, then lets present requests end. Needs a tokio runtime.
    pub(crate) async fn serve(self, daemon: Arc<Daemon>, stop: watch::Receiver<bool>) -> std::io::Result<()> {
        let Self { listener, address, settings } = self;
        let guard = Arc::new(Guard::new(address, settings.token, settings.host_names, settings.listeners));
        let streams = Arc::new(stream::Streams::new(stop.clone()));
        let app = App { daemon, guard: Arc::clone(&guard), streams };
        let router = router(app);
        server::serve(listener, router, guard, stop).await
    }
}

fn router(app: App) -> Router {
    let guard = Arc::clone(&app.guard);
    api::routes()
        .merge(page::routes())
        .with_state(app)
        .layer(middleware::from_fn_with_state(guard, guard::check))
        .layer(middleware::from_fn(deadline))
}

/// Longest time for one request: a move of the rig and its retries.
const REQUEST: Duration = Duration::from_secs(90);

async fn deadline(request: axum::extract::Request, next: middleware::Next) -> axum::response::Response {
    use axum::response::IntoResponse as _;
    match tokio::time::timeout(REQUEST, next.run(request)).await {
        Ok(response) => response,
        Err(_) => {
            refusal::Refusal::new(axum::http::StatusCode::REQUEST_TIMEOUT, "it took too long").into_response()
        }
    }
}
