"""Ouster's own client talks to the web interface of outrigger's mock sensor, and sees what outrigger set there.

    python tests/peers/sensor_web.py OUTRIGGER

Ends with `N passed, N failed`; exit status 1 when a check failed.
"""

import contextlib
import json
import socket
import subprocess
import sys
import time

import ouster.sdk.sensor as sensor
from ouster.sdk.core import SensorConfig, SensorInfo


def expect(what, found, wanted):
    if found != wanted:
        raise AssertionError(f"{what}: found {found!r}, wanted {wanted!r}")


@contextlib.contextmanager
def mock(program, *options):
    """A mock sensor that sends to a socket here: its web address, and that socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
        to.bind(("127.0.0.1", 0))
        command = [program, "mock", "sensor", "--json", "--model", "os1-64", "--http", "0", "--to",
                   f"127.0.0.1:{to.getsockname()[1]}", *options]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            yield json.loads(child.stdout.readline())["http"], to
        finally:
            child.kill()
            child.wait(10)


def outrigger(program, *arguments, code=0):
    done = subprocess.run([program, "sensor", *arguments, "--json"], capture_output=True, text=True, timeout=120)
    expect(f"sensor {' '.join(arguments)}: {done.stderr}", done.returncode, code)
    return json.loads(done.stdout)


def reads_it(program):
    for options in ((), ("--old-firmware",)):
        with mock(program, *options) as (address, _):
            http = sensor.SensorHttp.create(address)
            version = http.firmware_version()
            expect("firmware", (version.major, version.minor), (2, 4) if options else (3, 2))
            info = SensorInfo(http.metadata())
            state = outrigger(program, "info", address)["sensors"][0]
            expect("serial", str(info.sn), state["serial"])
            expect("product line", info.prod_line, state["model"])
            expect("beams", len(info.beam_altitude_angles), 64)
            config = sensor.get_config(address)
            expect("port", config.udp_port_lidar, state["destination"]["port"])
            expect("destination", config.udp_dest, state["destination"]["host"])


def sets_it(program):
    for options in ((), ("--old-firmware",)):
        with mock(program, *options) as (address, _), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
            there.bind(("127.0.0.1", 0))
            there.settimeout(20)
            config = SensorConfig()
            config.udp_port_lidar = there.getsockname()[1]
            config.azimuth_window = (90000, 270000)
            sensor.set_config(address, config, persist=True, udp_dest_auto=True)
            state = outrigger(program, "info", address)["sensors"][0]
            expect("port", state["destination"]["port"], config.udp_port_lidar)
            expect("window", state["settings"]["azimuth_window"], [90000, 270000])
            expect("packets at the new port", len(there.recv(65536)) > 1000, True)


def sees_what_outrigger_set(program):
    for options in ((), ("--old-firmware",)):
        with mock(program, *options) as (address, _):
            outrigger(program, "configure", address, "--dest", "auto", "--lidar-port", "17502", "--set", "azimuth_window=[0,180000]", "--save")
            config = sensor.get_config(address)
            expect("port", config.udp_port_lidar, 17502)
            expect("window", tuple(config.azimuth_window), (0, 180000))
            expect("destination", config.udp_dest, "127.0.0.1")
            expect("staged is active", sensor.get_config(address, active=False).udp_port_lidar, 17502)


CHECKS = (reads_it, sets_it, sees_what_outrigger_set)

if __name__ == "__main__":
    failed = 0
    for check in CHECKS:
        begun = time.monotonic()
        try:
            check(sys.argv[1])
            print(f"{check.__name__}: ok ({time.monotonic() - begun:.1f} s)")
        except Exception as error:  # what the client raises is its judgement
            failed += 1
            print(f"{check.__name__}: {type(error).__name__} {error}")
    print(f"{len(CHECKS) - failed} passed, {failed} failed")
    sys.exit(failed > 0)
