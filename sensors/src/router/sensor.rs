//! One sensor of a recording: its decoder and what the user specified for it.

use std::fmt;
use std::net::{IpAddr, SocketAddr};

use super::is_evidence;
use super::paths::Paths;
use super::senders::{Rival, Senders};
use super::source_filter::{Named, SourceFilter};
use super::streams::{Stream, Streams};
use crate::ouster::{Claim, Correction, OusterDecoder, TimestampMode};
use crate::velodyne::{Calibration, CalibrationError, Product, VelodyneDecoder};
use crate::{DecodeStats, Decoder, Link, Packet, SensorModel};

/// A sensor that packets are routed to.
pub struct Sensor {
    /// Name of the metadata it came from, where it came from metadata.
    pub metadata_name: Option<String>,
    /// How it is called, where somebody says.
    pub name: Option<String>,
    pub(super) source_filter: Option<SourceFilter>,
    pub(super) family: Family,
    pub(super) sources: Vec<IpAddr>,
    pub(super) source_is_known: bool,
    pub(super) first_source: Option<SocketAddr>,
    pub(super) data_port: Option<u16>,
    pub(super) streams: Streams,
    pub(super) senders: Senders,
    pub(super) paths: Paths,
    /// Another sensor with the same source and destination; only its clock differs.
    pub(super) twin: Option<usize>,
    pub(super) is_twin: bool,
    /// Position packets that came.
    pub position_packets: u64,
    /// Port of its auxiliary stream, if specified.
    auxiliary_port: Option<u16>,
    pub(super) first_damage: Option<String>,
    pub(super) misread_bytes: Option<usize>,
    calibrated: Option<(String, Result<SensorModel, CalibrationError>)>,
}

/// The calibration of a Velodyne, as given.
#[derive(Clone, Debug)]
pub struct GivenCalibration {
    /// The Velodynes that it is meant for.
    pub applies_to: AppliesTo,
    /// What messages call it.
    pub name: String,
    /// What it says.
    pub calibration: Calibration,
}

/// The product of a Velodyne, as given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GivenModel {
    /// The Velodynes that it holds for; every one without a filter.
    pub source_filter: Option<SourceFilter>,
    /// What they are.
    pub product: Product,
}

/// Which sensors something is meant for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AppliesTo {
    /// Every one.
    Everyone,
    /// Those that the filter accepts.
    From(SourceFilter),
    /// The one that is called so.
    Named(String),
}

impl fmt::Display for AppliesTo {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Everyone => Ok(()),
            Self::From(source_filter) => write!(out, "{source_filter}"),
            Self::Named(name) => out.write_str(name),
        }
    }
}

/// Where the beams of a sensor come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beams<'a> {
    /// From the metadata of an Ouster.
    Metadata,
    /// From the calibration of this name.
    Given(&'a str),
    /// From what the unit itself sends along; so many frames were complete before that was, with nominal beams.
    Unit {
        /// None where it was read before.
        after_frames: u64,
    },
    /// From the product: those of a unit without any deviation.
    Nominal,
}

impl fmt::Display for Beams<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Metadata => out.write_str("of the metadata"),
            Self::Given(name) => write!(out, "as {name} says"),
            Self::Unit { after_frames: 0 } => out.write_str("as the unit says of itself"),
            Self::Unit { after_frames } => {
                write!(out, "as the unit says of itself, nominal in the first {after_frames} frames")
            }
            Self::Nominal => out.write_str("nominal"),
        }
    }
}

/// The two families.
pub enum Family {
    /// Described by metadata.
    Ouster(Box<OusterDecoder>),
    /// Found in the data.
    Velodyne(Box<VelodyneDecoder>),
}

impl Family {
    pub(super) fn decoder(&self) -> &dyn Decoder {
        match self {
            Self::Ouster(decoder) => &**decoder,
            Self::Velodyne(decoder) => &**decoder,
        }
    }

    pub(super) fn decoder_mut(&mut self) -> &mut dyn Decoder {
        match self {
            Self::Ouster(decoder) => &mut **decoder,
            Self::Velodyne(decoder) => &mut **decoder,
        }
    }
}

impl Sensor {
    pub(super) fn new(family: Family, metadata_name: Option<String>) -> Self {
        Self {
            metadata_name,
            name: None,
            source_filter: None,
            family,
            sources: Vec::new(),
            source_is_known: false,
            first_source: None,
            data_port: None,
            streams: Streams::default(),
            senders: Senders::default(),
            paths: Paths::default(),
            twin: None,
            is_twin: false,
            position_packets: 0,
            auxiliary_port: None,
            first_damage: None,
            misread_bytes: None,
            calibrated: None,
        }
    }

    /// Its decoder.
    pub fn family(&self) -> &Family {
        &self.family
    }

