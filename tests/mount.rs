//! `outrigger mount`: what it writes means what the mount file says, to programs that are not ours and by hand; what other
//! programs write comes back as that mount; what cannot be meant is refused with its reason.

mod drawings;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Output};

use glam::{DMat3, DQuat, DVec3};
use outrigger::base::geometry::Pose;
use outrigger::rig::{MountFile, SensorEntry};
use sensors::ouster::{Profile, Synthetic};
use serde_json::Value;
use tempfile::TempDir;

use crate::support::{Case, case, shared, with_shared};

pub const CASES: &[Case] = &[
    case("a_pitch_of_30_degrees_points_where_the_hand_calculation_says", pitch_by_hand),
    case("urdf_rs_finds_the_frames_where_tf_says", urdf_is_tf),
    case("extrinsics_come_back_as_the_mount", extrinsics_come_back),
    case("ouster_metadata_bring_extrinsics_model_and_calibration", ouster_metadata),
    with_shared("a_recorded_sensor_s_extrinsic_is_where_its_metadata_say", recorded_extrinsic),
    case("dxf_measures_what_the_mount_file_says", drawings::dxf_measures),
    case("words_of_the_drawing_do_not_overlap", drawings::words_do_not_overlap),
    case("mounts_that_cannot_be_meant_are_refused_with_the_value", doubted),
    case("damaged_extrinsics_are_refused_with_place_and_reason", damaged),
    case("touching_housings_are_exit_code_3", touching),
    case("wrong_usage_is_exit_code_2", wrong_usage),
];

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn mount(&self, name: &str, sensors: &[SensorEntry]) {
        MountFile::new(sensors.to_vec()).write(&self.path(name)).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
        command.current_dir(self.0.path()).arg("mount").args(arguments).output().unwrap()
    }

    fn done(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &["--json"]].concat());
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
        crate::support::document(&output.stdout).unwrap()
    }

    /// What a refused command says; it leaves nothing behind.
    fn refused(&self, arguments: &[&str]) -> String {
        let before = std::fs::read_dir(self.0.path()).unwrap().count();
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty(), "{arguments:?}");
        assert_eq!(std::fs::read_dir(self.0.path()).unwrap().count(), before, "{arguments:?}");
        stderr(&output)
    }
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn entry(
    name: &str,
    model: &str,
    position_m: [f64; 3],
    [pitch_deg, roll_deg, yaw_deg]: [f64; 3],
) -> SensorEntry {
    let [x_m, y_m, z_m] = position_m;
    let (name, model) = (name.into(), model.into());
    SensorEntry { name, model, x_m, y_m, z_m, pitch_deg, roll_deg, yaw_deg, angle_tolerance_deg: None }
}

