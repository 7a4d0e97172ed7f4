"""The fan of a 64 x 1024 sensor through a mesh by Open3D (Embree) on one thread, its hits counted in voxels by numpy.

Arguments: mesh (two u64 counts, f32 vertices, u32 triangles), voxel edge, x, y, z, pitch in degrees. Prints processor
time per ray in ns of casting and of casting with counting, the voxels hit, and the mean range.
"""

import os
import sys
import time

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
import numpy as np
import open3d as o3d

data = open(sys.argv[1], "rb").read()
vertices, triangles = (int(n) for n in np.frombuffer(data, np.uint64, 2))
v = np.frombuffer(data, np.float32, 3 * vertices, 16).reshape(-1, 3).copy()
f = np.frombuffer(data, np.uint32, 3 * triangles, 16 + 12 * vertices).reshape(-1, 3).copy()
voxel, x, y, z, pitch = (float(word) for word in sys.argv[2:7])
scene = o3d.t.geometry.RaycastingScene(nthreads=1)
scene.add_triangles(o3d.core.Tensor(v), o3d.core.Tensor(f))

c, s = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
e, a = np.meshgrid(np.radians(np.linspace(-21.2, 21.2, 64)), 2 * np.pi * np.arange(1024) / 1024)
e, a = e.ravel(), a.ravel()
directions = np.stack([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)], 1) @ turn.T
origin = np.array([x, y, z])
rays = np.concatenate([np.broadcast_to(origin, directions.shape), directions], 1).astype(np.float32)
tensor = o3d.core.Tensor(rays)
low = v[f].reshape(-1, 3).min(0).astype(float) - 0.5 * voxel
size = np.round((v[f].reshape(-1, 3).max(0) - v[f].reshape(-1, 3).min(0)) / voxel).astype(np.int64) + 1
seen = np.zeros(size.prod(), bool)
cast_s, all_s = [], []
for _ in range(11):
    start = time.process_time()
    t = scene.cast_rays(tensor, nthreads=1)["t_hit"].numpy()
    cast_s.append(time.process_time() - start)
    hit = np.isfinite(t)
    points = origin + t[hit, None] * directions[hit]
    cell = np.floor((points - low) / voxel).astype(np.int64)
    seen[cell[:, 0] + size[0] * (cell[:, 1] + size[1] * cell[:, 2])] = True
    all_s.append(time.process_time() - start)
per_ray = 1e9 / len(rays)
print(np.median(cast_s) * per_ray, np.median(all_s) * per_ray, int(seen.sum()), float(t[hit].mean()))
