"""Which core is loaded, and that one which does not fit is never used without a word."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from compiled import build_core, needs_compiler, python, runs_v3
from tacstrip.cli import cli
from tacstrip.core import library as module
from tacstrip.core.sources import fingerprint
from tacstrip.errors import OptionError

SHOW = "from tacstrip.core.library import *; core = library(); print(core and core._name, '|', description())"
built = pytest.mark.skipif(not module.BASELINE.exists(), reason="no core was built")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return an empty folder where the library is looked for from now on."""
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    for name in ("BASELINE", "V3"):
        monkeypatch.setattr(module, name, tmp_path / getattr(module, name).name)
    monkeypatch.delenv("TACSTRIP_CORE", raising=False)
    for function in (module._chosen, fingerprint):
        function.cache_clear()
    yield tmp_path
    for function in (module._chosen, fingerprint):
        function.cache_clear()


@built
@pytest.mark.parametrize(("asked", "file"), [("baseline", module.BASELINE), ("v3", module.V3)])
def test_the_core_that_is_asked_for_is_the_one_described(asked: str, file: Path) -> None:
    if asked == "v3" and not (file.exists() and runs_v3()):
        pytest.skip("no build for x86-64-v3, or no processor for it")
    path, described = python(SHOW, asked).stdout.strip().split(" | ")
    assert path == str(file)
    assert described.endswith(f", {'x86-64-v3' if asked == 'v3' else asked}")
    assert described.split()[0] in ("gcc", "clang", "tcc")


def test_no_core_can_be_asked_for() -> None:
    assert python(SHOW, "numpy").stdout.strip() == "None | NumPy, as TACSTRIP_CORE asks"


@built
@pytest.mark.skipif(not Path("/proc/cpuinfo").exists(), reason="the processor is told by /proc/cpuinfo here")
def test_the_best_build_that_the_processor_runs_is_taken() -> None:
    flags = set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    best = module.V3 if module.V3.exists() and {"avx2", "fma", "bmi1", "bmi2"} <= flags else module.BASELINE
    assert python(SHOW, None).stdout.startswith(f"{best} | ")


def test_a_core_that_is_not_there_is_an_error_when_asked_for(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACSTRIP_CORE", "baseline")
    with pytest.raises(
        OptionError, match=r"TACSTRIP_CORE=baseline: there is no .*; unset it, or take numpy, "
    ):
        module.library()
    monkeypatch.delenv("TACSTRIP_CORE")
    assert module.library() is None
    assert module.description() == "NumPy, none was built"


@needs_compiler
@pytest.mark.parametrize(
    ("source", "told"),
    [
        (None, r"file too short|invalid|not a mach-o|slice is not valid"),
        ("int other(void) { return 0; }", "is not the compiled core of tacstrip"),
        (
            'int tacstrip_core_version(void) { return 999; } char *tacstrip_core_fingerprint(void) { return ""; }',
            f"is of version 999, not {module.VERSION}",
        ),
    ],
)
def test_a_core_that_does_not_fit_is_left_with_one_warning(
    source: str | None, told: str, folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    if source is None:
        module.BASELINE.write_bytes(b"no library")
    else:
        (folder / "other.c.txt").write_text(source, encoding="utf-8")
        options = ("-x", "c", "-shared", "-fPIC")
        build_core.cc().compile(module.BASELINE, [folder / "other.c.txt"], options)
    assert module.library() is None
    assert module.library() is None
    assert len(caplog.records) == 1
    assert re.search(told, caplog.text)
    assert re.search(told, module.description())


@built
def test_a_core_of_other_sources_is_left_and_one_without_sources_beside_it_taken(folder: Path) -> None:
    here = Path(module.__file__).parent / module.BASELINE.name
    shutil.copy(here, module.BASELINE)
    assert module.library() is not None  # as in a wheel
    for file in here.parent.glob("*.[ch]"):
        shutil.copy(file, folder)
    for text, fits in (("", True), ("/* changed */\n", False)):
        with (folder / "core.h").open("a", encoding="utf-8") as header:
            header.write(text)
        module._chosen.cache_clear()
        fingerprint.cache_clear()
        assert (module.library() is not None) is fits
    assert "was built from other sources: run `make setup`" in module.description()


def test_names_and_texts_of_the_sources_are_in_the_fingerprint(tmp_path: Path) -> None:
    seen = set()
    for name, text in (("a.c", "1"), ("a.c", "2"), ("b.c", "1"), ("b.h", "1"), ("b.txt", "1")):
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        seen.add(fingerprint.__wrapped__(tmp_path))
        file.unlink()
    assert len(seen) == 5
    assert "" in seen  # nothing to hold a library against


def test_the_header_and_python_agree_on_the_version() -> None:
    header = (build_core.CORE / "core.h").read_text(encoding="utf-8")
    assert re.findall(r"#define TACSTRIP_VERSION (\d+)", header) == [str(module.VERSION)]


def test_the_version_option_says_which_core(monkeypatch: pytest.MonkeyPatch) -> None:
    said = CliRunner().invoke(cli, ["--version"]).output
    assert re.fullmatch(r"tacstrip \d+\.\d+\.\d+\S* \(core: (.*)\)\n", said)[1] == module.description()  # type: ignore[index]
    asked = python(
        "from tacstrip.cli import main; import sys; sys.argv = ['t', '--version']; main()", "nonsense"
    )
    assert (asked.returncode, asked.stderr.count("\n")) == (2, 1)
    assert "TACSTRIP_CORE=nonsense: there is no nonsense" in asked.stderr
