"""Odometry by outrigger and by KISS-ICP must agree within what KISS-ICP's own answers differ by.

    python tests/peers/odometry.py OUTRIGGER CAPTURE[,META.json]...

KISS-ICP walks each capture nine times: with cells of half, once and twice the edge that outrigger took, each with all
points, the even and the odd ones. Compared is the motion from the middle of the first whole revolution to the middle of
the last. KISS-ICP's motion correction begins with the third revolution, so that the poses of the first two stand for the
middle of theirs and later ones for the end: where the sensor moves that is the greater error in captures of three to ten
revolutions, and it goes without. Where it stands the moment does not matter, and it walks nine times more, with the
correction. Outrigger may be as far from the mean of all as the farthest of them is.
Ends with `N passed, N failed`; exit status 1 when a comparison failed.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP

STILL_M = 0.02  # less motion than this is none
LEAST_RANGE_M, GREATEST_RANGE_M = 0.5, 100.0


def outrigger(program, arguments):
    result = subprocess.run([program, *arguments, "--json"], capture_output=True, text=True, timeout=600)
    if result.returncode not in (0, 3):
        raise AssertionError(f"outrigger ended with {result.returncode}: {result.stderr.strip()}")
    return json.loads(result.stdout)


def frames(program, capture, metas, folder):
    """Points (m), when each was taken (share of the revolution) and middle (ns) of every whole revolution."""
    path = pathlib.Path(folder, "points.csv")
    document = outrigger(program, ["decode", capture, *metas, "--format", "csv", "--out", str(path)])
    [sensor] = document["sensors"]
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding=None)
    table = table[table["return_number"] == table["return_number"].min()]
    spans = [(frame["first_time_ns"], frame["last_time_ns"]) for frame in sensor["frames"]]
    longest = max(last - first for first, last in spans)
    found = []
    for number, (first, last) in enumerate(spans):
        if last - first < 0.97 * longest:
            continue
        rows = table[(table["time_ns"] >= first) & (table["time_ns"] <= last)]
        points = np.stack([rows["x_m"], rows["y_m"], rows["z_m"]], axis=1).astype(np.float64)
        found.append((points, (rows["time_ns"] - first) / (last - first), (first + last) // 2))
    assert len(found) >= 2, "fewer than two whole revolutions"
    return found


def kiss(whole, voxel_m, part, corrected):
    config = KISSConfig()
    config.data.min_range, config.data.max_range = LEAST_RANGE_M, GREATEST_RANGE_M
    config.mapping.voxel_size = voxel_m
    config.data.deskew, config.registration.max_num_threads = corrected, 1
    walk, poses = KissICP(config), []
    for points, shares, _ in whole:
        walk.register_frame(points[part], shares[part] if corrected else np.zeros(0))
        poses.append(walk.last_pose.copy())
    return np.linalg.inv(poses[0]) @ poses[-1]


def matrix(row):
    x, y, z, w = row[4:8]
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = row[1:4]
    return pose


def turn_deg(pose):
    off = pose[:3, :3] - pose[:3, :3].T
    return np.degrees(np.array([off[2, 1], off[0, 2], off[1, 0]]) / 2)  # small angles


def between(path, first_ns, last_ns):
    rows, times = [], []
    for line in open(path):
        if not line.startswith("#"):
            words = line.split()
            seconds, fraction = words[0].split(".")
            times.append(int(seconds) * 10**9 + int(fraction))
            rows.append([0.0, *map(float, words[1:])])
    rows, times = np.array(rows), np.array(times)

    def at(time_ns):
        after = int(np.clip(np.searchsorted(times, time_ns), 1, len(times) - 1))
        share = (time_ns - times[after - 1]) / (times[after] - times[after - 1])
        row = rows[after - 1] * (1 - share) + rows[after] * share
        row[4:8] /= np.linalg.norm(row[4:8])
        return matrix(row)

    return np.linalg.inv(at(first_ns)) @ at(last_ns)


def check(program, capture, metas):
    with tempfile.TemporaryDirectory() as folder:
        whole = frames(program, capture, metas, folder)
        path = str(pathlib.Path(folder, "walk.tum"))
        document = outrigger(program, ["odometry", capture, *metas, "--out", path])
        ours = between(path, whole[0][-1], whole[-1][-1])
    edges_m = [scale * document["voxel_m"] for scale in (0.5, 1.0, 2.0)]
    parts = [slice(None), slice(0, None, 2), slice(1, None, 2)]
    theirs = [kiss(whole, edge_m, part, False) for edge_m in edges_m for part in parts]
    if np.linalg.norm(np.mean([pose[:3, 3] for pose in theirs], axis=0)) < STILL_M:
        theirs += [kiss(whole, edge_m, part, True) for edge_m in edges_m for part in parts]
    shifts, turns = np.array([pose[:3, 3] for pose in theirs]), np.array([turn_deg(pose) for pose in theirs])
    spread_m = np.linalg.norm(shifts - shifts.mean(axis=0), axis=1).max()
    spread_deg = np.linalg.norm(turns - turns.mean(axis=0), axis=1).max()
    off_m = np.linalg.norm(ours[:3, 3] - shifts.mean(axis=0))
    off_deg = np.linalg.norm(turn_deg(ours) - turns.mean(axis=0))
    words = (
        f"{len(whole)} revolutions, {len(theirs)} walks, {np.linalg.norm(shifts.mean(axis=0)):.3f} m: apart {off_m:.4f} m {off_deg:.3f} deg, "
        f"KISS-ICP's own spread {spread_m:.4f} m {spread_deg:.3f} deg"
    )
    assert off_m <= spread_m and off_deg <= spread_deg, words
    return words


def main():
    program, *captures = sys.argv[1:]
    passed = failed = 0
    for given in captures:
        capture, *metas = given.split(",")
        arguments = [word for meta in metas for word in ("--meta", meta)]
        try:
            print(f"ok {pathlib.Path(capture).name}: {check(program, capture, arguments)}")
            passed += 1
        except AssertionError as error:
            print(f"FAILED {pathlib.Path(capture).name}: {error}")
            failed += 1
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


main()
