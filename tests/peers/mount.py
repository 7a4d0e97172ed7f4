"""What `outrigger mount` writes must mean to other people's programs what the mount file says.

    python tests/peers/mount.py OUTRIGGER

ezdxf reads the drawing: its audit finds no error, and what its dimensions measure are the positions of the mount file.
yourdfpy reads the URDF: with its joints at the pitches, every frame is where the YAML for tf says, and a pitch of +30 degrees
points up where the hand calculation says. Ends with `N passed, N failed`; exit status 1 when a comparison failed.
"""

import json
import math
import pathlib
import subprocess
import sys
import tempfile

import ezdxf
import numpy as np
import yaml
import yourdfpy

SENSORS = [
    {"name": "right", "model": "os1-64", "x_m": 0.1234, "y_m": 0.05, "z_m": 0.119, "pitch_deg": 30.0, "roll_deg": 0.0},
    {"name": "left", "model": "os0-128", "x_m": -0.1, "y_m": -0.07, "z_m": 0.119, "pitch_deg": -41.5, "roll_deg": 3.25,
     "yaw_deg": 17.0, "angle_tolerance_deg": 0.5},
    {"name": "front", "model": "vlp-16", "x_m": 0.0, "y_m": 0.31, "z_m": 0.2, "pitch_deg": 12.0, "roll_deg": -12.0,
     "yaw_deg": -90.0},
]


def written(program, folder):
    mount = folder / "mount.json"
    mount.write_text(json.dumps({"format": "outrigger-mount/1", "frame": "mount: x right, y forward, z up",
                                 "sensors": SENSORS}))
    command = [program, "mount", mount, "--drawing", folder / "mount.dxf", "--urdf", folder / "rig.urdf",
               "--tf", folder / "rig.yaml"]
    subprocess.run(command, check=True, capture_output=True, timeout=60)


def the_drawing_measures_the_mount(folder):
    drawing = ezdxf.readfile(folder / "mount.dxf")
    assert drawing.dxfversion == "AC1009", drawing.dxfversion
    audit = drawing.audit()
    assert not audit.errors and not audit.fixes, [entry.message for entry in audit.errors + audit.fixes]
    found = sorted(dimension.get_measurement() for dimension in drawing.modelspace().query("DIMENSION"))
    # y in the top and the side view, x and z in the front view; each value once, none for zero
    of = {axis: {1000 * abs(sensor[axis]) for sensor in SENSORS} - {0} for axis in ("x_m", "y_m", "z_m")}
    expected = sorted([*of["x_m"], *of["y_m"], *of["y_m"], *of["z_m"]])
    assert np.allclose(found, expected, atol=0.01), (found, expected)
    for dimension in drawing.modelspace().query("DIMENSION"):
        assert abs(float(dimension.dxf.text) - dimension.get_measurement()) < 0.01
    circles = [circle for circle in drawing.modelspace().query("CIRCLE") if circle.dxf.layer in ("OUTLINE", "PHANTOM")]
    places = {round(circle.dxf.radius, 2): circle.dxf.center for circle in circles}
    across = places[51.65] - places[43.5]
    assert len({43.5, 51.65} & places.keys()) == 2 and abs(across.y) > 100, places
    return f"{len(found)} dimensions, ezdxf {ezdxf.__version__}"


def quaternion_matrix(x, y, z, w):
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def urdf_has_the_frames_of_tf(folder):
    robot = yourdfpy.URDF.load(str(folder / "rig.urdf"))
    pitches = {f"{sensor['name']}_pitch": math.radians(sensor["pitch_deg"]) for sensor in SENSORS}
    assert set(robot.actuated_joint_names) == pitches.keys(), robot.actuated_joint_names
    robot.update_cfg(pitches)
    frames = {"base_link": np.eye(4)}
    transforms = yaml.safe_load((folder / "rig.yaml").read_text())["transforms"]
    for transform in transforms:
        at, by = transform["transform"]["translation"], transform["transform"]["rotation"]
        parent_from_frame = np.eye(4)
        parent_from_frame[:3, :3] = quaternion_matrix(by["x"], by["y"], by["z"], by["w"])
        parent_from_frame[:3, 3] = at["x"], at["y"], at["z"]
        name, parent = transform["child_frame_id"], transform["header"]["frame_id"]
        frames[name] = frames[parent] @ parent_from_frame
        off = np.abs(robot.get_transform(name, "base_link") - frames[name]).max()
        assert off < 1e-6, (name, off)
    up = robot.get_transform("right_os_sensor", "base_link")[:3, 2]
    # R = Rx(roll) Ry(pitch) in x right, y forward, z up: up becomes (sin 30, 0, cos 30), in the body (0, -sin 30, cos 30)
    assert np.allclose(up, [0, -0.5, math.sqrt(3) / 2], atol=1e-6), up
    return f"{len(transforms)} frames within 1e-6"


def main():
    program = pathlib.Path(sys.argv[1]).resolve()
    passed = failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        written(program, folder)
        for check in (the_drawing_measures_the_mount, urdf_has_the_frames_of_tf):
            try:
                print(f"ok   {check.__name__}: {check(folder)}")
                passed += 1
            except AssertionError as error:
                print(f"FAIL {check.__name__}: {error}")
                failed += 1
    print(f"{passed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


main()
