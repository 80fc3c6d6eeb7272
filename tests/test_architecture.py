"""The house: arrows run one way, names do not drift."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import tacstrip
from tacstrip.cli import VERBS
from tacstrip.sensor.constructions import CONSTRUCTIONS

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "tacstrip"

# From the ground up: a file imports only what stands above it in this list.
ORDER = [
    "errors", "arguments", "files", "core.sources", "core.library", "arrays", "data", "fisher",
    "sensor.constructions", "sensor.circuit", "sensor.slant", "sensor.channel", "sensor.calibration",
    "sensor.spec", "sensor.raw", "sensor.rest_level", "sensor.surface",
    "contact.unreadable", "contact.shape", "contact.footprint", "contact.signature", "contact.noise",
    "network.nodal", "network.wires", "network.build", "network.mesh", "network.strips", "network.ladder",
    "network.spice", "network.timing", "network.arrays", "network.fourwire", "network.switches",
    "network.digital",
    "network.crp_mesh", "network.crp_scan", "network.crp_readings", "network.crp_limits", "network.crp_bound",
    "network.crp_descent", "network.crp", "network.sheet",
    "network.wide_mesh", "network.wide",
    "scan", "simulate",
    "core.binding", "core.signal", "core.fit", "core.equations", "core.descent", "core.score",
    "core.moves", "core.criterion", "core.search", "core.ellipse", "core.outliers", "core.polytope",
    "reconstruct.moments", "reconstruct.region", "reconstruct.result", "reconstruct.untouched", "reconstruct.outline",
    "reconstruct.bound",
    "reconstruct.bounded_lines", "reconstruct.bounded_set", "reconstruct.bounded_centre",
    "reconstruct.bounded_inside",
    "reconstruct.bounded_sample", "reconstruct.bounded_regions", "reconstruct.bounded",
    "reconstruct.sections", "reconstruct.ends", "reconstruct.polygon_fit", "reconstruct.polygon_run",
    "reconstruct.wide", "reconstruct.polygon_verdict", "reconstruct.polygon_object", "reconstruct.polygon",
    "reconstruct.blocks", "reconstruct.transitions", "reconstruct.validity", "reconstruct.vertex",
    "reconstruct.profile", "reconstruct.methods",
    "io.names", "io.columns", "io.rows", "io.readings", "io.runs", "io.geometry", "io.suspicions",
    "calibrate.residuals", "calibrate.offsets", "calibrate.model", "calibrate.fit", "calibrate.told",
    "calibrate.choose", "calibrate.goodness", "calibrate.interpretation",
    "calibrate.unit", "calibrate.plan", "calibrate.touch", "calibrate.drift",
    "stream.source", "stream.codes", "stream.messages", "stream.resync", "stream.framing", "stream.mcapfile",
    "stream.recording", "stream.interrupt", "stream.replay", "stream.simulated", "stream.recover", "stream.pipeline",
    "stream.export", "stream.summary",
    "diagnose.finding", "diagnose.fits", "diagnose.log", "diagnose.view", "diagnose.beside",
    "diagnose.channels", "diagnose.order",
    "diagnose.shorts", "diagnose.converter", "diagnose.noise", "diagnose.drift", "diagnose.hum", "diagnose.doctor",
    "stream.wire_frames", "stream.wire_messages", "stream.wire_commands", "stream.wire_scans", "stream.wire",
    "stream.clocks", "stream.port", "stream.mailbox", "stream.device", "stream.pty_device", "stream.greeting",
    "stream.serial_source", "stream.readings",
    "stream.following", "stream.tracking", "stream.frame", "stream.disk", "stream.meter", "stream.live",
    "stream.warm", "stream.start",
    "stream.osc", "stream.sinks",
    "view.access", "view.health", "view.picture", "view.playground", "view.stage", "view.server",
    "metrics",
    "plot.style", "plot.scene", "plot.numbered", "plot.result", "plot.doctor", "plot.calibration",
    "studies.thesis.published", "studies.twin", "studies.thesis.shapes", "studies.thesis.chapter2",
    "studies.thesis.chapter3",
    "studies.thesis.chapter4",
    "studies.thesis.metrics_figures", "studies.thesis.estimator", "studies.thesis.chapter5",
    "studies.thesis.chapter5_figures",
    "studies.thesis.chapter6", "studies.thesis.chapter6_calibration", "studies.thesis.chapter6_figures",
    "studies.thesis.chapter6_prototypes",
    "studies.thesis.claims", "studies.thesis.chapter6_claims", "studies.report", "calibrate.report",
    "studies.thesis.reproduce", "studies.demo", "studies.physics",
    "studies.crp", "studies.budget", "studies.width", "studies.estimation", "studies.estimation_figures",
    "studies.limits", "studies.design", "plot.limits",
    "studies.faults", "studies.checkup",
    "cli",
]  # fmt: skip


def _modules() -> list[tuple[str, Path]]:
    found = []
    for file in sorted(SOURCE.rglob("*.py")):
        parts = file.relative_to(SOURCE).with_suffix("").parts
        name = ".".join(p for p in parts if p != "__init__")
        if name:
            found.append((name, file))
    return found


def _imports(file: Path) -> set[str]:
    """Return the tacstrip modules that a file imports anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("tacstrip"):
            base = node.module.removeprefix("tacstrip").lstrip(".")
            submodules = {f"{base}.{a.name}".lstrip(".") for a in node.names}
            known = {n for n in submodules if (SOURCE / Path(*n.split("."))).with_suffix(".py").exists()}
            names |= known or {base}
        elif isinstance(node, ast.Import):
            names |= {a.name.removeprefix("tacstrip.") for a in node.names if a.name.startswith("tacstrip.")}
    return {n for n in names if n}


