//! Where packets go.

use std::net::{IpAddr, ToSocketAddrs as _};

/// A host, and a port if one was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Target {
    pub(super) ip: IpAddr,
    pub(super) port: Option<u16>,
}

pub(crate) fn parse_target(text: &str) -> Result<Target, String> {
    if let Ok(ip) = text.parse() {
        return Ok(Target { ip, port: None });
    }
    let resolve = |with_port: &str| with_port.to_socket_addrs().ok().and_then(|mut found| found.next());
    let has_port = text.rsplit_once(':').is_some_and(|(_, port)| port.parse::<u16>().is_ok());
    let found = if has_port { resolve(text) } else { resolve(&format!("{text}:0")) };
    let found = found.ok_or_else(|| format!("{text:?}: expected HOST or HOST:PORT of a known host"))?;
    Ok(Target { ip: found.ip(), port: has_port.then_some(found.port()) })
}

pub(crate) fn parse_map(text: &str) -> Result<(u16, u16), String> {
    let parts = text.split_once('=').and_then(|(from, to)| Some((from.parse().ok()?, to.parse().ok()?)));
    parts.ok_or_else(|| format!("{text:?}: expected PORT=PORT"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_with_and_without_port() {
        let target = |text: &str| parse_target(text).map(|target| (target.ip.to_string(), target.port));
        assert_eq!(target("127.0.0.1"), Ok(("127.0.0.1".into(), None)));
        assert_eq!(target("127.0.0.1:2368"), Ok(("127.0.0.1".into(), Some(2368))));
        assert_eq!(target("::1"), Ok(("::1".into(), None)));
        assert_eq!(target("[::1]:7502"), Ok(("::1".into(), Some(7502))));
        assert!(target("no.such.host.invalid:1").is_err());
        assert_eq!(parse_map("7502=17502"), Ok((7502, 17502)));
        assert!(parse_map("7502:17502").is_err() && parse_map("7502=x").is_err());
    }
}
