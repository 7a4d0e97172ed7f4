"""What the program does on real CAN interfaces; run by tests/can/run.sh inside a virtual machine.

    python tests/can/checks.py OUTRIGGER

Each check gets an interface of its own. Ends with `N passed, N failed`; exit status 1 when a check failed.
"""

import contextlib
import fcntl
import os
import pathlib
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
import tty

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "peers"))

import rig as peers  # noqa: E402

ERROR, EXTENDED = 0x20000000, 0x80000000
HELLO = bytes([1, 1]) + struct.pack("<HI", 1000, 77)


def ip(*arguments):
    subprocess.run(["/tmp/busybox", "ip", "link", *arguments], check=True)


@contextlib.contextmanager
def interface(name, mtu=16):
    ip("add", "dev", name, "type", "vcan")
    ip("set", name, "mtu", str(mtu))
    ip("set", name, "up")
    try:
        yield name
    finally:
        with contextlib.suppress(subprocess.CalledProcessError):
            ip("del", name)


def raw(name, fd=False):
    bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    if fd:
        bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    bus.bind((name,))
    return bus


def classic(identifier, data):
    return struct.pack("=IB3x8s", identifier, len(data), data.ljust(8, b"\0"))


def flexible(identifier, data):
    return struct.pack("=IBB2x64s", identifier, len(data), 1, data.ljust(64, b"\0"))


def to_rig(message, node=1):
    return 2 << 26 | 0b10110 << 21 | 1 << 16 | message << 8 | node | EXTENDED


