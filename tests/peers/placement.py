"""KISS-Matcher and point-to-plane ICP on the walks that outrigger placed, in the same scenes.

placement.py WALKS SCENES: WALKS is the folder that OUTRIGGER_CLOUDS=WALKS makes the statistics of the alignment write (the returns of
each walk in a frame of its own, as float32 x, y, z, and what outrigger found), SCENES that of the meshes. As there, a walk is right
within 0.1 m and 0.5 degrees of the best rigid fit after refinement.
"""

import json
import sys
import time
from pathlib import Path

import kiss_matcher
import numpy as np
import open3d

VOXEL_M = 0.25
POINTS_PER_M2 = 100.0


def refined(walk, scene, start):
    """ICP with shrinking gates."""
    transform = start
    for gate_m in (1.0, 0.3, 0.1):
        estimate = open3d.pipelines.registration.TransformationEstimationPointToPlane()
        transform = open3d.pipelines.registration.registration_icp(walk, scene, gate_m, transform, estimate).transformation
    return transform


def off(found, best, middle):
    """Distance in the middle of the walk, m, and angle, degrees."""
    apart = found @ np.append(middle, 1.0) - best @ np.append(middle, 1.0)
    turned = found[:3, :3].T @ best[:3, :3]
    return np.linalg.norm(apart[:3]), np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))


def place(points, scene_points):
    config = kiss_matcher.KISSMatcherConfig(VOXEL_M)
    solution = kiss_matcher.KISSMatcher(config).estimate(points, scene_points)
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = solution.rotation, np.asarray(solution.translation).ravel()
    return transform


def cloud_of(points):
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(float)))


def main():
    walks, scenes = map(Path, sys.argv[1:3])
    for name in sorted({file.name.split("-")[0] for file in walks.glob("*.json")}):
        mesh = open3d.io.read_triangle_mesh(str(scenes / f"{name}.ply"))
        mesh.compute_triangle_normals()
        open3d.utility.random.seed(1)
        scene = mesh.sample_points_uniformly(int(mesh.get_surface_area() * POINTS_PER_M2), use_triangle_normal=True)
        scene = scene.voxel_down_sample(VOXEL_M / 2)
        scene_points = np.asarray(scene.points, dtype=np.float32)
        right, seconds, ours, ours_s = 0, [], 0, []
        files = sorted(walks.glob(f"{name}-*.json"))
        for file in files:
            found = json.loads(file.read_text())
            points = np.fromfile(file.with_suffix(".f32"), dtype="<f4").reshape(-1, 3)
            walk = cloud_of(points).voxel_down_sample(VOXEL_M / 2)
            begin = time.perf_counter()
            start = place(np.asarray(walk.points, dtype=np.float32), scene_points)
            seconds.append(time.perf_counter() - begin)
            off_m, turned_deg = off(refined(walk, scene, start), np.array(found["scene_from_walk"]), found["middle_m"])
            right += off_m < 0.1 and turned_deg < 0.5
            ours += found["off_m"] < 0.1 and found["turned_deg"] < 0.5
            ours_s.append(found["seconds"])
        print(f"{name}: KISS-Matcher {right} of {len(files)}, median {np.median(seconds):.2f} s; outrigger {ours}, median {np.median(ours_s):.2f} s")


if __name__ == "__main__":
    main()