    /// `Ouster` or `Velodyne`.
    pub fn vendor(&self) -> &'static str {
        match self.family {
            Family::Ouster(_) => "Ouster",
            Family::Velodyne(_) => "Velodyne",
        }
    }

    /// Product, as metadata or packets say.
    pub fn product(&self) -> String {
        match &self.family {
            Family::Ouster(decoder) => decoder.metadata().product(),
            Family::Velodyne(decoder) => {
                decoder.identity().map_or("unknown".into(), |identity| identity.product.name().into())
            }
        }
    }

    /// Packet format: the profile of an Ouster, the returns of a Velodyne.
    pub fn format(&self) -> String {
        match &self.family {
            Family::Ouster(decoder) => decoder.metadata().profile.name().into(),
            Family::Velodyne(decoder) => match decoder.return_mode() {
                Some(mode) => format!("{mode:?}").to_lowercase(),
                None => "unknown".into(),
            },
        }
    }

    /// Serial number; empty where it is not known (data packets of a Velodyne do not carry it).
    pub fn serial(&self) -> &str {
        match &self.family {
            Family::Ouster(decoder) => &decoder.metadata().serial,
            Family::Velodyne(_) => "",
        }
    }

    /// Where its first packet came from.
    pub fn source(&self) -> Option<SocketAddr> {
        self.first_source
    }

    /// How its data packets come to the host, where the recording says so (Velodyne).
    pub fn link(&self) -> Option<Link> {
        self.paths.current().map(|path| path.link).or(self.paths.auxiliary)
    }

    /// Length of the lidar packets of an Ouster.
    pub(super) fn lidar_bytes(&self) -> Option<usize> {
        match &self.family {
            Family::Ouster(decoder) => Some(decoder.lidar_bytes()),
            Family::Velodyne(_) => None,
        }
    }

    /// Port its lidar packets go to.
    pub fn data_port(&self) -> Option<u16> {
        self.data_port
    }

    /// Its beams, once they are known; as calibrated, where a calibration was given.
    pub fn model(&self) -> Option<&SensorModel> {
        if let Some((_, Ok(model))) = &self.calibrated {
            return Some(model);
        }
        self.family.decoder().model()
    }

    /// Whether the model is that of a calibration that was given for it.
    pub fn is_calibrated(&self) -> bool {
        matches!(self.calibrated, Some((_, Ok(_))))
    }

    /// Where its beams come from.
    pub fn beams(&self) -> Beams<'_> {
        match (&self.family, &self.calibrated) {
            (Family::Ouster(_), _) => Beams::Metadata,
            (Family::Velodyne(_), Some((name, _))) => Beams::Given(name),
            (Family::Velodyne(decoder), None) => decoder
                .calibrated_after_frames()
                .map_or(Beams::Nominal, |after_frames| Beams::Unit { after_frames }),
        }
    }

    /// Why the calibration that was given for it is not used: its name, and what is wrong.
    pub fn calibration_error(&self) -> Option<(&str, &CalibrationError)> {
        let (name, model) = self.calibrated.as_ref()?;
        Some((name, model.as_ref().err()?))
    }

    /// Everything its decoder counted.
    pub fn stats(&self) -> &DecodeStats {
        self.family.decoder().stats()
    }

    /// What was wrong with the first of its packets that is malformed.
    pub fn first_damage(&self) -> Option<&str> {
        self.first_damage.as_deref()
    }

    /// Length of the first of its packets that is malformed, where the metadata of another time would read it, bytes.
    pub fn misread_bytes(&self) -> Option<usize> {
        self.misread_bytes
    }

    /// Another source that sends under its serial number.
    pub fn rival(&self) -> Option<&Rival> {
        self.senders.rival()
    }

    /// The source filter that the user specified for it.
    pub fn source_filter(&self) -> Option<SourceFilter> {
        self.source_filter
    }

    /// How surely a packet is of this Ouster.
    pub(super) fn claim(&self, packet: &Packet<'_>) -> Claim {
        let Family::Ouster(decoder) = &self.family else { return Claim::No };
        let claim = decoder.claim(packet);
        if claim == Claim::No || (self.has_anonymous(packet) && self.streams.is_other_lidar(packet)) {
            return Claim::No;
        }
        let address = packet.source.ip();
        match self.source_filter.and_then(|source_filter| source_filter.holds(packet, decoder.lidar_bytes()))
        {
            Some(false) => Claim::No,
            Some(true) => claim.max(Claim::Familiar),
            None if claim >= Claim::Familiar || address.is_loopback() => claim,
            None if self.sources.contains(&address) => Claim::Familiar,
            None if self.sources.is_empty() => claim,
            None => Claim::No, // it sends from elsewhere
        }
    }

    /// Whether only the source filter rejects this packet.
    pub(super) fn is_filtered_out(&self, packet: &Packet<'_>) -> bool {
        let Family::Ouster(decoder) = &self.family else { return false };
        let holds =
            self.source_filter.and_then(|source_filter| source_filter.holds(packet, decoder.lidar_bytes()));
        // a decoder that has a sender claims nothing of another
        holds == Some(false) && (self.has_anonymous(packet) || decoder.claim(packet) != Claim::No)
    }

    /// Whether this is a lidar packet of its length that names no sensor.
    fn has_anonymous(&self, packet: &Packet<'_>) -> bool {
        let Family::Ouster(decoder) = &self.family else { return false };
        !decoder.names_sensor() && packet.payload.len() == decoder.lidar_bytes()
    }

    /// Whether a packet has the format of this Ouster's, wherever it comes from or goes to.
    pub(super) fn fits(&self, packet: &Packet<'_>) -> bool {
        matches!(&self.family, Family::Ouster(decoder) if decoder.claim(packet) != Claim::No)
    }

    /// Notes lidar packets that fit and that no sensor takes.
    pub(super) fn note_rival(&mut self, packet: &Packet<'_>) {
        if self.has_anonymous(packet)
            && self.streams.is_other_lidar(packet)
            && self.fits(packet)
            && !self.is_filtered_out(packet)
        {
            self.streams.note_rival(packet);
        }
    }

    /// The port that inertial packets go to, by who recorded them or by its metadata.
    pub(super) fn imu_port(&self) -> Option<u16> {
        let Family::Ouster(decoder) = &self.family else { return None };
        self.auxiliary_port.or(decoder.metadata().imu_port)
    }

    /// The inertial packets that could be its own.
    pub(super) fn imu_streams(&self) -> Vec<Stream> {
        self.streams.imu(&self.sources, self.imu_port())
    }

    /// Takes its name, once it is known who it is.
    pub(super) fn take_name(&mut self, names: &[Named]) {
        if self.name.is_some() || names.is_empty() {
            return;
        }
        let seen = self.first_source.zip(self.data_port);
        let mut meant = names.iter().filter(|named| named.means(self.metadata_name.as_deref(), seen));
        if let (Some(named), None) = (meant.next(), meant.next()) {
            self.name = Some(named.name.clone());
            self.auxiliary_port = named.auxiliary_port;
        }
    }

    /// Notes where one of its packets came from and went to.
    pub(super) fn note_packet(&mut self, packet: &Packet<'_>, claim: Option<Claim>) {
        if claim.is_some_and(|claim| is_evidence(claim, packet)) {
            self.note_source(packet);
        }
        self.first_source.get_or_insert(packet.source);
        if let Family::Ouster(decoder) = &self.family
            && packet.payload.len() == decoder.lidar_bytes()
        {
            self.data_port.get_or_insert(packet.destination.port());
        }
    }

    /// Whether something is meant for it.
    pub(super) fn is_meant(&self, applies_to: &AppliesTo) -> bool {
        let address = self.first_source.map(|source| source.ip());
        match applies_to {
            AppliesTo::Everyone => true,
            AppliesTo::From(SourceFilter::Sender(sender)) => address == Some(*sender),
            AppliesTo::From(SourceFilter::Port(port)) => self.data_port == Some(*port),
            AppliesTo::From(SourceFilter::Stream(stream)) => {
                address == Some(stream.ip()) && self.data_port == Some(stream.port())
            }
            AppliesTo::Named(name) => self.name.as_ref() == Some(name),
        }
    }

    /// Takes the first calibration that is meant for it, once it is known what it is.
    pub(super) fn calibrate(&mut self, calibrations: &[GivenCalibration]) {
        if self.calibrated.is_some() || calibrations.is_empty() {
            return;
        }
        let Family::Velodyne(decoder) = &self.family else { return };
        let Some(identity) = decoder.identity() else { return };
        let meant = calibrations.iter().find(|given| self.is_meant(&given.applies_to));
        self.calibrated = meant.map(|given| (given.name.clone(), given.calibration.model(identity.product)));
    }

    /// Holds one of its packets against its metadata, before any is decoded.
    pub(super) fn learn(&mut self, packet: &Packet<'_>) {
        if let Family::Ouster(decoder) = &mut self.family {
            decoder.learn(packet.payload);
        }
    }

    pub(super) fn end_learning(&mut self) {
        if let Family::Ouster(decoder) = &mut self.family {
            decoder.end_learning();
        }
    }

    /// What its packets and its metadata do not agree on; its packets count.
    pub fn corrections(&self) -> &[Correction] {
        match &self.family {
            Family::Ouster(decoder) => decoder.corrections(),
            Family::Velodyne(_) => &[],
        }
    }

    /// Where it takes its time from, where metadata say so.
    pub fn timestamp_mode(&self) -> Option<TimestampMode> {
        match &self.family {
            Family::Ouster(decoder) => decoder.metadata().timestamp_mode,
            Family::Velodyne(_) => None,
        }
    }

    pub(super) fn note_source(&mut self, packet: &Packet<'_>) {
        self.source_is_known = true;
        if self.has_anonymous(packet) {
            self.streams.note_lidar(packet);
        }
        let address = packet.source.ip();
        // loopback says nothing: recordings that were sent again come from there, whatever the sensor
        if !address.is_loopback() && !self.sources.contains(&address) && self.sources.len() < 16 {
            self.sources.push(address);
        }
    }
}
