//! Small whole bags of every container: made by the program from its capture, and by SQLite.

use std::path::Path;

use super::seeds::Kit;
use crate::support::shared_folder;

/// As `cut` writes it; where there are others' bags, also with packed chunks and as a killed recorder leaves one.
pub fn ros1_bags(kit: &Kit) -> Vec<Vec<u8>> {
    let others = ["vlp16_scans_cut_lz4.bag", "vlp16_scans_bz2.bag", "vlp16_scans_bz2_killed.bag.active"];
    [vec![kit.cut("good.bag")], of_others(&others)].concat()
}

/// Packets and clouds.
pub fn mcap_files(kit: &Kit) -> Vec<Vec<u8>> {
    let clouds = kit.decode("clouds.mcap");
    let others = ["os0_windowed_mcap_message_zstd/os0_windowed_mcap_message_zstd_0.mcap"];
    [vec![kit.cut("good.mcap"), clouds], of_others(&others)].concat()
}

/// Packets and metadata.
pub fn db3_files(kit: &Kit) -> Vec<Vec<u8>> {
    let path = kit.path("good.db3");
    let _ = std::fs::remove_file(&path);
    write_db3(&path, &String::from_utf8(kit.file("meta.json")).unwrap());
    let others = ["os1_fusa_db3_message_zstd/os1_fusa_db3_message_zstd.db3"];
    [vec![std::fs::read(path).unwrap()], of_others(&others)].concat()
}

/// A file that is packed as a whole.
pub fn packed_files(kit: &Kit) -> Vec<Vec<u8>> {
    let packed = |bytes: Vec<u8>| zstd::encode_all(&bytes[..], 3).unwrap();
    vec![packed(db3_files(kit).swap_remove(0)), packed(kit.cut("good.mcap")), packed(kit.file("good.pcap"))]
}

/// The list of a folder's files, beside a part.
pub fn lists(kit: &Kit) -> Vec<Vec<u8>> {
    std::fs::create_dir_all(kit.path("folder")).unwrap();
    std::fs::write(kit.path("folder/part_0.mcap"), kit.cut("good.mcap")).unwrap();
    vec![
        b"rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n    - part_0.mcap\n  \
          compression_format: \"\"\n  compression_mode: \"\"\n"
            .to_vec(),
    ]
}

fn of_others(names: &[&str]) -> Vec<Vec<u8>> {
    let Some(shared) = shared_folder() else { return Vec::new() };
    names.iter().map(|name| std::fs::read(shared.join("captures/bags").join(name)).unwrap()).collect()
}

fn write_db3(path: &Path, metadata: &str) {
    let connection = rusqlite::Connection::open(path).unwrap();
    let tables = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
                  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);\
                  CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, \
                  data BLOB NOT NULL);\
                  CREATE INDEX timestamp_idx ON messages (timestamp ASC);\
                  INSERT INTO topics VALUES(1, '/left/metadata', 'std_msgs/msg/String', 'cdr', '');\
                  INSERT INTO topics VALUES(2, '/left/lidar_packets', 'ouster_sensor_msgs/msg/PacketMsg', 'cdr', '');";
    connection.execute_batch(tables).unwrap();
    let message = |content: &[u8]| {
        let length = u32::try_from(content.len()).unwrap().to_le_bytes();
        [&[0, 1, 0, 0], &length[..], content].concat()
    };
    let mut insert = connection.prepare("INSERT INTO messages VALUES(NULL, ?1, ?2, ?3)").unwrap();
    insert.execute((1, 0, message(&[metadata.as_bytes(), b"\0"].concat()))).unwrap();
    for (at, packet) in Kit::lidar_packets().iter().take(12).enumerate() {
        let time_ns = packet.host_time_ns.cast_signed() + at.cast_signed() as i64;
        insert.execute((2, time_ns, message(&packet.payload))).unwrap();
    }
}
