//! Who may ask for what: hosts, origins, rates, tokens. (Own rate limit: `governor` stores every address without a bound.)

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use axum::Extension;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;

use super::doors::Origin;
use super::page_files::FILES;
use super::refusal::Refusal;

/// Requests that an address may make at once, and per second from then on.
const BURST: f64 = 200.0;
const PER_SECOND: f64 = 50.0;
/// What a wrong token costs of that.
const WRONG_TOKEN: f64 = 20.0;
/// Addresses with a counter of their own.
const ADDRESSES: usize = 1024;
/// Letters of the shortest token.
const SHORTEST_TOKEN: usize = 16;
/// Cookie that a browser keeps the token in.
pub(super) const COOKIE: &str = "outrigger_token";
/// What stops the rig is never held up.
pub(super) const STOPS: [&str; 2] = ["/api/v1/rig/hold", "/api/v1/rig/e-stop"];
/// Where pages of other sites may listen, if they were named.
const FOXGLOVE: &str = "/api/v1/foxglove";
/// Paths that need no token, besides the page itself, while tokens are typed: they disclose nothing.
const OPEN: [&str; 2] = ["/healthz", "/api/v1/login"];

fn is_open(path: &str) -> bool {
    OPEN.contains(&path) || FILES.iter().any(|(file, ..)| *file == path)
}

/// The other end of a connection.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peer(pub SocketAddr);

/// A secret that requests must know. Only its hash is stored.
#[derive(Clone)]
pub struct Token([u8; 32]);

impl std::fmt::Debug for Token {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Token")
    }
}

impl Token {
    /// From its text, without spaces around it; short ones and such with other than visible letters are refused.
    pub(crate) fn new(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.len() < SHORTEST_TOKEN || !text.bytes().all(|byte| byte.is_ascii_graphic() && byte != b';') {
            return Err(format!(
                "a token needs at least {SHORTEST_TOKEN} visible ASCII letters, and no semicolon"
            ));
        }
        Ok(Self(Sha256::digest(text).into()))
    }

    /// Whether a text is the token; takes as long for a nearly right one as for a wrong one.
    pub(crate) fn is(&self, text: &str) -> bool {
        let other: [u8; 32] = Sha256::digest(text).into();
        self.0.ct_eq(&other).into()
    }
}

/// All checks with their state.
pub(super) struct Guard {
    address: SocketAddr,
    token: Option<Token>,
    host_names: Vec<String>,
    listeners: Vec<String>,
    buckets: Mutex<HashMap<Origin, (f64, Instant)>>,
}

impl Guard {
    pub(crate) fn new(
        address: SocketAddr,
        token: Option<Token>,
        host_names: Vec<String>,
        listeners: Vec<String>,
    ) -> Self {
        Self { address, token, host_names, listeners, buckets: Mutex::default() }
    }

    /// Whether the page has to ask for a token.
    pub(crate) fn needs_token(&self) -> bool {
        self.token.is_some()
    }

    /// Whether a text is the token.
    pub(crate) fn knows(&self, text: &str) -> bool {
        self.token.as_ref().is_none_or(|token| token.is(text))
    }

    /// Whether a request shows the token, where one is set.
    pub(crate) fn shows_token(&self, headers: &HeaderMap) -> bool {
        let token = self.token.as_ref();
        token.is_some_and(|token| presented(headers).is_some_and(|text| token.is(text)))
    }

    /// A wrong token makes the next requests wait.
    pub(crate) fn punish(&self, peer: IpAddr) {
        self.take(peer, WRONG_TOKEN, Instant::now());
    }

    /// Whether a request may pass; why not.
    fn check(&self, method: &Method, path: &str, headers: &HeaderMap, peer: IpAddr) -> Result<(), Refusal> {
        let host = self.host(headers)?;
        if !self.is_listener(method, path, headers) {
            self.origin(method, headers, &host)?;
        }
        if !STOPS.contains(&path) && !self.take(peer, 1.0, Instant::now()) {
            return Err(Refusal::new(StatusCode::TOO_MANY_REQUESTS, "too many requests from this address"));
        }
        let Some(token) = self.token.as_ref().filter(|_| !is_open(path)) else { return Ok(()) };
        let known = presented(headers).is_some_and(|text| token.is(text));
        if !known {
            if presented(headers).is_some() {
                self.punish(peer);
            }
            return Err(Refusal::new(StatusCode::UNAUTHORIZED, "this needs the daemon's token"));
        }
        Ok(())
    }

    /// The host that is asked for: an address, or a name that is this machine's for sure.
    fn host(&self, headers: &HeaderMap) -> Result<String, Refusal> {
        let refuse = |why: &str| Err(Refusal::new(StatusCode::MISDIRECTED_REQUEST, why));
        let Some(host) = one(headers, header::HOST) else { return refuse("no Host, or several") };
        let name = without_port(host);
        let known = match name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>() {
            Ok(ip) => ip.is_loopback() || !self.address.ip().is_loopback(),
            Err(_) => {
                name.eq_ignore_ascii_case("localhost")
                    || self.host_names.iter().any(|known| known.eq_ignore_ascii_case(name))
            }
        };
        if known { Ok(host.to_ascii_lowercase()) } else { refuse("this host is not served under that name") }
    }

