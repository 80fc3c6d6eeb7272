"""`tacstrip live` as a user runs it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import tacstrip as ts
from live_devices import SENSOR, LinkedPty, device, with_strips
from tacstrip.cli.live import _line, command
from waiting import HANG_S, wait_until


def _start(*words: str, **variables: str) -> subprocess.Popen[str]:
    line = [sys.executable, "-c", "from tacstrip.cli import main; main()", "live", *words]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **variables}
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    SENSOR.save(tmp_path / "sensor.toml")
    return tmp_path / "sensor.toml"


def test_ctrl_c_leaves_a_complete_recording(tmp_path: Path, spec: Path) -> None:
    file = tmp_path / "a.mcap"
    with LinkedPty(device(rate_hz=500.0), tmp_path / "ttyTEST") as served:
        run = _start("--port", served.path, "--sensor", str(spec), "-o", str(file), "--http", "0")
        wait_until(lambda: file.exists() and file.stat().st_size > 20_000)
        run.send_signal(signal.SIGINT)
        _, said = run.communicate(timeout=HANG_S)
    assert run.returncode == 0, said
    recording = ts.Recording(file)
    scans = list(recording)
    assert recording.condition.whole
    assert [raw.sequence for raw in scans] == list(range(len(scans)))
    assert f"{file}: {len(scans)} scan(s)" in said
    assert "the page is at http://127.0.0.1:" in said


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--device", "-o", "a.mcap"), "-o"),
        (("--device", "--json"), "--json is not for --device"),
        (("--simulate", "--speed", "2"), "--speed is for INPUT"),
        (("a.mcap", "--rate", "5"), "--rate is for a device"),
        (("a.toml", "a.csv", "--sensor", "b.toml"), "--sensor names the sensor a second time, after a.toml"),
    ],
)
def test_what_would_be_passed_over_is_refused(words: tuple[str, ...], says: str) -> None:
    done = CliRunner().invoke(command, words)
    assert isinstance(done.exception, ts.OptionError)
    assert says in str(done.exception)


def test_a_service_says_that_it_is_ready_and_lives_and_ends_on_request(tmp_path: Path, spec: Path) -> None:
    file, address = tmp_path / "a.mcap", str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        manager.settimeout(HANG_S)
        words = ("--simulate", "--sensor", str(spec), "--rate", "100", "--no-view", "-o", str(file))
        run = _start(*words, NOTIFY_SOCKET=address, WATCHDOG_USEC="200000")
        said = [manager.recv(4096).decode()]
        assert said == ["READY=1"]
        while not (any("STATUS=" in text for text in said) and sum("WATCHDOG=1" in t for t in said) > 1):
            said.append(manager.recv(4096).decode())
        assert any(f"; recording to {file}" in text for text in said)
        run.send_signal(signal.SIGTERM)
        while said[-1] != "STOPPING=1":
            said.append(manager.recv(4096).decode())
        _, told = run.communicate(timeout=HANG_S)
    assert run.returncode == 0, told
    recording = ts.Recording(file)
    assert len(list(recording)) > 0
    assert recording.condition.whole


def test_json_lines_of_the_simulated_device_and_of_its_recording(tmp_path: Path, spec: Path) -> None:
    file = str(tmp_path / "a.mcap")
    run = _start("--simulate", "--sensor", str(spec), "--rate", "200", "--no-view", "--json", "-o", file)
    assert run.stdout is not None
    first = [run.stdout.readline() for _ in range(30)]
    run.send_signal(signal.SIGINT)
    rest, said = run.communicate(timeout=HANG_S)
    assert run.returncode == 0, said
    lines = [json.loads(line) for line in [*first, *rest.splitlines()]]
    assert lines[-1]["objects"][0]["id"] == 1
    count = len(list(ts.Recording(file)))
    assert count >= len(lines) >= 30
    done = CliRunner().invoke(command, [file, "--speed", "10", "--no-view", "--json"])
    assert done.exit_code == 0, done.stderr
    again = [json.loads(line)["sequence"] for line in done.stdout.splitlines()]
    assert again == list(range(count))


def test_corners_of_a_doubtful_outline_are_known_if_it_is_right() -> None:
    outline, nowhere = np.array([(0.0, 0.0), (20.0, 0.0), (0.0, 20.0)]), np.full(3, np.nan)
    doubted = ts.LiveTrack(
        1, outline, nowhere, nowhere, 0.0, 30, "doubtful", "the motion does not tell the shape"
    )
    assert _line(doubted).startswith("object 1: doubtful; if its outline is right, 3 corners, 200 mm2 +- ")
    assert _line(replace(doubted, status="ok")).startswith("object 1: ok, 3 corners, 200 mm2 +- ")


def test_another_sensor_and_a_missing_port_end_with_one_line(tmp_path: Path) -> None:
    with_strips(12).save(tmp_path / "other.toml")
    with LinkedPty(device(), tmp_path / "ttyTEST") as served:
        done = CliRunner().invoke(
            command, ["--port", served.path, "--sensor", str(tmp_path / "other.toml"), "--no-view"]
        )
    assert done.exit_code == 1
    assert "Error: the device has strips = 20 and the spec 12" in done.stderr
    done = CliRunner().invoke(command, ["--port", "/dev/none", "--no-view"])
    assert done.exit_code == 1
    assert "Error: /dev/none: no such port." in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give one of --port PORT, --simulate"),
        (["--simulate", "--port", "x"], "give one of --port PORT"),
        (["--simulate", "-o", "a.csv"], "a recording is a file that ends in .mcap"),
        (["--simulate", "--seconds", "0"], "--seconds 0.0: must be above 0"),
        (["a", "b", "c"], "c: one INPUT only"),
        (["--simulate", "--osc", "nowhere", "--no-view"], "must be HOST:PORT"),
        (["--simulate", "--osc", "127.0.0.1:\u00b2", "--no-view"], "must be HOST:PORT"),
        (["--simulate", "--http", "80000"], "--http 80000: must be 0 to 65535; 0: any free one"),
        (["--simulate", "--http", "-5"], "--http -5: must be 0 to 65535"),
        (
            ["--simulate", "--http", "0", "--host", "no.such.invalid"],
            "'no.such.invalid' is no address of this computer; choose another --host, or leave it out",
        ),
        (["--simulate", "--http", "0", "--host", "a..b"], "'a..b' is no address of this computer"),
        (
            ["--simulate", "--sensor", "prototype-crs-m", "--method", "profile", "--http", "0"],
            "--method profile needs both k_h and k_l, and here is k alone; take --method polygon",
        ),
    ],
)
def test_bad_options_are_named(words: list[str], message: str) -> None:
    done = CliRunner().invoke(command, words)
    assert isinstance(done.exception, ts.OptionError)
    assert message in str(done.exception)


def test_a_port_that_is_taken_begins_no_recording(tmp_path: Path) -> None:
    file = tmp_path / "a.mcap"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        done = CliRunner().invoke(command, ["--simulate", "--http", port, "-o", str(file)])
    assert isinstance(done.exception, ts.OptionError)
    assert f"127.0.0.1:{port}: the port is in use, perhaps by another `tacstrip live`" in str(done.exception)
    assert not file.exists()


def test_the_virtual_device_for_other_programs() -> None:
    run = _start("--device")
    assert run.stderr is not None
    said = run.stderr.readline()
    path = said.split(" is on ")[1].split(";")[0]
    try:
        stream = ts.live(
            path, sensor=ts.Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0)
        )
        for frame in stream:
            if frame.objects:
                break
        assert frame.objects[0].shape.found
    finally:
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=HANG_S)
    assert run.returncode == 0


def test_scans_without_shapes_are_counted_at_the_end(
    tmp_path: Path, spec: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tacstrip.stream.live.pipeline._LATE_S", -1.0)  # every scan comes too late
    words = [
        "--simulate",
        "--sensor",
        str(spec),
        "--no-view",
        "--seconds",
        "0.1",
        "-o",
        str(tmp_path / "a.mcap"),
    ]
    done = CliRunner().invoke(command, words)
    assert done.exit_code == 0
    scans = len(list(ts.Recording(tmp_path / "a.mcap")))
    assert f"{scans} of {scans} scan(s) have no shapes" in done.stderr
    assert "tacstrip replay" in done.stderr
