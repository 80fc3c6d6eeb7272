"""Natural mistakes in Python get a sentence that says what to write; objects show themselves in a line."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
import tacstrip.reconstruction
import tacstrip.stream
from tacstrip import errors
from tacstrip.diagnose import read_log
from tacstrip.errors import figures
from tacstrip.stream import encode
from tacstrip.tracking import LiveObject

S = ts.Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0, adc_bits=12)
C = ts.Contact.polygon([(20, 40), (60, 30), (70, 70)])
K = ts.simulate(S, C, ts.Noise(positional=0.001))
CORNERS: Any = [(20, 40), (60, 30), (70, 70)]
A: Any = ts  # the same without the type checker, which finds these mistakes before
STREAM: Any = tacstrip.stream
RECONSTRUCTION: Any = tacstrip.reconstruction

MISTAKES: dict[str, tuple[Callable[[], object], str]] = {
    "corners for a contact": (
        lambda: A.simulate(S, CORNERS),
        r"simulate: contact is a list, not a Contact; write ts\.Contact\.polygon\(\[\(x, y\), \.\.\.\]\)",
    ),
    "an array for a contact": (lambda: A.footprint(S, np.array(CORNERS)), r"contact is an? ndarray, not a Contact"),
    "a file for a contact": (lambda: A.simulate(S, "c.wkt"), r"contact is 'c\.wkt', .*write ts\.read_contact\('c"),
    "a number for noise": (
        lambda: A.simulate(S, C, 0.005),
        r"noise is 0\.005, not a Noise; write ts\.Noise\(positional=0\.005\), half-width over Vref",
    ),
    "a tuple for noise": (lambda: A.fit_polygon(K, S, (0.0, 0.005)), r"noise is a tuple, .*ts\.Noise\(positional="),
    "noise without a name": (lambda: A.Noise(0.005), r"ts\.Noise\(0\.005\) does not say .*: write ts\.Noise\("),
    "readings for a scan": (
        lambda: A.fit_polygon([0.5] * 100, S),
        r"fit_polygon: scan is a list, not a Scan; write ts\.Scan\(kh=\.\.\., kl=\.\.\.\)",
    ),
    "many scans for one": (lambda: A.fit_polygon([K, K], S), r"scan is a list, not a Scan; write one Scan at a time"),
    "one scan for many": (lambda: A.fit_polygons(K, S), r"scans is a Scan, not a list of Scans; write \[it\]"),
    "one to write": (lambda: A.write_readings("r.csv", S, K), r"scans is a Scan, not a list of Scans; write \[it\]"),
    "exchanged": (
        lambda: A.fit_polygon(S, K),
        r"fit_polygon: scan and sensor are exchanged; write fit_polygon\(scan, sensor, noise, \.\.\.\)",
    ),
    "the file last": (
        lambda: A.write_readings(S, [], "r.csv"),
        r"write_readings\(path, sensor, scans, \.\.\.\)",
    ),
    "contact first": (lambda: A.simulate(C, S), r"simulate: sensor and contact are exchanged; write simulate\(sensor"),
    "contacts first": (lambda: A.footprint(C, S), r"sensor and contact are exchanged"),
    "sensor before the file": (lambda: A.read_readings(S, "r.csv"), r"sensor and path are exchanged"),
    "by name": (lambda: A.vertex_reconstruction(scan=K, sensor="s.toml"), r"write ts\.Sensor\.load\('s\.toml'\)"),
    "a path for a sensor": (lambda: A.simulate(Path("s.toml"), C), r"write ts\.Sensor\.load\('s\.toml'\)"),
    "keys for a sensor": (lambda: A.simulate({"strips": 3}, C), r"sensor is a dict, .*ts\.Sensor\(\*\*keys\)"),
    "nothing for a sensor": (lambda: A.profile_reconstruction(K, None), r"sensor is None, not a Sensor"),
    "a file to a sensor": (lambda: A.Sensor("s.toml"), r"ts\.Sensor\('s\.toml'\) does not say .*ts\.Sensor\.load"),
    "corners to a contact": (lambda: A.Contact(CORNERS), r"of coordinates write ts\.Contact\.polygon"),
    "a source of a file": (lambda: STREAM.ReadingsSource("r.csv", "s.toml"), r"ReadingsSource: sensor is 's\.toml'"),
    "a recorder of a file": (lambda: A.Recorder("a.mcap", "s.toml", ("kh",), 0), r"Recorder: sensor is 's\.toml'"),
    "a simulated source": (lambda: A.SimulatedSource(C, S), r"sensor and contact are exchanged"),
    "live": (lambda: A.live(source=object(), noise=0.01), r"live: noise is 0\.01, not a Noise"),
    "codes for a scan": (lambda: STREAM.decode(K, S), r"raw is a Scan, not a RawScan; write tacstrip\.stream\.encode"),
    "an estimate for runs": (lambda: A.calibrate_unit(S, "runs.csv"), r"runs is 'runs\.csv', not a Runs; write ts\."),
    "the bound": (lambda: RECONSTRUCTION.reading_sigma(0.01, S), r"noise is 0\.01, not a Noise"),
    "the outline": (lambda: A.vertex_covariance(CORNERS, S, 0.01), r"outline is a list, not an Outline"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_says_what_to_write(name: str) -> None:
    call, message = MISTAKES[name]
    with pytest.raises(ts.ArgumentError, match=message) as caught:
        call()
    assert isinstance(caught.value, ts.TacstripError)
    assert isinstance(caught.value, TypeError)


@pytest.mark.parametrize("half", [None, [0.1], "0.1"])
def test_noise_of_no_number(half: Any) -> None:
    with pytest.raises(ts.OptionError, match=r"positional = .*: must be 0 or more"):
        ts.Noise(positional=half)


def test_what_is_right_passes() -> None:
    assert ts.fit_polygon(scan=K, sensor=S, noise=None).status == "ok"
    assert len(ts.fit_polygons((K, K), S)) == 2
    assert ts.footprint(S, [C, C]).l.shape == (2, 50)
    for one in (ts.Noise(positional=0.01), S, C):
        assert copy.deepcopy(one) == pickle.loads(pickle.dumps(one)) == one


def test_errors_are_of_the_kinds_that_python_users_catch() -> None:
    kinds = [e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, ts.TacstripError)]
    for kind in kinds:
        assert kind is ts.TacstripError or issubclass(kind, (ValueError, TypeError, OSError)), kind
        assert kind is ts.TacstripError or str(kind("a text")) == "a text"
    with pytest.raises(ValueError, match="strips"):
        ts.Sensor(construction="crs-crs", strips=0, pitch_mm=1.0, length_mm=1.0)
    with pytest.raises(OSError, match="no such port"):
        ts.live("/dev/none")


def test_the_version_is_that_of_the_package() -> None:
    assert ts.__version__ == version("tacstrip")
    command = [sys.executable, "-c", "from tacstrip.cli import main; main()", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"tacstrip {ts.__version__} (core: ")
    with pytest.raises(AttributeError, match="nothing"):
        _ = A.nothing


def test_objects_show_themselves_in_a_line() -> None:
    raw = encode(K, S, 3)
    fit = ts.fit_polygon(K, S)
    x0, x1 = np.flatnonzero(K.touched)[[0, -1]]
    shown = {
        "<Sensor crs-crs, 50 strips, pitch 2 mm, length 100 mm, 12 bits>": S,
        f"<Scan of 50 strips at 0 s: 25 touched ({x0} to {x1}), kh ": K,
        "<Contact: polygon of 3 vertices, x 20 to 70, y 30 to 70 mm>": C,
        "<Contact: 1 polygon, 2 points, x 1 to 70, y 2 to 70 mm>": C + ts.Contact.points([(1, 2), (3, 4)]),
        "<Footprint: 25 touched (10 to 34), l ": ts.footprint(S, C),
        "<Footprint of 2 contacts: 25 touched": ts.footprint(S, [C, C]),
        "<Reconstruction by polygon at 0 s: ok, 1 object, <RecoveredObject: ok, 3 corners, ": fit,
        "<RecoveredObject: too few strips, strips 4 to 4>": ts.RecoveredObject(
            slice(4, 5), status="too few strips"
        ),
        "<RawScan 3 of 50 strips at 0 s: 25 touched (10 to 34), codes kh, kl>": raw,
        "<Frame 7 at 0 s: 1 object, 25 touched (10 to 34), after 2 ms>": ts.Frame(
            7, raw, S, K, (LiveObject(1, fit.objects[0]),), 0.002, 0.0
        ),
        "<Scan of 3 strips at 0 s: none touched, k none>": ts.Scan(k=np.full(3, np.nan)),
    }
    for text, one in shown.items():
        assert repr(one).startswith(text), repr(one)
        assert repr(one).endswith(">")
        assert "\n" not in repr(one)
        assert len(repr(one)) < 200


def test_a_table_in_place_of_a_file_is_named() -> None:
    class DataFrame: ...

    for read in (ts.read_runs, read_log):
        with pytest.raises(ts.ArgumentError, match=r"path is a DataFrame, not a Path; .*table\.to_csv"):
            read(DataFrame(), S)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(140.2, 2, "140"), (1000.0, 3, "1000"), (99.6, 2, "100"), (0.0123, 2, "0.012"), (1e-6, 2, "1e-06")],
)
def test_numbers_in_messages_have_no_exponent_where_they_are_large(
    value: float, digits: int, text: str
) -> None:
    assert figures(value, digits) == text
    assert "e" not in figures(np.inf).replace("inf", "")
