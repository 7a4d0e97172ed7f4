//! A program that listens in Foxglove's way.

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::time::Instant;

use foxglove::Decode as _;
use foxglove::messages::{FrameTransforms, JointStates, PointCloud, VoxelGrid};
use glam::{DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::mock::rig::{MockConfig, MockRig};
use outrigger::mock::sensor::MockSensor;
use outrigger::rig::MountFile;
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

use super::program::{Bench, PATIENCE, Running};
use super::sensor::{ROOM, SERIAL, Sending, entry, metadata};

/// Degrees; positive turns the sensor to its right.
const PITCH_DEG: f64 = 15.0;

fn connect(daemon: &Running, protocol: Option<&str>) -> Result<WebSocket<TcpStream>, u16> {
    let stream = TcpStream::connect(daemon.address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut request = format!("ws://{}/api/v1/foxglove", daemon.address).into_client_request().unwrap();
    if let Some(protocol) = protocol {
        request.headers_mut().insert("Sec-WebSocket-Protocol", protocol.parse().unwrap());
    }
    match tungstenite::client(request, stream) {
        Ok((socket, response)) => {
            assert_eq!(response.headers()["sec-websocket-protocol"], protocol.unwrap());
            Ok(socket)
        }
        Err(tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response))) => {
            Err(response.status().as_u16())
        }
        Err(error) => panic!("{error}"),
    }
}

fn hear(socket: &mut WebSocket<TcpStream>, op: &str) -> Value {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            assert_eq!(message["op"], op, "{message}");
            return message;
        }
    }
}

fn say(socket: &mut WebSocket<TcpStream>, message: &Value) {
    socket.send(Message::Text(message.to_string().into())).unwrap();
}

/// The newest message of every channel, by the client's own numbers.
fn newest(
    socket: &mut WebSocket<TcpStream>,
    ids: &[u32],
    enough: impl Fn(&BTreeMap<u32, Vec<u8>>) -> bool,
) -> BTreeMap<u32, Vec<u8>> {
    let (begun, mut newest) = (Instant::now(), BTreeMap::new());
    while newest.len() < ids.len() || !enough(&newest) {
        assert!(begun.elapsed() < PATIENCE, "only {:?} came", newest.keys());
        if let Message::Binary(bytes) = socket.read().unwrap() {
            let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
            assert!(bytes[0] == 1 && ids.contains(&id), "{:?}", &bytes[..13]);
            let time_ns = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
            assert!(outrigger::live::receive::now_ns().abs_diff(time_ns) < 60_000_000_000, "{time_ns}");
            newest.insert(id, bytes[13..].to_vec());
        }
    }
    newest
}

fn to_pose(translation: &foxglove::messages::Vector3, rotation: &foxglove::messages::Quaternion) -> Pose {
    let rotation = DQuat::from_xyzw(rotation.x, rotation.y, rotation.z, rotation.w);
    Pose::new(rotation, DVec3::new(translation.x, translation.y, translation.z))
}

