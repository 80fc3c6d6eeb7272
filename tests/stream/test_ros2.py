"""The bridge to ROS 2, read by a participant in another process and by rosbags."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import tacstrip as ts
from live_devices import SENSOR, SHAPE, still
from tacstrip.cli.live import command
from tacstrip.stream import encode
from tacstrip.stream.bridges import ros_messages
from tacstrip.stream.bridges.ros2 import Ros2
from tacstrip.stream.live.pipeline import Live
from tacstrip.tracking import LiveObject

READER = Path(__file__).parents[1] / "ros2_reader.py"
DOMAIN = 101 + os.getpid() % 100  # tests run side by side
PACKAGES = {"PolygonStamped": "geometry_msgs", "DiagnosticArray": "diagnostic_msgs"}  # others: std_msgs
ORIGIN_NS = 1_700_000_000_123_456_789
NAME = "left/skin"


@pytest.fixture
def cyclone() -> None:
    pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (make ros2)")


@contextmanager
def _reader(wanted: dict[str, str]) -> Iterator[Iterator[str]]:
    """Run the reader; give its lines, which end when it does."""
    words = [f"{topic}={kind}" for topic, kind in wanted.items()]
    run = subprocess.Popen(
        [sys.executable, str(READER), str(DOMAIN), *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    with run:
        assert run.stdin is not None
        assert run.stdout is not None
        yield iter(run.stdout)
        run.stdin.close()


def _frame(number: int, statuses: dict[int, str]) -> ts.Frame:
    """Return a frame of objects of these statuses, by their ids."""
    scan = replace(ts.simulate(SENSOR, SHAPE), time_s=0.25 * number)
    shape = ts.profile_reconstruction(scan, SENSOR).objects[0]
    objects = tuple(
        LiveObject(id_, replace(shape, status=status, vertices=shape.vertices + id_))  # type: ignore[arg-type]
        for id_, status in statuses.items()
    )
    return ts.Frame(number, encode(scan, SENSOR, number), SENSOR, scan, objects, 0.0, 0.0)


def _live() -> Live:
    source = ts.SimulatedSource(SENSOR, still, scans=1)
    source.origin_ns = ORIGIN_NS
    return Live(source)


# Ids come and go: 7 takes the number 0, 8 the number 1, and 9 the number 0 that 7 has left.
SCENE = [
    {7: "ok"},
    {7: "ok", 8: "ok"},
    {7: "likely", 8: "ok"},
    {8: "doubtful"},
    {8: "doubtful", 9: "ok"},
    {},
]
# id of the polygon, 0 for an empty one, by its topic: (scan, id)
EXPECTED = {
    "object_0/polygon": [(0, 7), (1, 7), (2, 0), (4, 9), (5, 0)],
    "object_0/polygon_likely": [(2, 7), (3, 0)],
    "object_1/polygon": [(1, 8), (2, 8), (3, 0)],
    "object_1/polygon_doubtful": [(3, 8), (4, 8), (5, 0)],
}


@pytest.mark.usefixtures("cyclone")
def test_another_participant_and_rosbags_read_every_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "file:///nowhere/that/exists.xml")  # the user's counts for nothing
    monkeypatch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
    frames = [_frame(i, statuses) for i, statuses in enumerate(SCENE)]
    bridge = Ros2(_live(), NAME, frame_id="skin_link")
    monkeypatch.delenv("CYCLONEDDS_URI")
    wanted = {f"{NAME}/{topic}": "PolygonStamped" for topic in EXPECTED}
    wanted |= {f"{NAME}/readings": "Float32MultiArray", f"{NAME}/sensor_description": "String"}
    wanted |= {"diagnostics": "DiagnosticArray"}
    received: dict[str, list[tuple[bytes, Any]]] = defaultdict(list)
    n_expected = sum(map(len, EXPECTED.values())) + len(SCENE) + 1
    n_messages, ended = 0, False  # the diagnostics aside
    with _reader(wanted) as lines:
        for line in lines:
            if line == "ready\n":
                for frame in frames:
                    bridge.send(frame, 0)
                bridge.close()
                continue
            topic, data, fields = json.loads(line)
            received[topic].append((bytes.fromhex(data), fields))
            if topic == "diagnostics":
                ended |= "has ended" in fields["status"][0]["message"]
            else:
                n_messages += 1
            if ended and n_messages == n_expected:
                break
    assert n_messages == n_expected
    assert bridge.lost == 0

    for topic, expected in EXPECTED.items():
        for (_, message), (number, id_) in zip(received[f"{NAME}/{topic}"], expected, strict=True):
            header, points = message["header"], message["polygon"]["points"]
            stamp = header["stamp"]["sec"] * 10**9 + header["stamp"]["nanosec"]
            assert (stamp, header["frame_id"]) == (ORIGIN_NS + number * 250_000_000, "skin_link"), topic
            shapes = {one.id: one.shape.vertices for one in frames[number].objects}
            corners = np.array([(p["x"], p["y"], p["z"]) for p in points]).reshape(-1, 3) * 1e3  # [mm]
            np.testing.assert_allclose(corners[:, :2], shapes.get(id_, np.empty((0, 2))), atol=1e-3)
    for (_, message), frame in zip(received[f"{NAME}/readings"], frames, strict=True):
        sizes = [(d["label"], d["size"], d["stride"]) for d in message["layout"]["dim"]]
        assert sizes == [("kh,kl", 2, 40), ("strip", 20, 20)]
        np.testing.assert_allclose(
            np.reshape(message["data"], (2, 20)), [frame.scan["kh"], frame.scan["kl"]], atol=2e-4
        )
    ((_, text),) = received[f"{NAME}/sensor_description"]
    (tmp_path / "sensor.toml").write_text(text["data"], encoding="utf-8")
    assert ts.Sensor.load(tmp_path / "sensor.toml") == SENSOR
    _check_with_rosbags(tmp_path / "bag.mcap", wanted, received)


def _check_with_rosbags(
    path: Path, wanted: dict[str, str], received: dict[str, list[tuple[bytes, Any]]]
) -> None:
    """Have rosbags write the same bytes from what Cyclone DDS has read, in Humble and Jazzy, and read them as a bag."""
    kinds = {t: f"{PACKAGES.get(kind, 'std_msgs')}/msg/{kind}" for t, kind in wanted.items()}
    for release in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY):
        store = get_typestore(release)
        for topic, kind in kinds.items():
            assert store.hash_rihs01(kind) == ros_messages.type_store().hash_rihs01(kind)
            for data, fields in received[topic]:
                assert _unpadded(bytes(store.serialize_cdr(_message(store, kind, fields), kind)), data), topic
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for topic, kind in kinds.items():
            text = store.generate_msgdef(kind, ros_version=2)[0].encode()
            channel = writer.register_channel(
                f"/{topic}", "cdr", writer.register_schema(kind, "ros2msg", text)
            )
            for i, (data, _) in enumerate(received[topic]):
                writer.add_message(channel, i, data, i)
        writer.finish()  # type: ignore[no-untyped-call]
    with AnyReader([path]) as bag:
        counts = {c.topic: c.msgcount for c in bag.connections}
        assert counts == {f"/{topic}": len(received[topic]) for topic in wanted}
        for connection, _, data in bag.messages():
            made = bytes(store.serialize_cdr(bag.deserialize(data, connection.msgtype), connection.msgtype))
            assert _unpadded(made, data), connection.topic


def _unpadded(made: bytes, data: bytes) -> bool:
    """Whether bytes are the same; DDS pads a message to a multiple of four, and says by how much in its header."""
    return data[:3] == made[:3] and data[4 : len(made)] == made[4:] and not any(data[len(made) :])


def _message(store: Any, kind: str, fields: dict[str, Any]) -> Any:
    """Return a message of rosbags with the fields that another library has read."""
    values = {}
    for name, (node, what) in store.fielddefs[kind][1]:
        value, sequence = fields[name], node.name == "SEQUENCE"
        inner_node, inner = what[0] if sequence else (node, what)
        if inner_node.name == "NAME":
            value = [_message(store, inner, v) for v in value] if sequence else _message(store, inner, value)
        elif sequence:
            value = np.array(value, np.dtype(inner[0]))
        values[name] = value
    return store.types[kind](**values)


@pytest.mark.usefixtures("cyclone")
def test_the_state_names_what_is_wrong() -> None:
    live = _live()
    bridge = Ros2(live, domain=DOMAIN)
    assert [(s.level, s.message) for s in bridge.state()] == [(ros_messages.STALE, "no scan has come yet")]
    frame = _frame(0, {3: "ok", 4: "doubtful"})
    bridge.send(replace(frame, sensor=replace(SENSOR, without=("7:v_h",))), dropped=2)
    stream, channels, sound, doubtful = bridge.state()
    assert (stream.level, stream.message) == (ros_messages.ERROR, "no scans come")
    assert (channels.level, channels.message) == (ros_messages.WARN, "left out: 7:v_h")
    assert (sound.level, sound.name, sound.values["id"]) == (ros_messages.OK, "object_0", 3)
    assert (doubtful.level, doubtful.values["status"]) == (ros_messages.WARN, "doubtful")
    for _ in range(3):
        live.meter.arrived(time.perf_counter())
    live.late = 5
    stream = bridge.state()[0]
    assert stream.level == ros_messages.WARN
    assert stream.message.startswith("5 scan(s) not reconstructed because the computer was behind")
    assert bridge.state()[0].level == ros_messages.OK  # nothing has come to it since
    bridge.close()


def test_a_sheet_s_electrodes_are_rows_of_energised_strips() -> None:
    codes = np.arange(18, dtype=np.uint16).reshape(3, 6)
    raw = ts.stream.RawScan(0.0, {"electrodes": codes}, np.array([True, False, True]))
    store = ros_messages.type_store()
    data = ros_messages.readings_message(raw, ("electrodes",), 1023)
    message: Any = store.deserialize_cdr(data, ros_messages.READINGS)
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
        ("energised strip", 3, 18), ("electrode", 6, 6)
    ]  # fmt: skip
    want = np.where([[1], [0], [1]], codes / 1023, np.nan)
    np.testing.assert_allclose(message.data.reshape(3, 6), want, rtol=1e-6)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--ros-domain", "3"], "--ros-domain is for --ros2"),
        (["--ros2", "--ros-domain", "233"], "--ros-domain 233: must be a whole number from 0 to 232"),
        (["--ros2", "--ros-name", "/skin"], "--ros-name /skin: a namespace is"),
        (["--ros2", "--ros-name", "a__b"], "such as left_hand/skin"),
        (["--ros2", "--ros-frame", "a b"], "--ros-frame 'a b': a frame id has no space"),
    ],
)
def test_wrong_options_get_a_sentence(words: list[str], said: str) -> None:
    result = CliRunner().invoke(command, ["--simulate", "--no-view", *words])
    assert said in str(result.exception)


@pytest.mark.usefixtures("cyclone")
def test_an_interface_that_is_not_there_gets_a_sentence() -> None:
    with pytest.raises(ts.OptionError, match="--ros-interface nowhere0: domain"):
        Ros2(_live(), domain=DOMAIN, interface="nowhere0")


def test_without_cyclone_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "tacstrip.stream.bridges.cyclone", raising=False)
    for name in ("cyclonedds", "cyclonedds.core"):
        monkeypatch.setitem(sys.modules, name, None)
    for machine, how in (
        ("x86_64", r": pip install 'tacstrip\[ros2\]'"),
        ("aarch64", ", which is not built for"),
    ):
        monkeypatch.setattr("platform.machine", lambda machine=machine: machine)
        monkeypatch.setattr("sys.platform", "linux")
        with pytest.raises(ts.OptionError, match=f"--ros2 needs cyclonedds{how}"):
            Ros2(_live(), domain=DOMAIN)
    monkeypatch.setenv("ROS_DOMAIN_ID", "zero")
    with pytest.raises(ts.OptionError, match="ROS_DOMAIN_ID zero: must be"):
        Ros2(SimpleNamespace())  # type: ignore[arg-type]
