"""Other people's programs talk to outrigger's mock rigs.

    python tests/peers/rig.py OUTRIGGER

`dynamixel-sdk` (the vendor's client) drives the mock servos, `python-can` speaks the LAWICEL text protocol to the mock CAN
adapter. Ends with `N passed, N failed`; exit status 1 when a check failed.
"""

import contextlib
import subprocess
import sys
import time


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
            bus.send(can.Message(arbitration_id=identifier, data=hello, is_extended_id=True))
            info = 6 << 26 | 0b10110 << 21 | 1 << 16 | 0x02 << 8 | 1 << 7 | 1
            end = time.time() + 5
            while time.time() < end:
                message = bus.recv(1)
                if message and message.arbitration_id == info and message.data[4:] == hello[4:]:
                    expect("info", list(message.data[:3]), [1, 2, 1])
                    return
            raise AssertionError("no answer to hello")


if __name__ == "__main__":
    failed = 0
    for check in (dynamixel, slcan):
        try:
            check(sys.argv[1])
            print(f"{check.__name__}: ok")
        except AssertionError as error:
            failed += 1
            print(f"{check.__name__}: {error}")
    print(f"{2 - failed} passed, {failed} failed")
    sys.exit(failed > 0)
