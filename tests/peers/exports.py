"""Point files written by outrigger must be read the same by the programs people use.

    python tests/peers/exports.py OUTRIGGER CAPTURE [META.json...]

Needs: numpy plyfile laspy[lazrs] pye57 mcap-ros2-support mcap-protobuf-support rosbags open3d. Every file is judged by point count,
bounds and sums of coordinates against the `decode --json` document. Ends with `N passed, N failed`; exit status 1 when a
comparison failed.
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np


def run(program, capture, metas, *more):
    command = [program, "decode", capture, "--json", *more]
    for meta in metas:
        command += ["--meta", meta]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode in (0, 3), f"outrigger ended with {result.returncode}: {result.stderr.strip()}"
    return json.loads(result.stdout)


def read_ply(path):
    from plyfile import PlyData

    vertex = PlyData.read(path)["vertex"]
    assert vertex["ring"].dtype == np.uint16 and vertex["timestamp"].dtype == np.float64
    return np.stack([vertex[axis] for axis in "xyz"], 1), vertex["ring"], vertex["t"]


def read_open3d(path):
    import open3d

    cloud = open3d.t.io.read_point_cloud(str(path))
    positions = cloud.point.positions.numpy()
    attributes = {name: cloud.point[name].numpy() for name in cloud.point}
    return positions, attributes.get("ring"), attributes.get("t")


def read_las(path):
    import laspy

    file = laspy.read(path)
    return np.asarray(file.xyz), np.asarray(file.ring), None


def read_e57(path):
    import pye57

    file = pye57.E57(str(path))
    # the standard's return and time fields are not in that package's list
    scans = [file.read_scan_raw(index, ignore_unsupported_fields=True) for index in range(file.scan_count)]
    positions = [np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], 1) for scan in scans]
    return np.concatenate(positions), np.concatenate([scan["rowIndex"] for scan in scans]), None


def read_mcap_ros2(path):
    from mcap_ros2.reader import read_ros2_messages

    positions = []
    for message in read_ros2_messages(str(path)):
        cloud = message.ros_msg
        if message.channel.topic.endswith("/imu"):
            assert abs(cloud.linear_acceleration.z) > 5, "gravity is felt"
            continue
        data = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
        offsets = {field.name: field.offset for field in cloud.fields}
        columns = [data[:, offsets[axis]:offsets[axis] + 4].copy().view("<f4")[:, 0] for axis in "xyz"]
        positions.append(np.stack(columns, 1))
    return np.concatenate(positions), None, None


def read_mcap_foxglove(path):
    from mcap_protobuf.reader import read_protobuf_messages

    positions, rings = [], []
    for message in read_protobuf_messages(str(path)):
        cloud = message.proto_msg
        assert cloud.DESCRIPTOR.full_name == "foxglove.PointCloud" and cloud.frame_id
        data = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
        offsets = {field.name: field.offset for field in cloud.fields}
        columns = [data[:, offsets[axis]:offsets[axis] + 4].copy().view("<f4")[:, 0] for axis in "xyz"]
        positions.append(np.stack(columns, 1))
        rings.append(data[:, offsets["ring"]:offsets["ring"] + 2].copy().view("<u2")[:, 0])
    return np.concatenate(positions), np.concatenate(rings), None


def read_ros2_bag(path):
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    positions, gravity = [], []
    with Reader(path) as bag:
        for connection, time_ns, raw in bag.messages():
            message = store.deserialize_cdr(raw, connection.msgtype)
            assert bag.start_time <= time_ns < bag.end_time
            if connection.msgtype == "sensor_msgs/msg/Imu":
                acceleration = message.linear_acceleration
                gravity.append((acceleration.x**2 + acceleration.y**2 + acceleration.z**2) ** 0.5)
                continue
            data = message.data.reshape(-1, message.point_step)
            offsets = {field.name: field.offset for field in message.fields}
            columns = [data[:, offsets[axis]:offsets[axis] + 4].copy().view("<f4")[:, 0] for axis in "xyz"]
            positions.append(np.stack(columns, 1))
        assert bag.message_count == len(positions) + len(gravity)
    if gravity:
        assert 8 < float(np.median(gravity)) < 12, "acceleration at rest is about that of gravity"
    return np.concatenate(positions), None, None


def read_csv(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    positions = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    return positions, np.array([int(row["ring"]) for row in rows]), None


def read_npy(path):
    points = np.load(path)
    assert points.dtype.names[:4] == ("sensor", "frame_id", "column", "ring") and points["range_mm"].min() > 0
    positions = np.stack([points[f"{axis}_m"] for axis in "xyz"], 1)
    return positions, points["ring"], None


# kind, reader, what lies behind --out (a folder with a file per frame, one file, a bag), tolerance in m
CASES = [
    ("ply", read_ply, "frames", 1e-5),
    ("ply", read_open3d, "frames", 1e-5),
    ("pcd", read_open3d, "frames", 1e-5),
    ("las", read_las, "file", 1e-4),
    ("laz", read_las, "file", 1e-4),
    ("e57", read_e57, "file", 1e-5),
    ("csv", read_csv, "file", 1e-6),
    ("npy", read_npy, "file", 1e-9),
    ("mcap", read_mcap_ros2, "file", 1e-5),
    ("mcap", read_ros2_bag, "bag", 1e-5),
    ("foxglove", read_mcap_foxglove, "file", 1e-5),
]


def check(program, capture, metas, kind, read, place, tolerance):
    with tempfile.TemporaryDirectory() as folder:
        extension = "mcap" if kind == "foxglove" else kind
        out = pathlib.Path(folder) / (f"one.{extension}" if place == "file" else "folder")
        document = run(program, capture, metas, "--format", kind, "--out", str(out))
        files = sorted(out.iterdir()) if place == "frames" else [out]
        assert len(files) == (sum(len(sensor["frames"]) for sensor in document["sensors"]) if place == "frames" else 1)
        parts = [read(path) for path in files]
    positions = np.concatenate([part[0] for part in parts]).astype(np.float64)
    points = sum(s["totals"]["points"] + s["totals"]["points_second"] for s in document["sensors"])
    assert len(positions) == points, (len(positions), points)
    if all(s["totals"]["points_second"] == 0 for s in document["sensors"]):
        expected = np.sum([s["totals"]["xyz_sum_m"] for s in document["sensors"]], axis=0)
        found = positions.sum(axis=0)
        assert np.all(np.abs(found - expected) <= tolerance * points), (found, expected)
    if parts[0][1] is not None:
        assert max(int(np.max(part[1])) for part in parts) > 10, "rings are there"
    return f"{points} points in {len(files)} file(s)"


def main():
    program, capture, metas = sys.argv[1], sys.argv[2], sys.argv[3:]
    passed = failed = 0
    for kind, read, place, tolerance in CASES:
        name = f"{kind} by {read.__name__.removeprefix('read_')}"
        try:
            what = check(program, capture, metas, kind, read, place, tolerance)
            passed += 1
            print(f"agrees: {name}: {what}")
        except Exception as problem:  # every kind of disagreement is a failure of that format
            failed += 1
            print(f"DIFFERS: {name}: {type(problem).__name__}: {problem}")
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed or not passed else 0)


main()
