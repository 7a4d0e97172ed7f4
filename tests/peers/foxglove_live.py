"""Another WebSocket client and Google's protobuf read what the daemon tells Foxglove, by the schemas it advertises alone.

    python tests/peers/foxglove_live.py OUTRIGGER

Ends with `N passed, N failed`; exit status 1 when a check failed.
"""

import base64
import contextlib
import json
import pathlib
import socket
import struct
import subprocess
import sys
import tempfile
import time

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

BOX = (-6, -4, -1.5, 6, 4, 2)
MOUNT = {"x_m": -0.2, "y_m": 0.1, "z_m": 0.3, "pitch_deg": 20.0, "roll_deg": 0.0}


def expect(what, found, wanted):
    if found != wanted:
        raise AssertionError(f"{what}: found {found!r}, wanted {wanted!r}")


@contextlib.contextmanager
def running(command, **more):
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **more)
    try:
        yield child
    finally:
        child.terminate()
        child.wait(20)


def document(child):
    text = ""
    for line in child.stdout:
        text += line
        with contextlib.suppress(json.JSONDecodeError):
            return json.loads(text)
    raise AssertionError(f"it ended before it was ready: {text}")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def reader(channel):
    """A class that reads the messages of a channel, from nothing but what was advertised."""
    pool = descriptor_pool.DescriptorPool()
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"], validate=True))
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


def rotate(quaternion, points):
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    matrix = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    return points @ matrix.T


def off_the_walls(points):
    corners = np.array(BOX, float).reshape(2, 3)
    return np.abs(points[:, None, :] - corners[None]).min(axis=(1, 2))


def is_read(url):
    with connect(url, subprotocols=["foxglove.websocket.v1"], max_size=None) as socket_:
        expect("subprotocol", socket_.subprotocol, "foxglove.websocket.v1")
        expect("first message", json.loads(socket_.recv(30))["op"], "serverInfo")
        channels = {channel["topic"]: channel for channel in json.loads(socket_.recv(30))["channels"]}
        expect("topics", sorted(channels), ["/coverage/voxels", "/left/points", "/rig/joints", "/rig/state", "/tf"])
        ids = {5 + number: topic for number, topic in enumerate(channels)}
        socket_.send(json.dumps({"op": "subscribe", "subscriptions": [
            {"id": number, "channelId": channels[topic]["id"]} for number, topic in ids.items()]}))
        newest, until = {}, time.monotonic() + 60
        while time.monotonic() < until:
            message = socket_.recv(60)
            opcode, number, time_ns = struct.unpack_from("<BIQ", message)
            expect("opcode", opcode, 1)
            assert abs(time_ns * 1e-9 - time.time()) < 60, "times are of now"
            newest[ids[number]] = message[13:]
            if len(newest) < len(ids):
                continue
            grid = reader(channels["/coverage/voxels"]).FromString(newest["/coverage/voxels"])
            states = np.frombuffer(grid.data, np.uint8)[[field.name for field in grid.fields].index("state")::grid.cell_stride]
            if (states == 2).sum() > 50:
                break
        else:
            raise AssertionError(f"only {sorted(newest)} came, or no cell that was promised is seen")
    frames = {frame.child_frame_id: frame for frame in reader(channels["/tf"]).FromString(newest["/tf"]).transforms}
    expect("parents", {name: frame.parent_frame_id for name, frame in frames.items()}, {"body": "world", "left": "body"})
    cloud = reader(channels["/left/points"]).FromString(newest["/left/points"])
    expect("frame", cloud.frame_id, "left")
    rows = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_stride)
    offsets = {field.name: field.offset for field in cloud.fields}
    points = np.stack([rows[:, offsets[axis]:offsets[axis] + 4].copy().view("<f4")[:, 0] for axis in "xyz"], 1)
    assert len(points) > 10_000, f"only {len(points)} points"
    place = frames["left"]
    in_world = rotate(place.rotation, points) + [place.translation.x, place.translation.y, place.translation.z]
    assert off_the_walls(in_world).max() < 0.05, f"{off_the_walls(in_world).max()} m off every wall"
    cells = len(states) == grid.column_count * grid.row_count * (len(grid.data) // grid.slice_stride)
    assert cells and grid.frame_id == "world", "the block of cells is whole"
    joints = reader(channels["/rig/joints"]).FromString(newest["/rig/joints"]).joints
    expect("axes", [joint.name for joint in joints], ["axis_0", "axis_1"])
    state = json.loads(newest["/rig/state"])
    expect("rig", (state["connected"], len(state["status"]["axes"])), (True, 2))


def others_are_refused(url):
    for protocols in (None, ["something.else"]):
        try:
            with connect(url, subprotocols=protocols):
                raise AssertionError(f"{protocols} was let in")
        except InvalidStatus as refusal:
            expect("answer", refusal.response.status_code, 400)
    try:
        with connect(url, subprotocols=["foxglove.websocket.v1"], origin="https://evil.example"):
            raise AssertionError("another site was let in")
    except InvalidStatus as refusal:
        expect("answer", refusal.response.status_code, 403)


def main(program):
    outcomes = []
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        folder, port = pathlib.Path(folder), free_port()
        rig = document(stack.enter_context(running([program, "--json", "mock", "rig"])))["port"]
        # the rig stands anywhere when it is switched on, and the sensor with it
        state = json.loads(subprocess.run([program, "--json", "rig", "status", "--port", rig], capture_output=True, text=True,
                                          timeout=60, check=True).stdout)
        pitch_deg = state["axes"][0]["position_deg"]
        box = ",".join(map(str, BOX))
        mount = ",".join(str(MOUNT[key]) for key in ("x_m", "y_m", "z_m", "pitch_deg", "roll_deg"))
        stack.enter_context(running([
            program, "mock", "sensor", "--model", "os1-64", "--to", f"127.0.0.1:{port}", "--metadata",
            folder / "left.json", f"--box={box}", f"--mount={mount}", f"--actual-pitch-deg={pitch_deg}"]))
        until = time.monotonic() + 30
        while not (folder / "left.json").exists() and time.monotonic() < until:
            time.sleep(0.05)
        sensor = {"name": "left", "model": "os1-64", **MOUNT}
        (folder / "mount.json").write_text(json.dumps({"format": "outrigger-mount/1", "frame": "mount: x right, y forward, z up", "sensors": [sensor]}))
        (folder / "rig.toml").write_text(f'''format = "outrigger-rig/1"
[[sensor]]
name = "left"
model = "os1-64"
listen = "127.0.0.1:{port}"
metadata = "left.json"
[rig]
port = "{rig}"
[predict]
mount = "mount.json"
room = "{box}"
''')
        daemon = stack.enter_context(running([
            program, "--json", "daemon", "--config", folder / "rig.toml", "--listen", "127.0.0.1:0", "--out",
            folder / "sessions"], stderr=subprocess.DEVNULL))
        url = document(daemon)["url"].replace("http", "ws") + "api/v1/foxglove"
        for check in (is_read, others_are_refused):
            try:
                check(url)
                outcomes.append(True)
                print(f"passed {check.__name__}")
            except Exception as error:
                outcomes.append(False)
                print(f"FAILED {check.__name__}: {type(error).__name__}: {error}")
    print(f"{sum(outcomes)} passed, {len(outcomes) - sum(outcomes)} failed")
    return 0 if all(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
