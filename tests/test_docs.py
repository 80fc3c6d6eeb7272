"""What the documents say is true: examples run, links lead somewhere, names exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tacstrip.cli import VERBS
from tacstrip.sensor.spec import KEYS

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_and_pictures_are_there(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_named_source_files_are_there(page: Path) -> None:
    for name in re.findall(r"`([\w/]+\.(?:py|toml|pyi))`", page.read_text(encoding="utf-8")):
        assert list(ROOT.glob(name)) or list((ROOT / "src").rglob(name)), name


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


def test_the_readmes_table_has_every_verb() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `tacstrip (\w+)", text, re.MULTILINE) == list(VERBS)


def test_the_files_page_has_every_key() -> None:
    text = (ROOT / "docs/files.md").read_text(encoding="utf-8")
    for key in KEYS:
        assert f"`{key}`" in text, key
