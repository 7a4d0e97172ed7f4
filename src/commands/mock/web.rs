//! The web server of a mock sensor, by flags.

use std::net::{Ipv4Addr, SocketAddr};

use anyhow::Context as _;
use sensors::ouster::Metadata;

use crate::mock::web::{Announced, Announcer, Behind, MockWeb, OusterWeb, VelodyneWeb, WebFault};

/// Flags of the web server.
#[derive(clap::Args, Debug)]
pub struct WebArgs {
    /// Serve the sensor's web interface on this port of loopback (0: any free one). What is set there as the destination is
    /// where packets then go.
    #[arg(long, value_name = "PORT")]
    http: Option<u16>,
    /// Something is wrong with it: refuses, slow, half, wrong-json, other-json, endless, elsewhere, server-error, reverts,
    /// never-ready.
    #[arg(long, value_name = "NAME", requires = "http")]
    http_fault: Option<WebFault>,
    /// An Ouster's firmware from before 3.1, which knows commands only.
    #[arg(long, requires = "http")]
    old_firmware: bool,
    /// Announce an Ouster by mDNS on loopback.
    #[arg(long, requires = "http")]
    announce: bool,
}

/// A running server, and what announces it.
pub struct Web {
    server: MockWeb,
    _announcer: Option<Announcer>,
}

impl Web {
    /// Starts what the flags ask for.
    pub(crate) fn start(
        args: &WebArgs,
        model: &str,
        metadata: Option<&Metadata>,
        to: SocketAddr,
        auxiliary_to: Option<SocketAddr>,
    ) -> anyhow::Result<Option<Self>> {
        let Some(port) = args.http else { return Ok(None) };
        let behind = match metadata {
            Some(metadata) => {
                let web = OusterWeb::new(&metadata.to_json(), true).context("the mock's own metadata")?;
                let web = if args.old_firmware { web.with_old_firmware() } else { web };
                Behind::Ouster(Box::new(web.sending_to(to, auxiliary_to)))
            }
            None => Behind::Velodyne(VelodyneWeb::new(model, "AG00000000").sending_to(to, auxiliary_to)),
        };
        let server = MockWeb::start((Ipv4Addr::LOCALHOST, port).into(), behind, args.http_fault)
            .with_context(|| format!("cannot serve HTTP on port {port} of loopback"))?;
        let announced = args.announce.then(|| Announced {
            serial: metadata.map_or(String::new(), |metadata| metadata.serial.clone()),
            part: "840-103575-06".into(),
            firmware: metadata.map_or(String::new(), |metadata| metadata.firmware.clone()),
            address: Ipv4Addr::LOCALHOST,
            port: server.address().port(),
        });
        let announcer = announced
            .map(|announced| Announcer::start(announced, Ipv4Addr::LOCALHOST))
            .transpose()
            .context("cannot announce by mDNS on loopback")?;
        Ok(Some(Self { server, _announcer: announcer }))
    }

    pub(crate) fn server(&self) -> &MockWeb {
        &self.server
    }
}