    /// A page of a site that was named, which wants to listen and nothing else.
    fn is_listener(&self, method: &Method, path: &str, headers: &HeaderMap) -> bool {
        let origin = one(headers, header::ORIGIN);
        let named = |origin: &str| self.listeners.iter().any(|known| known.eq_ignore_ascii_case(origin));
        *method == Method::GET && path == FOXGLOVE && origin.is_some_and(named)
    }

    /// Whoever changes something or opens a stream comes from no page, or from the page of this very host.
    fn origin(&self, method: &Method, headers: &HeaderMap, host: &str) -> Result<(), Refusal> {
        let refuse = || Err(Refusal::new(StatusCode::FORBIDDEN, "requests from other sites are refused"));
        if let Some(site) = headers.get("sec-fetch-site") {
            let harmless =
                *method == Method::GET && headers.get("sec-fetch-mode").is_some_and(|m| m == "navigate");
            if !harmless && site != "same-origin" && site != "none" {
                return refuse();
            }
        }
        if headers.get(header::ORIGIN).is_none() {
            return Ok(());
        }
        let Some(origin) = one(headers, header::ORIGIN) else { return refuse() };
        let from = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
        if from.is_some_and(|from| from.eq_ignore_ascii_case(host)) { Ok(()) } else { refuse() }
    }

    /// Takes from an address' bucket; false when it is empty.
    fn take(&self, peer: IpAddr, cost: f64, now: Instant) -> bool {
        let peer = Origin::of(peer);
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if buckets.len() >= ADDRESSES && !buckets.contains_key(&peer) {
            // the longest silent one has most of its requests back
            let oldest = buckets.iter().min_by_key(|(_, (_, since))| *since).map(|(oldest, _)| *oldest);
            oldest.map(|oldest| buckets.remove(&oldest));
        }
        let (left, since) = buckets.entry(peer).or_insert((BURST, now));
        let filled = *left + PER_SECOND * now.saturating_duration_since(*since).as_secs_f64();
        *since = now;
        *left = filled.min(BURST);
        let enough = *left >= 1.0;
        *left = (*left - cost).max(if enough { -BURST } else { *left });
        enough
    }
}

