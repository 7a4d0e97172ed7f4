"""Other people's programs talk to outrigger's mock rigs.

    python tests/peers/rig.py OUTRIGGER [CHECK...]

`dynamixel-sdk` (the vendor's client) drives the mock servos, `python-can` speaks the LAWICEL text protocol to the mock CAN
adapter; outrigger drives the simulated servos of `feetech-cli` (with and without echo) and drives made with `canopen`. Ends with `N passed, N failed`; exit status 1 when a check failed.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
import tty


@contextlib.contextmanager
def mock(program, *options):
    child = subprocess.Popen([program, "mock", "rig", *options], stdout=subprocess.PIPE, text=True)
    try:
        yield child.stdout.readline().strip()
    finally:
        child.terminate()
        child.wait(10)


def expect(what, found, wanted):
    if found != wanted:
        raise AssertionError(f"{what}: found {found!r}, wanted {wanted!r}")


def dynamixel(program):
    import dynamixel_sdk as sdk

    with mock(program, "--dynamixel") as path:
        port, packet = sdk.PortHandler(path), sdk.PacketHandler(2.0)
        port.openPort()
        port.setBaudRate(1000000)
        expect("ping", packet.ping(port, 1), (1020, 0, 0))
        start = packet.read4ByteTxRx(port, 1, 132)[0]
        expect("torque on", packet.write1ByteTxRx(port, 1, 64, 1), (0, 0))
        expect("EEPROM with torque on", packet.write1ByteTxRx(port, 1, 11, 3), (0, 7))
        expect("goal out of range", packet.write4ByteTxRx(port, 1, 116, 5000), (0, 4))
        expect("stuffing both ways", packet.write4ByteTxRx(port, 1, 112, 0xFDFFFF), (0, 0))
        expect("stuffing both ways", packet.read4ByteTxRx(port, 1, 112), (0xFDFFFF, 0, 0))
        goal = start + 200
        expect("goal", packet.write4ByteTxRx(port, 1, 116, goal), (0, 0))
        time.sleep(2)
        position = packet.read4ByteTxRx(port, 1, 132)[0]
        if abs(position - goal) > 3:
            raise AssertionError(f"position {position}, goal {goal}")
        group = sdk.GroupSyncRead(port, packet, 132, 4)
        group.addParam(1), group.addParam(2)
        expect("sync read", group.txRxPacket(), 0)
        expect("sync read", abs(group.getData(1, 132, 4) - goal) <= 3, True)
        expect("watchdog", packet.write1ByteTxRx(port, 1, 98, 5), (0, 0))
        time.sleep(0.5)
        expect("watchdog bit", packet.read1ByteTxRx(port, 1, 98), (255, 0, 0))
        expect("goal is read-only", packet.write4ByteTxRx(port, 1, 116, goal), (0, 4))
        expect("absent servo", packet.ping(port, 9)[1] != 0, True)
        port.closePort()


def slcan(program):
    import can

    with mock(program, "--slcan") as path:
        with can.Bus(interface="slcan", channel=path, bitrate=1000000) as bus:
            hello = bytes([1, 1]) + (1000).to_bytes(2, "little") + (77).to_bytes(4, "little")
            identifier = 2 << 26 | 0b10110 << 21 | 1 << 16 | 0x01 << 8 | 1
            info = 6 << 26 | 0b10110 << 21 | 1 << 16 | 0x02 << 8 | 1 << 7 | 1
            for _ in range(10):  # what nobody read before may have filled the line: a host repeats itself
                bus.send(can.Message(arbitration_id=identifier, data=hello, is_extended_id=True))
                end = time.time() + 1
                while time.time() < end:
                    message = bus.recv(0.5)
                    if message and message.arbitration_id == info and message.data[4:] == hello[4:]:
                        expect("info", list(message.data[:3]), [1, 2, 1])
                        return
            raise AssertionError("no answer to hello")


def rig(program, port, *arguments, code=0):
    """The program's document, or what it said when it was to fail."""
    done = subprocess.run([program, "rig", "--port", port, "--json", *arguments], capture_output=True, text=True, timeout=60)
    if done.returncode != code:
        raise AssertionError(f"rig {' '.join(arguments)}: exit {done.returncode}: {done.stderr}{done.stdout}")
    return json.loads(done.stdout) if code == 0 else done.stderr


