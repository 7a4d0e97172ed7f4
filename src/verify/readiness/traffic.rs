//! Ports that recording will open, and what comes to them.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Check, CheckState};
use crate::live::config::{Config, SensorConfig, Stream};
use crate::live::receive::is_auxiliary;
use crate::live::receive::{Listen, Options, ReceiveError, Receiver};
use crate::live::watch::{FirstLook, first_look};

/// What the ports receive.
pub(crate) struct Traffic {
    pub checks: Vec<Check>,
    /// Of all sensors together, where anything came.
    pub bytes_s: Option<f64>,
}

/// Opens what recording will open, and listens. `metadata` are those of sensors by name.
impl Traffic {
    pub(crate) fn probe(
        config: Option<&Config>,
        metadata: &BTreeMap<String, String>,
        receive_buffer_mib: u16,
        listen_for_s: f64,
    ) -> Self {
        let streams: Vec<Stream> =
            config.iter().flat_map(|config| &config.sensors).flat_map(SensorConfig::streams).collect();
        let configured: Vec<Listen> = streams.iter().map(|stream| stream.listen.clone()).collect();
        let any = Listen { name: "any".into(), address: ([127, 0, 0, 1], 0).into(), source: None };
        let listens = if configured.is_empty() { vec![any] } else { configured };
        let options =
            Options { receive_buffer_bytes: usize::from(receive_buffer_mib) << 20, ..Options::default() };
        let receiver = match Receiver::start(&listens, options) {
            Ok(receiver) => receiver,
            Err(error) => return Self { checks: refused(&listens, options, &error), bytes_s: None },
        };
        let mut checks = Vec::new();
        let warnings: Vec<String> =
            receiver.monitor().sockets().iter().filter_map(|socket| socket.buffer_warning()).collect();
        checks.push(match warnings.first() {
            None => {
                Check::new("receive buffer", CheckState::Ok, format!("{receive_buffer_mib} MiB granted"), "")
            }
            Some(warning) => Check::new(
                "receive buffer",
                CheckState::Bad,
                warning.clone(),
                "for good: a line in /etc/sysctl.d/, as the package brings",
            ),
        });
        if streams.is_empty() {
            return Self { checks, bytes_s: None };
        }
        let mut looks: Vec<Option<FirstLook>> = streams
            .iter()
            .map(|stream| first_look(stream, metadata.get(&stream.listen.name).map(String::as_str), &listens))
            .collect();
        let monitor = receiver.monitor();
        let words = listen(receiver, &mut looks, listen_for_s);
        let names = || listens.iter().map(|listen| listen.name.as_str());
        let mut bytes = 0;
        for ((listen, counters), words) in listens.iter().zip(monitor.sensors()).zip(words) {
            bytes += counters.bytes;
            let is_auxiliary = is_auxiliary(&listen.name, names());
            checks.push(judge(listen, counters.packets, listen_for_s, &words, is_auxiliary));
        }
        let bytes_s = (bytes > 0).then(|| bytes as f64 / listen_for_s.max(1e-3));
        Self { checks, bytes_s }
    }
}

/// Takes packets for so long; what is wrong with those of each sensor.
fn listen(mut receiver: Receiver, looks: &mut [Option<FirstLook>], seconds: f64) -> Vec<Vec<String>> {
    let stop = receiver.stop_handle();
    let timer = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        stop.stop();
    });
    let mut words = vec![Vec::new(); looks.len()];
    while let Some(datagram) = receiver.recv_blocking() {
        if let Some(look) = &mut looks[datagram.sensor] {
            words[datagram.sensor].extend(look.take(&datagram.packet()));
        }
    }
    let _ = timer.join(); // it has stopped the receiver, or that ended by itself
    for (look, words) in looks.iter_mut().zip(&mut words) {
        words.extend(look.as_mut().map(FirstLook::conclude).unwrap_or_default());
    }
    words
}

fn judge(listen: &Listen, packets: u64, seconds: f64, wrong: &[String], is_auxiliary: bool) -> Check {
    let rate = packets as f64 / seconds.max(1e-3);
    let found = format!("{packets} packets in {seconds} s ({rate:.0} a second)");
    let name = format!("packets of {}", listen.name);
    if !wrong.is_empty() {
        let advice = "`model` and `metadata` are those of the sensor that sends here";
        return Check::new(&name, CheckState::Bad, format!("{found}; {}", wrong.join("; ")), advice);
    }
    let advice = format!(
        "nothing came to {}: is it powered and set to send here (`outrigger sensor info HOST`), and does no firewall stand between?",
        listen.address
    );
    let state = match (packets, is_auxiliary) {
        (1.., _) => CheckState::Ok,
        (0, true) => CheckState::Warning, // recording does without
        (0, false) => CheckState::Bad,
    };
    Check::new(&name, state, found, &advice)
}

/// Every port that cannot be had.
fn refused(listens: &[Listen], options: Options, error: &ReceiveError) -> Vec<Check> {
    let advice = "a daemon or recorder that runs has it: end that, or give the sensor another port (`outrigger sensor configure \
                  HOST --lidar-port PORT`)";
    let bad = |error: &ReceiveError| {
        let is_in_use = matches!(error, ReceiveError::Bind { source, .. } if source.kind() == std::io::ErrorKind::AddrInUse);
        Check::new("ports", CheckState::Bad, error.to_string(), if is_in_use { advice } else { "" })
    };
    let alone =
        listens.iter().filter_map(|listen| Receiver::start(std::slice::from_ref(listen), options).err());
    let each: Vec<Check> = alone.map(|error| bad(&error)).collect();
    if each.is_empty() { vec![bad(error)] } else { each }
}
