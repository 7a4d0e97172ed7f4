"""Golden vectors of the rig's messages, made without any of the project's code: packages `cobs` and `crc32c`, `struct`.

Run it to print firmware-protocol/golden/messages.txt anew.
"""

import struct

import cobs.cobs
import crc32c

FREE = int.from_bytes(b"FREE", "little")
PRIORITY = {("device", 0x16): 0, ("host", 0x32): 0, ("host", 0x20): 2, ("host", 0x33): 2,
            ("host", 0x02): 6, ("host", 0x06): 6, ("host", 0x07): 6, ("host", 0x21): 6}


def i24(value):
    return struct.pack("<i", value)[:3]


def wire(direction, sequence, node, message, payload):
    priority = PRIORITY.get((direction, message), 2 if direction == "device" else 4)
    identifier = priority << 26 | 0b10110 << 21 | 1 << 16 | message << 8 | (direction == "host") << 7 | node
    body = struct.pack("<BBI", 1, sequence, identifier) + payload
    return cobs.cobs.encode(body + struct.pack("<I", crc32c.crc32c(body))) + b"\0"


COMMANDS = [
    (0x01, struct.pack("<BBHI", 1, 1, 1000, 0xCAFE1234),
     "Hello { protocol_min: 1, protocol_max: 1, heartbeat_timeout_ms: 1000, nonce: 3405648436 }"),
    (0x03, struct.pack("<II", 0xCAFE1234, 123456), "Heartbeat { session: 3405648436, time_ms: 123456 }"),
    (0x05, struct.pack("<H", 7), "TimeSync { sequence: 7 }"),
    (0x1A, struct.pack("<BB", 1, 5), "GetLimit { axis: 1, limit: ServoMinimum }"),
    (0x10, struct.pack("<HBxi", 2, 1, -436332), "Order { id: 2, order: MoveTo { axis: 1, position_urad: -436332 } }"),
    (0x11, struct.pack("<HBxHH", 3, 0, 500, 2000),
     "Order { id: 3, order: Profile { axis: 0, speed_mrad_s: 500, acceleration_mrad_s2: 2000 } }"),
    (0x12, struct.pack("<H", 4) + i24(436332) + i24(-436332),
     "Order { id: 4, order: MovePair { a_urad: 436332, b_urad: -436332 } }"),
    (0x12, struct.pack("<H", 0x1000) + i24(8388607) + i24(-8388607),
     "Order { id: 4096, order: MovePair { a_urad: 8388607, b_urad: -8388607 } }"),
    (0x13, struct.pack("<H", 5), "Order { id: 5, order: Hold }"),
    (0x14, struct.pack("<HH", 6, 4000), "Order { id: 6, order: Stop { deceleration_mrad_s2: 4000 } }"),
    (0x15, struct.pack("<HB", 7, 255), "Order { id: 7, order: Home { axis: 255 } }"),
    (0x16, struct.pack("<H", 8), "Order { id: 8, order: EStop }"),
    (0x17, struct.pack("<HBxI", 9, 11, FREE), f"Order {{ id: 9, order: ClearFault {{ fault: EStop, key: {FREE} }} }}"),
    (0x18, struct.pack("<HBBi", 10, 0, 1, 785398),
     "Order { id: 10, order: SetLimit { axis: 0, limit: Maximum, value: 785398 } }"),
    (0x19, struct.pack("<HB", 11, 1), "Order { id: 11, order: Arm { armed: true } }"),
]
REPORTS = [
    (0x02, struct.pack("<BBBBI", 1, 2, 1, 1, 0xCAFE1234),
     "Info { protocol: 1, axes: 2, capabilities: 1, reset: BrownOut, session: 3405648436 }"),
    (0x04, struct.pack("<BBHI", 4, 3, 0, 0xCAFE1234),
     "Heartbeat { state: Holding, armed: true, homed: true, faults: Faults(0), session: 3405648436 }"),
    (0x04, struct.pack("<BBHI", 6, 2, 0x0804, 0),
     "Heartbeat { state: EStop, armed: false, homed: true, faults: Faults(2052), session: 0 }"),
    (0x05, struct.pack("<H", 7) + (0x123456789ABC).to_bytes(6, "little"),
     "TimeSync { sequence: 7, device_us: 20015998343868 }"),
    (0x06, struct.pack("<Q", 0x4F55545249470001), f"Identity {{ uid: {0x4F55545249470001} }}"),
    (0x07, struct.pack("<II", 0x010203, 0xDEADBEEF), "Build { firmware: 66051, revision: 3735928559 }"),
    (0x20, struct.pack("<HBBi", 4, 0x12, 3, 1), "Ack { id: 4, message: 18, code: Limit, detail: 1 }"),
    (0x21, struct.pack("<BBi", 1, 0, -1047198), "Limit { axis: 1, limit: Minimum, value: -1047198 }"),
    (0x30, struct.pack("<BBHi", 1, 0, 54321, -436332),
     "Position { axis: 1, source: Measured, time_ms: 54321, position_urad: -436332 }"),
    (0x31, struct.pack("<BbhHh", 0, -5, -120, 11950, -523),
     "Effort { axis: 0, temperature_c: -5, current_ma: -120, supply_mv: 11950, speed_mrad_s: -523 }"),
    (0x32, struct.pack("<BBHi", 2, 1, 999, 6000), "Fault { fault: Stall, axis: 1, time_ms: 999, detail: 6000 }"),
    (0x33, struct.pack("<HBxi", 4, 255, 235), "Done { id: 4, axis: 255, error_urad: 235 }"),
    (0x34, struct.pack("<BBHi", 0, 0x83, 4, 436332),
     "Target { axis: 0, state: Moving, homed: true, id: 4, target_urad: 436332 }"),
    (0x30, struct.pack("<BBHi", 0, 3, 1, 383), "Position { axis: 0, source: NotHomed, time_ms: 1, position_urad: 383 }"),
]

if __name__ == "__main__":
    print("# direction sequence node wire-bytes message (made by tests/peers/rig_vectors.py)")
    for direction, messages in (("device", COMMANDS), ("host", REPORTS)):
        for sequence, (message, payload, text) in enumerate(messages):
            bytes_ = wire(direction, sequence, 1 + sequence % 3, message, payload)
            print(direction, sequence, 1 + sequence % 3, bytes_.hex(), text)