/// A rig with every angle, both makers, and a name that no frame can have as it is.
fn rig() -> Vec<SensorEntry> {
    vec![
        entry("right", "os1-64", [0.1234, 0.05, 0.119], [30.0, 0.0, 0.0]),
        entry("left-hand", "os0-128", [-0.1234, 0.05, 0.119], [-41.5, 3.25, 17.0]),
        entry("front", "vlp-16", [0.0, 0.31, 0.2], [12.0, -12.0, -90.0]),
    ]
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let numbers: Vec<f64> = value.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Every frame of a description in base_link, by name.
fn frames_of(document: &Value) -> BTreeMap<String, Pose> {
    let mut frames = BTreeMap::from([("base_link".to_owned(), Pose::IDENTITY)]);
    for frame in document["frames"].as_array().unwrap() {
        let rotation = DQuat::from_array(numbers(&frame["rotation_xyzw"]));
        let pose = Pose::new(rotation, DVec3::from_array(numbers(&frame["translation_m"])));
        let parent = frames[frame["parent"].as_str().unwrap()];
        frames.insert(frame["name"].as_str().unwrap().to_owned(), parent * pose);
    }
    frames
}

fn assert_same_pose(one: &Pose, other: &Pose, tolerance: f64, what: &str) {
    let off_m = one.translation_m.distance(other.translation_m);
    let turned = DMat3::from_quat(one.rotation) - DMat3::from_quat(other.rotation);
    let turned = turned.to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
    assert!(off_m < tolerance && turned < tolerance, "{what}: {off_m} m, {turned}");
}

fn pitch_by_hand() {
    // The mount frame is x right, y forward, z up, and R = Rx(roll) Ry(pitch). With roll 0, Ry(30°) takes z to
    // (sin 30°, 0, cos 30°): up leans to the right. The body is (y, -x, z) of that: (0, -0.5, 0.8660254).
    let folder = Folder::new();
    folder.mount("mount.json", &[entry("right", "os1-64", [0.1, 0.2, 0.3], [30.0, 0.0, 0.0])]);
    let document = folder.done(&["mount.json", "--urdf", "rig.urdf"]);
    let by_hand = DVec3::new(0.0, -0.5, 3_f64.sqrt() / 2.0);
    let sensor = frames_of(&document)["right_os_sensor"];
    assert!((sensor.rotation * DVec3::Z).abs_diff_eq(by_hand, 1e-9));
    assert!((sensor.rotation * DVec3::X).abs_diff_eq(DVec3::X, 1e-9), "the servo's axis is the forward one");
    // 0.1 m right, 0.2 m ahead, 0.3 m up
    assert!(sensor.translation_m.abs_diff_eq(DVec3::new(0.2, -0.1, 0.3), 1e-12));
    let robot = urdf_rs::read_file(folder.path("rig.urdf")).unwrap();
    let by_urdf = urdf_frames(&robot, &BTreeMap::from([("right_pitch".to_owned(), 30_f64.to_radians())]));
    assert!((by_urdf["right_os_sensor"].rotation * DVec3::Z).abs_diff_eq(by_hand, 1e-6));
    // the optical centre of an OS1 lies 38.195 mm along its axis
    let lidar = by_hand * 0.038195 + DVec3::new(0.2, -0.1, 0.3);
    assert!(by_urdf["right_os_lidar"].translation_m.abs_diff_eq(lidar, 1e-6));
    let yaw = entry("turned", "os1-64", [0.0; 3], [0.0, 0.0, 90.0]).mount().body_from_sensor();
    assert!(
        (yaw.rotation * DVec3::X).abs_diff_eq(DVec3::Y, 1e-12),
        "a positive yaw turns the front to the left"
    );
    let roll = entry("rolled", "os1-64", [0.0; 3], [0.0, 30.0, 0.0]).mount().body_from_sensor();
    assert!((roll.rotation * DVec3::Z).x < -0.49, "a positive roll takes the top back");
}

/// Every link in base_link, by urdf-rs and URDF's own rules, with joints at these positions.
fn urdf_frames(robot: &urdf_rs::Robot, positions: &BTreeMap<String, f64>) -> BTreeMap<String, Pose> {
    let mut frames = BTreeMap::from([("base_link".to_owned(), Pose::IDENTITY)]);
    while frames.len() < robot.links.len() {
        let before = frames.len();
        for joint in &robot.joints {
            let Some(parent) = frames.get(&joint.parent.link).copied() else { continue };
            let ([x, y, z], [roll, pitch, yaw]) = (joint.origin.xyz.0, joint.origin.rpy.0);
            let zero =
                DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
            let axis = DVec3::from_array(joint.axis.xyz.0).normalize_or(DVec3::X);
            let turned = DQuat::from_axis_angle(axis, positions.get(&joint.name).copied().unwrap_or(0.0));
            let pose = parent * Pose::new(zero * turned, DVec3::new(x, y, z));
            frames.insert(joint.child.link.clone(), pose);
        }
        assert!(frames.len() > before, "links that hang from nothing");
    }
    frames
}

fn urdf_is_tf() {
    let folder = Folder::new();
    folder.mount("mount.json", &rig());
    let limits = ["--limits-deg=-60,60", "--limits-deg=-50,45.5"];
    let with_servos = [
        &["mount.json", "--urdf", "rig.urdf", "--tf", "rig.yaml", "--sensors", "front,left-hand"][..],
        &limits,
    ]
    .concat();
    let frames = frames_of(&folder.done(&with_servos));
    assert_eq!(
        frames.keys().map(String::as_str).collect::<Vec<_>>(),
        [
            "base_link",
            "front_velodyne",
            "left_hand_os_imu",
            "left_hand_os_lidar",
            "left_hand_os_sensor",
            "right_os_imu",
            "right_os_lidar",
            "right_os_sensor",
        ]
    );
    let robot = urdf_rs::read_file(folder.path("rig.urdf")).unwrap();
    let positions: BTreeMap<_, _> = [("front_pitch", 12.0), ("left_hand_pitch", -41.5)]
        .map(|(name, deg)| (name.to_owned(), f64::to_radians(deg)))
        .into();
    let turned: Vec<_> = robot
        .joints
        .iter()
        .filter(|joint| matches!(joint.joint_type, urdf_rs::JointType::Revolute))
        .collect();
    assert_eq!(turned.len(), 2, "one joint for each servo");
    let front = turned.iter().find(|joint| joint.name == "front_pitch").unwrap();
    assert!((front.limit.upper - f64::to_radians(60.0)).abs() < 1e-12);
    let by_urdf = urdf_frames(&robot, &positions);
    frames.iter().for_each(|(name, pose)| assert_same_pose(&by_urdf[name], pose, 1e-6, name));
    let housings: Vec<_> = robot.links.iter().flat_map(|link| &link.collision).collect();
    assert_eq!(housings.len(), 3);
    // without servos the frames are where they are at once
    folder.done(&["mount.json", "--urdf", "fixed.urdf", "--sensors="]);
    let fixed = urdf_frames(&urdf_rs::read_file(folder.path("fixed.urdf")).unwrap(), &BTreeMap::new());
    frames.iter().for_each(|(name, pose)| assert_same_pose(&fixed[name], pose, 1e-6, name));
    // and the YAML says the same as the document
    assert_eq!(folder.read("rig.yaml").matches("child_frame_id: ").count(), frames.len() - 1);
}

fn matrix(sensor: &SensorEntry) -> Vec<[f64; 4]> {
    let pose = sensor.mount().body_from_sensor();
    let (rotation, at) = (DMat3::from_quat(pose.rotation), pose.translation_m);
    let row = |row: usize| [rotation.x_axis[row], rotation.y_axis[row], rotation.z_axis[row], at[row]];
    vec![row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

fn extrinsics_come_back() {
    let folder = Folder::new();
    folder.mount("mount.json", &rig());
    folder.done(&["mount.json", "--urdf", "rig.urdf", "--tf", "rig.yaml"]);
    folder.done(&["mount.json", "--urdf", "fixed.urdf", "--sensors", ""]);
    let by_name: BTreeMap<String, Vec<[f64; 4]>> =
        rig().iter().map(|sensor| (sensor.name.clone(), matrix(sensor))).collect();
    folder.write("rig.json", &serde_json::to_string(&by_name).unwrap());
    let line = |row: &[f64; 4]| row.map(|number| number.to_string()).join(" ");
    let text: Vec<String> = rig()
        .iter()
        .map(|sensor| {
            format!("{}:\n{}\n", sensor.name, matrix(sensor).iter().map(line).collect::<Vec<_>>().join("\n"))
        })
        .collect();
    folder.write("rig.txt", &format!("# base_link from sensor\n{}", text.join("\n")));
    let columns: Vec<f64> = (0..16).map(|at| matrix(&rig()[1])[at % 4][at / 4]).collect();
    folder.write("left-hand.json", &serde_json::to_string(&columns).unwrap());
    let transforms = rig().into_iter().map(|sensor| {
        let pose = sensor.mount().body_from_sensor();
        let ([x, y, z], q) = (pose.translation_m.to_array(), pose.rotation);
        serde_json::json!({ "source_frame": sensor.name, "destination_frame": "world", "p_x": x, "p_y": y, "p_z": z,
                            "q_x": q.x, "q_y": q.y, "q_z": q.z, "q_w": q.w })
    });
    folder.write(
        "ouster.json",
        &serde_json::json!({ "transforms": transforms.collect::<Vec<_>>() }).to_string(),
    );

    let models = ["--sensor", "right=os1-64", "--sensor", "left-hand=os0-128", "--sensor", "front=vlp-16"];
    for (file, models) in [
        ("rig.urdf", &models[..0]),
        ("fixed.urdf", &[]),
        ("rig.json", &models),
        ("rig.txt", &models),
        ("ouster.json", &models),
    ] {
        folder.done(&[&[file, "-o", "back.json"], models].concat());
        same_rig(&MountFile::read(&folder.path("back.json")).unwrap().sensors, &rig(), file);
    }
    // tf has frames' names alone, without the dash
    let models = ["--sensor", "right=os1-64", "--sensor", "left_hand=os0-128", "--sensor", "front=vlp-16"];
    folder.done(&[&["rig.yaml", "-o", "back.json"], &models[..]].concat());
    let mut renamed = rig();
    renamed[1].name = "left_hand".into();
    same_rig(&MountFile::read(&folder.path("back.json")).unwrap().sensors, &renamed, "rig.yaml");
    // column by column is read as that and said
    let document = folder.done(&["left-hand.json", "--sensor", "os0-128", "-o", "back.json"]);
    same_rig(&MountFile::read(&folder.path("back.json")).unwrap().sensors, &rig()[1..2], "by columns");
    assert!(document["problems"][0].as_str().unwrap().contains("column by column"), "{document}");
    // a joint whose position nobody says is at its zero, and that is said
    let bare: String = folder
        .read("rig.urdf")
        .lines()
        .filter(|line| !line.contains("<outrigger"))
        .map(|line| format!("{line}\n"))
        .collect();
    folder.write("bare.urdf", &bare);
    let document = folder.done(&[&["bare.urdf"], &models[..]].concat());
    assert_eq!(document["sensors"][0]["pitch_deg"], 0.0);
    assert!(document["problems"].to_string().contains("right_pitch stands at its zero"), "{document}");
    let error = folder.refused(&["bare.urdf", "-o", "none.json"]);
    assert!(error.contains("--sensor right=MODEL"), "{error}");
}

fn same_rig(found: &[SensorEntry], expected: &[SensorEntry], what: &str) {
    let named = |of: &[SensorEntry]| {
        let mut names: Vec<_> = of.iter().map(|sensor| (sensor.name.clone(), sensor.model.clone())).collect();
        names.sort();
        names
    };
    assert_eq!(named(found), named(expected), "{what}");
    for sensor in expected {
        let back = found.iter().find(|other| other.name == sensor.name).unwrap();
        for (ours, theirs) in [
            (back.x_m, sensor.x_m),
            (back.y_m, sensor.y_m),
            (back.z_m, sensor.z_m),
            (back.pitch_deg, sensor.pitch_deg),
            (back.roll_deg, sensor.roll_deg),
            (back.yaw_deg, sensor.yaw_deg),
        ] {
            assert!((ours - theirs).abs() < 1e-7, "{what}: {back:?}, expected {sensor:?}");
        }
    }
}

fn ouster_metadata() {
    let folder = Folder::new();
    for sensor in [&rig()[1], &entry("right", "os0-128", [0.2, 0.0, 0.1], [20.0, 0.0, 0.0])] {
        let made = Synthetic::new("os0-128", 7, Profile::Rng19Rfl8Sig16Nir16).columns(1024, 16);
        let text = sensors::ouster::Metadata::synthetic(&made).unwrap().to_json();
        let mut metadata: Value = serde_json::from_str(&text).unwrap();
        metadata["ouster-sdk"] = serde_json::json!({ "extrinsic": matrix(sensor).concat() });
        folder.write(&format!("{}.json", sensor.name), &metadata.to_string());
    }
    folder.done(&["left-hand.json", "right.json", "-o", "mount.json"]);
    let file = MountFile::read(&folder.path("mount.json")).unwrap();
    same_rig(&file.sensors[..1], &rig()[1..2], "metadata");
    assert_eq!(file.sensors.len(), 2);
    assert_eq!(file.calibration_files().unwrap().len(), 2, "the unit's beams go with its place");
    let mut metadata: Value = serde_json::from_str(&folder.read("right.json")).unwrap();
    metadata.as_object_mut().unwrap().remove("ouster-sdk");
    folder.write("bare.json", &metadata.to_string());
    let error = folder.refused(&["bare.json", "-o", "none.json"]);
    assert!(error.contains("bare.json") && error.contains("without extrinsics"), "{error}");
}

fn recorded_extrinsic() {
    let folder = Folder::new();
    let path = shared("captures/ouster/synthetic/osf2pcap_osf_fw_3.2_10scans_0.json");
    let metadata: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let rows: [f64; 16] = numbers(&metadata["ouster-sdk"]["extrinsic"]);
    let path = path.to_str().unwrap();
    let error = folder.refused(&[path]);
    assert!(error.contains("MODEL"), "no model has 8 channels: {error}");
    let document = folder.done(&[path, "--sensor", "os0-32"]);
    let frames = frames_of(&document);
    let (_, sensor) = frames.iter().find(|(name, _)| name.ends_with("os_sensor")).unwrap();
    let at = |row: usize| DVec3::new(rows[4 * row], rows[4 * row + 1], rows[4 * row + 2]);
    let expected = DMat3::from_cols(at(0), at(1), at(2)).transpose();
    let pose = Pose::new(DQuat::from_mat3(&expected), DVec3::new(rows[3], rows[7], rows[11]));
    assert_same_pose(sensor, &pose, 1e-6, path);
}

fn doubted() {
    let folder = Folder::new();
    let json = |x_m: f64, z_m: f64| {
        format!(
            "{{\"format\": \"outrigger-mount/1\", \"frame\": \"mount: x right, y forward, z up\", \"sensors\": [{{\"name\": \
             \"a\", \"model\": \"os1-64\", \"x_m\": {x_m}, \"y_m\": 0, \"z_m\": {z_m}, \"pitch_deg\": 25, \"roll_deg\": 0}}]}}"
        )
    };
    for (x_m, z_m, words) in [
        (74.0, 119.0, &["sensors[0].x_m is 74", "0.074", "millimetres"][..]),
        (0.1, -100.0, &["sensors[0].z_m is -100", "metres"]),
        (0.1, -4.0, &["sensors[0].z_m is -4", "below the floor"]),
        (412_345.0, 0.1, &["x_m is 412345", "place in the world"]),
    ] {
        folder.write("bad.json", &json(x_m, z_m));
        let error = folder.refused(&["bad.json", "--urdf", "rig.urdf"]);
        assert!(error.contains("bad.json") && words.iter().all(|word| error.contains(word)), "{error}");
    }
    folder.write("odd.json", &json(0.1, -1.5));
    assert!(folder.done(&["odd.json"])["problems"].to_string().contains("below the floor"));
    // a matrix in millimetres
    folder.write("a.txt", "1 0 0 74\n0 1 0 0\n0 0 1 119\n0 0 0 1\n");
    let error = folder.refused(&["a.txt", "--sensor", "os1-64", "-o", "none.json"]);
    assert!(error.contains("a.txt") && error.contains("millimetres"), "{error}");
}

fn damaged() {
    let folder = Folder::new();
    let joint = |inside: &str| {
        format!(
            "<robot name='r'><link name='base_link'/>\n<joint name='j' type='fixed'>{inside}</joint></robot>"
        )
    };
    let ends = "<parent link='base_link'/><child link='a_os_sensor'/>";
    let tf = |rotation: &str| {
        format!(
            "transforms:\n- header: {{frame_id: base_link}}\n  child_frame_id: a_os_sensor\n  transform:\n    translation: {{x: 0, y: 0, \
             z: 0}}\n    rotation: {{{rotation}}}\n"
        )
    };
    for (name, text, words) in [
        ("empty.txt", String::new(), &["empty"][..]),
        ("a.txt", "1 0 0 0\n0 1 0\n".into(), &["line 2", "3 numbers"]),
        ("a.txt", "1 0 0 0\n0 1 0 0\n".into(), &["8 of the 16"]),
        ("a.txt", "1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n".into(), &["mirror image"]),
        ("a.txt", "1 0 0 0\nx y z w\n".into(), &["line 2", "four numbers"]),
        ("a.json", "[1, 2, 3]".into(), &["3 numbers"]),
        ("a.json", "[1, 2".into(), &["no JSON", "line 1"]),
        (
            "a.json",
            "{\"transforms\": [{\"source_frame\": \"1\", \"q_x\": 0}]}".into(),
            &["transforms[0]", "q_y is missing"],
        ),
        ("a.yaml", tf("x: 0, y: 0, z: 0, w: 0"), &["transforms[0]", "length 0"]),
        ("a.yaml", tf("x: 0, y: 0, z: 0"), &["missing field", "w"]),
        ("a.yaml", "a: b".into(), &["transforms"]),
        ("a.urdf", "<robot".into(), &["no XML"]),
        ("a.urdf", "<mesh/>".into(), &["<mesh>", "<robot>"]),
        ("a.urdf", joint("<parent link='base_link'/>"), &["line 2", "<child>"]),
        ("a.urdf", joint(&format!("{ends}<origin xyz='0 0'/>")), &["line 2", "three numbers"]),
        ("a.urdf", joint(&format!("{ends}<origin rpy='0 NaN 0'/>")), &["line 2", "NaN"]),
        ("a.urdf", joint(ends).replace("fixed", "floating"), &["floating", "revolute"]),
        ("a.urdf", joint("<parent link='a'/><child link='a'/>"), &["its own parent"]),
        (
            "a.urdf",
            "<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:arm/></robot>".into(),
            &["xacro:arm", "xacro FILE"],
        ),
    ] {
        folder.write(name, &text);
        let error = folder.refused(&[name, "--sensor", "os1-64", "-o", "none.json"]);
        std::fs::remove_file(folder.path(name)).unwrap();
        assert!(
            error.contains(name) && words.iter().all(|word| error.contains(word)),
            "{name} {text}: {error}"
        );
    }
}

fn touching() {
    let folder = Folder::new();
    folder.mount(
        "near.json",
        &[
            entry("a", "os1-64", [0.03, 0.0, 0.0], [0.0; 3]),
            entry("b", "os1-64", [-0.03, 0.0, 0.0], [0.0; 3]),
        ],
    );
    let output = folder.run(&["near.json", "--drawing", "near.svg"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("cannot be built"));
    assert!(folder.read("near.svg").contains("THEY TOUCH"));
}

fn wrong_usage() {
    let folder = Folder::new();
    folder.mount("mount.json", &rig());
    for arguments in [
        &["mount.json", "--drawing", "mount.png"][..],
        &["mount.json", "--limits-deg=-60,60"],
        &["mount.json", "--urdf", "r.urdf", "--limits-deg=60,-60"],
        &["mount.json", "--urdf", "r.urdf", "--sensors", "nobody"],
        &["mount.json", "--urdf", "r.urdf", "--limits-deg=-60,60", "--limits-deg=-50,50"],
        &["mount.json", "mount.json"],
        &[],
    ] {
        let output = folder.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(output.stdout.is_empty());
    }
    assert_eq!(std::fs::read_dir(folder.0.path()).unwrap().count(), 1, "nothing is written");
}
