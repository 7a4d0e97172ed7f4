//! The loop that accepts connections, and what becomes of each: its request is to be whole in time, stops go first.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, HeaderValue, Method, Request, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use futures_util::StreamExt as _;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpStream;
use tokio::sync::{Notify, Semaphore, watch};

use super::doors::{Doors, Origin, REQUESTS, Slots, Wait};
use super::guard::{Guard, Peer, STOPS};
use super::refusal::Refusal;

/// Longest time from the first byte of a request (or from the answer before) to the end of its headers.
const HEADERS: Duration = Duration::from_secs(2);
/// Longest time from there to the end of its body.
const BODY: Duration = Duration::from_secs(2);
/// Longest body of a request, bytes.
const BODY_BYTES: usize = 16 << 10;
/// Longest time for a client to take its answer.
const ANSWER: Duration = Duration::from_secs(10);
/// Longest headers, bytes.
const HEADER_BYTES: usize = 16 << 10;
/// Most headers.
const MAX_HEADERS: usize = 64;
/// Stops of one kind at once: they wait for the rig, which does the same for each.
const STOPS_AT_ONCE: usize = 32;
/// How long present requests may take to end when the daemon stops.
const FAREWELL: Duration = Duration::from_secs(2);
/// How much is read, and how long, of a body that was refused, so that its sender can read why.
const DRAIN_BYTES: usize = 1 << 20;
const DRAIN: Duration = Duration::from_secs(1);

/// What all connections share.
struct Hall {
    router: Router,
    guard: Arc<Guard>,
    doors: Arc<Doors>,
    slots: Arc<Slots>,
    /// One for each of [`STOPS`].
    stops: [Semaphore; STOPS.len()],
    stop: watch::Receiver<bool>,
}

/// Serves until `stop` says true.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    guard: Arc<Guard>,
    mut stop: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let hall = Arc::new(Hall {
        router,
        guard,
        doors: Arc::default(),
        slots: Arc::new(Slots::new(REQUESTS)),
        stops: std::array::from_fn(|_| Semaphore::new(STOPS_AT_ONCE)),
        stop: stop.clone(),
    });
    loop {
        let accepted = tokio::select! {
            biased;
            () = stopped(&mut stop) => break,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, peer)) => drop(tokio::spawn(connection(stream, Peer(peer), Arc::clone(&hall)))),
            Err(_) => {
                // out of file descriptors, or a connection that was gone at once: others still want to be served
                hall.doors.close_oldest();
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
        }
    }
    let until = Instant::now() + FAREWELL; // those that stay are cut off
    while Arc::strong_count(&hall) > 1 && Instant::now() < until {
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    Ok(())
}

/// Waits until the daemon ends.
pub(super) async fn stopped(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await; // a sender that is gone means the same
}

/// A connection between its requests: since when, and its place among those that wait.
struct Idle(Mutex<Option<(Instant, Wait)>>);

impl Idle {
    fn set(&self, wait: Option<Wait>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = wait.map(|wait| (Instant::now(), wait));
    }

    fn is_longer_than(&self, time: Duration) -> bool {
        let idle = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        idle.as_ref().is_some_and(|(since, _)| since.elapsed() > time)
    }
}

