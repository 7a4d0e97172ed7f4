#!/usr/bin/env python3
"""A long recording of a VLS-128: the whole revolutions of the one in OUTRIGGER_SHARED again and again, each time later, on the
sensor's clock too.

    python3 tests/browser/long_vls128.py OUT.pcap [MEGABYTES]"""

import os
import struct
import sys
from pathlib import Path

HEADER, RECORD, STAMP = 24, 16, 42 + 1200
HOUR_US = 3_600_000_000


def azimuth(packet):
    return struct.unpack_from("<H", packet, 42 + 2)[0]


def main():
    shared = Path(os.environ.get("OUTRIGGER_SHARED", Path(__file__).resolve().parents[3] / "shared"))
    capture = (shared / "captures/velodyne/nebula_vls128.pcap").read_bytes()
    packets, at = [], HEADER  # time, us, and bytes
    while at < len(capture):
        seconds, micros, length, _ = struct.unpack_from("<4I", capture, at)
        at += RECORD
        packets.append((seconds * 1_000_000 + micros, bytearray(capture[at : at + length])))
        at += length
    begins = [at for at in range(1, len(packets)) if azimuth(packets[at][1]) < azimuth(packets[at - 1][1])]
    span_us = packets[begins[-1]][0] - packets[begins[0]][0]
    packets = packets[begins[0] : begins[-1]]
    size = int(float(sys.argv[2] if len(sys.argv) > 2 else 120) * 1e6)
    with open(sys.argv[1], "wb") as out:
        out.write(capture[:HEADER])
        for turn in range(-(-(size - HEADER) // sum(RECORD + len(packet) for _, packet in packets))):
            for time_us, packet in packets:
                host_us = time_us + turn * span_us
                again = bytearray(packet)
                (stamp_us,) = struct.unpack_from("<I", packet, STAMP)
                struct.pack_into("<I", again, STAMP, (stamp_us + turn * span_us) % HOUR_US)
                out.write(struct.pack("<4I", *divmod(host_us, 1_000_000), len(packet), len(packet)) + again)


main()
