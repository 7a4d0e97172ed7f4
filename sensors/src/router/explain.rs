//! Why no sensor took a packet, and what would help.

use std::net::SocketAddr;

use super::guess::Guess;
use super::senders::Rival;
use super::sensor::{AppliesTo, Beams, Family, GivenCalibration, Sensor};
use super::streams::{Stream, listed};
use crate::Packet;
use crate::ouster::Metadata;
use crate::ouster::imu::LEGACY_BYTES;

impl Sensor {
    /// What is wrong with its beams where they are others than its own and that moves points by decimetres, and what
    /// would help.
    pub fn beams_are_off(&self) -> Option<String> {
        let Family::Velodyne(decoder) = &self.family else { return None };
        let is_hdl_64e = decoder.identity().is_some_and(|identity| identity.product.is_hdl_64e());
        is_hdl_64e.then(|| foreign_beams(self.beams(), self.stats().frames)).flatten()
    }

    /// Why it has no packets, where those of several units could be its own.
    pub fn one_of_several(&self) -> Option<String> {
        let of_several = self.streams.of_several().is_some()
            || (self.stats().packets == 0 && self.imu_streams().len() > 1);
        of_several.then(|| of_one_of_several(self))
    }

    /// That there is one, in words.
    pub fn two_sources(&self) -> Option<String> {
        self.rival().map(|rival| two_sources(self, rival))
    }

    /// That its packets are those of two sensors, where no single one could send them.
    pub fn mixed(&self) -> Option<String> {
        let Family::Velodyne(decoder) = &self.family else { return None };
        let how = if decoder.has_second_clock() {
            "use two clocks: those of the second count as another sensor's"
        } else if decoder.sends_too_often() {
            "come at twice the rate of one: their points are mixed"
        } else {
            return None;
        };
        Some(format!(
            "two sensors send as one: the packets from {} {how} (give each an address or a port of its own)",
            at_home(self).unwrap_or_default()
        ))
    }

    /// That it stands still, where it does.
    pub fn does_not_turn(&self) -> Option<String> {
        let Family::Velodyne(decoder) = &self.family else { return None };
        let at_deg = decoder.still_at_deg()?;
        Some(format!("it does not turn: its azimuth stays at {at_deg:.2}°"))
    }

    /// That position packets came and no data packets, where that is so.
    pub fn only_positions(&self) -> Option<String> {
        let count = self.position_packets;
        let is_alone = count > 0 && self.paths.current().is_none();
        let packets = if count == 1 { "position packet" } else { "position packets" };
        is_alone.then(|| {
            format!(
                "{count} {packets} from {} and no data packets: its lasers are off, or its data port was filtered away",
                self.first_source.map_or(String::new(), |source| source.ip().to_string())
            )
        })
    }

    pub(super) fn note_damage(&mut self, packet: &Packet<'_>, reason: String) {
        if self.first_damage.is_none() {
            let other = other_setting(self, packet);
            self.misread_bytes = other.is_some().then_some(packet.payload.len());
            self.first_damage = Some(other.unwrap_or(reason));
        }
    }
}

/// Why a packet goes to none of so many sensors that it could be of.
pub(super) fn ambiguous(count: usize, packet: &Packet<'_>) -> String {
    if packet.payload.len() == LEGACY_BYTES {
        return format!(
            "{count} sensors send inertial packets like this one without a serial number, and neither its sender nor the \
             udp_port_imu of their metadata identifies the sensor; give only the metadata of sensors in the recording, or \
             say who sends: --meta ADDRESS=FILE.json"
        );
    }
    format!(
        "{count} sensors send packets like this one without a serial number, and its sender is none that is known; \
         give only the metadata of sensors that are in the recording, or say who sends where: --meta ADDRESS=FILE.json, or \
         --meta :PORT=FILE.json"
    )
}

/// Why packets that claim to be a sensor's are rejected: they come from two places at once.
fn two_sources(sensor: &Sensor, Rival { accepted, other, .. }: &Rival) -> String {
    let applies_to = match (sensor.serial(), sensor.metadata_name.as_deref()) {
        ("", name) => format!("of packets that fit {}", name.unwrap_or("one sensor")),
        (serial, _) => format!("with serial {serial}"),
    };
    format!(
        "two sources {applies_to}: {accepted} and {other}; the packets of the second were left out (one of them sends with another's \
         serial number, or is replayed; record each on a port of its own, or --source NAME=ADDRESS)"
    )
}

