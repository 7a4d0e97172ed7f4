//! A sensor's packets as a person types them, and how many there will be.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;

use sensors::ouster::Metadata;
use sensors::velodyne::Product;
use sensors::velodyne::wire::DATA_PACKET_BYTES;

use super::config::{SensorConfig, Stream};
use super::receive::Listen;

impl FromStr for Stream {
    type Err = String;

    /// `NAME=[ADDRESS:]PORT[:METADATA.json|:http://HOST]`
    fn from_str(text: &str) -> Result<Self, String> {
        const FORM: &str = "expected NAME=PORT, NAME=ADDRESS:PORT or either with :METADATA.json behind";
        let (name, rest) = text.split_once('=').ok_or(FORM)?;
        let (ip, rest) = match rest.strip_prefix('[') {
            Some(v6) => {
                let (ip, rest) = v6.split_once("]:").ok_or(FORM)?;
                (ip.parse::<IpAddr>().map_err(|error| format!("{ip}: {error}"))?, rest)
            }
            None => match rest.split_once(':') {
                Some((ip, behind)) if ip.contains('.') => {
                    (IpAddr::V4(ip.parse().map_err(|error| format!("{ip}: {error}"))?), behind)
                }
                _ => (IpAddr::V4(Ipv4Addr::UNSPECIFIED), rest),
            },
        };
        let (port, metadata) = match rest.split_once(':') {
            Some((port, path)) if !path.is_empty() => (port, Some(PathBuf::from(path))),
            _ => (rest, None),
        };
        let (host, metadata) = match metadata.as_ref().and_then(|path| path.to_str()?.strip_prefix("http://"))
        {
            Some(host) => (Some(host.to_owned()), None),
            None => (None, metadata),
        };
        let port = port.parse::<u16>().map_err(|_| format!("{port:?} is no port (0 to 65535); {FORM}"))?;
        Ok(Stream {
            listen: Listen { name: name.into(), address: SocketAddr::new(ip, port), source: None },
            model: None,
            metadata,
            host,
        })
    }
}

impl SensorConfig {
    /// What a sensor sends, by its metadata or the manual of its model.
    pub(crate) fn bytes_per_s(&self, metadata: Option<&String>) -> Option<f64> {
        if let Some(product) = Product::from_name(&self.model) {
            let packet_s = product.cycle_ns() * product.sequences_per_packet(true) as f64 * 1e-9;
            return Some(DATA_PACKET_BYTES as f64 / packet_s);
        }
        let ours = Metadata::parse(metadata?, &self.name).ok()?;
        let frame_bytes = ours.packets_per_frame() * ours.packet_format().packet_bytes();
        Some(frame_bytes as f64 * ours.frame_rate_hz)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn listens_as_typed() {
        let parsed = |text: &str| {
            let arg = text.parse::<Stream>().unwrap();
            (arg.listen.address.to_string(), arg.metadata.map(|path| path.display().to_string()))
        };
        assert_eq!(parsed("left=7502"), ("0.0.0.0:7502".into(), None));
        assert_eq!(parsed("left=7502:a:b.json"), ("0.0.0.0:7502".into(), Some("a:b.json".into())));
        assert_eq!(parsed("l=127.0.0.1:7502:m.json"), ("127.0.0.1:7502".into(), Some("m.json".into())));
        assert_eq!(parsed("l=[::1]:2368"), ("[::1]:2368".into(), None));
        for (wrong, words) in
            [("7502", "NAME=PORT"), ("a=70000", "70000"), ("a=1.2.3:4", "1.2.3"), ("a=", "no port")]
        {
            assert!(wrong.parse::<Stream>().unwrap_err().contains(words), "{wrong}");
        }
    }
}
