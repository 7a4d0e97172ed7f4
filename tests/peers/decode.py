"""Recordings decoded by outrigger and by the sensors' own or a well-known Python package must agree.

    python tests/peers/decode.py OUTRIGGER CAPTURE[,META.json]...

Ouster captures (those given with metadata) are judged by ouster-sdk, Velodyne captures by velodyne_decoder. Ends with
`N passed, N failed`; exit status 1 when a comparison failed.
"""

import json
import math
import subprocess
import sys

import numpy as np


def ours(program, capture, metas):
    command = [program, "decode", capture, "--json"]
    for meta in metas:
        command += ["--meta", meta]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if result.returncode not in (0, 3):
        raise AssertionError(f"outrigger ended with {result.returncode}: {result.stderr.strip()}")
    return json.loads(result.stdout)


def ouster(capture, metas):
    """Frame id -> (points, sum of ranges in mm, sum of xyz in m), per serial number."""
    from ouster.sdk import open_source
    from ouster.sdk.core import ChanField, XYZLut

    source = open_source(capture, meta=list(metas))
    infos = source.sensor_info
    tables = [XYZLut(info, use_extrinsics=False) for info in infos]
    frames = {}
    for scans in source:
        for index, scan in enumerate(scans):
            if scan is None or not scan.has_field(ChanField.RANGE):
                continue
            ranges = scan.field(ChanField.RANGE)
            points = tables[index](scan)[ranges > 0]
            serial = str(infos[index].sn)
            sums = (int((ranges > 0).sum()), int(ranges.astype(np.uint64).sum()), points.sum(axis=0))
            frames.setdefault(serial, {})[int(scan.frame_id)] = sums
    return frames


def check_ouster(document, capture, metas):
    compared = 0
    for serial, frames in ouster(capture, metas).items():
        # the oldest metadata has a serial number that the peer cannot read
        alone = len(document["sensors"]) == 1
        mine = [sensor for sensor in document["sensors"] if alone or str(sensor["serial"]) == serial]
        assert mine, f"no sensor {serial} in our document"
        by_id = {frame["frame_id"]: frame for frame in mine[0]["frames"]}
        for frame_id, (points, range_sum_mm, xyz_sum_m) in frames.items():
            frame = by_id[frame_id]
            assert frame["points"] == points, (frame_id, frame["points"], points)
            assert frame["range_sum_mm"] == range_sum_mm, (frame_id, frame["range_sum_mm"], range_sum_mm)
            for a, b in zip(frame["xyz_sum_m"], xyz_sum_m):
                assert abs(a - b) <= 1e-9 * max(points, 1), (frame_id, a, b)
            compared += 1
    assert compared, "the peer found no frame"
    return f"{compared} frames"


def check_velodyne(document, capture):
    import velodyne_decoder

    everything = velodyne_decoder.Config(min_range=0.0, max_range=1000.0)  # the default keeps 0.1 to 200 m
    total, sums = 0, np.zeros(3)
    for _, points in velodyne_decoder.read_pcap(capture, everything, as_pcl_structs=True):
        total += len(points)
        sums += [points[axis].astype(np.float64).sum() for axis in "xyz"]
    mine = document["sensors"]
    found = sum(sensor["totals"]["points"] + sum(f.get("points_second") or 0 for f in sensor["frames"]) for sensor in mine)
    assert found == total, (found, total)
    if all(not f.get("points_second") for sensor in mine for f in sensor["frames"]):
        added = np.sum([sensor["totals"]["xyz_sum_m"] for sensor in mine], axis=0)
        # the peer rounds azimuths to 0.01 degrees: its error per point averages out
        bound = math.radians(0.01) * 100.0 * math.sqrt(total) + 2e-4 * total
        assert np.all(np.abs(added - sums) <= bound), (added, sums, bound)
    return f"{total} points"


def main():
    program, passed, failed = sys.argv[1], 0, 0
    for argument in sys.argv[2:]:
        capture, *metas = argument.split(",")
        try:
            document = ours(program, capture, metas)
            what = check_ouster(document, capture, metas) if metas else check_velodyne(document, capture)
            passed += 1
            print(f"agrees: {capture}: {what}")
        except Exception as problem:  # every kind of disagreement is a failure of that capture
            failed += 1
            print(f"DIFFERS: {capture}: {type(problem).__name__}: {problem}")
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed or not passed else 0)


main()
