"""The site's sources: every name, option, key and status has its entry, pages and examples stay short, links hold."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any, get_args

import click
import pytest
from docs_site.ahead import LONGEST, jobs
from docs_site.commands import command_page
from docs_site.gallery_links import to_pages
from docs_site.legible import refuse_small_letters, small_letters
from docs_site.links import problems
from docs_site.reproduction import claims, printed_table
from docs_site.transcript import run
from matplotlib.figure import Figure

from polygons import SURE
from tacstrip.cli import VERBS
from tacstrip.reconstruction.result import Status

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MOST_WORDS, MOST_LINES, MOST_README = 1500, 40, 120
ROOMS = ["tacstrip"] + [
    f"tacstrip.{room}"
    for room in (
        *("calibrate", "contact", "diagnose", "io", "network", "plot"),
        *("reconstruction", "sensor", "stream", "surface", "tracking"),
    )
]
BUILT = ("_build", "examples", "python")
PAGES = sorted(p for p in DOCS.rglob("*.md") if not set(p.relative_to(DOCS).parts) & set(BUILT))
EXAMPLES = sorted((DOCS / "gallery").glob("plot_*.py"))


def notebook(file: Path, folder: Path) -> dict[str, Any]:
    """Return the notebook that the site offers for an example, through JSON as it is stored."""
    # Late: collection by every process would take a third of a second longer.
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    settings = {**DEFAULT_GALLERY_CONF, "src_dir": str(folder), "notebook_images": False}
    blocks = split_code_and_text_blocks(str(file))[1]
    made: dict[str, Any] = json.loads(json.dumps(jupyter_notebook(blocks, settings, str(folder))))
    return made


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_name_has_its_entry(room: str) -> None:
    text = (DOCS / "reference/python.md").read_text(encoding="utf-8")
    blocks = re.findall(rf"currentmodule:: {re.escape(room)}\n(.*?)```", text, re.DOTALL)
    listed = Counter(re.findall(r"^   (\w+)$", "\n".join(blocks), re.MULTILINE))
    module = importlib.import_module(room)
    names = [n for n in dir(module) if not n.startswith("__") and not inspect.ismodule(getattr(module, n))]
    assert listed == Counter(names)


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_of_a_command_has_its_entry(verb: str) -> None:
    page = (DOCS / f"reference/commands/{verb}.md").read_text(encoding="utf-8")
    assert f"```{{command}} {verb}\n" in page
    assert "## Typical output" in page
    shown = command_page(verb)
    command: click.Command = importlib.import_module(f"tacstrip.cli.{verb}").command
    for option in command.params:
        if isinstance(option, click.Option) and not option.hidden:
            assert option.help, f"{verb} {option.opts} says nothing"
            for name in option.opts:
                assert re.search(rf"`[^`\n]*(?<![\w-]){re.escape(name)}(?![\w-])", shown), f"{verb} {name}"


def test_pages_that_help_names_are_links() -> None:
    assert "[docs/guide/doctor.md](../../guide/doctor.md)" in command_page("doctor")


def test_every_status_has_its_row() -> None:
    text = (DOCS / "reference/statuses.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `([^`]+)`", text, re.MULTILINE) == list(get_args(Status))


def test_pages_are_short_and_have_one_title() -> None:
    any_length = {"science", "decisions", "architecture.md"}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        prose = re.sub(r"(?s)```.*?```", "", text)
        assert len(re.findall(r"(?m)^# ", prose)) == 1, page
        assert text.startswith("# "), page
        assert len(prose.split()) <= MOST_WORDS or any_length & set(page.relative_to(DOCS).parts), page


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= MOST_README


def test_there_are_examples_enough() -> None:
    assert len(EXAMPLES) >= 24


def test_long_jobs_of_the_site_begin_first() -> None:
    made = jobs(DOCS)
    assert set(made) >= {file.name for file in EXAMPLES} | {"2.3", "5.61"}
    assert [job[5:7] if job.endswith(".py") else job for job in made[: len(LONGEST)]] == list(LONGEST)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_short_and_draws(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    code = ast.parse(text)
    words = {n.value for n in ast.walk(code) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    beside = {w for w in words if Path(w).suffix and "\n" not in w and (file.parent / w).is_file()}
    assert not beside or ".exists()" in text, f"a download has no {beside}"
    title, underline = (ast.get_docstring(code) or "\n").splitlines()[:2]
    assert underline == "=" * len(title)
    assert "figure" in {
        n.id for n in ast.walk(code) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda p: p.stem)
def test_an_examples_notebook_is_whole(file: Path, tmp_path: Path) -> None:
    cells = notebook(file, tmp_path)["cells"]
    assert cells[0]["cell_type"] == "markdown"
    for cell in cells:
        assert set(cell) >= {"cell_type", "metadata", "source"}
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            compile("".join(cell["source"]), file.name, "exec")


def test_the_tutorials_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    made = notebook(next(f for f in EXAMPLES if "ten_minutes" in f.stem), tmp_path)
    names: dict[str, Any] = {}
    for cell in made["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]).replace("%matplotlib inline", ""), names)
    assert (made["nbformat"], names["found"].status) == (4, SURE)
    assert small_letters(names["figure"]) == []


def test_letters_that_are_too_small_are_found() -> None:
    wide, narrow = Figure(figsize=(12, 3)), Figure(figsize=(6, 3))
    for figure in (wide, narrow):
        figure.suptitle("ten points", fontsize=10)
    assert small_letters(wide) == ["'ten points' (6.9 pixels)"]
    assert small_letters(narrow) == []
    with pytest.raises(
        ValueError, match=r"a\.png: too small where it is shown 600 pixels wide: 'ten points'"
    ):
        refuse_small_letters(wide, "a.png")


def test_links_to_the_gallery_lead_to_its_pages() -> None:
    text = "[a](../gallery/README.rst), [b](gallery/plot_01_one_scan.py), [c](../gallery/a.csv)"
    assert (
        to_pages(text)
        == "[a](../examples/index.rst), [b](examples/plot_01_one_scan.rst), [c](../gallery/a.csv)"
    )


def test_a_transcript_is_what_the_command_prints(tmp_path: Path) -> None:
    code, said = run("tacstrip init sensor.toml", tmp_path)
    assert code == 0
    assert (tmp_path / "sensor.toml").exists()
    assert run("tacstrip init sensor.toml", tmp_path)[0] == 2
    assert said


def test_the_printed_tables_are_shown() -> None:
    table = printed_table("5.5")
    assert "| ideal | M.C. [rad] | **0.000**; 0.000 |" in table
    assert printed_table("6.2").count("\n") == 6
    assert claims("6").count("**fails**") > 0
    with pytest.raises(KeyError, match=r"no table 9\.9"):
        printed_table("9.9")


def test_broken_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<p id="here"><a href="b.html#there">b</a><a href="#here">a</a><img src="c.png">'
    )
    (tmp_path / "b.html").write_text(
        '<script src="https://example.org/x.js"></script><a href="https://example.org">'
    )
    wrong, outside = problems(tmp_path)
    assert sorted(wrong) == [
        "a.html: a picture without an alternative text: c.png",
        "a.html: b.html#there: no such place on that page",
        "a.html: c.png leads nowhere",
        "b.html: needs https://example.org/x.js from the network",
    ]
    assert "https://example.org" in outside
