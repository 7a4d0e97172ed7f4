//! The viewer of a recording: a page on loopback, its files embedded as they stand here.
//!
//! | path | answer |
//! |---|---|
//! | `/` and its files | the page |
//! | `/api/recording/KNOWN` | JSON: sensors, revolutions, problems; `3,5` leaves out the first 3 and 5 revolutions, `0` none |
//! | `/api/scene` | bytes: `u32` 1 for triangles, 2 for points, `u32` how many places follow, then `f32` x, y, z of each, m |
//! | `/api/points/FRAME/SENSOR/REVOLUTION` | bytes (`recording::playback::points`); FRAME: `sensor` or `world` |

use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::extract::{Path, Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{Json, Router};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use serde::Serialize;

use crate::recording::playback::{FrameOfPoints, Index, Player};

const FILES: [(&str, &str, &str); 5] = [
    ("/", "text/html; charset=utf-8", include_str!("viewer.html")),
    ("/viewer.css", "text/css; charset=utf-8", include_str!("viewer.css")),
    ("/viewer.js", "text/javascript; charset=utf-8", include_str!("viewer.js")),
    ("/limits.js", "text/javascript; charset=utf-8", include_str!("limits.js")),
    ("/cloud.js", "text/javascript; charset=utf-8", super::CLOUD),
];
/// Longest time for a request's headers.
const HEADERS: Duration = Duration::from_secs(5);

/// What the page gets once.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Heading {
    /// The recording, as it was typed.
    pub recording: String,
    /// The trajectory that puts points into the world, by name; none without.
    pub trajectory: Option<String>,
    /// Its positions, at most some hundred, m, from the origin below.
    pub track_m: Vec<[f32; 3]>,
    /// When it was there, s.
    pub track_time_s: Vec<f64>,
    /// Where it headed, rad.
    pub track_heading_rad: Vec<f32>,
    /// The recording in a command line.
    pub recording_words: String,
    /// Flags about its sensors, as typed.
    pub source_words: String,
    /// Flags about mount and trajectory, where these are files.
    pub mount_words: String,
    pub trajectory_words: String,
    /// The scene below the points; none without.
    pub scene: Option<String>,
    /// Subtracted from all positions of the world, m.
    pub origin_m: [f64; 3],
}

/// A scene below the points.
pub(crate) struct Ground {
    /// Whether the places are corners of triangles.
    pub is_surface: bool,
    /// From the origin of the heading, m.
    pub places_m: Vec<[f32; 3]>,
}

impl Ground {
    fn bytes(&self) -> Vec<u8> {
        let head = [if self.is_surface { 1 } else { 2 }, self.places_m.len() as u32];
        let mut bytes: Vec<u8> = head.iter().flat_map(|value| value.to_le_bytes()).collect();
        bytes.extend(self.places_m.iter().flatten().flat_map(|value| value.to_le_bytes()));
        bytes
    }
}

#[derive(Clone)]
struct Shown {
    player: Arc<Player>,
    heading: Arc<Heading>,
    ground: Option<Arc<Ground>>,
}

#[derive(Serialize)]
struct Document {
    format: &'static str,
    #[serde(flatten)]
    heading: Heading,
    #[serde(flatten)]
    index: Index,
}

/// Serves until the runtime ends.
///
/// # Errors
/// The listener cannot be used.
pub(crate) async fn serve(
    listener: TcpListener,
    player: Arc<Player>,
    heading: Heading,
    ground: Option<Ground>,
) -> std::io::Result<()> {
    let own = listener.local_addr()?;
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let files = FILES.iter().fold(Router::new(), |router, (path, kind, content)| {
        let headers = [(header::CONTENT_TYPE, *kind), (header::CACHE_CONTROL, "no-cache")];
        router.route(path, get(move || async move { (headers, *content).into_response() }))
    });
    let router = files
        .route("/api/recording/{known}", get(recording))
        .route("/api/scene", get(scene))
        .route("/api/points/{frame}/{sensor}/{revolution}", get(points))
        .layer(middleware::from_fn(move |request, next| only_here(own, request, next)))
        .with_state(Shown { player, heading: Arc::new(heading), ground: ground.map(Arc::new) });
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            tokio::time::sleep(Duration::from_millis(20)).await; // out of file descriptors
            continue;
        };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(
            http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEADERS)
                .serve_connection(TokioIo::new(stream), service),
        );
    }
}

/// Another site's page that calls itself this address is not answered (DNS rebinding).
async fn only_here(own: SocketAddr, request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let port = own.port();
    match [format!("{own}"), format!("localhost:{port}"), format!("127.0.0.1:{port}")]
        .iter()
        .any(|own| own == host)
    {
        true => next.run(request).await,
        false => {
            (StatusCode::FORBIDDEN, format!("this is {own}; the request is for {host:?}")).into_response()
        }
    }
}

async fn recording(State(shown): State<Shown>, Path(known): Path<String>) -> Response {
    let known: Vec<usize> = known.split(',').filter_map(|count| count.parse().ok()).collect();
    let index = shown.player.index(&known);
    Json(Document { format: "outrigger-view/1", heading: (*shown.heading).clone(), index }).into_response()
}

async fn scene(State(shown): State<Shown>) -> Response {
    let kind = [(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "no-store")];
    match shown.ground {
        Some(ground) => (kind, ground.bytes()).into_response(),
        None => (StatusCode::NOT_FOUND, "no scene was given (--scene)").into_response(),
    }
}

async fn points(
    State(shown): State<Shown>,
    Path((frame, sensor, revolution)): Path<(String, usize, usize)>,
) -> Response {
    let frame = match frame.as_str() {
        "sensor" => FrameOfPoints::Sensor,
        "world" if shown.heading.trajectory.is_some() => FrameOfPoints::World,
        other => {
            let words = format!("frame {other:?}: expected sensor, or world where a trajectory is given");
            return (StatusCode::BAD_REQUEST, words).into_response();
        }
    };
    let player = Arc::clone(&shown.player);
    let bytes = tokio::task::spawn_blocking(move || player.points((sensor, revolution), frame)).await;
    match bytes {
        Ok(Some(bytes)) => {
            let kind =
                [(header::CONTENT_TYPE, "application/octet-stream"), (header::CACHE_CONTROL, "no-store")];
            (kind, bytes.as_ref().clone()).into_response()
        }
        _ => {
            (StatusCode::NOT_FOUND, "there is no such revolution, or it could not be decoded").into_response()
        }
    }
}
