//! Who is refused, and that nonsense does no harm.

use std::os::unix::fs::PermissionsExt as _;

use super::program::{Bench, exchange, exchange_bytes};

const SECRET: &str = "correct-horse-battery";

pub fn unknown_hosts_and_origins_are_refused() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&[]);
    let address = daemon.address;
    let request = |line: &str, headers: &str| {
        exchange(address, &format!("{line} HTTP/1.1\r\nConnection: close\r\n{headers}\r\n")).0
    };
    let host = format!("Host: {address}\r\n");
    let port = address.port();
    assert_eq!(request("GET /api/v1/status", &host), 200);
    assert_eq!(
        request("GET /api/v1/status", &format!("Host: evil.example:{port}\r\n")),
        421,
        "DNS rebinding"
    );
    assert_eq!(
        request("POST /api/v1/recording/start", &format!("{host}Origin: http://evil.example\r\n")),
        403
    );
    assert_eq!(
        request("POST /api/v1/recording/start", &format!("{host}Sec-Fetch-Site: cross-site\r\n")),
        403
    );
    let upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
                   Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let (code, _) = exchange(
        address,
        &format!("GET /api/v1/stream HTTP/1.1\r\n{host}Origin: http://evil.example\r\n{upgrade}\r\n"),
    );
    assert_eq!(code, 403, "another site may not listen");
    for path in
        ["/../rig.toml", "/%2e%2e/rig.toml", "/sessions/", "/page.js/..", "//etc/passwd", "/api/v1/nothing"]
    {
        assert_eq!(request(&format!("GET {path}"), &host), 404, "{path}");
    }
    assert_eq!(request("DELETE /api/v1/status", &host), 405);
    assert_eq!(daemon.status()["recorder"]["recording"], false);
    let (code, answer) =
        daemon.post("/api/v1/recording/start", &format!("{{\"label\": \"{}\"}}", "x".repeat(20_000)));
    assert_eq!(code, 413, "{answer}");
    for (body, words) in
        [("{\"label\": \"a\\nb\"}", "on one line"), ("{\"path\": \"/etc\"}", "unknown field"), ("{", "JSON")]
    {
        let (code, answer) = daemon.post("/api/v1/recording/start", body);
        assert!(
            (400..=422).contains(&code) && answer["error"].as_str().unwrap().contains(words),
            "{body}: {answer}"
        );
    }
    // a label with every sign in it names no file
    daemon.order("/api/v1/recording/start", "{\"label\": \"../../outside\"}");
    assert!(std::fs::read_dir(bench.folder.path()).unwrap().count() == 3, "rig.toml, left.json, sessions");
    assert_eq!(daemon.end().0, Some(0));
    assert_eq!(bench.sessions().len(), 1);
}

