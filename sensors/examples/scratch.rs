#![allow(missing_docs)]
use sensors::ouster::*;
use std::net::SocketAddr;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    if args[1] == "dump" {
        for path in &args[2..] {
            match Metadata::parse(&std::fs::read_to_string(path).unwrap(), path) {
                Ok(m) => {
                    let b = m.model.beams();
                    println!(
                        "{path}\tOK\t{}",
                        serde_json::json!({"prod_line": m.product_line, "sn": m.serial, "init_id": m.init_id, "profile": m.profile.name(), "imu": m.imu_profile.name(), "header": m.header.name(), "w": m.columns_per_frame, "cpp": m.columns_per_packet, "h": m.pixels_per_column, "win": m.column_window, "fps": m.frame_rate_hz, "shift": m.pixel_shift_by_row, "port": m.lidar_port, "imu_port": m.imu_port, "ts": m.timestamp_mode.map(|t| t.name()),
                     "alt": b.iter().map(|b| b.elevation_rad.to_degrees()).collect::<Vec<_>>(), "az": b.iter().map(|b| b.azimuth_offset_rad.to_degrees()).collect::<Vec<_>>(), "bx": b[0].origin_radial_m*1e3, "bz": b[0].origin_z_m*1e3,
                     "l2s": m.model.sensor_from_lidar().to_cols_array(), "ipf": m.imu_packets_per_frame, "max": m.model.max_range_m.is_finite() })
                    );
                    let json = m.to_json();
                    let again = Metadata::parse(&json, "again").unwrap();
                    assert_eq!(again.to_json(), json);
                    if let Some(dir) = std::env::var_os("OUT") {
                        let name =
                            std::path::Path::new(path).file_name().unwrap().to_str().unwrap().to_owned();
                        std::fs::write(std::path::Path::new(&dir).join(name), json).unwrap();
                    }
                }
                Err(e) => println!("{path}\tERR\t{e}"),
            }
        }
        return;
    }
    let dir = std::path::PathBuf::from(&args[2]);
    for (k, profile) in Profile::all().enumerate() {
        for (model, cols, cpp) in [("os1-64", 1024, 16), ("os0-32", 512, 8), ("os1-16", 4096, 16)] {
            let mut want = Synthetic::new(model, 122246000293, profile).columns(cols, cpp);
            if cols == 4096 {
                want.frame_rate_hz = 5.0;
            }
            if cols == 512 {
                want.imu_profile = ImuProfile::Accel32Gyro32Nmea;
                if profile.has_packet_header() {
                    want.column_window = [400, 100];
                }
            }
            let meta = Metadata::synthetic(&want).unwrap();
            let stem = format!("{}_{model}", profile.name());
            std::fs::write(dir.join(format!("{stem}.json")), meta.to_json()).unwrap();
            if profile == Profile::Off {
                continue;
            }
            let mut decoder = OusterDecoder::new(meta.clone());
            // get an empty frame by decoding one zero packet
            let mut packet = vec![0u8; meta.packet_format().packet_bytes()];
            let _ = &mut decoder;
            let mut seed = 1 + k as u64;
            let mut rnd = || {
                seed ^= seed << 13;
                seed ^= seed >> 7;
                seed ^= seed << 17;
                seed
            };
            // random bytes through the format: write random pixel bytes, decode, then encode again
            let f = meta.packet_format();
            let mut frame = None;
            let a: SocketAddr = ([127, 0, 0, 1], 7502).into();
            use sensors::Decoder;
            for slot in 0..meta.packet_slots() {
                if !meta.expects_slot(slot) {
                    continue;
                }
                for b in packet.iter_mut() {
                    *b = rnd() as u8;
                }
                if profile.has_packet_header() {
                    wire::Header {
                        kind: wire::PacketKind::Lidar,
                        frame_id: 700,
                        init_id: meta.init_id,
                        serial: 122246000293,
                        health: Default::default(),
                    }
                    .write(meta.header, &mut packet);
                }
                for i in 0..cpp {
                    let id = slot * cpp + i;
                    let h = wire::ColumnHeader {
                        time_ns: 1_000_000 + 1000 * id as u64,
                        measurement_id: id as u16,
                        valid: meta.in_window(id),
                    };
                    f.write_column(f.column_mut(&mut packet, i), h, 700, cols);
                }
                if profile.has_packet_header() {
                    wire::write_crc(&mut packet);
                }
                decoder
                    .push(
                        &sensors::Packet { host_time_ns: 1, source: a, destination: a, payload: &packet },
                        &mut |d| {
                            if let sensors::Decoded::Frame(fr) = d {
                                frame = Some(fr.clone())
                            }
                        },
                    )
                    .unwrap();
            }
            let frame = frame.unwrap();
            let mut enc = OusterEncoder::new(meta.clone());
            let file = std::fs::File::create(dir.join(format!("{stem}.pcap"))).unwrap();
            let mut w = sensors::capture::PcapWriter::new(file).unwrap();
            let mut t = 1_700_000_000_000_000_000u64;
            enc.frame(&frame, &mut |p| {
                t += 1_000_000;
                w.write(&sensors::Packet { host_time_ns: t, source: a, destination: a, payload: p }).unwrap();
            });
            let s: u64 = frame.first.range_mm.iter().map(|r| *r as u64).sum();
            let s2: u64 = frame.second.as_ref().map_or(0, |l| l.range_mm.iter().map(|r| *r as u64).sum());
            let sum16 = |v: &Vec<u16>| v.iter().map(|x| *x as u64).sum::<u64>();
            let sum8 = |v: &Vec<u8>| v.iter().map(|x| *x as u64).sum::<u64>();
            let rgb = |c: usize| frame.first.rgb.iter().map(|x| x[c] as u64).sum::<u64>();
            println!(
                "{stem}\t{}",
                serde_json::json!({"RANGE": s, "RANGE2": s2, "NEAR_IR": sum16(&frame.first.near_ir), "SIGNAL": sum16(&frame.first.signal), "REFLECTIVITY": sum8(&frame.first.reflectivity), "FLAGS": sum8(&frame.first.flags), "WINDOW": sum8(&frame.first.window), "ZONE_MASK": sum16(&frame.first.zone_mask),
              "SIGNAL2": frame.second.as_ref().map_or(0, |l| sum16(&l.signal)), "REFLECTIVITY2": frame.second.as_ref().map_or(0, |l| sum8(&l.reflectivity)), "FLAGS2": frame.second.as_ref().map_or(0, |l| sum8(&l.flags)), "RGB": [rgb(0), rgb(1), rgb(2)], "valid": frame.valid_columns(), "complete": frame.complete,
              "RAW": (0..5).map(|i| frame.first.raw_words.iter().map(|w| w[i] as u64).sum::<u64>()).collect::<Vec<_>>()})
            );
        }
    }
}
