"""CANopen drives made with the Python package `canopen`: CiA 301 by the package, the CiA 402 state machine and the motor here.

As a program, two drives on a CAN interface until it is killed; commands come by lines on standard input:

    python tests/peers/drives.py INTERFACE NODE,NODE [HOMING_METHOD]   (fault N | restart N | silence N | dead-switch N | quit)

`Hub` is a CAN adapter with the LAWICEL text protocol on a pseudo terminal, for machines without CAN.
"""

import os
import struct
import sys
import threading
import time
import tty

import can
import canopen

COUNTS_PER_TURN = 36000
TOP_COUNTS_PER_S = 6000.0


def object_dictionary(homing_method):
    od = canopen.ObjectDictionary()
    od.bitrate = 1000000

    def variable(index, sub, name, kind, value, parent=None, pdo=True):
        entry = canopen.objectdictionary.ODVariable(name, index, sub)
        entry.data_type, entry.access_type, entry.default, entry.pdo_mappable = kind, "rw", value, pdo
        (parent.add_member if parent is not None else od.add_object)(entry)

    def record(index, name, members):
        parent = canopen.objectdictionary.ODRecord(name, index)
        od.add_object(parent)
        for sub, (member, kind, value) in enumerate(members):
            variable(index, sub, member, kind, value, parent)

    u8, u16, u32, i8, i16, i32 = (canopen.objectdictionary.datatypes.__dict__[name] for name in (
        "UNSIGNED8", "UNSIGNED16", "UNSIGNED32", "INTEGER8", "INTEGER16", "INTEGER32"))
    variable(0x1000, 0, "Device type", u32, 0x00020192)
    variable(0x1001, 0, "Error register", u8, 0)
    record(0x1016, "Consumer heartbeat", [("Number", u8, 1), ("Heartbeat", u32, 0)])
    variable(0x1017, 0, "Producer heartbeat time", u16, 0)
    record(0x1018, "Identity", [("Number", u8, 1), ("Vendor", u32, 0)])
    record(0x1400, "RPDO 1", [("Number", u8, 2), ("COB-ID", u32, 0x80000000), ("Transmission type", u8, 1)])
    record(0x1600, "RPDO 1 mapping", [("Number", u8, 0)] + [(f"Object {n}", u32, 0) for n in range(1, 5)])
    record(0x1800, "TPDO 1", [("Number", u8, 2), ("COB-ID", u32, 0x80000000), ("Transmission type", u8, 1)])
    record(0x1A00, "TPDO 1 mapping", [("Number", u8, 0)] + [(f"Object {n}", u32, 0) for n in range(1, 5)])
    variable(0x603F, 0, "Error code", u16, 0)
    variable(0x6040, 0, "Controlword", u16, 0)
    variable(0x6041, 0, "Statusword", u16, 0x0250)
    variable(0x6060, 0, "Modes of operation", i8, 0)
    variable(0x6061, 0, "Modes of operation display", i8, 0)
    variable(0x6098, 0, "Homing method", i8, homing_method)
    record(0x6099, "Homing speeds", [("Number", u8, 2), ("Switch", u32, 1000), ("Zero", u32, 200)])
    variable(0x6064, 0, "Position actual value", i32, 500)
    variable(0x6075, 0, "Motor rated current", u32, 2000)
    variable(0x6078, 0, "Current actual value", i16, 50)
    variable(0x6079, 0, "DC link circuit voltage", u32, 24000)
    variable(0x607A, 0, "Target position", i32, 0)
    record(0x607D, "Software position limit", [("Number", u8, 2), ("Lowest", i32, -7000), ("Highest", i32, 7000)])
    record(0x608F, "Position encoder resolution", [("Number", u8, 2), ("Counts", u32, COUNTS_PER_TURN), ("Turns", u32, 1)])
    variable(0x6502, 0, "Supported drive modes", u32, 1 << 0 | 1 << 5 | 1 << 7)
    return od


