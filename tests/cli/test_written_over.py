"""What is written over, and what is not: one rule for all verbs."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import tacstrip as ts
from tacstrip.cli import VERBS, cli

# Every file or folder that a verb is told, by its option, or its name where it is an argument: read or drawn; else
# written, with the rest of a call.
READ = {
    "init": {"--from"}, "simulate": {"contact"}, "press": {"--path"}, "import": {"log", "--mapping"},
    "reconstruct": {"readings", "--object", "--truth"}, "generate": {"study"}, "sweep": {"study"},
    "calibrate": {"data", "--touch"}, "replay": {"recording"}, "recover": {"recording"}, "doctor": {"file"},
    "noise": {"recording"}, "spice": {"contact"}, "limits": {"contact"},
}  # fmt: skip
EDITED = {("noise", "--write")}
WRITTEN = {
    ("init", "file"): "init a.toml",
    ("simulate", "-o"): "simulate s.toml o.wkt -o a.csv",
    ("simulate", "--placed"): "simulate s.toml o.wkt -o new.csv --placed a.wkt",
    ("press", "-o"): "press fingertip plane --pose 0 0 20 -1 0 -1 --depth 1 -o a.csv",
    ("press", "--patch"): "press fingertip plane --pose 0 0 20 -1 0 -1 --depth 1 -o new.csv --patch a.json",
    ("import", "-o"): "import log.csv -o a.csv",
    # It writes b.mapping.toml, which somebody may have edited.
    ("import", "mapping"): "import log.csv s.toml -o b.csv --answer strip_base=0 --answer missing=untouched",
    ("reconstruct", "-o"): "reconstruct s.toml r.csv -o a.geojson",
    ("track", "-o"): "track s.toml r.csv -o a.geojson",
    ("calibrate", "-o"): "calibrate s.toml runs.csv -o a.toml",
    ("record", "-o"): "record s.toml r.csv -o a.mcap",
    ("recover", "-o"): "recover old.mcap -o a.mcap",
    ("recover", "beside"): "recover a.mcap",
    ("convert", "-o"): "convert s.toml r.csv -o a.npz",
    ("live", "-o"): "live s.toml r.csv -o a.mcap",
    ("live", "--foxglove-layout"): "live s.toml r.csv --foxglove 0 --foxglove-layout a.json",
    ("noise", "-o"): "noise r.csv s.toml -o a.toml",
    ("spice", "-o"): "spice s.toml o.wkt -o a.cir",
    ("limits", "-o"): "limits s.toml o.wkt -o a.json",
}
FOLDERS = {
    ("demo", "--out"): "demo --out own",
    ("generate", "--out"): "generate study.toml --out own",
    ("sweep", "--out"): "sweep sweep.toml --out own",
    ("calibrate", "--report"): "calibrate s.toml runs.csv -o new.toml --report own",
    ("reproduce", "--out"): "reproduce --out own",
}
SENSOR = ts.Sensor(construction="crs-crs", strips=10, pitch_mm=3.0, length_mm=30.0)
STUDY = """\
sensor = "s.toml"
[shapes]
n = 3
size_mm = [8, 12]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    SENSOR.save("s.toml")
    Path("o.wkt").write_text("POLYGON ((3 5, 27 9, 22 25, 3 5))\n", encoding="utf-8")
    ts.write_readings("r.csv", SENSOR, [ts.simulate(SENSOR, ts.Contact.from_wkt(Path("o.wkt").read_text()))])
    Path("log.csv").write_text("t_ms,strip,vh,vl\n" + "".join(f"{20 * n},3,2.{n},1.{n}\n" for n in range(8)))
    for name in (
        "a.toml",
        "a.csv",
        "a.wkt",
        "a.json",
        "a.geojson",
        "a.mcap",
        "a.npz",
        "a.cir",
        "b.mapping.toml",
    ):
        Path(name).write_text("the only copy", encoding="utf-8")
    Path("a-recovered.mcap").write_text("the only copy", encoding="utf-8")
    (tmp_path / "own/figures").mkdir(parents=True)
    Path("own/figures/setup.png").write_text("the only copy", encoding="utf-8")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    Path("sweep.toml").write_text(
        STUDY.replace("n = 3\n", "") + '[measure]\nwhat = ["bound"]\n[vary]\npitch_mm = [5.0]\n',
        encoding="utf-8",
    )
    return tmp_path