@contextlib.contextmanager
def program(*arguments):
    child = subprocess.Popen([sys.argv[1], *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True)
    try:
        yield child
    finally:
        child.kill()
        child.wait()


@contextlib.contextmanager
def mock(name, *options):
    with program("mock", "rig", "--can", name, *options) as child:
        peers.expect("mock rig", child.stdout.readline().strip(), f"can:{name}")
        yield child


def rig(name, *arguments, code=0):
    return peers.rig(sys.argv[1], f"can:{name}", *arguments, code=code)


@contextlib.contextmanager
def watching(name):
    """A host that watches the rig; `ended` waits for it and gives what it said."""
    with program("rig", "--port", f"can:{name}", "watch", "--json") as child:
        child.stdout.readline()

        def ended():
            said = child.communicate(timeout=30)[1]
            peers.expect("exit status of watch", child.returncode, 1)
            return said

        yield ended


def others_on_the_bus():
    """Standard, extended and FD messages of others, requests, and error frames do not disturb."""
    with interface("vcan0", mtu=72) as name, mock(name):
        bus, busy = raw(name, fd=True), True
        noise = [
            classic(0x123, b"others"),
            classic(0x7FF, b""),
            classic(0x1ABCDE | EXTENDED, b"12345678"),
            classic(0x123 | 0x40000000, b""),
            flexible(0x321, bytes(range(64))),
            flexible(to_rig(0x12), bytes(48)),
            classic(to_rig(0x12), b"short"),
            classic(ERROR | 0x4, bytes([0, 0x10, 0, 0, 0, 0, 0, 0])),  # the controller is error-passive
        ]

        def talk():
            while busy:
                for frame in noise:
                    bus.send(frame)
                time.sleep(0.005)

        talker = threading.Thread(target=talk, daemon=True)
        talker.start()
        rig(name, "home", "--arm")
        peers.expect_at(rig(name, "set", "15", "-15", "--arm"), [15, -15])
        status = rig(name, "status")
        busy = False
        talker.join()
        errors = status["axes"][0]["device_errors"]
        peers.expect("error frame", len(errors) == 1 and "rx" in errors[0].lower() and "passive" in errors[0].lower(), True)


def off_the_bus():
    with interface("vcan1") as name, mock(name), watching(name) as ended:
        raw(name).send(classic(ERROR | 0x40, bytes(8)))
        peers.expect_said("bus-off", ended(), "off the bus")


def interface_down():
    with interface("vcan2") as name, mock(name):
        rig(name, "home", "--arm")
        with watching(name) as ended:
            ip("set", name, "down")
            peers.expect_said("interface down", ended(), "hung up")
        peers.expect_said("still down", rig(name, "status", code=1), "rig cable")
        ip("set", name, "up")
        status = rig(name, "status")
        peers.expect("up again", [axis["state"] for axis in status["axes"]], ["idle", "idle"])


def interface_deleted():
    with interface("vcan3") as name, mock(name):
        with watching(name) as ended:
            ip("del", name)
            peers.expect_said("interface deleted", ended(), "hung up")
        peers.expect_said("gone", rig(name, "status", code=1), f"cannot open can:{name}")


@contextlib.contextmanager
def stuck_adapter():
    """A CAN interface of the kernel behind a serial adapter that takes nothing: its queue of two fills."""
    master, slave = os.openpty()
    tty.setraw(slave)
    fcntl.ioctl(slave, termios.TIOCSETD, struct.pack("i", 17))  # N_SLCAN
    name = fcntl.ioctl(slave, 0x8910, bytes(40))[:16].split(b"\0")[0].decode()  # SIOCGIFNAME
    pathlib.Path(f"/sys/class/net/{name}/tx_queue_len").write_text("2")
    ip("set", name, "up")
    try:
        yield name, master
    finally:
        os.close(slave)
        os.close(master)


def queue_full():
    with stuck_adapter() as (name, master):
        said = rig(name, "status", code=1)
        peers.expect_said("full queue", said, f"send queue of can:{name}", "no device on the bus acknowledges", "not sent")
        said = peers.rig(sys.argv[1], f"cia402:{name}@1,2", "status", code=1)
        peers.expect_said("full queue", said, f"send queue of cia402:{name}", "not sent")
        # an adapter that is slow, not dead: what was offered again arrives, every message once
        os.set_blocking(master, False)
        with contextlib.suppress(BlockingIOError):
            while os.read(master, 65536):
                pass
        heard = bytearray()

        def read_slowly():
            end = time.monotonic() + 4
            while time.monotonic() < end:
                with contextlib.suppress(BlockingIOError):
                    heard.extend(os.read(master, 64))
                time.sleep(0.05)

        reader = threading.Thread(target=read_slowly)
        reader.start()
        said = rig(name, "status", code=1)
        reader.join()
        peers.expect_said("nobody answers, and that is what it says", said, "no answer to hello")
        hellos = [line for line in bytes(heard).split(b"\r") if line.startswith(b"T%08X" % (to_rig(1) & 0x1FFFFFFF))]
        peers.expect("hellos that arrived", len(hellos) >= 5, True)


def two_hosts():
    """Two hosts and two rigs on one bus; then two hosts and one rig."""
    with interface("vcan4") as name, mock(name, "--node", "1"), mock(name, "--node", "2", "--seed", "2"):
        rig(name, "home", "--arm")
        rig(name, "home", "--arm", "--node", "2")
        moves = [program("rig", "--port", f"can:{name}", "--node", node, "--arm", "--json", "set", pitch, pitch)
                 for node, pitch in (("1", "12"), ("2", "-8"))]
        with moves[0] as first, moves[1] as second:
            for child in (first, second):
                said = child.communicate(timeout=60)[1]
                peers.expect(f"both move: {said}", child.returncode, 0)
        peers.expect_at(rig(name, "status"), [12, 12])
        peers.expect_at(rig(name, "status", "--node", "2"), [-8, -8])
        with watching(name) as ended:
            rig(name, "status")
            peers.expect_said("taken over", ended(), "another program took it over")


def one_node_number_twice():
    with interface("vcan5") as name, mock(name, "--seed", "1"), mock(name, "--seed", "2"):
        said = rig(name, "status", code=1)
        peers.expect_said("two rigs", said, "two rigs answer as node 1", "4f55545249470001", "4f55545249470002")


@contextlib.contextmanager
def drives(name, nodes, homing_method="0"):
    script = pathlib.Path(__file__).parent.parent / "peers" / "drives.py"
    child = subprocess.Popen([sys.executable, script, name, nodes, homing_method], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    peers.expect("drives", child.stdout.readline().strip(), "ready")

    def tell(node, what):
        child.stdin.write(f"{what} {node}\n")
        child.stdin.flush()
        peers.expect(what, child.stdout.readline().strip(), "done")

    try:
        yield tell
    finally:
        child.kill()
        child.wait()


def cia402_drives():
    with interface("vcan6") as name, drives(name, "1,2") as tell:
        peers.check_drives(sys.argv[1], f"cia402:{name}@1,2", tell)


def cia402_homing():
    with interface("vcan9") as name, drives(name, "1,2", "17") as tell:
        peers.check_homing(sys.argv[1], f"cia402:{name}@1,2", tell)


def one_drive_number_twice():
    with interface("vcan7") as name, drives(name, "1,2"), drives(name, "2"):
        said = peers.rig(sys.argv[1], f"cia402:{name}@1,2", "status", code=1)
        peers.expect_said("two drives", said, "node 2", "two devices answer")


def time_to_answer():
    """Not a check: how long a question takes to its answer."""
    with interface("vcan8") as name, mock(name):
        bus = raw(name)
        bus.settimeout(2)
        times_us = []
        for number in range(300):
            answered = False
            while not answered:  # an answer that a starved reader's buffer lost is asked for again
                asked = time.perf_counter()
                bus.send(classic(to_rig(0x05), struct.pack("<H", number)))
                while not answered and time.perf_counter() < asked + 1:
                    identifier, length, data = struct.unpack("=IB3x8s", bus.recv(16))
                    is_answer = identifier >> 8 & 0xFF == 0x05 and identifier & 0x80
                    answered = is_answer and data[:2] == struct.pack("<H", number)
            times_us.append((time.perf_counter() - asked) * 1e6)
        times_us.sort()
        print(f"question to answer over SocketCAN in the emulated machine: p50 {times_us[150]:.0f} us, p99 {times_us[297]:.0f} us")


CHECKS = (others_on_the_bus, off_the_bus, interface_down, interface_deleted, queue_full, two_hosts, one_node_number_twice,
          cia402_drives, cia402_homing, one_drive_number_twice, time_to_answer)

if __name__ == "__main__":
    failed = 0
    for check in CHECKS:
        begun = time.monotonic()
        try:
            check()
            print(f"{check.__name__}: ok ({time.monotonic() - begun:.1f} s)", flush=True)
        except Exception as error:  # a check that broke in any way failed, and the others still run
            failed += 1
            print(f"{check.__name__}: {type(error).__name__} {error}", flush=True)
    print(f"{len(CHECKS) - failed} passed, {failed} failed", flush=True)
    sys.exit(failed > 0)