async fn connection(stream: TcpStream, peer: Peer, hall: Arc<Hall>) {
    let _ = stream.set_nodelay(true); // a socket that refuses works all the same
    let (origin, close) = (Origin::of(peer.0.ip()), Arc::new(Notify::new()));
    let idle = Arc::new(Idle(Mutex::default()));
    idle.set(Some(hall.doors.wait(origin, &close)));
    let mut stop = hall.stop.clone();
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .half_close(true) // who asked for a stop and went away gets it
        .header_read_timeout(HEADERS)
        .max_buf_size(HEADER_BYTES)
        .max_headers(MAX_HEADERS);
    let answering = {
        let (idle, close) = (Arc::clone(&idle), Arc::clone(&close));
        service_fn(move |request| {
            let (idle, close, hall) = (Arc::clone(&idle), Arc::clone(&close), Arc::clone(&hall));
            async move {
                let answer = hall.answer(request, peer, origin, &idle).await;
                // the client reads the answer and sends the next request as one that waits
                idle.set(Some(hall.doors.wait(origin, &close)));
                Ok::<_, Infallible>(answer)
            }
        })
    };
    let served = builder.serve_connection(TokioIo::new(stream), answering).with_upgrades();
    let mut served = std::pin::pin!(served);
    let mut look = tokio::time::interval(ANSWER / 10);
    loop {
        tokio::select! {
            _ = served.as_mut() => return, // a client that broke off
            () = close.notified() => return, // another one needs the room
            () = stopped(&mut stop) => {
                served.as_mut().graceful_shutdown();
                let _ = tokio::time::timeout(FAREWELL, served).await;
                return;
            }
            _ = look.tick() => {
                // hyper sees to headers; this is for who does not take an answer
                if idle.is_longer_than(ANSWER) {
                    return;
                }
            }
        }
    }
}

impl Hall {
    async fn answer(&self, request: Request<Incoming>, peer: Peer, origin: Origin, idle: &Idle) -> Response {
        let (mut parts, body) = request.into_parts();
        parts.extensions.insert(peer);
        let stop = STOPS.iter().position(|path| *path == parts.uri.path() && parts.method == Method::POST);
        if let Some(stop) = stop {
            idle.set(None);
            let Ok(_turn) = self.stops[stop].try_acquire() else {
                return refuse(
                    StatusCode::SERVICE_UNAVAILABLE,
                    "as many of these stops are in progress already",
                );
            };
            return self.route(Request::from_parts(parts, Body::empty())).await;
        }
        let body = match whole(&parts.headers, body).await {
            Ok(body) => body,
            Err(refusal) => return refusal,
        };
        idle.set(None);
        let is_known = origin == Origin::Here || self.guard.shows_token(&parts.headers);
        let Some(_slot) = self.slots.take(origin, is_known) else {
            let mut refusal = refuse(StatusCode::SERVICE_UNAVAILABLE, "too many requests are in progress");
            refusal.headers_mut().insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
            return refusal;
        };
        self.route(Request::from_parts(parts, body.into())).await
    }

    async fn route(&self, request: Request<Body>) -> Response {
        match TowerToHyperService::new(self.router.clone()).call(request).await {
            Ok(response) => response,
            Err(never) => match never {},
        }
    }
}

/// A body in time and within its limit; otherwise the answer.
async fn whole(headers: &HeaderMap, body: Incoming) -> Result<Bytes, Response> {
    let large = || refuse(StatusCode::PAYLOAD_TOO_LARGE, format!("a body has at most {BODY_BYTES} bytes"));
    let mut stream = Body::new(body).into_data_stream();
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok());
    if announced.is_some_and(|length| length.parse().map_or(true, |length: u64| length > BODY_BYTES as u64)) {
        // who waits to be asked for its body is not asked
        if !headers.contains_key(header::EXPECT) {
            tokio::spawn(tokio::time::timeout(DRAIN, async move {
                let mut read = 0;
                while let Some(Ok(bytes)) = stream.next().await {
                    read += bytes.len();
                    if read > DRAIN_BYTES {
                        break;
                    }
                }
            }));
        }
        return Err(large());
    }
    let reading = async {
        let mut bytes = Vec::new();
        while let Some(piece) = stream.next().await {
            let broken = |_| refuse(StatusCode::BAD_REQUEST, "the body broke off");
            bytes.extend_from_slice(&piece.map_err(broken)?);
            if bytes.len() > BODY_BYTES {
                return Err(large());
            }
        }
        Ok(bytes.into())
    };
    let late =
        |_| refuse(StatusCode::REQUEST_TIMEOUT, format!("the body did not come within {} s", BODY.as_secs()));
    tokio::time::timeout(BODY, reading).await.map_err(late)?
}

/// A refusal after which the connection ends.
fn refuse(code: StatusCode, words: impl Into<String>) -> Response {
    let mut response = Refusal::new(code, words).into_response();
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}
