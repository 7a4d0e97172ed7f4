//! What the first packets of a sensor say against what is known of it: while it can still be mended, not when the recording
//! is read.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sensors::ouster::{Correction, Metadata};
use sensors::router::{Family, Guess, Routed, Router, Sensor, Unclaimed};
use sensors::velodyne::Product;
use sensors::{Packet, catalogue};

use super::is_model;
use crate::base::times::rfc3339;

/// Packets that tell every product.
const ENOUGH_PACKETS: u32 = 64;

/// What was corrected, in words.
pub(crate) fn correction_words(sensor: &Sensor, correction: &Correction) -> String {
    let Correction { setting, stated, found, since_ns } = correction;
    let file = sensor.metadata_name.as_deref().unwrap_or("its metadata");
    match (*setting, since_ns) {
        // says that settings may differ, and is none
        ("initialization_id", _) => format!(
            "{file} is of initialization {stated}, the packets of {found}: settings may have changed in between"
        ),
        (_, None) => {
            format!("{file} says {setting} {stated}, its packets have {found}: decoded as the packets are")
        }
        (_, Some(since_ns)) => format!(
            "its {setting} changed from {stated} to {found} at {}: decoded as the packets are from there on",
            rfc3339(*since_ns)
        ),
    }
}

/// A look at the first packets of one sensor.
pub struct FirstLook {
    model: Option<String>,
    has_metadata: bool,
    router: Router,
    packets: u32,
    decoded: u32,
    /// Pixels in a column of the first Ouster packet, where its length leaves no choice.
    pixels: Option<usize>,
    is_done: bool,
}

impl FirstLook {
    /// At a sensor that is to be of this model and have these metadata, each with what messages call it.
    pub(crate) fn new(model: Option<String>, metadata: Option<(Metadata, String)>) -> Self {
        let mut router = Router::new();
        let has_metadata = metadata.is_some();
        if let Some((metadata, name)) = metadata {
            router.add_ouster(metadata, name);
        }
        Self { model, has_metadata, router, packets: 0, decoded: 0, pixels: None, is_done: false }
    }

    /// Looks at one more packet. What is wrong is reported once, when enough were seen.
    pub(crate) fn take(&mut self, packet: &Packet<'_>) -> Vec<String> {
        if self.is_done {
            return Vec::new();
        }
        if let (None, Guess::OusterLidar { formats, .. }) = (self.pixels, Guess::of(packet.payload))
            && let Some((first, others)) = formats.split_first()
            && others.iter().all(|other| other.pixels_per_column == first.pixels_per_column)
        {
            self.pixels = Some(first.pixels_per_column);
        }
        let routed = self.router.push(packet, &mut |_, _, _| {});
        self.decoded += u32::from(matches!(routed, Routed::Assigned(_)));
        self.packets += 1;
        if self.packets < ENOUGH_PACKETS { Vec::new() } else { self.conclude() }
    }

    /// What is wrong with the packets so far; nothing where that was reported already.
    pub(crate) fn conclude(&mut self) -> Vec<String> {
        if self.is_done || self.packets == 0 {
            return Vec::new();
        }
        self.is_done = true;
        self.router.finish(&mut |_, _, _| {});
        self.unread().into_iter().chain(self.other_model()).chain(self.corrections()).collect()
    }

    /// Why packets cannot be decoded, where that is so.
    fn unread(&self) -> Option<String> {
        let damage = self.router.sensors().iter().find_map(|sensor| sensor.first_damage());
        // auxiliary packets may stay unassigned
        let matters = |entry: &&Unclaimed| self.decoded == 0 || entry.is_ouster_lidar;
        let unassigned = self.router.unclaimed().filter(matters).max_by_key(|entry| entry.packets);
        let no_metadata = |entry: &Unclaimed| {
            let serial = entry.serial.map_or(String::new(), |serial| format!(" of serial number {serial}"));
            format!(
                "an Ouster{serial} sends, and nothing names its metadata, without which its packets cannot be decoded: \
                 `outrigger sensor info HOST --save-metadata FILE.json` saves them, `metadata` or `host` of its [[sensor]] \
                 names them"
            )
        };
        match (unassigned, damage) {
            (Some(entry), _) if entry.needs_metadata && !self.has_metadata => Some(no_metadata(entry)),
            (Some(entry), _) => Some(format!("its packets cannot be decoded: {}", entry.reason)),
            (None, Some(damage)) if self.decoded == 0 => {
                Some(format!("its packets cannot be decoded: {damage}"))
            }
            (None, _) => None,
        }
    }

    /// What its metadata say and its packets do not show; they are decoded as they are.
    fn corrections(&self) -> Vec<String> {
        let sensors = self.router.sensors().iter();
        let all = sensors.flat_map(|sensor| sensor.corrections().iter().map(move |found| (sensor, found)));
        let words = all
            .filter(|(_, found)| found.setting != "initialization_id")
            .map(|(sensor, found)| correction_words(sensor, found));
        words.collect()
    }