def _level(name: str) -> int:
    return ORDER.index("cli" if name.split(".")[0] == "cli" else name)


PACKAGES = {
    "core",
    "diagnose",
    "view",
    "sensor",
    "contact",
    "network",
    "reconstruct",
    "io",
    "calibrate",
    "stream",
    "plot",
    "studies",
    "studies.thesis",
}


@pytest.mark.parametrize(("name", "file"), [m for m in _modules() if m[0] not in PACKAGES])
def test_a_file_imports_only_what_stands_above_it(name: str, file: Path) -> None:
    for imported in _imports(file):
        assert imported not in PACKAGES, f"{name} imports the package {imported}, not a file of it"
        if name.startswith("cli") and imported.startswith("cli"):
            continue
        assert _level(imported) < _level(name), f"{name} imports {imported}, which stands below it"


def test_the_order_lists_every_file_once() -> None:
    there = {n for n, _ in _modules()} - PACKAGES
    assert sorted(ORDER) == sorted({"cli" if n.split(".")[0] == "cli" else n for n in there})


def test_nobody_else_compares_the_construction() -> None:
    """Only the table knows constructions by name; shipped data and command-line defaults name one."""
    for name, file in _modules():
        if name == "sensor.constructions":
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare):
                texts = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)}
                assert not texts & set(CONSTRUCTIONS), f"{file.name}:{node.lineno} compares the construction"


def test_every_name_of_the_stub_is_there() -> None:
    names = dir(tacstrip)
    assert "vertex_reconstruction" in names
    for name in names:
        assert getattr(tacstrip, name) is not None
        assert getattr(tacstrip, name).__doc__


def test_verbs_are_the_modules_of_cli() -> None:
    assert sorted(VERBS) == sorted(f.stem for f in (SOURCE / "cli").glob("*.py") if f.stem != "__init__")


@pytest.mark.parametrize("code", ["import tacstrip", "import tacstrip.cli; tacstrip.cli.cli"])
def test_importing_loads_nothing_heavy(code: str) -> None:
    check = f"{code}; import sys; print([m for m in ('numpy', 'shapely', 'matplotlib', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
