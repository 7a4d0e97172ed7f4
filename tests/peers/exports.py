"""Point files written by outrigger must be read the same by the programs people use.

    python tests/peers/exports.py OUTRIGGER CAPTURE [META.json...]

Needs: numpy plyfile laspy[lazrs] pye57 mcap-ros2-support open3d. Every file is judged by point count,
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
        data = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, cloud.point_step)
        offsets = {field.name: field.offset for field in cloud.fields}
        columns = [data[:, offsets[axis]:offsets[axis] + 4].copy().view("<f4")[:, 0] for axis in "xyz"]
        positions.append(np.stack(columns, 1))
    return np.concatenate(positions), None, None


def read_csv(path):
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    positions = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    return positions, np.array([int(row["ring"]) for row in rows]), None


CASES = [
    ("ply", read_ply, True, 1e-5),
    ("ply", read_open3d, True, 1e-5),
    ("pcd", read_open3d, True, 1e-5),
    ("las", read_las, False, 1e-4),
    ("laz", read_las, False, 1e-4),
    ("e57", read_e57, False, 1e-5),
    ("csv", read_csv, False, 1e-6),
    ("mcap", read_mcap_ros2, False, 1e-5),
]


def check(program, capture, metas, kind, read, per_frame, tolerance):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / (f"one.{kind}" if not per_frame else "folder")
        document = run(program, capture, metas, "--format", kind, "--out", str(out))
        files = sorted(out.iterdir()) if per_frame else [out]
        assert len(files) == (sum(len(sensor["frames"]) for sensor in document["sensors"]) if per_frame else 1)
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
    for kind, read, per_frame, tolerance in CASES:
        name = f"{kind} by {read.__name__.removeprefix('read_')}"
        try:
            what = check(program, capture, metas, kind, read, per_frame, tolerance)
            passed += 1
            print(f"agrees: {name}: {what}")
        except Exception as problem:  # every kind of disagreement is a failure of that format
            failed += 1
            print(f"DIFFERS: {name}: {type(problem).__name__}: {problem}")
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed or not passed else 0)


main()