class Drive:
    """One drive: its dictionary is served by the package; state and motor are here, in steps of a SYNC."""

    def __init__(self, network, node, homing_method=0):
        self.node_id, self.network, self.homing_method = node, network, homing_method
        self.zero = 0.0  # what its encoder shows less than the shaft's angle; lost with the power when it homes
        self.switch_works = True
        self.begin()
        network.subscribe(0x080, self.on_sync)
        network.subscribe(0x200 + node, self.on_target)
        network.subscribe(0x700 + 127, self.on_host)

    def begin(self):
        self.node = canopen.LocalNode(self.node_id, object_dictionary(self.homing_method))
        self.network.add_node(self.node)
        self.node.nmt.send_command(0x82)  # boot-up message, then pre-operational
        self.status, self.position, self.target, self.control = 0x0250, 500.0, 500, 0
        if self.homing_method:
            self.zero = self.position + 1234  # counts from somewhere
        self.error, self.silent, self.host_heard, self.stepped = 0, False, None, time.monotonic()

    def fall_silent(self):
        self.silent = True
        self.node.remove_network()

    def value(self, index, sub):
        return self.node.sdo[index][sub].raw

    def operational(self):
        return self.node.nmt.state == "OPERATIONAL"

    def mapped(self, index, cob):
        return (self.value(index, 1) == cob + self.node_id
                and self.value(index + 0x200, 0) == 2)

    def on_host(self, *_):
        self.host_heard = time.monotonic()

    def on_target(self, _, data, __):
        if self.silent or not self.operational() or not self.mapped(0x1400, 0x200):
            return
        control, self.target = struct.unpack("<Hi", data)
        self.command(control)

    def command(self, control):
        before, self.control = self.control, control
        state = self.status & 0x6F
        if self.status & 0x4F == 0x08:
            if control & 0x80 and not before & 0x80:
                self.status, self.error = 0x0250, 0
                self.node.emcy.reset()
        elif control & 0x87 == 0x06:
            self.status = 0x0631
        elif control & 0x8F == 0x07 and state in (0x21, 0x23, 0x27):
            self.status = 0x0633
        elif control & 0x8F == 0x0F and state in (0x23, 0x27):
            if self.mode() in (6, 8):
                keep = self.status & 0x3400 if self.status & 0x6F == 0x27 and self.mode() == 6 else 0
                self.status = 0x0237 | (keep if self.mode() == 6 else 0x0400)
            if self.mode() == 6 and control & 0x10 and not before & 0x10:
                self.status &= ~0x3400  # under way: neither attained, nor reached, nor failed

    def mode(self):
        return self.node.sdo[0x6060].raw

    def seek(self, elapsed):
        """Method 17: down until the switch at -1500 counts, which is zero's place; a dead one is an end stop at -3000."""
        self.position -= self.value(0x6099, 1) * elapsed
        if self.position <= -1500 and self.switch_works:
            self.zero = self.position + 1500
            self.status |= 0x1400
        elif self.position <= -3000:
            self.status |= 0x2000

    def fault(self, code):
        self.status, self.error = 0x0638, code
        self.node.sdo[0x603F].raw = code
        self.node.emcy.send(code, 0x20, b"")

    def on_sync(self, *_):
        if self.silent:
            return
        now = time.monotonic()
        elapsed, self.stepped = min(now - self.stepped, 0.1), now
        watched = self.value(0x1016, 1)
        late = self.host_heard is not None and now - self.host_heard > (watched & 0xFFFF) / 1000
        if watched & 0xFFFF and late and self.status & 0x6F == 0x27:
            self.fault(0x8130)
        self.node.sdo[0x6061].raw = self.mode()
        if self.status & 0x6F == 0x27 and self.mode() == 8:
            reach = TOP_COUNTS_PER_S * elapsed
            self.position += max(-reach, min(reach, self.target + self.zero - self.position))
        elif self.status & 0x6F == 0x27 and self.control & 0x10 and not self.status & 0x3000:
            self.seek(elapsed)
        if self.operational() and self.mapped(0x1800, 0x180):
            self.network.send_message(
                0x180 + self.node_id, struct.pack("<Hi", self.status, round(self.position - self.zero)))


class Hub:
    """A CAN adapter on a pseudo terminal, and the `virtual` bus behind it."""

    def __init__(self, channel):
        self.master, self.slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.open = False
        for job in (self.from_host, self.to_host):
            threading.Thread(target=job, daemon=True).start()

    def from_host(self):
        line = b""
        while True:
            for byte in os.read(self.master, 4096):
                if byte != 13:
                    line += bytes([byte])
                    continue
                if line[:1] in (b"t", b"T") and self.open:
                    digits = 3 if line[:1] == b"t" else 8
                    identifier, data = int(line[1:1 + digits], 16), bytes.fromhex(line[2 + digits:].decode())
                    self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=digits == 8))
                    os.write(self.master, b"z\r" if digits == 3 else b"Z\r")
                else:
                    self.open = {b"O": True, b"C": False}.get(line[:1], self.open)
                    os.write(self.master, b"\r")
                line = b""

    def to_host(self):
        while True:
            message = self.bus.recv()
            if message and self.open:
                letter, digits = ("T", 8) if message.is_extended_id else ("t", 3)
                head = f"{letter}{message.arbitration_id:0{digits}X}{message.dlc}"
                os.write(self.master, (head + message.data.hex().upper() + "\r").encode())


def connect(interface, channel, nodes, homing_method=0):
    network = canopen.Network()
    network.connect(interface=interface, channel=channel)
    return network, {node: Drive(network, node, homing_method) for node in nodes}


def serve(drives, lines):
    for line in lines:
        command, *node = line.split()
        if command == "quit":
            return
        drive = drives[int(node[0])]
        {"dead-switch": lambda: setattr(drive, "switch_works", False), "fault": lambda: drive.fault(0x8611), "restart": drive.begin,
         "silence": drive.fall_silent}[command]()
        print("done", flush=True)


if __name__ == "__main__":
    _, made = connect("socketcan", sys.argv[1], [int(node) for node in sys.argv[2].split(",")], int((sys.argv[3:] or ["0"])[0]))
    print("ready", flush=True)
    serve(made, sys.stdin)
