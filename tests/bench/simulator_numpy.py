"""The published evaluation in vectorised numpy: prints the voxels seen and the median processor time in ms.

Arguments: beams, field of view in degrees, axis of the walk (0 or 1), mounts as JSON [[x, y, z, pitch_deg, roll_deg]].
"""

import json
import sys
import time

import numpy as np

beams, fov, axis = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
mounts = json.loads(sys.argv[4])
LOW, HIGH, VOXEL = np.array([-25.0, -25.0, 0.0]), np.array([25.0, 25.0, 20.0]), 0.5
CELLS = ((HIGH - LOW) / VOXEL).astype(int)
azimuth = np.radians(np.arange(180) * 2.0)
elevation = np.radians(np.linspace(-fov / 2, fov / 2, beams))
local = np.stack(
    [
        np.outer(np.cos(azimuth), np.cos(elevation)).ravel(),
        np.outer(np.sin(azimuth), np.cos(elevation)).ravel(),
        np.tile(np.sin(elevation), 180),
    ]
)


def evaluate():
    union = np.zeros(CELLS.prod(), bool)
    for x, y, z, pitch, roll in mounts:
        sp, cp = np.sin(np.radians(pitch)), np.cos(np.radians(pitch))
        sr, cr = np.sin(np.radians(roll)), np.cos(np.radians(roll))
        rotation = np.array([[cp, 0, sp], [sr * sp, cr, -sr * cp], [-cr * sp, sr, cr * cp]])
        direction = (rotation @ local).T
        direction = direction[(direction != 0).all(axis=1)]
        inverse = 1 / direction
        wall = np.where(direction > 0, HIGH, LOW)
        for station in range(-20, 21):
            origin = np.array([x, y, z + 1.6])
            origin[axis] += station
            exit_m = ((wall - origin) * inverse).min(axis=1)
            hit = np.clip(origin + exit_m[:, None] * direction, LOW + 0.25 * VOXEL, HIGH - 0.25 * VOXEL)
            cell = np.floor((hit - LOW) / VOXEL).astype(np.int64)
            union[cell[:, 0] + CELLS[0] * (cell[:, 1] + CELLS[1] * cell[:, 2])] = True
    return int(union.sum())


times = []
for _ in range(3):
    start = time.process_time()
    seen = evaluate()
    times.append(1e3 * (time.process_time() - start))
print(seen, sorted(times)[1])