def test_every_file_that_a_verb_is_told_is_known_here() -> None:
    drawn = {"--plot"}
    for verb in VERBS:
        command = cli.get_command(click.Context(cli), verb)
        assert command is not None
        paths = [p for p in command.params if isinstance(p.type, click.Path)]
        names = {p.opts[0] if isinstance(p, click.Option) else p.name for p in paths}
        written = {option for v, option in (*WRITTEN, *FOLDERS, *EDITED) if v == verb}
        extra = {"mapping", "beside"}  # names that the verb makes itself
        assert names - drawn - READ.get(verb, set()) == written - extra, verb


@pytest.mark.parametrize("call", [*WRITTEN.values()])
def test_no_verb_writes_over_a_file_unasked(folder: Path, call: str) -> None:
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    done = CliRunner().invoke(cli, call.split())
    assert isinstance(done.exception, ts.OptionError), done.output
    assert "exists already; choose another name, or add --" in str(done.exception)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


def test_the_same_mapping_once_more_is_no_loss(folder: Path) -> None:
    for output in ("new.csv", "new.mcap"):
        done = CliRunner().invoke(
            cli, f"import log.csv s.toml -o {output} --answer strip_base=0 --answer missing=untouched".split()
        )
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize("call", [*FOLDERS.values()])
def test_no_verb_fills_a_folder_of_something_else(folder: Path, call: str) -> None:
    done = CliRunner().invoke(cli, call.split())
    assert isinstance(done.exception, ts.OptionError), done.output
    assert str(done.exception).startswith("own ")
    assert [path.name for path in (folder / "own").rglob("*")] == ["figures", "setup.png"]


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("report.html", FOLDERS["calibrate", "--report"]),  # as test runners write it
        ("tables.json", FOLDERS["reproduce", "--out"]),
        ("figures/figure_2.png", FOLDERS["reproduce", "--out"]),
        ("demo.png", FOLDERS["demo", "--out"]),
    ],
)
def test_a_folder_is_not_known_by_a_name_that_others_give_too(folder: Path, name: str, call: str) -> None:
    for own in (name, "shape.geojson"):
        (folder / "own" / own).write_text("the only copy", encoding="utf-8")
    assert isinstance(CliRunner().invoke(cli, call.split()).exception, ts.OptionError)


@pytest.mark.parametrize(
    "call",
    [
        "reconstruct s.toml r.csv -o new.geojson",
        "reconstruct s.toml r.csv -o new.json",
        "track s.toml r.csv -o new.geojson",
        "limits s.toml o.wkt -o new.json --positional 0.005",
        "spice s.toml o.wkt -o new.cir",
    ],
)
def test_results_are_made_again_in_their_place(folder: Path, call: str) -> None:
    for _ in range(2):
        assert CliRunner().invoke(cli, call.split()).exit_code == 0


@pytest.mark.parametrize(
    ("name", "text", "call"),
    [
        ("plan.geojson", '{"properties": {"status": "planned"}}', "reconstruct s.toml r.csv -o plan.geojson"),
        ("rig.json", '{"limits": [0, 5]}', "limits s.toml o.wkt -o rig.json --positional 0.005"),
    ],
)
def test_a_file_with_a_word_of_ours_is_not_taken_for_a_result(
    folder: Path, name: str, text: str, call: str
) -> None:
    (folder / name).write_text(text, encoding="utf-8")
    assert isinstance(CliRunner().invoke(cli, call.split()).exception, ts.OptionError)
    assert (folder / name).read_text(encoding="utf-8") == text


def test_what_is_asked_for_is_written_over_and_pictures_always(folder: Path) -> None:
    call = ["reconstruct", "s.toml", "r.csv", "-o", "a.geojson", "--plot", "a.png"]
    Path("a.png").write_text("an older picture", encoding="utf-8")
    assert CliRunner().invoke(cli, [*call, "--force"]).exit_code == 0
    assert "FeatureCollection" in Path("a.geojson").read_text(encoding="utf-8")
    assert Path("a.png").read_bytes().startswith(b"\x89PNG")
