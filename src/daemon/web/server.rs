//! The loop that accepts connections: so many at once, each with a time limit for its headers.

use std::convert::Infallible;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::AsyncWriteExt as _;
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use super::guard::Peer;

/// Connections at once.
const CONNECTIONS: usize = 64;
/// Longest time from the first byte of a request (or from the one before) to the end of its headers.
const HEADERS: Duration = Duration::from_secs(10);
/// Longest headers, bytes.
const HEADER_BYTES: usize = 16 << 10;
/// Most headers.
const MOST_HEADERS: usize = 64;
/// How long requests under way may take to end when the daemon stops.
const FAREWELL: Duration = Duration::from_secs(2);

const TOO_MANY: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\ncontent-length: 0\r\nretry-after: 1\r\nconnection: close\r\n\r\n";

/// Serves until `stop` says true.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    mut stop: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let seats = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let accepted = tokio::select! {
            biased;
            () = told(&mut stop) => break,
            accepted = listener.accept() => accepted,
        };
        let Ok((mut stream, peer)) = accepted else {
            // out of file descriptors, or a connection that was gone at once: others still want to be served
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        match Arc::clone(&seats).try_acquire_owned() {
            Ok(seat) => {
                let router = router.clone().layer(axum::Extension(Peer(peer)));
                tokio::spawn(connection(stream, router, seat, stop.clone()));
            }
            Err(_) => drop(stream.write_all(TOO_MANY).await), // who is refused may have gone
        }
    }
    let all = CONNECTIONS as u32;
    let _ = tokio::time::timeout(FAREWELL, seats.acquire_many(all)).await; // those that stay are cut off
    Ok(())
}

/// Waits until the daemon ends.
pub(super) async fn told(stop: &mut watch::Receiver<bool>) {
    let _ = stop.wait_for(|stop| *stop).await; // nobody left to tell means the same
}

async fn connection(
    stream: TcpStream,
    router: Router,
    seat: OwnedSemaphorePermit,
    mut stop: watch::Receiver<bool>,
) -> Result<(), Infallible> {
    let _ = stream.set_nodelay(true); // a socket that refuses works all the same
    let mut builder = http1::Builder::new();
    builder
        .timer(TokioTimer::new())
        .half_close(true) // who asked for a stop and went away gets it
        .header_read_timeout(HEADERS)
        .max_buf_size(HEADER_BYTES)
        .max_headers(MOST_HEADERS);
    let served =
        builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router)).with_upgrades();
    let mut served = std::pin::pin!(served);
    tokio::select! {
        _ = served.as_mut() => {} // a client that broke off
        () = told(&mut stop) => {
            served.as_mut().graceful_shutdown();
            let _ = tokio::time::timeout(FAREWELL, served).await;
        }
    }
    drop(seat);
    Ok(())
}