/// The middleware: checks, then adds what browsers are to heed.
pub(super) async fn check(
    State(guard): State<Arc<Guard>>,
    Extension(Peer(peer)): Extension<Peer>,
    request: Request,
    next: Next,
) -> Response {
    let allowed = guard.check(request.method(), request.uri().path(), request.headers(), peer.ip());
    let mut response = match allowed {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (
            header::CONTENT_SECURITY_POLICY,
            "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'self'",
        ),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_FRAME_OPTIONS, "DENY"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// The token that a request shows: `Authorization: Bearer`, or the page's cookie.
fn presented(headers: &HeaderMap) -> Option<&str> {
    if let Some(authorization) = one(headers, header::AUTHORIZATION) {
        return authorization.strip_prefix("Bearer ").map(str::trim);
    }
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let pair =
        |pair: &'_ str| pair.trim().split_once('=').map(|(name, value)| (name.to_owned(), value.len()));
    let mut found = None;
    for cookie in cookies.flat_map(|cookies| cookies.split(';')) {
        if let Some((name, length)) = pair(cookie)
            && name == COOKIE
        {
            found = cookie.get(cookie.len() - length..);
        }
    }
    found
}

/// The value of a header that comes once and is text.
fn one(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    let mut values = headers.get_all(name).iter();
    let first = values.next()?;
    if values.next().is_some() { None } else { first.to_str().ok() }
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) && !name.ends_with(':') => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const SECRET: &str = "correct-horse-battery";

    fn guard(listen: &str, token: bool) -> Guard {
        let token = token.then(|| Token::new(SECRET).unwrap());
        let listeners = vec!["https://app.foxglove.dev".into()];
        Guard::new(listen.parse().unwrap(), token, vec!["rover.lan".into()], listeners)
    }

    fn check(guard: &Guard, method: Method, path: &str, headers: &[(&str, &str)]) -> u16 {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(name.parse::<header::HeaderName>().unwrap(), value.parse().unwrap());
        }
        let outcome = guard.check(&method, path, &map, [10, 0, 0, 9].into());
        outcome.map_or_else(|problem| problem.into_response().status().as_u16(), |()| 200)
    }

    #[test]
    fn names_that_point_here_by_tricks_are_refused() {
        let local = guard("127.0.0.1:8750", false);
        for (host, code) in [
            ("127.0.0.1:8750", 200),
            ("localhost:8750", 200),
            ("LOCALHOST", 200),
            ("[::1]:8750", 200),
            ("rover.lan:8750", 200),
            ("evil.example:8750", 421),
            ("127.0.0.1.evil.example", 421),
            ("192.168.1.5:8750", 421),
            ("localhost:8750:1", 421),
            ("", 421),
        ] {
            assert_eq!(check(&local, Method::GET, "/", &[("host", host)]), code, "{host}");
        }
        assert_eq!(check(&local, Method::GET, "/", &[]), 421);
        assert_eq!(check(&local, Method::GET, "/", &[("host", "localhost"), ("host", "localhost")]), 421);
        assert_eq!(check(&guard("0.0.0.0:1", true), Method::GET, "/", &[("host", "192.168.1.5:1")]), 200);
    }

    #[test]
    fn other_sites_may_not_act() {
        let local = guard("127.0.0.1:8750", false);
        let host = ("host", "127.0.0.1:8750");
        let post = |more: &[(&str, &str)]| {
            let headers: Vec<_> = std::iter::once(host).chain(more.iter().copied()).collect();
            check(&local, Method::POST, "/api/v1/rig/arm", &headers)
        };
        assert_eq!(post(&[]), 200, "a program");
        assert_eq!(post(&[("origin", "http://127.0.0.1:8750"), ("sec-fetch-site", "same-origin")]), 200);
        assert_eq!(post(&[("origin", "http://127.0.0.1:9999")]), 403, "another port is another site");
        assert_eq!(post(&[("origin", "null")]), 403);
        assert_eq!(post(&[("origin", "http://evil.example")]), 403);
        assert_eq!(post(&[("sec-fetch-site", "cross-site")]), 403);
        let stream = [host, ("origin", "http://evil.example"), ("upgrade", "websocket")];
        assert_eq!(check(&local, Method::GET, "/api/v1/stream", &stream), 403, "nor listen");
        let link = [host, ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
        assert_eq!(check(&local, Method::GET, "/", &link), 200, "a link leads here");
        let named = [host, ("origin", "https://app.foxglove.dev"), ("sec-fetch-site", "cross-site")];
        assert_eq!(check(&local, Method::GET, FOXGLOVE, &named), 200, "a site that was named may listen");
        assert_eq!(check(&local, Method::GET, "/api/v1/stream", &named), 403, "there only");
        assert_eq!(check(&local, Method::POST, "/api/v1/rig/arm", &named), 403, "and do nothing");
        let other = [host, ("origin", "https://app.foxglove.dev.evil.example")];
        assert_eq!(check(&local, Method::GET, FOXGLOVE, &other), 403);
    }

    #[test]
    fn the_token_opens_what_is_not_open() {
        let guard = guard("0.0.0.0:8750", true);
        let host = ("host", "10.0.0.1:8750");
        let bearer = format!("Bearer {SECRET}");
        let cookie = format!("a=b; {COOKIE}={SECRET}; c=d");
        for (path, headers, code) in [
            ("/", vec![host], 200),
            ("/healthz", vec![host], 200),
            ("/api/v1/status", vec![host], 401),
            ("/metrics", vec![host], 401),
            ("/api/v1/rig/e-stop", vec![host], 401),
            ("/api/v1/status", vec![host, ("authorization", bearer.as_str())], 200),
            ("/api/v1/status", vec![host, ("cookie", cookie.as_str())], 200),
            ("/api/v1/status", vec![host, ("cookie", "outrigger_token=wrong")], 401),
            ("/api/v1/status", vec![host, ("authorization", "Basic x")], 401),
        ] {
            assert_eq!(check(&guard, Method::GET, path, &headers), code, "{path} {headers:?}");
        }
        assert!(Token::new("short").is_err() && Token::new("letters with spaces in it").is_err());
    }

    #[test]
    fn too_many_requests_wait_and_stops_do_not() {
        let guard = guard("127.0.0.1:1", false);
        let (peer, now) = ([10, 0, 0, 9].into(), Instant::now());
        let passed = (0..1000).filter(|_| guard.take(peer, 1.0, now)).count();
        assert_eq!(passed, BURST as usize);
        assert!(guard.take([10, 0, 0, 10].into(), 1.0, now), "another address has its own");
        let others = (0..2 * ADDRESSES as u32).map(|at| IpAddr::from((0x0a01_0000 + at).to_be_bytes()));
        let later = now + Duration::from_millis(1);
        assert!(others.clone().all(|other| guard.take(other, 1.0, later)), "many shut out no other");
        assert_eq!(guard.buckets.lock().unwrap().len(), ADDRESSES);
        guard.buckets.lock().unwrap().clear();
        assert!((0..1000).any(|_| !guard.take(peer, 1.0, now)));
        assert!(guard.take(peer, 1.0, now + Duration::from_millis(100)));
        for _ in 0..1000 {
            guard.take(peer, 1.0, Instant::now());
        }
        assert_eq!(check(&guard, Method::GET, "/", &[("host", "localhost")]), 429);
        assert_eq!(check(&guard, Method::POST, STOPS[1], &[("host", "localhost")]), 200);
    }
}
