"""A second participant, in a process of its own: reads topics with types written out here, by nothing of tacstrip.

`python ros2_reader.py DOMAIN TOPIC=KIND ...` prints "ready" when a writer of every topic is there, and then a line of
JSON per message: topic, the bytes as they came, and what Cyclone DDS reads in them. It ends with its standard input.
"""

import json
import select
import sys
from dataclasses import asdict, dataclass
from typing import Any

from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import byte, float32, int32, sequence, uint32
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

LOOPBACK = """
<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):  # type: ignore[misc, call-arg]
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):  # type: ignore[misc, call-arg]
    stamp: Time
    frame_id: str


@dataclass
class Point32(IdlStruct, typename="geometry_msgs.msg.dds_.Point32_"):  # type: ignore[misc, call-arg]
    x: float32
    y: float32
    z: float32


@dataclass
class Polygon(IdlStruct, typename="geometry_msgs.msg.dds_.Polygon_"):  # type: ignore[misc, call-arg]
    points: sequence[Point32]


@dataclass
class PolygonStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PolygonStamped_"):  # type: ignore[misc, call-arg]
    header: Header
    polygon: Polygon


@dataclass
class MultiArrayDimension(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayDimension_"):  # type: ignore[misc, call-arg]
    label: str
    size: uint32
    stride: uint32


@dataclass
class MultiArrayLayout(IdlStruct, typename="std_msgs.msg.dds_.MultiArrayLayout_"):  # type: ignore[misc, call-arg]
    dim: sequence[MultiArrayDimension]
    data_offset: uint32


@dataclass
class Float32MultiArray(IdlStruct, typename="std_msgs.msg.dds_.Float32MultiArray_"):  # type: ignore[misc, call-arg]
    layout: MultiArrayLayout
    data: sequence[float32]


@dataclass
class String(IdlStruct, typename="std_msgs.msg.dds_.String_"):  # type: ignore[misc, call-arg]
    data: str


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs.msg.dds_.KeyValue_"):  # type: ignore[misc, call-arg]
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticStatus_"):  # type: ignore[misc, call-arg]
    level: byte
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs.msg.dds_.DiagnosticArray_"):  # type: ignore[misc, call-arg]
    header: Header
    status: sequence[DiagnosticStatus]


KINDS = {one.__name__: one for one in (PolygonStamped, Float32MultiArray, String, DiagnosticArray)}


def keep_bytes(kind: Any) -> Any:
    """Have a type keep the bytes that it is read from."""
    read = kind.deserialize

    def deserialize(data: bytes, **options: Any) -> Any:
        sample = read(data, **options)
        sample.received = data
        return sample

    kind.deserialize = deserialize
    return kind


def open_reader(participant: Any, topic: str, kind: str) -> Any:
    """Return a reader as a ROS 2 node has it by default, but one that keeps all; of latched texts."""
    latched = kind == "String"
    quality = Qos(
        Policy.Reliability.Reliable(0),
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepAll,
    )
    return DataReader(participant, Topic(participant, f"rt/{topic}", keep_bytes(KINDS[kind])), quality)


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(domain: int, wanted: dict[str, str]) -> None:
    held = Domain(domain, LOOPBACK)
    participant = DomainParticipant(domain)
    readers = {topic: open_reader(participant, topic, kind) for topic, kind in wanted.items()}
    ready = False
    while not select.select([sys.stdin], [], [], 0.005)[0]:
        counts = [reader.get_subscription_matched_status().current_count for reader in readers.values()]
        if not ready and all(counts):
            ready = True
            _say("ready")
        for topic, reader in readers.items():
            for sample in reader.take(100):
                if hasattr(sample, "received"):  # else: a writer has gone
                    fields = asdict(sample)
                    _say(json.dumps([topic, sample.received.hex(), fields]))
    del held


if __name__ == "__main__":
    main(int(sys.argv[1]), dict(word.split("=") for word in sys.argv[2:]))
