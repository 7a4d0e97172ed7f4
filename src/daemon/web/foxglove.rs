//! A Foxglove WebSocket server: points of each sensor, the coverage, frames and the rig, to be looked at and nothing
//! else. Source: Foxglove WebSocket protocol v1 (subprotocol `foxglove.websocket.v1`; `foxglove.sdk.v1` says the same).

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use base64::Engine as _;
use futures_util::StreamExt as _;
use futures_util::stream::SplitSink;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::broadcast::error::RecvError;

use super::App;
use super::doors::Slot;
use super::guard::Peer;
use super::refusal::Refusal;
use super::server::stopped;
use super::stream::{Streams, accept, send};
use crate::daemon::hub::Wanted;
use crate::daemon::status::RigState;
use crate::daemon::{Daemon, Status};
use crate::live::receive::now_ns;
use crate::recording::export::{self, Cause, Kind, foxglove};

const PROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];
/// Longest message of a client: a list of subscriptions.
const MESSAGE_BYTES: usize = 64 << 10;
/// First byte of a message of a channel.
const MESSAGE_DATA: u8 = 1;
/// Frame of coverage and body.
const WORLD: &str = "world";
const FRAMES_EVERY: Duration = Duration::from_millis(100);
const CELLS_EVERY: Duration = Duration::from_secs(1);

/// What a channel carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Points(usize),
    Voxels,
    Frames,
    Joints,
    Rig,
}

struct Channel {
    content: Content,
    topic: String,
    kind: Option<Kind>,
}

/// Says yes to Foxglove's protocol.
pub(super) async fn open(
    State(app): State<App>,
    Extension(peer): Extension<Peer>,
    upgrade: WebSocketUpgrade,
) -> Response {
    let upgrade = upgrade.protocols(PROTOCOLS);
    if upgrade.selected_protocol().is_none() {
        let words = format!("this speaks the WebSocket protocol {}: ask for it", PROTOCOLS[0]);
        return Refusal::new(StatusCode::BAD_REQUEST, words).into_response();
    }
    accept(app, peer, upgrade, MESSAGE_BYTES, run)
}

/// One client with its subscriptions.
struct Client {
    daemon: Arc<Daemon>,
    channels: Vec<Channel>,
    sink: SplitSink<WebSocket, Message>,
    /// By place of the channel: the client's number for it.
    subscriptions: HashMap<usize, (u32, Option<Wanted>)>,
    cells_sent: Option<u64>,
}

async fn run(socket: WebSocket, daemon: Arc<Daemon>, streams: Arc<Streams>, _slot: Slot) {
    let (sink, mut source) = socket.split();
    let (mut states, mut poured, mut stop) = (daemon.states(), daemon.hub().listen(), streams.stop());
    let channels = channels(&daemon);
    let mut client = Client { daemon, channels, sink, subscriptions: HashMap::new(), cells_sent: None };
    let mut frames = tokio::time::interval(FRAMES_EVERY);
    let mut cells = tokio::time::interval(CELLS_EVERY);
    let mut going = client.greet().await;
    while going.is_ok() {
        going = tokio::select! {
            () = stopped(&mut stop) => {
                let _ = send(&mut client.sink, Message::Close(None)).await; // it ends in any case
                break;
            }
            message = source.next() => match message {
                Some(Ok(Message::Close(_)) | Err(_)) | None => break,
                Some(Ok(Message::Text(text))) => client.hear(&text).await,
                Some(Ok(_)) => Ok(()), // nothing can be published here
            },
            message = poured.recv() => match message {
                Ok(poured) => {
                    let content = Content::Points(poured.sensor);
                    client.put(content, poured.time_ns, || Ok(poured.message)).await
                }
                Err(RecvError::Lagged(missed)) => {
                    streams.miss(missed);
                    Ok(())
                }
                Err(RecvError::Closed) => break,
            },
            changed = states.changed() => match changed {
                Ok(()) => {
                    let status = client.daemon.status();
                    client.rig(&status).await
                }
                Err(_) => break,
            },
            _ = frames.tick() => client.frames().await,
            _ = cells.tick() => client.cells().await,
        };
    }
}

fn channels(daemon: &Daemon) -> Vec<Channel> {
    let points = daemon.hub().names().enumerate().map(|(sensor, name)| Channel {
        content: Content::Points(sensor),
        topic: export::topic(name, foxglove::POINTS.topic),
        kind: Some(foxglove::POINTS),
    });
    let of = |content, kind: Kind, topic: String| Channel { content, topic, kind: Some(kind) };
    let mut channels: Vec<Channel> = points.collect();
    channels.push(of(Content::Voxels, foxglove::VOXELS, export::topic("coverage", foxglove::VOXELS.topic)));
    channels.push(of(Content::Frames, foxglove::TRANSFORMS, format!("/{}", foxglove::TRANSFORMS.topic)));
    if daemon.rig_state().is_some() {
        channels.push(of(Content::Joints, foxglove::JOINTS, export::topic("rig", foxglove::JOINTS.topic)));
        channels.push(Channel { content: Content::Rig, topic: "/rig/state".into(), kind: None });
    }
    channels
}

impl Channel {
    /// As the protocol advertises it, under a number.
    fn advertised(&self, id: usize) -> Value {
        match &self.kind {
            Some(kind) => json!({
                "id": id, "topic": self.topic, "encoding": kind.encoding, "schemaName": kind.schema,
                "schema": base64::engine::general_purpose::STANDARD.encode((kind.schema_data)()),
                "schemaEncoding": kind.schema_encoding,
            }),
            None => json!({
                "id": id, "topic": self.topic, "encoding": "json", "schemaName": "outrigger.RigState",
                "schema": include_str!("../../report/web/rig_state.schema.json"), "schemaEncoding": "jsonschema",
            }),
        }
    }
}