/// Why a packet is not given to the one sensor that it fits: other packets would fit it as well.
pub(super) fn of_one_of_several(sensor: &Sensor) -> String {
    let name = sensor.metadata_name.as_deref().unwrap_or("FILE.json");
    let say = format!("say which, --meta ADDRESS={name}, --meta :PORT={name}, or both, ADDRESS:PORT={name}");
    if let Some(lidar) = sensor.streams.of_several() {
        return format!(
            "{name} fits the packets of several sensors, which bear no serial number: lidar packets come from {}; {say}",
            listed(&lidar)
        );
    }
    let imu = sensor.imu_streams();
    match &imu[..] {
        [own] => format!(
            "inertial packets without a serial number, of another sensor than those from {}, which {name} took",
            listed(&[*own])
        ),
        _ => format!(
            "inertial packets without a serial number of {} sensors, one of which may be that of {name}: {}; say \
             who sends, --meta ADDRESS={name}",
            imu.len(),
            listed(&imu)
        ),
    }
}

/// Why a position packet is not given to one of the Velodynes behind its address.
pub(super) fn position_of_several(units: &[Stream]) -> String {
    format!(
        "Velodyne position packet of one of several behind its address ({}), and nothing says of which; a \
         session does: record each with --listen NAME-aside=PORT",
        listed(units)
    )
}

pub(super) fn too_many(most: usize) -> String {
    format!("more than {most} kinds: not looked at one by one")
}

/// The reason for a packet of which the router knows no better one.
pub(super) fn unclaimed(
    sensors: &[Sensor],
    packet: &Packet<'_>,
    guess: &Guess,
    decoder_says: Option<String>,
) -> String {
    let length = packet.payload.len();
    match guess {
        Guess::VelodyneBlocks => {
            return format!(
                "blocks like a Velodyne's, but {length} bytes where a data packet has 1206: another maker's sensor"
            );
        }
        Guess::Unknown => {
            let damaged = sensors.iter().any(|sensor| sensor.first_source == Some(packet.source));
            return match decoder_says {
                Some(says) if damaged => format!("comes from a known sensor, but: {says}"),
                _ => "no LiDAR packet of a known format".into(),
            };
        }
        Guess::VelodyneData | Guess::VelodynePosition => {
            return decoder_says.unwrap_or_else(|| guess.to_string());
        }
        Guess::OusterLidar { .. } | Guess::OusterImu { .. } | Guess::OusterZone { .. } => {}
    }
    let rival = sensors.iter().filter(|sensor| sensor.fits(packet)).find_map(Sensor::one_of_several);
    if let Some(reason) = rival {
        return reason;
    }
    let ousters: Vec<(&Metadata, &str)> = sensors
        .iter()
        .filter_map(|sensor| match &sensor.family {
            Family::Ouster(decoder) => {
                Some((decoder.metadata(), sensor.metadata_name.as_deref().unwrap_or("metadata")))
            }
            Family::Velodyne(_) => None,
        })
        .collect();
    let serial = guess.serial();
    let of_whom = serial.map_or(String::new(), |serial| format!(" of sensor {serial}"));
    if ousters.is_empty() {
        return format!("{guess}{of_whom}, but no metadata was given; add --meta FILE.json");
    }
    if let Some(sensor) = sensors.iter().find(|sensor| sensor.is_filtered_out(packet))
        && let (Some(source_filter), Some(name)) = (sensor.source_filter(), &sensor.metadata_name)
    {
        let (address, port) = (packet.source.ip(), packet.destination.port());
        return format!(
            "{guess} from {address} to port {port}; it would fit {name}, which is configured for {source_filter}"
        );
    }
    if let Some(serial) = serial {
        let Some((metadata, name)) =
            ousters.iter().find(|(metadata, _)| metadata.serial_number() == Some(serial))
        else {
            let known: Vec<String> = ousters
                .iter()
                .map(|(metadata, name)| match metadata.serial.as_str() {
                    "" => format!("{name} (no serial number)"),
                    serial => format!("{name} ({serial})"),
                })
                .collect();
            return format!("{guess}{of_whom}; metadata is of {}: add that of {serial}", known.join(", "));
        };
        if matches!(guess, Guess::OusterLidar { .. }) {
            return other_format(guess, length, metadata, name);
        }
        return decoder_says.map_or_else(|| guess.to_string(), |says| format!("{guess}: {says}"));
    }
    if let (Guess::OusterLidar { .. }, [(metadata, name)]) = (guess, &ousters[..])
        && metadata.packet_format().packet_bytes() == length
    {
        let from = packet.source.ip();
        return format!(
            "{guess} from {from}, which {name} would fit, and another unit has it already: say who sends, --meta \
             ADDRESS=FILE.json for each"
        );
    }
    let sends_elsewhere =
        |sensor: &&Sensor| !sensor.sources.is_empty() && !sensor.sources.contains(&packet.source.ip());
    if let [sensor] = &sensors.iter().filter(sends_elsewhere).collect::<Vec<_>>()[..]
        && ousters.len() == 1
    {
        return format!(
            "{guess} from {}; the sensor of {} sends from {}: add the metadata of the other",
            packet.source.ip(),
            sensor.metadata_name.as_deref().unwrap_or("the metadata"),
            sensor.sources[0],
        );
    }
    match (guess, &ousters[..]) {
        (Guess::OusterLidar { .. }, [(metadata, name)]) => other_format(guess, length, metadata, name),
        _ => decoder_says.unwrap_or_else(|| format!("{guess}, which fits no metadata that was given")),
    }
}

