"""What the documents say is true: examples run, links lead somewhere, names exist."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import math
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from docs_site import transcript

import tacstrip as ts
from polygons import SURE
from tacstrip.cli import VERBS
from tacstrip.sensor.spec import KEYS

ROOT = Path(__file__).parents[1]
BUILT = {"_build", "examples"}  # of docs/, by `make docs`
PAGES = sorted(
    p
    for p in [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]
    if not BUILT & set(p.relative_to(ROOT).parts)
)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_what_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    _check_links_and_pictures(page, text)
    _check_names_and_keywords(text)
    # A record tells of what was, and may be gone.
    if page.name != "CHANGELOG.md" and page.parent.name != "decisions":
        _check_options_of_commands(text)
    for name in re.findall(r"`([\w/]*/[\w/]+\.(?:py|toml|pyi))`", text):
        assert list(ROOT.glob(name)) or list((ROOT / "src").rglob(name)), name


def _check_links_and_pictures(page: Path, text: str) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def _code(text: str) -> Iterator[ast.Module]:
    """Yield what is Python of a page: its blocks, and calls within its sentences."""
    for code in re.findall(r"```(?:python)?\n(.*?)```|`(ts\.[^`]+)`", text, re.DOTALL):
        try:
            yield ast.parse("".join(code))
        except SyntaxError:
            continue


def _find(dotted: str) -> Any:
    """Return what a name such as tacstrip.stream.decode is; AttributeError or ImportError where there is none."""
    found: Any = importlib.import_module("tacstrip")
    done = "tacstrip"
    for part in dotted.split(".")[1:]:
        done += f".{part}"
        found = getattr(found, part) if hasattr(found, part) else importlib.import_module(done)
    return found


def _check_names_and_keywords(text: str) -> None:
    given: dict[str, Any] = {"ts": ts}
    codes = list(_code(text))
    for code in codes:
        for node in ast.walk(code):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("tacstrip"):
                given |= {n.asname or n.name: _find(f"{node.module}.{n.name}") for n in node.names}
    for name in re.findall(r"\b(?:tacstrip|ts)(?:\.[A-Za-z_]\w*)+", text):
        if not re.fullmatch(r"tacstrip\.(toml|json|service|rules|conf)", name):  # files
            _find(re.sub("^ts", "tacstrip", name))
    for code in codes:
        for node in ast.walk(code):
            if not isinstance(node, ast.Call) or ast.unparse(node.func).split(".")[0] not in given:
                continue
            taken = inspect.signature(eval(ast.unparse(node.func), given)).parameters
            if not any(p.kind is p.VAR_KEYWORD for p in taken.values()):
                assert {k.arg for k in node.keywords if k.arg} <= set(taken), ast.unparse(node)


@cache
def _options(verb: str) -> set[str]:
    command = importlib.import_module(f"tacstrip.cli.{verb}").command
    return {"-h", "--help", *(option for p in command.params for option in (*p.opts, *p.secondary_opts))}


def _check_options_of_commands(text: str) -> None:
    for verb, words in re.findall(r"\btacstrip (\w+) ([^`\n|]+)", text):
        if verb in VERBS:
            used = set(re.findall(r"(?<!\S)--?[a-z][\w-]*", words))
            assert used <= _options(verb), (verb, words)


def test_the_readmes_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    exec(compile(code, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines] == [["polygon", "ok"], ["profile", "ok"], ["vertex", "ok"]]
    assert all(float(line.split()[-1]) > 0.95 for line in lines)


def _snippet(page: str) -> str:
    (code,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.DOTALL
    )
    return str(code)


def _run_page(page: str, folder: Path) -> dict[str, Any]:
    """Run a page's files, commands and snippets one after the other in a folder; return the snippets' names.

    Few fits of `limits --check`: as many as it says run where the site is built.
    """
    text, names = (ROOT / "docs" / page).read_text(encoding="utf-8"), dict[str, Any]()
    for kind, block in re.findall(r"```(\{transcript\}|python)\n(.*?)```", text, re.DOTALL):
        if kind == "python":
            exec(compile(block, page, "exec"), names)
        elif block.startswith(":file: "):
            name, _, rest = block.removeprefix(":file: ").partition("\n")
            (folder / name).write_text(rest, encoding="utf-8")
        else:
            for line in re.findall(r"^\$ (.*)$", block, re.MULTILINE):
                code, said = transcript.run(line.replace("--check 20", "--check 4"), folder)
                assert code == 0, said
    return names


def test_the_short_answers_run_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = _run_page("start/how-do-i.md", tmp_path)
    assert names["found"].status == SURE
    assert [row["scan"] for row in names["table"]] == list(range(10))
    for picture, least in (("shapes.png", 10_000), ("tracks.png", 10_000), ("shape.pdf", 8_000)):
        assert Path(picture).stat().st_size > least
    one, two = (json.loads(Path(f"{name}.geojson").read_text())["features"] for name in ("one", "layers"))
    assert len(one) == 1  # what the page warns of
    assert one[0]["properties"]["status"] == "doubtful"
    assert len(two) == 2  # what a second layer tells


def test_the_answers_on_planning_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = _run_page("start/how-do-i-plan.md", tmp_path)
    assert (names["solid"].status, names["ball"].status) == ("ok", "ok")
    for fit, radius in ((names["solid"], 6.0), (names["ball"], 8.0)):
        assert abs(fit.radius_mm - radius) < 3.0 * fit.radius_sigma_mm
    for picture in ("press.png", "compared/figures/pareto.png"):
        assert Path(picture).stat().st_size > 10_000


def test_the_doctors_snippet_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    sensor = ts.Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0)
    sensor.save("sensor.toml")
    contact = ts.Contact.polygon([(2.0, 10.0), (38.0, 14.0), (38.0, 40.0), (2.0, 34.0)])
    lines = ["scan,time_s,strip,v_h,v_l"]
    for t in range(30):
        scan = ts.simulate(sensor, contact.moved(0.0, 25.0 * (1.0 - math.cos(t))), rng=t)
        volts = np.stack([scan["kh"], scan["kl"]], axis=1) * sensor.vref_volt
        volts[5] = 0.0  # open at the end at Vref
        lines += [f"{t},{0.01 * t:.2f},{i},{h:.5f},{low:.5f}" for i, (h, low) in enumerate(volts)]
    Path("readings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    exec(compile(_snippet("guide/doctor.md"), "doctor.md", "exec"), {})
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("strip 5 open strip")
    assert told[-1].startswith("False")


def test_the_calibrations_snippet_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=5.0, length_mm=100.0)
    sensor.save("sensor.toml")
    lines = ["strip,l_mm,w_mm,v_out"]
    for l, w in ((10.0, 0.0), (30.0, 10.0), (50.0, 0.0), (60.0, 20.0), (90.0, 0.0)):
        for i in range(2):
            (k,) = ts.signatures(sensor, np.array([l]), np.array([l + w]))["k"]
            lines.append(f"{i},{l},{w},{sensor.vref_volt * (k + 0.02 + 0.0005 * (-1) ** len(lines)):.5f}")
    Path("runs.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    exec(compile(_snippet("guide/calibration.md"), "calibration.md", "exec"), {})
    assert capsys.readouterr().out.startswith("ok")
    calibration = ts.Sensor.load("calibrated.toml").calibration
    assert calibration is not None
    np.testing.assert_allclose(calibration.correct("k", [0.52, 0.52]), 0.5, atol=2e-3)


def test_the_specs_page_has_every_key() -> None:
    text = (ROOT / "docs/reference/spec.md").read_text(encoding="utf-8")
    for key in KEYS:
        assert f"`{key}`" in text, key
