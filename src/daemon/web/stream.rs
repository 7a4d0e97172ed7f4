//! The WebSocket: states as text, points and cells as bytes. A page that is too slow misses points, never holds one up.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::{Message, Utf8Bytes, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use futures_util::stream::SplitSink;
use futures_util::{SinkExt as _, StreamExt as _};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::watch;

use super::App;
use super::doors::{Origin, STREAMS, Slot, Slots};
use super::guard::Peer;
use super::refusal::Refusal;
use super::server::stopped;
use crate::daemon::Daemon;

/// A page that takes nothing for so long is gone.
const PATIENCE: Duration = Duration::from_secs(5);
/// A page need not say anything; this is for what browsers answer to pings.
const MESSAGE_BYTES: usize = 4 << 10;
const PING: Duration = Duration::from_secs(10);
/// A state that is not followed by a newer one is sent again after this time.
const REPEAT: Duration = Duration::from_secs(1);

/// What all streams share.
pub(super) struct Streams {
    slots: Arc<Slots>,
    missed: AtomicU64,
    /// The newest state as text, with the moment that it is of: one for all pages.
    text: Mutex<Option<(Instant, Utf8Bytes)>>,
    stop: watch::Receiver<bool>,
}

impl Streams {
    pub(crate) fn new(stop: watch::Receiver<bool>) -> Self {
        let slots = Arc::new(Slots::new(STREAMS));
        Self { slots, missed: AtomicU64::new(0), text: Mutex::default(), stop }
    }

    /// A slot for one more, if there is one. Whoever may ask for a stream is known: by the token, or as of this machine.
    pub(crate) fn slot(&self, Peer(peer): Peer) -> Result<Slot, Refusal> {
        let slot = self.slots.take(Origin::of(peer.ip()), true);
        slot.ok_or_else(|| Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many pages are open"))
    }

    /// The state as a message.
    fn message(&self, daemon: &Daemon) -> Message {
        let as_of = daemon.states().borrow().as_of;
        let mut text = self.text.lock().unwrap_or_else(PoisonError::into_inner);
        let known = text.as_ref().filter(|(of, _)| *of == as_of && of.elapsed() < REPEAT);
        if let Some((_, known)) = known {
            return Message::Text(known.clone());
        }
        let status = daemon.status();
        let made = serde_json::to_string(&serde_json::json!({ "type": "status", "status": status }));
        let made = Utf8Bytes::from(made.unwrap_or_default()); // numbers and texts always serialize
        *text = Some((as_of, made.clone()));
        Message::Text(made)
    }

    /// Says true when the daemon ends.
    pub(crate) fn stop(&self) -> watch::Receiver<bool> {
        self.stop.clone()
    }

    /// So many messages were missed.
    pub(crate) fn miss(&self, messages: u64) {
        self.missed.fetch_add(messages, Ordering::Relaxed);
    }

    /// Messages that slow pages missed.
    pub(crate) fn missed(&self) -> u64 {
        self.missed.load(Ordering::Relaxed)
    }
}

/// Opens a stream.
pub(super) async fn open(
    State(app): State<App>,
    Extension(peer): Extension<Peer>,
    upgrade: WebSocketUpgrade,
) -> Response {
    accept(app, peer, upgrade, MESSAGE_BYTES, run)
}

/// Runs a stream in a slot of its client.
pub(super) fn accept<F: Future<Output = ()> + Send + 'static>(
    app: App,
    peer: Peer,
    upgrade: WebSocketUpgrade,
    message_bytes: usize,
    run: impl FnOnce(WebSocket, Arc<Daemon>, Arc<Streams>, Slot) -> F + Send + 'static,
) -> Response {
    let slot = match app.streams.slot(peer) {
        Ok(slot) => slot,
        Err(problem) => return problem.into_response(),
    };
    upgrade
        .max_message_size(message_bytes)
        .max_frame_size(message_bytes)
        .on_upgrade(move |socket| run(socket, app.daemon, app.streams, slot))
}

async fn run(socket: WebSocket, daemon: Arc<Daemon>, streams: Arc<Streams>, _slot: Slot) {
    let (mut sink, mut source) = socket.split();
    let mut states = daemon.states();
    let (cells, mut picture) = daemon.picture();
    let mut stop = streams.stop();
    let mut ping = tokio::time::interval(PING);
    // a state that does not change any more is sent all the same: its age does
    let mut repeat = tokio::time::interval(REPEAT);
    states.mark_changed();
    if send(&mut sink, Message::Binary(cells)).await.is_err() {
        return;
    }
    loop {
        let message = tokio::select! {
            () = stopped(&mut stop) => {
                let _ = send(&mut sink, Message::Close(None)).await; // it ends in any case
                break;
            }
            changed = states.changed() => match changed {
                Ok(()) => {
                    repeat.reset();
                    streams.message(&daemon)
                }
                Err(_) => break,
            },
            _ = repeat.tick() => streams.message(&daemon),
            message = picture.recv() => match message {
                Ok(bytes) => Message::Binary(bytes),
                Err(RecvError::Lagged(missed)) => {
                    streams.miss(missed);
                    continue;
                }
                Err(RecvError::Closed) => break,
            },
            message = source.next() => match message {
                Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                Some(Ok(_)) => continue, // a page has nothing to say here: commands are requests
            },
            _ = ping.tick() => Message::Ping(Default::default()),
        };
        if send(&mut sink, message).await.is_err() {
            break;
        }
    }
}

/// Hands over a message; an error when the other end takes none.
pub(super) async fn send(sink: &mut SplitSink<WebSocket, Message>, message: Message) -> Result<(), ()> {
    match tokio::time::timeout(PATIENCE, sink.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(()),
    }
}
