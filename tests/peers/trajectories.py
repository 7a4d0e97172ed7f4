"""Trajectories that outrigger writes and reads must mean the same to evo, the program that trajectories are judged by.

    python tests/peers/trajectories.py OUTRIGGER

A demo is walked; its session's trajectory (TUM) and that of `odometry` are read by evo, whose absolute pose error between
the two must be what outrigger's own accuracy allows; the same way as KITTI poses must evaluate to the same coverage. Ends
with `N passed, N failed`; exit status 1 when a comparison failed.
"""

import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from evo.core import metrics, sync
from evo.tools import file_interface

# of the demo's walk of 20 m in a hall, aligned: odometry against the way that the mock sensors went
MOST_ERROR_M = 0.05


def run(program, *arguments):
    result = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=600)
    assert result.returncode in (0, 3), f"{arguments[0]} ended with {result.returncode}: {result.stderr.strip()}"
    return result.stdout


def the_session_s_trajectory_is_whole(session, _odometry):
    path = file_interface.read_tum_trajectory_file(session / "trajectory.tum")
    valid, details = path.check()
    assert valid, details
    assert path.num_poses > 10 and path.path_length > 5, (path.num_poses, path.path_length)
    return f"{path.num_poses} poses, {path.path_length:.2f} m"


def odometry_went_the_same_way(session, odometry):
    truth = file_interface.read_tum_trajectory_file(session / "trajectory.tum")
    found = file_interface.read_tum_trajectory_file(odometry)
    valid, details = found.check()
    assert valid, details
    # the truth has few poses and straight lines between them: both at the times of the fewer
    truth, found = sync.associate_trajectories(truth, found, max_diff=0.06)
    found.align(truth)
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data((truth, found))
    rms_m = error.get_statistic(metrics.StatisticsType.rmse)
    assert truth.num_poses > 5 and rms_m < MOST_ERROR_M, f"{rms_m} m over {truth.num_poses} poses"
    return f"{1000 * rms_m:.1f} mm over {truth.num_poses} poses"


CHECKS = [the_session_s_trajectory_is_whole, odometry_went_the_same_way]


def main(program):
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        run(program, "demo", "--out", folder / "demo")
        session, odometry = folder / "demo" / "session", folder / "odometry.tum"
        run(program, "odometry", session, "--out", odometry)
        for check in CHECKS:
            try:
                said = check(session, odometry)
                outcomes.append(True)
                print(f"agrees: {check.__name__}: {said}")
            except Exception as problem:  # whatever evo thinks of it
                outcomes.append(False)
                print(f"DIFFERS: {check.__name__}: {type(problem).__name__}: {problem}")
    print(f"{sum(outcomes)} passed, {len(outcomes) - sum(outcomes)} failed")
    return 0 if all(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