def expect_at(status, wanted_deg, tolerance_deg=0.3, source="measured"):
    for axis, wanted in zip(status["axes"], wanted_deg, strict=True):
        if abs(axis["position_deg"] - wanted) > tolerance_deg or axis["source"] != source:
            raise AssertionError(f"wanted {wanted} deg {source}, found {axis}")


def expect_said(what, said, *words):
    for word in words:
        if word not in said:
            raise AssertionError(f"{what}: `{word}` is not in `{said}`")


class FeetechBus:
    """`feetech-cli`'s simulated servos behind a pseudo terminal, as a half-duplex adapter shows them."""

    def __init__(self, echo):
        import feetech_cli.simulator as simulator

        self.servos = [simulator.SimulatedServo(1), simulator.SimulatedServo(2)]
        self.bus = simulator.SimulatedBus(self.servos, echo=echo)
        self.master, slave = os.openpty()
        tty.setraw(self.master), tty.setraw(slave)
        self.slave, self.path = slave, os.ttyname(slave)
        self.silent = False
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        waiting = b""
        while True:
            waiting += os.read(self.master, 4096)
            while len(waiting) >= 4 and len(waiting) >= 4 + waiting[3]:
                packet, waiting = waiting[:4 + waiting[3]], waiting[4 + waiting[3]:]
                self.bus.write(packet)
                answer = self.bus.read(4096)
                if answer and not self.silent:
                    os.write(self.master, answer)


def feetech(program):
    for echo in (False, True):
        servos = FeetechBus(echo)
        port = f"feetech:{servos.path}@1000000:1,2"
        status = rig(program, port, "status")
        expect_at(status, [0.0, 0.0])
        expect("not homed", [axis["homed"] for axis in status["axes"]], [False, False])
        expect("supply", status["axes"][0]["supply_mv"], 12100)
        expect("torque before arming", [servo.get("torque_enable") for servo in servos.servos], [0, 0])
        expect_said("not homed", rig(program, port, "set", "20", "-20", "--arm", code=1), "say --home")
        expect("still where they were", [servo.get("present_position") for servo in servos.servos], [2048, 2048])
        expect_moves(program, port, servos)
        servos.servos[1].error = 0x20
        status = rig(program, port, "status")
        expect("error status", status["axes"][1]["device_errors"], ["overload"])
        servos.servos[1].error = 0x02
        status = rig(program, port, "status")
        expect("error status", (status["axes"][1]["device_errors"], status["axes"][1]["state"]), (["angle sensor"], "boot"))
        servos.servos[1].error = 0
        servos.silent = True
        expect_said("silence", rig(program, port, "status", code=1), "servo 1", "no answer")
        expect_said("absent id", rig(program, f"feetech:{servos.path}@1000000:1,9", "status", code=1), "no answer")


def expect_moves(program, port, servos):
    status = rig(program, port, "set", "20", "-20", "--home", "--arm")
    expect_at(status, [20.0, -20.0])
    goals = [servo.get("goal_position") for servo in servos.servos]
    expect("goals in counts", goals, [2048 + 228, 2048 - 228])
    expect_said("limits", rig(program, port, "set", "80", "0", "--home", "--arm", code=1), "axis 0", "limits")


def cia402(program):
    import drives

    hub = drives.Hub("rig")
    _, made = drives.connect("virtual", "rig", [1, 2])
    expect_said("absent node", rig(program, f"cia402:slcan:{hub.path}@1,5", "status", code=1), "node 5", "no answer")
    expect_said("no such number", rig(program, f"cia402:slcan:{hub.path}@1,500", "status", code=1), "cia402:INTERFACE@NODE,NODE")
    check_drives(program, f"cia402:slcan:{hub.path}@1,2", lambda node, what: drives.serve(made, [f"{what} {node}"]))


