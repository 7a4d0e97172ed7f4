"""Registered clouds that outrigger writes must be read the same by the programs people use, and so must the packets that it cuts.

    python tests/peers/registered.py OUTRIGGER CAPTURE META.json POSES_KITTI VELODYNE_CAPTURE

Needs: numpy laspy[lazrs] pyproj open3d pye57 ouster-sdk velodyne_decoder. The cloud of CAPTURE in the world frame, moved to where UTM has its
coordinates, is read back from LAZ, PLY and E57 and compared point by point with that of the NumPy file; the WKT has to be there.
Of a cut capture the peers have to find the revolutions that were asked for. Ends with `N passed, N failed`; exit status 1 when a
comparison failed.
"""

import pathlib
import subprocess
import sys
import tempfile

import numpy as np

SHIFT_M = np.array([412_341.0, 5_567_887.0, 312.0])


def run(program, *arguments):
    result = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, f"outrigger ended with {result.returncode}: {result.stderr.strip()}"


def read_laz(path):
    import laspy

    file = laspy.read(path)
    crs = file.header.parse_crs()
    wkt = next(vlr.string for vlr in file.header.vlrs if vlr.record_id == 2112)
    assert wkt.startswith('PROJCS["ETRS89 / UTM zone 32N"'), wkt[:60]
    assert crs.to_epsg() == 25832, crs
    assert np.all(file.header.offsets % 1 == 0) and abs(file.header.offsets[1] - SHIFT_M[1]) < 100, file.header.offsets
    return np.asarray(file.xyz)


def read_ply(path):
    import open3d

    return open3d.t.io.read_point_cloud(str(path)).point.positions.numpy()


def read_e57(path):
    import pye57

    file = pye57.E57(str(path))
    scans = [file.read_scan_raw(index, ignore_unsupported_fields=True) for index in range(file.scan_count)]
    return np.concatenate([np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], 1) for scan in scans])


def world_clouds(program, folder, capture, meta, poses):
    far = folder / "far.txt"
    rows = np.loadtxt(poses).reshape(-1, 3, 4)
    rows[:, :, 3] += SHIFT_M
    np.savetxt(far, rows.reshape(-1, 12), fmt="%.12f")
    common = ["decode", capture, "--meta", meta, "--frame", "world", "--trajectory", far]
    run(program, *common, "-o", folder / "cloud.npy")
    points = np.load(folder / "cloud.npy")
    expected = np.stack([points[f"{axis}_m"] for axis in "xyz"], 1)
    words = []
    for name, read, more, tolerance_m in [
        ("cloud.laz", read_laz, ["--crs", "EPSG:25832"], 1e-4),
        ("cloud.ply", read_ply, [], 1e-9),
        ("cloud.e57", read_e57, [], 1e-9),
    ]:
        run(program, *common, *more, "-o", folder / name)
        found = np.asarray(read(folder / name), np.float64)
        assert found.shape == expected.shape, (name, found.shape, expected.shape)
        off_m = np.abs(found - expected).max()
        assert off_m <= tolerance_m, f"{name}: {off_m} m"
        words.append(f"{name} within {off_m:.1e} m")
    return f"{len(expected)} points, " + ", ".join(words)


def cut_ouster(program, folder, capture, meta):
    from ouster.sdk import open_source

    run(program, "cut", capture, "--meta", meta, "--from", "1f", "--to", "3f", "-o", folder / "part.pcap")
    whole = [np.count_nonzero(scans[0].field("RANGE")) for scans in open_source(str(capture), meta=[str(meta)])]
    part = [
        np.count_nonzero(scans[0].field("RANGE"))
        for scans in open_source(str(folder / "part.pcap"), meta=[str(meta)])
    ]
    assert part == whole[1:3], (part, whole)
    return f"revolutions of {part} returns"


def cut_velodyne(program, folder, capture):
    import velodyne_decoder as vd

    run(program, "cut", capture, "--from", "1f", "--to", "3f", "-o", folder / "part.pcap")
    everything = vd.Config(min_range=0.0, max_range=1000.0)  # the default keeps 0.1 to 200 m
    counts = lambda path: [len(points) for _, points in vd.read_pcap(str(path), everything)]
    whole, part = counts(capture), counts(folder / "part.pcap")
    # the peer's revolutions begin a packet earlier or later
    assert len(part) == 2 and sum(part) == sum(whole[1:3]), (part, whole)
    return f"revolutions of {part} returns, of {whole}"


def main(program, capture, meta, poses, velodyne):
    passed = failed = 0
    for name, check in [
        ("world clouds", lambda folder: world_clouds(program, folder, capture, meta, poses)),
        ("cut Ouster packets", lambda folder: cut_ouster(program, folder, capture, meta)),
        ("cut Velodyne packets", lambda folder: cut_velodyne(program, folder, velodyne)),
    ]:
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(f"agrees: {name}: {check(pathlib.Path(folder))}")
                passed += 1
            except Exception as problem:  # every kind of disagreement is a failure
                print(f"DIFFERS: {name}: {type(problem).__name__}: {problem}")
                failed += 1
    print(f"{passed} passed, {failed} failed")
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
