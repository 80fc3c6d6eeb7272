"""A recorder that is killed at any moment loses at most a tenth of a second."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import tacstrip as ts
from tacstrip.stream.recording.recover import recover
from tacstrip.stream.replay import Recording
from waiting import HANG_S, wait_until

ROOT = Path(__file__).parents[2]
KILLS = 20
RATE_HZ = 1000
# Starts a recorder, counts in shared memory the scans that it has taken, kills it: again and again. The scans have 100
# strips, double measurement, and a polygon each. Forking from a small process of its own spares an interpreter's start.
SCRIPT = f"""
import json, mmap, os, random, signal, struct, sys, time
import numpy as np
from recordings import ORIGIN, sensor, source
from tacstrip.stream.recording.recorder import with_shapes
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.source import paced
from dataclasses import replace

spec = sensor(strips=100)
ring = list(with_shapes(source(spec, 50, {RATE_HZ}), spec, "profile"))
rng = random.Random(5)
taken = mmap.mmap(-1, 8)

def scans():
    number = 0
    while True:
        yield replace(ring[number % len(ring)], time_s=number / {RATE_HZ}, sequence=number)
        number += 1

def child(path):
    with Recorder(path, spec, ("kh", "kl"), ORIGIN) as recorder:
        for raw in paced(scans(), idle=recorder.idle):
            recorder.add(raw)
            taken[:] = struct.pack("<q", recorder.scans)

told = []
for kill in range({KILLS}):
    taken[:] = bytes(8)
    path = f"{{sys.argv[1]}}/{{kill}}.mcap"
    if (pid := os.fork()) == 0:
        child(path)
    moment = rng.randint(1, 300)
    while struct.unpack("<q", taken[:])[0] < moment:
        time.sleep(0.001)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    told.append(struct.unpack("<q", taken[:])[0])
print(json.dumps(told))
"""


def test_killed_at_random(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        cwd=ROOT / "tests",
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )
    assert done.returncode == 0, done.stderr
    taken = json.loads(done.stdout)
    assert len(taken) == KILLS
    assert max(taken) > 150  # some lived for several chunks
    for kill, count in enumerate(taken):
        saved = recover(tmp_path / f"{kill}.mcap", tmp_path / "whole.mcap", force=True)
        assert saved.messages["/tacstrip/scan"] > count - 0.1 * RATE_HZ
        assert saved.messages["/tacstrip/scan"] - saved.messages["/tacstrip/polygon"] in (0, 1)
        numbers = [raw.sequence for raw in Recording(tmp_path / "whole.mcap")]
        assert numbers == list(range(saved.messages["/tacstrip/scan"]))  # none missing in between


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_ctrl_c_leaves_a_whole_recording(tmp_path: Path, number: signal.Signals) -> None:
    (tmp_path / "c.wkt").write_text("POINT (32 160)")
    words = ["record", "prototype-crs-crs", "c.wkt", "-o", "r.mcap", "--seconds", "100", "--paced"]
    command = [sys.executable, "-c", "from tacstrip.cli import main; main()", *words]
    running = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    file = tmp_path / "r.mcap"
    wait_until(lambda: file.exists() and file.stat().st_size > 10_000)
    running.send_signal(number)
    out, error = running.communicate(timeout=HANG_S)
    assert running.returncode == 0, error
    assert "r.mcap: stopped: " in out
    recording = ts.Recording(file)
    read = list(recording)
    assert recording.condition.whole
    assert f" {len(read)} scan(s)" in out
