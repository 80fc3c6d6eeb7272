"""ROS 2 at 1 kHz: what a reliable reader in another process gets of two objects and 100 strips, and how late.

Each scan goes out as its readings and two polygons, by `Ros2.send` at the scan's time; the latency is from then, the
building of the messages included, until the reader has taken a message off. Wanted: none lost, 99 % within 3 ms. It
needs `make ros2`.

Run: python benchmarks/ros2.py [seconds, 10 by default]
"""

from __future__ import annotations

import gc
import subprocess
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

try:
    from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
except ImportError:
    print("cyclonedds is not installed: make ros2")
    sys.exit()

import tacstrip as ts
from tacstrip.stream import encode
from tacstrip.stream.bridges import ros_messages
from tacstrip.stream.bridges.cyclone import LOOPBACK, configuration, idl_struct
from tacstrip.stream.bridges.ros2 import Ros2
from tacstrip.stream.live.pipeline import Live
from tacstrip.tracking import LiveObject

RATE_HZ = 1000.0
DOMAIN = 99
SENSOR = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0, adc_bits=12)
CONTACT = ts.Contact.from_wkt(
    "MULTIPOLYGON (((5 38, 30 20, 42 56, 20 76, 5 38)), ((55 30, 88 42, 70 80, 55 30)))"
)
TOPICS = {
    "tacstrip/readings": ros_messages.READINGS,
    "tacstrip/object_0/polygon": ros_messages.POLYGON,
    "tacstrip/object_1/polygon": ros_messages.POLYGON,
}
SILENT_S = 1.0  # after which the reader takes the stream for ended


def reader() -> None:
    """Be the reader: say what came once nothing comes any more."""
    held = Domain(DOMAIN, configuration(LOOPBACK))
    participant = DomainParticipant(DOMAIN)
    waits = WaitSet(participant)
    quality = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepAll)
    readers: dict[str, Any] = {}
    latency_ns: dict[str, list[int]] = {topic: [] for topic in TOPICS}
    for topic, kind in TOPICS.items():
        struct: Any = idl_struct(kind)
        struct.deserialize = classmethod(lambda cls, data, **_: object.__new__(cls))  # only times are wanted
        readers[topic] = DataReader(participant, Topic(participant, f"rt/{topic}", struct), quality)
        condition = ReadCondition(readers[topic], SampleState.Any | ViewState.Any | InstanceState.Any)
        waits.attach(condition)
    while not all(r.get_subscription_matched_status().current_count for r in readers.values()):
        time.sleep(0.01)
    print("ready", flush=True)
    gc.disable()
    began_s, last_s = time.process_time(), time.monotonic() + 10.0
    while time.monotonic() - last_s < SILENT_S:
        waits.wait(100_000_000)
        for topic, one in readers.items():
            samples = one.take(1000)
            now_ns = time.time_ns()
            latency_ns[topic] += [
                now_ns - s.sample_info.source_timestamp for s in samples if s.sample_info.valid_data
            ]
            last_s = time.monotonic() if samples else last_s
    spent_s = time.process_time() - began_s
    for topic, values in latency_ns.items():
        p50, p99, most = np.quantile(np.array(values) / 1e6, (0.5, 0.99, 1.0))
        print(
            f"{topic}: {len(values)} came, latency {p50:.2f} / {p99:.2f} / {most:.2f} ms (median / 99 % / most)"
        )
    print(f"reader: {1e3 * spent_s / max(len(values), 1):.3f} ms of processor time a scan")
    del held


def writer(seconds: float) -> None:
    """Publish at the rate, and say what that took."""
    scan = ts.simulate(SENSOR, CONTACT, noise=ts.Noise(positional=0.002))
    objects = tuple(LiveObject(i, o) for i, o in enumerate(ts.fit_polygon(scan, SENSOR).objects))
    assert len(objects) == 2
    objects = tuple(replace(o, shape=replace(o.shape, status="ok")) for o in objects)
    raw = encode(scan, SENSOR)
    source = ts.SimulatedSource(SENSOR, lambda time_s: CONTACT, scans=1)
    bridge = Ros2(Live(source), domain=DOMAIN)
    frame = ts.Frame(0, raw, SENSOR, scan, objects, 0.0, 0.0)
    run = subprocess.Popen([sys.executable, __file__, "reader"], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    assert run.stdout.readline() == "ready\n"
    scans = round(seconds * RATE_HZ)
    began_s, start_ns = time.process_time(), time.time_ns()
    late = 0
    for i in range(scans):
        due_ns = start_ns + round(1e9 * i / RATE_HZ)
        while (wait_ns := due_ns - time.time_ns()) > 0:
            time.sleep(1e-9 * wait_ns)
        now_ns = time.time_ns()
        late += now_ns - due_ns > 3_000_000
        bridge.send(replace(frame, number=i, raw=replace(raw, time_s=1e-9 * (now_ns - source.origin_ns))), 0)
    spent_s = time.process_time() - began_s
    print(
        f"{scans} scans sent, {late} of them more than 3 ms after their time, {bridge.lost} messages dropped"
    )
    print(f"writer: {1e3 * spent_s / scans:.3f} ms of processor time a scan, waiting included")
    print(run.communicate()[0], end="")
    bridge.close()


if __name__ == "__main__":
    if sys.argv[1:] == ["reader"]:
        reader()
    else:
        writer(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