/// What tells a sensor from others: its name, where it has one, the sender and the port of its data packets.
fn at_home(sensor: &Sensor) -> Option<String> {
    let address = sensor.first_source?.ip();
    let place = match sensor.data_port {
        Some(port) => SocketAddr::new(address, port).to_string(),
        None => address.to_string(),
    };
    Some(sensor.name.as_ref().map_or(place.clone(), |name| format!("{name} ({place})")))
}

/// Why a calibration serves no sensor.
pub(super) fn unused_calibration(sensors: &[Sensor], given: &GivenCalibration) -> String {
    let name = &given.name;
    let velodynes = sensors.iter().filter(|sensor| matches!(sensor.family, Family::Velodyne(_)));
    let is_nobodys = !velodynes.clone().any(|sensor| sensor.is_meant(&given.applies_to));
    let there: Vec<String> = velodynes.filter_map(at_home).collect();
    match &given.applies_to {
        _ if there.is_empty() => format!("calibration {name} is not used: no Velodyne is in the recording"),
        applies_to @ (AppliesTo::From(_) | AppliesTo::Named(_)) if is_nobodys => format!(
            "calibration {name} is not used: no Velodyne is that of {applies_to}; there {} {}",
            if there.len() == 1 { "is" } else { "are" },
            there.join(", ")
        ),
        _ => format!(
            "calibration {name} is not used: every Velodyne has another one, which was given before it"
        ),
    }
}

/// What beams that are not a unit's own mean for an HDL-64E.
fn foreign_beams(beams: Beams<'_>, frames: u64) -> Option<String> {
    let placed = match beams {
        Beams::Nominal => format!(
            "its {frames} frames are placed by nominal beams, as no whole calibration of the unit's own is among its \
             status bytes (that takes 1.2 to 2.4 s)"
        ),
        Beams::Unit { after_frames } if after_frames > 0 => {
            format!(
                "its first {after_frames} frames are placed by nominal beams: the unit had not sent its own yet"
            )
        }
        _ => return None,
    };
    Some(format!("{placed}; HDL-64Es differ by decimetres: give --calibration FILE"))
}

/// What is wrong with a packet of a sensor that its decoder calls malformed, where a wrong setting explains it.
fn other_setting(sensor: &Sensor, packet: &Packet<'_>) -> Option<String> {
    let guess = Guess::of(packet.payload);
    let length = packet.payload.len();
    match (&sensor.family, &guess) {
        (Family::Ouster(decoder), Guess::OusterLidar { .. })
            if length != decoder.metadata().packet_format().packet_bytes() =>
        {
            let name = sensor.metadata_name.as_deref().unwrap_or("metadata");
            Some(other_format(&guess, length, decoder.metadata(), name))
        }
        _ => None,
    }
}

fn other_format(guess: &Guess, length: usize, metadata: &Metadata, name: &str) -> String {
    let expected = metadata.packet_format();
    // no setting changes how many beams a unit has
    let is_other_unit = match guess {
        Guess::OusterLidar { header: None, formats } => {
            formats.iter().all(|format| format.pixels_per_column != expected.pixels_per_column)
        }
        _ => false,
    };
    let advice = match is_other_unit {
        true => "these are the metadata of another unit; take those of the sensor that was recorded",
        false => "the sensor was set differently while it was recorded; take the metadata of that time",
    };
    format!(
        "{guess}, {length} bytes; {name} says {} x {} pixels, {} columns per packet, {} bytes: {advice}",
        expected.profile.name(),
        expected.pixels_per_column,
        expected.columns_per_packet,
        expected.packet_bytes(),
    )
}