def cia402_homing(program):
    import drives

    hub = drives.Hub("homing")
    _, made = drives.connect("virtual", "homing", [1, 2], homing_method=17)
    check_homing(program, f"cia402:slcan:{hub.path}@1,2", lambda node, what: drives.serve(made, [f"{what} {node}"]))
    hub = drives.Hub("here")
    _, made = drives.connect("virtual", "here", [1, 2], homing_method=35)
    status = rig(program, f"cia402:slcan:{hub.path}@1,2", "status")
    expect("a method that calls zero where it stands is none", status["homing_moves"], False)


def check_homing(program, port, tell):
    """Drives that find their zero by themselves, one after the other; one whose switch is dead says so."""
    status = rig(program, port, "status")
    expect("homing moves", status["homing_moves"], True)
    expect_at(status, [-12.34, -12.34], source="not_homed")  # it counted from somewhere
    expect_at(rig(program, port, "--timeout-s", "40", "set", "10", "-10", "--home", "--arm"), [10.0, -10.0])
    tell(2, "dead-switch")
    expect_said("dead switch", rig(program, port, "--timeout-s", "40", "set", "0", "0", "--home", "--arm", code=1), "encoder_invalid", "axis 1")


def check_drives(program, port, tell):
    """Homes, moves, faults, recovers."""
    status = rig(program, port, "status")
    expect_at(status, [5.0, 5.0])
    expect("supply and current", (status["axes"][0]["supply_mv"], status["axes"][0]["current_ma"]), (24000, 100))
    expect_said("not homed", rig(program, port, "set", "20", "-20", "--arm", code=1), "say --home")
    expect_at(rig(program, port, "status"), [5.0, 5.0])
    expect_at(rig(program, port, "set", "20", "-20", "--home", "--arm"), [20.0, -20.0])
    tell(2, "fault")
    time.sleep(0.3)
    status = rig(program, port, "status")
    expect("emergency message", status["axes"][1]["device_errors"], ["error 0x8611 (following error)"])
    expect_said("fault", rig(program, port, "set", "0", "0", "--home", "--arm", code=1), "torque_lost", "axis 1")
    expect_at(rig(program, port, "clear"), [20.0, -20.0])
    expect_at(rig(program, port, "set", "10", "-10", "--home", "--arm"), [10.0, -10.0])
    expect_said("limits", rig(program, port, "set", "72", "0", "--home", "--arm", code=1), "axis 0", "the firmware's limits")
    mover = subprocess.Popen([program, "rig", "--port", port, "set", "-50", "50", "--home", "--arm"], stderr=subprocess.PIPE, text=True)
    time.sleep(2.5)
    tell(1, "restart")
    said = mover.communicate(timeout=60)[1]
    expect_said("restart on the way", said, "encoder_invalid", "axis 0")
    expect("exit status", mover.returncode, 1)
    expect_said("nothing is homed", rig(program, port, "set", "0", "0", "--arm", code=1), "say --home")
    expect_at(rig(program, port, "set", "0", "0", "--home", "--arm"), [0.0, 0.0])
    tell(1, "silence")
    expect_said("silence", rig(program, port, "status", code=1), "node 1", "no answer")


CHECKS = (dynamixel, slcan, feetech, cia402, cia402_homing)

if __name__ == "__main__":
    failed = 0
    for check in CHECKS:
        if sys.argv[2:] and check.__name__ not in sys.argv[2:]:
            continue
        try:
            check(sys.argv[1])
            print(f"{check.__name__}: ok")
        except AssertionError as error:
            failed += 1
            print(f"{check.__name__}: {error}")
    print(f"{len(CHECKS) - failed} passed, {failed} failed")
    sys.exit(failed > 0)