pub fn foxglove_sees_points_cells_frames_and_axes() {
    let start_urad = (PITCH_DEG.to_radians() * 1e6).round() as i32;
    let rig =
        MockRig::start(MockConfig { start_urad: Some([start_urad, 0]), ..MockConfig::default() }, 1).unwrap();
    let sections = format!(
        "[rig]\nport = \"{}\"\n[predict]\nmount = \"mount.json\"\nroom = \"{ROOM}\"\n",
        rig.path().display()
    );
    let bench = Bench::new(&["left"], &sections);
    let entry = entry("left", "os1-16", [-0.2, 0.1], PITCH_DEG);
    let mount = entry.mount();
    MountFile::new(vec![entry]).write(&bench.path("mount.json")).unwrap();
    let daemon = bench.start(&[]);
    let sensor = MockSensor::ouster(metadata(SERIAL, 1));
    let sending = Sending::start(sensor, daemon.sensor(0), mount, 0, None);
    daemon.wait("coverage is beside its prediction", |status| {
        status["coverage"]["seen_of_predicted"].as_u64() > Some(100)
    });
    let mut socket = connect(&daemon, Some("foxglove.websocket.v1")).unwrap();
    let info = hear(&mut socket, "serverInfo");
    assert!(info["name"].as_str().unwrap().starts_with("outrigger") && info["capabilities"] == json!([]));
    let channels = hear(&mut socket, "advertise")["channels"].as_array().unwrap().clone();
    let topics: Vec<(&str, &str)> = channels
        .iter()
        .map(|channel| (channel["topic"].as_str().unwrap(), channel["schemaName"].as_str().unwrap()))
        .collect();
    assert_eq!(
        topics,
        [
            ("/left/points", "foxglove.PointCloud"),
            ("/coverage/voxels", "foxglove.VoxelGrid"),
            ("/tf", "foxglove.FrameTransforms"),
            ("/rig/joints", "foxglove.JointStates"),
            ("/rig/state", "outrigger.RigState"),
        ]
    );
    let ids = [70, 71, 72, 73, 74];
    let subscriptions: Vec<Value> = channels
        .iter()
        .zip(ids)
        .map(|(channel, id)| json!({ "id": id, "channelId": channel["id"] }))
        .collect();
    say(&mut socket, &json!({ "op": "subscribe", "subscriptions": subscriptions }));
    let known = |messages: &BTreeMap<u32, Vec<u8>>| {
        let state: Value = serde_json::from_slice(&messages[&74]).unwrap();
        state["connected"] == true && state["status"]["axes"][0]["source"] == "measured"
    };
    let messages = newest(&mut socket, &ids, known);

    let frames = FrameTransforms::decode(&messages[&72][..]).unwrap().transforms;
    let names: Vec<(&str, &str)> =
        frames.iter().map(|frame| (frame.parent_frame_id.as_str(), frame.child_frame_id.as_str())).collect();
    assert_eq!(names, [("world", "body"), ("body", "left")]);
    let pose = to_pose(frames[1].translation.as_ref().unwrap(), frames[1].rotation.as_ref().unwrap());
    let expected = mount.body_from_sensor();
    assert!((pose.translation_m - expected.translation_m).length() < 1e-9);
    assert!(pose.rotation.angle_between(expected.rotation) < 2e-3, "{pose:?} for {expected:?}");

    let cloud = PointCloud::decode(&messages[&70][..]).unwrap();
    assert_eq!((cloud.frame_id.as_str(), cloud.fields[0].name.as_str()), ("left", "x"));
    let stride = cloud.point_stride as usize;
    assert!(cloud.data.len() / stride > 1000, "{}", cloud.data.len());
    let walls: Vec<f64> = ROOM.split(',').map(|part| part.parse().unwrap()).collect();
    for point in cloud.data.chunks(stride) {
        let of = |at: usize| f64::from(f32::from_le_bytes(point[at..at + 4].try_into().unwrap()));
        let in_world = pose.transform_point(DVec3::new(of(0), of(4), of(8)));
        let nearest = (0..3)
            .flat_map(|axis| [(in_world[axis] - walls[axis]).abs(), (in_world[axis] - walls[axis + 3]).abs()])
            .fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.05, "{in_world} is on no wall");
    }

    let grid = VoxelGrid::decode(&messages[&71][..]).unwrap();
    assert_eq!(
        (grid.frame_id.as_str(), grid.fields[0].name.as_str(), grid.cell_stride),
        ("world", "state", 5)
    );
    let slices = grid.data.len() / grid.slice_stride as usize;
    assert_eq!(grid.slice_stride, grid.row_count * grid.row_stride);
    let edge_m = grid.cell_size.as_ref().unwrap().x;
    let size_m = [grid.column_count as f64, grid.row_count as f64, slices as f64].map(|count| count * edge_m);
    for (axis, size_m) in size_m.into_iter().enumerate() {
        assert!((size_m - (walls[axis + 3] - walls[axis])).abs() < 1.0, "{size_m} m along axis {axis}");
    }
    let kept = grid.data.chunks(5).filter(|cell| cell[0] == 2).count();
    assert!(kept > 100, "{kept} cells are seen as promised");

    let joints = JointStates::decode(&messages[&73][..]).unwrap().joints;
    assert_eq!((joints.len(), joints[0].name.as_str()), (2, "axis_0"));
    assert!((joints[0].position.unwrap().to_degrees() - PITCH_DEG).abs() < 0.1, "{joints:?}");

    // who has enough of a channel gets no more of it
    say(&mut socket, &json!({ "op": "unsubscribe", "subscriptionIds": [70, 71, 73, 74] }));
    say(&mut socket, &json!({ "op": "nonsense" }));
    while !matches!(socket.read().unwrap(), Message::Text(_)) {} // what was under way, until the complaint
    newest(&mut socket, &[72], |_| true);
    drop(sending);
    assert_eq!(daemon.end().0, Some(0));
}

pub fn wrong_foxglove_requests_get_an_error() {
    let bench = Bench::new(&["left"], "");
    let daemon = bench.start(&["--foxglove-origin", "https://app.foxglove.dev"]);
    assert_eq!(connect(&daemon, None).err(), Some(400));
    assert_eq!(connect(&daemon, Some("something.else.v1")).err(), Some(400));
    let mut socket = connect(&daemon, Some("foxglove.sdk.v1")).unwrap();
    hear(&mut socket, "serverInfo");
    let channels = hear(&mut socket, "advertise")["channels"].as_array().unwrap().len();
    assert_eq!(channels, 3, "no rig, no axes");
    let mut told = |message: Value, words: &str| {
        say(&mut socket, &message);
        let answer = hear(&mut socket, "status");
        assert!(answer["message"].as_str().unwrap().contains(words), "{answer}");
    };
    told(json!({ "op": "advertise", "channels": [] }), "only subscribe and unsubscribe");
    told(json!([1, 2]), "only subscribe");
    let subscribe = |id: u32, channel: u32| json!({ "op": "subscribe", "subscriptions": [{ "id": id, "channelId": channel }] });
    told(subscribe(1, 0), "no channel 0");
    told(subscribe(1, 99), "no channel 99");
    say(&mut socket, &subscribe(1, 1));
    let mut told = |message: Value, words: &str| {
        say(&mut socket, &message);
        let answer = hear(&mut socket, "status");
        assert!(answer["message"].as_str().unwrap().contains(words), "{answer}");
    };
    told(subscribe(2, 1), "subscribed already");
    told(subscribe(1, 2), "number 1 is in use");
    assert_eq!(daemon.end().0, Some(0));
}