    /// Another sensor sends than the configured one.
    fn other_model(&self) -> Option<String> {
        let senders = || self.router.sensors().iter().filter(|sensor| sensor.source().is_some());
        let Some(configured) = self.model.as_deref() else {
            let velodyne = senders().find(|sensor| matches!(sensor.family(), Family::Velodyne(_)));
            let velodyne = velodyne.filter(|_| self.has_metadata)?;
            return Some(format!(
                "a {} sends, which has no metadata, and some are named",
                velodyne.product()
            ));
        };
        for sensor in senders() {
            let Some(found) = sensor.model() else { continue };
            if !is_model(configured, &sensor.product(), &found.name) {
                return Some(format!("a {} sends, `model` says {configured}", sensor.product()));
            }
        }
        let channels = catalogue::nominal(configured).map(|model| model.channels()).ok();
        match self.pixels {
            Some(_) if Product::from_name(configured).is_some() => {
                Some(format!("an Ouster sends, `model` says {configured}"))
            }
            Some(pixels) if self.decoded == 0 && channels != Some(pixels) => {
                Some(format!("an Ouster of {pixels} channels sends, `model` says {configured}"))
            }
            _ => None,
        }
    }
}

/// First looks at several sensors, by who receives and for who tells.
#[derive(Clone)]
pub struct FirstLooks(Arc<Mutex<Shared>>);

struct Shared {
    looks: Vec<Option<FirstLook>>,
    news: Vec<(usize, String)>,
}

impl FirstLooks {
    /// One for each sensor of a receiver that is looked at.
    pub(crate) fn new(looks: Vec<Option<FirstLook>>) -> Self {
        Self(Arc::new(Mutex::new(Shared { looks, news: Vec::new() })))
    }

    /// Looks at packets, each with its sensor's place in the receiver's list.
    pub(crate) fn take<'a>(&self, packets: impl Iterator<Item = (usize, Packet<'a>)>) {
        let mut shared = self.lock();
        let Shared { looks, news } = &mut *shared;
        for (sensor, packet) in packets {
            let look = looks.get_mut(sensor).and_then(Option::as_mut);
            let words = look.map(|look| look.take(&packet)).unwrap_or_default();
            news.extend(words.into_iter().map(|words| (sensor, words)));
        }
    }

    /// What is wrong with which sensor and was not reported yet.
    pub(crate) fn news(&self) -> Vec<(usize, String)> {
        std::mem::take(&mut self.lock().news)
    }

    /// The same once nothing more comes.
    pub(crate) fn conclude(&self) -> Vec<(usize, String)> {
        let mut shared = self.lock();
        let Shared { looks, news } = &mut *shared;
        for (sensor, look) in looks.iter_mut().enumerate() {
            let words = look.as_mut().map(FirstLook::conclude).unwrap_or_default();
            news.extend(words.into_iter().map(|words| (sensor, words)));
        }
        std::mem::take(news)
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use sensors::made_up::{ouster_revolution, velodyne_columns};
    use sensors::ouster::{Profile, Synthetic};

    use super::*;

    fn metadata(serial: u64) -> Metadata {
        let profile = Profile::from_name("RNG19_RFL8_SIG16_NIR16").unwrap();
        Metadata::synthetic(&Synthetic::new("os1-64", serial, profile).columns(1024, 16)).unwrap()
    }

    /// A revolution of an OS1-64.
    fn ouster() -> Vec<Vec<u8>> {
        ouster_revolution(&metadata(77), 0, 5_000_000_000)
    }

    fn velodyne() -> Vec<Vec<u8>> {
        velodyne_columns(Product::Vlp16, 2000)
    }

    /// What a look at a sensor of this model and these metadata says of packets.
    fn findings(model: Option<&str>, named: Option<Metadata>, packets: &[Vec<u8>]) -> String {
        let mut look =
            FirstLook::new(model.map(str::to_owned), named.map(|named| (named, "left.json".into())));
        let mut words = Vec::new();
        for payload in packets {
            let source = std::net::SocketAddr::from(([10, 0, 0, 7], 50_000));
            let destination = std::net::SocketAddr::from(([10, 0, 0, 9], 7502));
            let packet = Packet {
                host_time_ns: 1_700_000_000_000_000_000,
                source,
                destination,
                link: Default::default(),
                payload,
            };
            words.extend(look.take(&packet));
        }
        words.extend(look.conclude());
        words.join("\n")
    }

    #[test]
    fn packets_that_fit_are_not_talked_about() {
        assert_eq!(findings(Some("os1-64"), Some(metadata(77)), &ouster()), "");
        assert_eq!(findings(None, Some(metadata(77)), &ouster()), "");
        assert_eq!(findings(Some("puck-lite"), None, &velodyne()), "", "nothing tells it from a VLP-16");
        assert_eq!(findings(Some("os1-64"), None, &[]), "");
    }

    #[test]
    fn what_cannot_be_decoded_or_is_another_sensor_is_reported_once() {
        for (model, named, packets, words) in [
            (Some("os1-64"), None, ouster(), &["of serial number 77", "--save-metadata"][..]),
            (Some("os1-64"), Some(metadata(5)), ouster(), &["sensor 77", "left.json (5)"]),
            (Some("os1-128"), Some(metadata(77)), ouster(), &["OS-1-64", "`model` says os1-128"]),
            (Some("os1-128"), None, ouster(), &["an Ouster of 64 channels sends, `model` says os1-128"]),
            (Some("vlp-16"), None, ouster(), &["an Ouster sends, `model` says vlp-16"]),
            (Some("os1-64"), None, velodyne(), &["a vlp-16 sends, `model` says os1-64"]),
            (None, Some(metadata(77)), velodyne(), &["a vlp-16 sends, which has no metadata"]),
            (None, None, vec![vec![7; 99]], &["cannot be decoded: no LiDAR packet"]),
        ] {
            let found = findings(model, named, &packets);
            assert!(words.iter().all(|words| found.contains(words)), "{words:?}: {found}");
            assert!(found.lines().count() <= 2, "{found}");
        }
    }
}
