//! One pass over the packets of a recording, and how it ended.

use std::net::SocketAddr;
use std::ops::ControlFlow;
use std::sync::PoisonError;

use sensors::Packet;
use sensors::capture::{CaptureCounters, CaptureError, Interface};

use super::{Recording, RecordingError};
use crate::recording::bags::{BagPackets, TopicCount, notices_of};
use crate::recording::packet_reader::{PacketError, PacketReader};

/// How a pass over the packets ended.
pub(crate) struct Ending {
    /// What the file holds besides datagrams.
    pub counters: CaptureCounters,
    /// Why reading stopped before the end.
    pub damage: Option<PacketError>,
    /// Interfaces of the last section.
    pub interfaces: Vec<Interface>,
    /// What was not read behind the damage, in words.
    unread: Option<String>,
    missing: Vec<String>,
    /// Topics of a bag, and what each held.
    pub topics: Vec<TopicCount>,
    /// What else there is to know of a bag, in words.
    pub notices: Vec<String>,
}

impl Recording {
    /// Hands every datagram to `take`. A file that is cut off or damaged ends the pass early; the [`Ending`] says so.
    pub(crate) fn each_packet(&self, take: &mut dyn FnMut(&Packet<'_>)) -> Result<Ending, RecordingError> {
        self.each_packet_until(&mut |packet| {
            take(packet);
            ControlFlow::Continue(())
        })
    }

    /// The same, up to the first error of `take`.
    pub(crate) fn try_each_packet<E: From<RecordingError>>(
        &self,
        take: &mut dyn FnMut(&Packet<'_>) -> Result<(), E>,
    ) -> Result<Ending, E> {
        let mut outcome = Ok(());
        let ending = self.each_packet_until(&mut |packet| {
            outcome = take(packet);
            if outcome.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        outcome.and_then(|()| Ok(ending?))
    }

    /// The same, as long as `take` says to go on.
    pub(crate) fn each_packet_until(
        &self,
        take: &mut dyn FnMut(&Packet<'_>) -> ControlFlow<()>,
    ) -> Result<Ending, RecordingError> {
        let opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner).take();
        let mut reader = match opened {
            Some(opened) => opened,
            None => PacketReader::open(&self.path, &self.name)?,
        };
        let bytes = std::fs::metadata(&self.path).map(|metadata| metadata.len()).unwrap_or(0);
        let mut show_position = (self.observer.reading)(bytes);
        let mut packets = 0_u64;
        let mut found = Vec::new();
        let damage = loop {
            match reader.next_from() {
                Ok(Some((interface, packet))) => {
                    found.resize(found.len().max(interface + 1), 0);
                    found[interface] += 1;
                    if take(&packet).is_break() {
                        break None;
                    }
                }
                Ok(None) => break None,
                Err(error) => break Some(error),
            }
            packets += 1;
            if packets.is_multiple_of(1024) {
                show_position(reader.position());
            }
        };
        drop(show_position);
        let of_session = self.session.as_ref().map_or_else(Vec::new, |(_, manifest)| {
            let contradictions = manifest.contradictions(&found, reader.interfaces());
            manifest.missing().into_iter().chain(manifest.silent(&found)).chain(contradictions).collect()
        });
        let lost_in_bag = reader.bag().map_or_else(Vec::new, BagPackets::losses);
        let topics = reader.bag().map_or_else(Vec::new, |bag| bag.counts().to_vec());
        let notices = reader.bag().map_or_else(Vec::new, notices_of);
        Ok(Ending {
            counters: reader.counters(),
            unread: damage.as_ref().and_then(|damage| self.unread_behind(damage, &reader)),
            damage,
            interfaces: reader.interfaces().to_vec(),
            missing: self.unreadable.iter().cloned().chain(of_session).chain(lost_in_bag).collect(),
            topics,
            notices,
        })
    }

    /// How much of the file lies behind damage, in words.
    fn unread_behind(&self, damage: &PacketError, reader: &PacketReader) -> Option<String> {
        let PacketError::Capture(CaptureError::Damaged { offset, .. } | CaptureError::Read { offset, .. }) =
            damage
        else {
            return None;
        };
        let bytes = std::fs::metadata(&self.path).ok().filter(std::fs::Metadata::is_file)?.len();
        let (from, packed) = match reader.is_packed() {
            true => (reader.position(), " (packed)"),
            false => (*offset, ""),
        };
        let unread = bytes.saturating_sub(from);
        let percent = 100.0 * unread as f64 / bytes.max(1) as f64;
        Some(format!("from there on {unread} bytes{packed} were not read, {percent:.0} % of the file"))
    }
}

impl Ending {
    /// Where packets come from: their sender, or their topic in a bag.
    pub(crate) fn source(&self, sender: SocketAddr) -> String {
        let topic = self.topics.iter().find(|count| count.from == Some(sender));
        topic.map_or_else(|| sender.to_string(), |count| count.topic.clone())
    }

    /// Data that is missing because of the file or its recorder, in words.
    pub(crate) fn losses(&self) -> Vec<String> {
        let mut losses = self.missing.clone();
        let unread = self.unread.as_ref().map_or(String::new(), |unread| format!("; {unread}"));
        losses.extend(self.damage.as_ref().map(|damage| format!("{damage}{unread}")));
        losses.extend(capture_losses(&self.counters));
        losses
    }
}

/// Data that a capture lacks, in words.
pub(crate) fn capture_losses(counters: &CaptureCounters) -> Vec<String> {
    let counted = [
        (counters.fragments_incomplete, "datagrams lack a fragment"),
        (
            counters.cut_by_snap_length,
            "frames were cut short by the recorder's snap length (record with -s 0)",
        ),
        (counters.dropped_by_recorder, "packets were dropped by the recorder, by its own account"),
    ];
    let counted =
        counted.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
    let tail = counters.zero_tail.iter().map(ToString::to_string);
    counters.truncated.iter().map(ToString::to_string).chain(tail).chain(counted).collect()
}