/// What a client says that is understood here.
#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum ClientMessage {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        #[serde(rename = "subscriptionIds")]
        subscription_ids: Vec<u32>,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u64,
}

impl Client {
    async fn greet(&mut self) -> Result<(), ()> {
        let info = json!({
            "op": "serverInfo", "name": concat!("outrigger ", env!("CARGO_PKG_VERSION")), "capabilities": [],
            "metadata": {},
        });
        self.tell(&info).await?;
        // numbers begin at 1: some clients take 0 for none
        let channels: Vec<Value> =
            (1..).zip(&self.channels).map(|(id, channel)| channel.advertised(id)).collect();
        self.tell(&json!({ "op": "advertise", "channels": channels })).await
    }

    async fn tell(&mut self, message: &Value) -> Result<(), ()> {
        send(&mut self.sink, Message::Text(message.to_string().into())).await
    }

    async fn complain(&mut self, words: &str) -> Result<(), ()> {
        self.tell(&json!({ "op": "status", "level": 1, "message": words })).await
    }

    async fn hear(&mut self, text: &str) -> Result<(), ()> {
        match serde_json::from_str(text) {
            Ok(ClientMessage::Subscribe { subscriptions }) => {
                for subscription in subscriptions {
                    self.subscribe(&subscription).await?;
                }
                Ok(())
            }
            Ok(ClientMessage::Unsubscribe { subscription_ids }) => {
                self.subscriptions.retain(|_, (id, _)| !subscription_ids.contains(id));
                Ok(())
            }
            Err(error) => {
                self.complain(&format!("only subscribe and unsubscribe are understood here: {error}")).await
            }
        }
    }

    async fn subscribe(&mut self, wanted: &Subscription) -> Result<(), ()> {
        let place = usize::try_from(wanted.channel_id).ok().and_then(|id| id.checked_sub(1));
        let Some((place, channel)) = place.and_then(|place| Some((place, self.channels.get(place)?))) else {
            return self.complain(&format!("there is no channel {}", wanted.channel_id)).await;
        };
        let is_used = self.subscriptions.values().any(|(id, _)| *id == wanted.id);
        if is_used || self.subscriptions.contains_key(&place) {
            let words = format!(
                "channel {} is subscribed already, or number {} is in use",
                wanted.channel_id, wanted.id
            );
            return self.complain(&words).await;
        }
        let content = channel.content;
        let listens = match content {
            Content::Points(sensor) => Some(self.daemon.hub().want(sensor)),
            _ => None,
        };
        self.subscriptions.insert(place, (wanted.id, listens));
        match content {
            Content::Voxels => {
                self.cells_sent = None;
                self.cells().await
            }
            Content::Frames => self.frames().await,
            Content::Joints | Content::Rig => {
                let status = self.daemon.status();
                self.rig(&status).await
            }
            Content::Points(_) => Ok(()),
        }
    }

    fn is_wanted(&self, content: Content) -> Option<u32> {
        let place = self.channels.iter().position(|channel| channel.content == content)?;
        self.subscriptions.get(&place).map(|(id, _)| *id)
    }

    /// Sends a message on a channel, made only if it is subscribed.
    async fn put<T: AsRef<[u8]>>(
        &mut self,
        content: Content,
        time_ns: u64,
        message: impl FnOnce() -> Result<T, Cause>,
    ) -> Result<(), ()> {
        let Some(id) = self.is_wanted(content) else { return Ok(()) };
        let Ok(message) = message() else { return Ok(()) }; // a date after 2106 has no message
        let message = message.as_ref();
        let mut bytes = Vec::with_capacity(13 + message.len());
        bytes.push(MESSAGE_DATA);
        bytes.extend_from_slice(&id.to_le_bytes());
        bytes.extend_from_slice(&time_ns.to_le_bytes());
        bytes.extend_from_slice(message);
        send(&mut self.sink, Message::Binary(bytes.into())).await
    }

    async fn frames(&mut self) -> Result<(), ()> {
        let (daemon, time_ns) = (Arc::clone(&self.daemon), now_ns());
        self.put(Content::Frames, time_ns, || foxglove::transforms(time_ns, &daemon.transforms())).await
    }

    async fn cells(&mut self) -> Result<(), ()> {
        let version = self.daemon.coverage_version();
        if self.is_wanted(Content::Voxels).is_none() || self.cells_sent == Some(version) {
            return Ok(());
        }
        self.cells_sent = Some(version);
        let (daemon, time_ns) = (Arc::clone(&self.daemon), now_ns());
        let made = move || foxglove::voxels(time_ns, WORLD, &daemon.voxels());
        let made = tokio::task::spawn_blocking(made).await;
        self.put(Content::Voxels, time_ns, || made.unwrap_or_else(|panic| Err(panic.into()))).await
    }

    async fn rig(&mut self, status: &Status) -> Result<(), ()> {
        let Some(rig) = &status.rig else { return Ok(()) };
        self.put(Content::Joints, status.time_ns, || joints(status.time_ns, rig)).await?;
        self.put(Content::Rig, status.time_ns, || Ok(serde_json::to_vec(rig)?)).await
    }
}

/// Angles of the axes that are known: a message without an age has none that is stale.
fn joints(time_ns: u64, rig: &RigState) -> Result<Vec<u8>, Cause> {
    let axes = rig.status.iter().flat_map(|status| &status.axes).filter(|axis| axis.source != "stale");
    let axes: Vec<(String, f64)> =
        axes.map(|axis| (format!("axis_{}", axis.axis), axis.position_deg.to_radians())).collect();
    if axes.is_empty() {
        return Err("no angle is known now".into());
    }
    foxglove::joints(time_ns, &axes)
}
