//! REST: the state, the recorder, the rig. Described by `src/web/openapi.json`.

use std::sync::Arc;

use axum::extract::rejection::JsonRejection;
use axum::extract::{FromRequest, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use serde::{Deserialize, Serialize};

use super::guard::{COOKIE, Peer};
use super::refusal::Refusal;
use super::{App, foxglove, metrics, stream};
use crate::daemon::rig::{RigCommandError, RigHost};
use crate::daemon::{Daemon, Proposal};

/// A daemon that has not looked at itself for so long hangs.
const HANGS: std::time::Duration = std::time::Duration::from_secs(5);
const OPENAPI: &str = include_str!("../../report/web/openapi.json");

/// Longest label of a recording.
const LABEL_LETTERS: usize = 80;

/// A body of JSON, or none at all for what needs nothing.
struct Body<T>(T);

impl<S: Send + Sync, T: serde::de::DeserializeOwned + Default> FromRequest<S> for Body<T> {
    type Rejection = Refusal;

    async fn from_request(request: Request, state: &S) -> Result<Self, Refusal> {
        let length = request.headers().get(header::CONTENT_LENGTH);
        let is_chunked = request.headers().contains_key(header::TRANSFER_ENCODING);
        if !is_chunked && length.is_none_or(|length| length == "0") {
            return Ok(Self(T::default()));
        }
        let body = Json::<T>::from_request(request, state).await;
        body.map(|Json(body)| Self(body))
            .map_err(|error: JsonRejection| Refusal::new(error.status(), error.body_text()))
    }
}

/// A thing was done.
#[derive(Serialize)]
struct Done {
    done: bool,
}

const DONE: Json<Done> = Json(Done { done: true });

pub(super) fn routes() -> Router<App> {
    Router::new()
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .route("/api/v1/openapi.json", get(openapi))
        .route("/api/v1/login", post(login))
        .route("/api/v1/status", get(status))
        .route("/api/v1/stream", get(stream::open))
        .route("/api/v1/foxglove", get(foxglove::open))
        .route("/api/v1/recording/start", post(start))
        .route("/api/v1/recording/stop", post(stop))
        .route("/api/v1/reconfiguration/propose", post(propose))
        .route("/api/v1/reconfiguration/agree", post(agree))
        .route("/api/v1/rig/arm", post(|app: State<App>| rig(app, |rig| rig.arm(true))))
        .route("/api/v1/rig/disarm", post(|app: State<App>| rig(app, |rig| rig.arm(false))))
        .route("/api/v1/rig/home", post(|app: State<App>| rig(app, RigHost::home)))
        .route("/api/v1/rig/apply", post(apply))
        .route("/api/v1/rig/hold", post(|app: State<App>| rig(app, RigHost::hold)))
        .route("/api/v1/rig/e-stop", post(|app: State<App>| rig(app, RigHost::e_stop)))
        .route("/api/v1/rig/clear", post(|app: State<App>| rig(app, RigHost::clear)))
        .fallback(|| async { Refusal::new(StatusCode::NOT_FOUND, "there is nothing here") })
        .method_not_allowed_fallback(|| async {
            Refusal::new(StatusCode::METHOD_NOT_ALLOWED, "not that method")
        })
}

async fn health(State(app): State<App>) -> Response {
    let hangs = app.daemon.last_look() > HANGS;
    let code = if hangs { StatusCode::SERVICE_UNAVAILABLE } else { StatusCode::OK };
    (code, if hangs { "hangs\n" } else { "ok\n" }).into_response()
}

async fn metrics(State(app): State<App>) -> Response {
    let text = metrics::text(&app.daemon.status(), &app.daemon.picture_latency(), app.streams.missed());
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response()
}

async fn openapi() -> Response {
    ([(header::CONTENT_TYPE, "application/json")], OPENAPI).into_response()
}

async fn status(State(app): State<App>) -> Response {
    Json(app.daemon.status()).into_response()
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Login {
    #[serde(default)]
    token: String,
}

async fn login(
    State(app): State<App>,
    Extension(Peer(peer)): Extension<Peer>,
    Body(Login { token }): Body<Login>,
) -> Result<Response, Refusal> {
    if !app.guard.knows(token.trim()) {
        app.guard.punish(peer.ip());
        return Err(Refusal::new(StatusCode::UNAUTHORIZED, "that is not the daemon's token"));
    }
    let mut response = DONE.into_response();
    if app.guard.needs_token() {
        let cookie = format!("{COOKIE}={}; Path=/; HttpOnly; SameSite=Strict; Max-Age=2592000", token.trim());
        let cookie = HeaderValue::from_str(&cookie)
            .map_err(|_| Refusal::new(StatusCode::BAD_REQUEST, "a token is visible letters"))?;
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    Ok(response)
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Start {
    #[serde(default)]
    label: String,
}

async fn start(
    State(app): State<App>,
    Body(Start { label }): Body<Start>,
) -> Result<Json<serde_json::Value>, Refusal> {
    if label.chars().count() > LABEL_LETTERS || label.chars().any(char::is_control) {
        let words = format!("a label has at most {LABEL_LETTERS} letters, on one line");
        return Err(Refusal::new(StatusCode::BAD_REQUEST, words));
    }
    let session = blocking(app.daemon, move |daemon| daemon.begin_recording(label)).await??;
    Ok(Json(serde_json::json!({ "session": session })))
}

async fn stop(State(app): State<App>) -> Result<Response, Refusal> {
    let last = blocking(app.daemon, Daemon::end_recording).await??;
    Ok(Json(last).into_response())
}

async fn propose(State(app): State<App>) -> Result<Json<Proposal>, Refusal> {
    Ok(Json(blocking(app.daemon, Daemon::propose).await??))
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Agree {
    #[serde(default, deserialize_with = "whole")]
    id: u64,
}

/// Largest whole number that every JSON reader keeps exact.
const MAX_WHOLE: f64 = 9_007_199_254_740_991.0;

/// A whole number, which JSON may write as 7 or as 7.0.
fn whole<'de, D: serde::Deserializer<'de>>(source: D) -> Result<u64, D::Error> {
    let number = f64::deserialize(source)?;
    if (0.0..=MAX_WHOLE).contains(&number) && number.fract() == 0.0 {
        return Ok(number as u64);
    }
    Err(serde::de::Error::custom(format!("{number}: expected a whole number from 0 to {MAX_WHOLE}")))
}

async fn agree(State(app): State<App>, Body(Agree { id }): Body<Agree>) -> Result<Json<Proposal>, Refusal> {
    Ok(Json(blocking(app.daemon, move |daemon| daemon.agree(id)).await??))
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct Apply {
    pitches_deg: Option<Vec<f64>>,
}

async fn apply(app: State<App>, Body(Apply { pitches_deg }): Body<Apply>) -> Result<Response, Refusal> {
    rig(app, move |rig| match &pitches_deg {
        Some(pitches_deg) => rig.apply(pitches_deg),
        None => rig.apply_mount(),
    })
    .await
}

/// Lets the rig do something and answers with its state after that.
async fn rig(
    State(app): State<App>,
    work: impl FnOnce(&RigHost) -> Result<(), RigCommandError> + Send + 'static,
) -> Result<Response, Refusal> {
    let state = blocking(app.daemon, move |daemon| {
        work(daemon.rig()?)?;
        Ok::<_, RigCommandError>(daemon.rig_state())
    })
    .await??;
    Ok(Json(state).into_response())
}

/// Runs what waits for a device apart from the connections.
async fn blocking<T: Send + 'static>(
    daemon: Arc<Daemon>,
    work: impl FnOnce(&Daemon) -> T + Send + 'static,
) -> Result<T, Refusal> {
    let done = tokio::task::spawn_blocking(move || work(&daemon)).await;
    done.map_err(|_| Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, "a defect of the daemon: see its log"))
}

#[cfg(test)]
mod tests {
    /// Paths and methods in the source above are those of the document.
    #[test]
    fn the_document_describes_every_route() {
        let document: serde_json::Value = serde_json::from_str(super::OPENAPI).unwrap();
        let described: Vec<String> = document["paths"]
            .as_object()
            .unwrap()
            .iter()
            .flat_map(|(path, methods)| {
                methods.as_object().unwrap().keys().map(move |method| format!("{method} {path}"))
            })
            .collect();
        let source = include_str!("api.rs");
        let mut served: Vec<String> = source
            .lines()
            .filter_map(|line| line.trim().strip_prefix(".route(\""))
            .map(|line| {
                let (path, handler) = line.split_once("\", ").unwrap();
                format!("{} {path}", handler.split('(').next().unwrap())
            })
            .collect();
        served.sort_by(|a, b| a.split(' ').next_back().cmp(&b.split(' ').next_back()));
        let mut described = described;
        described.sort_by(|a, b| a.split(' ').next_back().cmp(&b.split(' ').next_back()));
        assert_eq!(served, described);
        assert!(served.len() > 10);
    }
}