pub fn a_token_opens_the_daemon_to_others() {
    let bench = Bench::new(&["left"], "");
    let refuse = |arguments: &[&str], words: &str| {
        let output = bench.command(arguments).env_remove("OUTRIGGER_DAEMON_TOKEN").output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(words), "{said}");
    };
    refuse(&["--listen", "0.0.0.0:0"], "could be reached from other machines");
    std::fs::write(bench.path("token"), "short\n").unwrap();
    let token = bench.path("token").display().to_string();
    refuse(&["--listen", "0.0.0.0:0", "--token-file", &token], "at least 16");
    std::fs::write(&token, format!("{SECRET}\n")).unwrap();
    let mut daemon = bench.start(&["--listen", "0.0.0.0:0", "--token-file", &token]);
    daemon.address.set_ip(std::net::Ipv4Addr::LOCALHOST.into());
    let (code, page) = daemon.get("/");
    assert_eq!(code, 200, "the page, which asks for the token");
    let page = page.to_string();
    let files: Vec<&str> =
        page.split(['"', '\\']).filter(|part| part.ends_with(".js") || part.ends_with(".css")).collect();
    assert!(files.len() >= 3, "{files:?}");
    for file in files {
        assert_eq!(daemon.get(file).0, 200, "{file}");
    }
    assert_eq!(daemon.get("/healthz").0, 200);
    for path in ["/api/v1/status", "/metrics", "/api/v1/openapi.json"] {
        assert_eq!(daemon.get(path).0, 401, "{path}");
    }
    assert_eq!(daemon.post("/api/v1/recording/start", "").0, 401);
    assert_eq!(daemon.post("/api/v1/login", "{\"token\": \"wrong-horse-battery\"}").0, 401);
    let with = |header: &str| {
        let address = daemon.address;
        let head = format!(
            "GET /api/v1/status HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{header}\r\n\r\n"
        );
        exchange(address, &head).0
    };
    assert_eq!(with(&format!("Authorization: Bearer {SECRET}")), 200);
    assert_eq!(with(&format!("Authorization: Bearer {SECRET}x")), 401);
    assert_eq!(with(&format!("Cookie: outrigger_token={SECRET}")), 200);
    assert_eq!(daemon.post("/api/v1/login", &format!("{{\"token\": \"{SECRET}\"}}")).0, 200);
    let (code, log) = daemon.end();
    assert_eq!(code, Some(0), "{log}");
    assert!(!log.contains(SECRET), "the log does not tell it");
    let said = |mode: u32| {
        std::fs::set_permissions(&token, std::fs::Permissions::from_mode(mode)).unwrap();
        bench.start(&["--token-file", &token]).end().1
    };
    let log = said(0o640);
    assert!(log.contains("has mode 0640") && log.contains("expected 0600: chmod 600"), "{log}");
    assert!(!said(0o600).contains("chmod"), "nobody else can read it");
}

/// Random requests, cut and turned over: the daemon answers sensible ones as before.
pub fn nonsense_does_no_harm() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&[]);
    let address = daemon.address;
    let mut rng = outrigger::base::rng::Rng::new(11, 0);
    let seeds = [
        format!("GET /api/v1/status HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"),
        format!(
            "POST /api/v1/rig/apply HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Type: application/json\r\n\
             Content-Length: 24\r\n\r\n{{\"pitches_deg\":[1e99,-0]}}"
        ),
        format!(
            "GET /api/v1/stream HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n\u{1}\u{7f}\u{3}"
        ),
    ];
    for round in 0..150 {
        let mut bytes = seeds[round % seeds.len()].clone().into_bytes();
        for _ in 0..1 + rng.below(4) {
            let at = rng.below(bytes.len() as u64) as usize;
            match rng.below(4) {
                0 => bytes[at] = rng.bits() as u8,
                1 => bytes.truncate(at.max(1)),
                2 => bytes.insert(at, rng.bits() as u8),
                _ => {
                    let piece: Vec<u8> = (0..rng.below(200)).map(|_| rng.bits() as u8).collect();
                    bytes.splice(at..at, piece);
                }
            }
        }
        let (code, body) = exchange_bytes(address, &bytes);
        assert!(code < 500 || code == 503, "{code} {body}: {}", String::from_utf8_lossy(&bytes));
    }
    let head = format!("GET / HTTP/1.1\r\nHost: {address}\r\n{}\r\n", "X: y\r\n".repeat(500));
    assert_eq!(exchange(address, &head).0, 431, "too many headers");
    let head = format!("GET / HTTP/1.1\r\nHost: {address}\r\nX: {}\r\n\r\n", "y".repeat(100_000));
    assert_eq!(exchange(address, &head).0, 431, "too long headers");
    // more connections than there is room for: the oldest are closed, and who asks is answered
    let held: Vec<_> = (0..80).map(|_| std::net::TcpStream::connect(address).unwrap()).collect();
    assert_eq!(daemon.get("/healthz"), (200, "ok\n".into()));
    drop(held);
    assert_eq!(daemon.end().0, Some(0));
}
