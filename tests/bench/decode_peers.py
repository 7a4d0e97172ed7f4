"""Runs a peer on a capture, one timed run per line of standard input, for the bench `decode`.

    python decode_peers.py ouster CAPTURE META.json
    python decode_peers.py velodyne CAPTURE MODEL

The first line printed is `ready POINTS`: points with a range, as the peer counts them. Every input line names a way;
the answer is `SECONDS`, the lesser of processor time and wall time. Ways, from the slowest honest one to what needs no
file at all:

    file          capture file to float32 arrays; ouster-sdk: every field of the packets decoded, velodyne_decoder: as
                  structures
    file_range    the same; ouster-sdk: ranges only, velodyne_decoder: as plain arrays
    file_f64      as file_range, float64 arrays
    core          packets that already are in memory, as the peer's own objects, to float32 arrays
    core_f64      the same, float64 arrays
"""

import sys
import time
import warnings

import numpy as np

warnings.simplefilter("ignore")


class Ouster:
    def __init__(self, capture, meta):
        import ouster.sdk._bindings.client as client
        import ouster.sdk._bindings.pcap as pcap
        from ouster.sdk import core

        self.capture, self.client, self.pcap = capture, client, pcap
        self.info = core.SensorInfo(open(meta).read())
        self.tables = {"f32": client.XYZLutFloat(self.info, False), "f64": client.XYZLut(self.info, False)}
        self.packets = []
        for _, packet in pcap.PcapPacketSource(capture, sensor_info=[self.info]):
            if isinstance(packet, core.LidarPacket):
                self.packets.append(packet)
        self.names, self.points = ["RANGE"], 0
        for frame in self.frames():
            self.names = [name for name in ("RANGE", "RANGE2") if name in frame.fields]
            self.points += sum(int((frame.field(name) > 0).sum()) for name in self.names)

    def frames(self, **options):
        for frames in self.pcap.PcapFrameSetSource(self.capture, sensor_info=[self.info], **options):
            yield from (frame for frame in frames if frame is not None)

    def project(self, frame, kind):
        for name in self.names:
            self.tables[kind](frame.field(name))

    def file(self):
        for frame in self.frames():
            self.project(frame, "f32")

    def file_range(self, kind="f32"):
        for frame in self.frames(field_names=self.names):
            self.project(frame, kind)

    def file_f64(self):
        self.file_range("f64")

    def core(self, kind="f32"):
        batcher, frame = self.client.FrameBatcher(self.info), self.client.LidarFrame(self.info)
        batch = batcher.batch
        for packet in self.packets:
            if batch(packet, frame):
                self.project(frame, kind)
        self.project(frame, kind)

    def core_f64(self):
        self.core("f64")


class Velodyne:
    """Writes float32 only; a point comes with its intensity, ring and time, which outrigger keeps in the frame."""

    def __init__(self, capture, model):
        import velodyne_decoder

        self.capture, self.peer = capture, velodyne_decoder
        self.configure = lambda: self.config(model)
        self.calibration = None
        if model.startswith("HDL64E"):
            _, self.calibration = velodyne_decoder.hdl64e.read_calibration_from_pcap(capture)
        stamped = [(s, d) for s, d in velodyne_decoder.util.iter_pcap(capture) if len(d) == velodyne_decoder.PACKET_SIZE]
        self.scans, scan, last, turned = [], velodyne_decoder.PacketVector(), None, 0
        for stamp, data in stamped:
            azimuth = int.from_bytes(data[2:4], "little")
            turned += 0 if last is None else (azimuth - last) % 36000
            last = azimuth
            if turned >= 36000:
                self.scans.append(scan)
                scan, turned = velodyne_decoder.PacketVector(), 0
            scan.append(velodyne_decoder.VelodynePacket(stamp, data))
        self.scans.append(scan)
        self.points = sum(len(points) for points in self.clouds(True))

    def config(self, model):
        config = self.peer.Config(min_range=0.0, max_range=1000.0)  # the default keeps 0.1 to 200 m
        config.model = getattr(self.peer.Model, model)
        if self.calibration is not None:
            config.calibration = self.calibration
        return config

    def clouds(self, as_structs):
        """As the peer's read_pcap, but for its look through the file for the calibration of an HDL-64E."""
        decoder = self.peer.StreamDecoder(self.configure())
        for stamp, data in self.peer.util.iter_pcap(self.capture):
            if len(data) == self.peer.PACKET_SIZE:
                cloud = decoder.decode(stamp, data, as_structs)
                if cloud is not None:
                    yield cloud[1]
        cloud = decoder.finish(as_structs)
        if cloud is not None:
            yield cloud[1]

    def file(self):
        for _ in self.clouds(True):
            pass

    def file_range(self):
        for _ in self.clouds(False):
            pass

    def core(self):
        decoder = self.peer.ScanDecoder(self.configure())
        for scan in self.scans:
            decoder.decode(scan, True)


def main():
    peer = {"ouster": Ouster, "velodyne": Velodyne}[sys.argv[1]](*sys.argv[2:])
    print("ready", peer.points, flush=True)
    for line in sys.stdin:
        way = getattr(peer, line.strip())
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        way()
        print(min(time.process_time() - cpu_s, time.perf_counter() - wall_s), flush=True)


main()
