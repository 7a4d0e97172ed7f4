//! The WebSocket: states as text, points and cells as bytes. A page that is too slow misses points, never holds one up.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use futures_util::stream::SplitSink;
use futures_util::{SinkExt as _, StreamExt as _};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use super::App;
use super::refusal::Refusal;
use super::server::told;
use crate::daemon::{Daemon, Status};

/// Streams at once.
const STREAMS: usize = 16;
/// A page that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);
/// A page need not say anything; this is for what browsers answer to pings.
const MESSAGE_BYTES: usize = 4 << 10;
const PING: Duration = Duration::from_secs(10);

/// What all streams share.
pub(super) struct Streams {
    seats: Arc<Semaphore>,
    missed: AtomicU64,
    stop: watch::Receiver<bool>,
}

impl Streams {
    pub fn new(stop: watch::Receiver<bool>) -> Self {
        Self { seats: Arc::new(Semaphore::new(STREAMS)), missed: AtomicU64::new(0), stop }
    }

    /// A place for one more, if there is one.
    pub fn seat(&self) -> Result<OwnedSemaphorePermit, Refusal> {
        let seat = Arc::clone(&self.seats).try_acquire_owned();
        seat.map_err(|_| Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many pages are open"))
    }

    /// Says true when the daemon ends.
    pub fn stop(&self) -> watch::Receiver<bool> {
        self.stop.clone()
    }

    /// So many messages were missed.
    pub fn miss(&self, messages: u64) {
        self.missed.fetch_add(messages, Ordering::Relaxed);
    }

    /// Messages that slow pages missed.
    pub fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }
}

/// Opens a stream.
pub(super) async fn open(State(app): State<App>, upgrade: WebSocketUpgrade) -> Response {
    let seat = match app.streams.seat() {
        Ok(seat) => seat,
        Err(problem) => return problem.into_response(),
    };
    upgrade
        .max_message_size(MESSAGE_BYTES)
        .max_frame_size(MESSAGE_BYTES)
        .on_upgrade(move |socket| run(socket, app.daemon, app.streams, seat))
}

async fn run(socket: WebSocket, daemon: Arc<Daemon>, streams: Arc<Streams>, seat: OwnedSemaphorePermit) {
    let (mut sink, mut source) = socket.split();
    let mut states = daemon.states();
    let (cells, mut picture) = daemon.picture();
    drop(daemon);
    let mut stop = streams.stop();
    let mut ping = tokio::time::interval(PING);
    states.mark_changed();
    if send(&mut sink, Message::Binary(cells)).await.is_err() {
        return;
    }
    loop {
        let message = tokio::select! {
            () = told(&mut stop) => {
                let _ = send(&mut sink, Message::Close(None)).await; // it ends either way
                break;
            }
            changed = states.changed() => match changed {
                Ok(()) => text(&states.borrow_and_update().clone()),
                Err(_) => break,
            },
            message = picture.recv() => match message {
                Ok(bytes) => Message::Binary(bytes),
                Err(RecvError::Lagged(missed)) => {
                    streams.miss(missed);
                    continue;
                }
                Err(RecvError::Closed) => break,
            },
            said = source.next() => match said {
                Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                Some(Ok(_)) => continue, // a page has nothing to say here: commands are requests
            },
            _ = ping.tick() => Message::Ping(Default::default()),
        };
        if send(&mut sink, message).await.is_err() {
            break;
        }
    }
    drop(seat);
}

fn text(status: &Status) -> Message {
    let text = serde_json::to_string(&serde_json::json!({ "type": "status", "status": status }));
    Message::Text(text.unwrap_or_default().into()) // numbers and texts always serialize
}

/// Hands over a message; an error when the other end takes none.
pub(super) async fn send(sink: &mut SplitSink<WebSocket, Message>, message: Message) -> Result<(), ()> {
    match tokio::time::timeout(PATIENCE, sink.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}
