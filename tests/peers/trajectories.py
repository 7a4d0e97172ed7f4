"""Trajectories that outrigger writes must mean to evo, the program that trajectories are compared by, what they mean here.

    python tests/peers/trajectories.py OUTRIGGER DEMO [CAPTURE META.json]

DEMO is the folder of a demo: the way of its session (TUM) has to be a valid trajectory for evo, as long and as fast as the
demo says it walked. Of the capture, what `odometry` writes as TUM and as KITTI has to be one trajectory for evo. Ends with
`N passed, N failed`; exit status 1 when a comparison failed.
"""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from evo.tools import file_interface


def is_valid(path):
    valid, details = path.check()
    assert valid, details


def the_demo_s_way_is_a_walk(_program, demo, _capture):
    way = file_interface.read_tum_trajectory_file(demo / "session" / "trajectory.tum")
    is_valid(way)
    seconds = way.timestamps[-1] - way.timestamps[0]
    straight_m = np.linalg.norm(way.positions_xyz[-1] - way.positions_xyz[0])
    # the sway of a gait is some per cent of the way and no more
    assert straight_m <= way.path_length < 1.2 * straight_m, (way.path_length, straight_m)
    assert 0.5 < straight_m / seconds < 3, f"{straight_m / seconds} m/s is no walk"
    created_s = json.loads((demo / "session" / "manifest.json").read_text())["created_ns"] * 1e-9
    assert abs(way.timestamps[0] - created_s) < 60, "times are those of the recording, in seconds"
    return f"{way.num_poses} poses, {way.path_length:.2f} m in {seconds:.1f} s"


def on_segment(position, number, begin, end):
    """How far a position is from a segment of the way, and where along the way that is."""
    share = np.clip((position - begin) @ (end - begin) / ((end - begin) @ (end - begin)), 0, 1)
    return np.linalg.norm(position - begin - share * (end - begin)), number + share


def odometry_as_tum_and_as_kitti_is_one(program, _demo, capture):
    with tempfile.TemporaryDirectory() as folder:
        files = [pathlib.Path(folder, name) for name in ("way.tum", "way.kitti")]
        command = [program, "odometry", capture[0], "--meta", capture[1], "--out", files[0], "--kitti", files[1]]
        result = subprocess.run(command, capture_output=True, text=True, timeout=600)
        assert result.returncode in (0, 3), f"odometry ended with {result.returncode}: {result.stderr.strip()}"
        tum = file_interface.read_tum_trajectory_file(files[0])
        kitti = file_interface.read_kitti_poses_file(files[1])
    is_valid(tum)
    is_valid(kitti)
    assert kitti.num_poses > 1, "a pose for each revolution"
    # KITTI has no times: its poses, one in the middle of each revolution, lie on the other's way, one after the other
    way, reached = tum.positions_xyz, 0.0
    for position in kitti.positions_xyz:
        off, along = min(on_segment(position, number, *way[number:number + 2]) for number in range(len(way) - 1))
        assert off < 1e-6 and along >= reached, f"a pose of KITTI is {off} m beside the way, at {along} after {reached}"
        reached = along
    return f"{tum.num_poses} and {kitti.num_poses} poses, {tum.path_length:.3f} m"


def main(program, demo, *capture):
    checks = [the_demo_s_way_is_a_walk] + ([odometry_as_tum_and_as_kitti_is_one] if capture else [])
    outcomes = []
    for check in checks:
        try:
            said = check(program, pathlib.Path(demo), capture)
            outcomes.append(True)
            print(f"agrees: {check.__name__}: {said}")
        except Exception as problem:  # whatever evo thinks of it
            outcomes.append(False)
            print(f"DIFFERS: {check.__name__}: {type(problem).__name__}: {problem}")
    print(f"{sum(outcomes)} passed, {len(outcomes) - sum(outcomes)} failed")
    return 0 if all(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
