"""What is written is whole or not there, whichever verb writes it; what has no end is not read."""

from __future__ import annotations

import json
import os
import re
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import tacstrip as ts
from studies.mutations import make_inputs
from tacstrip.errors import OptionError
from tacstrip.files import replacing, why_unreadable, write_text
from tacstrip.io.log_import.mapping import ColumnMapping
from tacstrip.stream import ReadingsSource, recover

SENSOR = ts.Sensor(construction="crs-crs", strips=12, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(12.0, 30.0), (45.0, 22.0), (50.0, 70.0), (20.0, 80.0)])


def test_a_file_takes_its_name_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    with replacing(file) as part:
        part.write_text("new")
        assert part.parent == tmp_path
        assert not file.exists()
    assert file.read_text() == "new"
    assert [f.name for f in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_what_breaks_off_leaves_the_file_as_it_was(tmp_path: Path, error: type[BaseException]) -> None:
    file = tmp_path / "a.txt"
    file.write_text("old")

    def write() -> None:
        with replacing(file) as part:
            part.write_text("ne")
            raise error

    with pytest.raises(error):
        write()
    assert file.read_text() == "old"
    assert [f.name for f in tmp_path.iterdir()] == ["a.txt"]


def test_a_killed_process_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text("old")
    code = (
        "import sys, tacstrip.files as f\n"
        "with f.replacing('a.txt') as part:\n"
        "    part.write_text('ne'); print('there', flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == b"there\n"
        process.send_signal(signal.SIGKILL)
    assert file.read_text() == "old"


def test_a_link_stays_a_link_and_a_mode_its_mode(tmp_path: Path) -> None:
    file, link = tmp_path / "a.txt", tmp_path / "link"
    file.write_text("old")
    file.chmod(0o640)
    link.symlink_to(file)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def test_a_device_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    write_text("/dev/null", "text")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(OSError, match="/dev/full"):
        write_text("/dev/full", "text")
    assert Path("/dev/full").is_char_device()


def test_errors_name_the_file_and_not_the_one_beside_it(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        write_text(tmp_path / "no" / "a.txt", "text")
    assert missing.value.filename == str(tmp_path / "no" / "a.txt")
    with pytest.raises(IsADirectoryError):
        write_text(tmp_path, "text")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anything")
def test_a_file_that_may_not_be_written_is_not_replaced(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text("old")
    file.chmod(0o444)
    with pytest.raises(PermissionError):
        write_text(file, "new")
    assert file.read_text() == "old"


NEW = "new.mcap"  # the recording of `live` and `record` grows in place, and begins only where there is room
# Every verb that writes a file, with the file; pictures, which one function writes, of each kind.
WRITES = [
    ("init out.toml --force", "out.toml"),
    ("simulate s.toml c.wkt -o out.csv --force", "out.csv"),
    ("simulate s.toml c.wkt -o /dev/null --placed out.wkt --force", "out.wkt"),
    ("simulate s.toml c.wkt -o /dev/null --plot out.svg", "out.svg"),
    ("reconstruct s.toml r.csv --method profile -o out.geojson --force", "out.geojson"),
    ("calibrate s.toml --plan -o out.csv --wanted 3 --overwrite", "out.csv"),
    ("calibrate s.toml --touch rest.csv -o out.toml --overwrite", "out.toml"),
    ("convert r.mcap -o out.csv --force", "out.csv"),
    ("convert r.mcap -o out.npz --force", "out.npz"),
    ("convert r.mcap -o out.geojson --force", "out.geojson"),
    ("convert r.mcap -o out.toml --force", "out.toml"),
    ("convert r.mcap -o out.mcap --force", "out.mcap"),
    ("recover r.mcap -o out.mcap --force", "out.mcap"),
    ("replay r.mcap --fast --plot out.pdf", "out.pdf"),
    ("demo --out demo", "demo/demo.png"),
    ("calibrate s.toml runs.csv --model offset -o /dev/null --report report", "report/figures/worst.png"),
    ("noise still.csv s.toml -o out.toml --force", "out.toml"),
    ("record r.mcap -o new.mcap", NEW),
    ("live r.mcap --no-view --speed 1000 -o new.mcap", NEW),
    ("doctor r.csv --sensor s.toml --plot out.png", "out.png"),
    ("spice s.toml c.wkt -o out.cir --force", "out.cir"),
    ("limits s.toml c.wkt --positional 0.01 --grid 2 -o out.json --force", "out.json"),
]
# Files of more than 64 bytes cannot be written: that stands for the end of the disk. Output goes through pipes.
DRIVER = """
import contextlib, io, json, resource, sys
from tacstrip.cli import main
sys.dont_write_bytecode = True  # half a file of bytecode would stay
resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64))
told = []
for line in json.load(sys.stdin):
    sys.argv, said, code = ["tacstrip", *line.split()], io.StringIO(), 0
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            main()
        except SystemExit as end:
            code = end.code
    told.append((code, said.getvalue()))
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[tuple[int, str]]]:
    """Run every writing verb where the disk is full: the folder, and each one's exit code and words."""
    folder = tmp_path_factory.mktemp("full")
    make_inputs(folder)
    for name in ("report/figures", "demo"):
        (folder / name).mkdir(parents=True)
    for _, name in WRITES:
        if name != NEW:
            (folder / name).write_text("old")
    done = subprocess.run(
        [sys.executable, "-c", DRIVER], cwd=folder, input=json.dumps([words for words, _ in WRITES]),
        capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


@pytest.mark.parametrize(
    "at", range(len(WRITES)), ids=[words.split()[0] + "-" + name for words, name in WRITES]
)
def test_a_full_disk_leaves_no_part_of_a_file(full: tuple[Path, list[tuple[int, str]]], at: int) -> None:
    folder, told = full
    code, said = told[at]
    assert code == 1, said
    assert f"Error: {WRITES[at][1]}: File too large; nothing is written there: make room" in said
    assert WRITES[at][1] == NEW or (folder / WRITES[at][1]).read_text() == "old"
    assert not (folder / NEW).exists()
    assert not list(folder.glob(".*"))


def test_one_function_alone_writes_pictures() -> None:
    source = Path(ts.__file__).parent
    writing = {
        f
        for f in source.rglob("*.py")
        if re.search(r"^[^>]*\.(savefig|print_\w+)\(", f.read_text("utf-8"), re.M)
    }
    assert writing == {source / "plot/theme.py"}


def test_a_picture_that_cannot_be_drawn_leaves_the_old_one(tmp_path: Path) -> None:
    from tacstrip.plot.theme import new_axes, save

    figure, axes = new_axes()
    axes.set_title("$\\nothing$")  # no such symbol: found while it is drawn
    (tmp_path / "a.png").write_text("old")
    with pytest.raises(ValueError, match="nothing"):
        save(figure, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_text() == "old"


def _endless(folder: Path, ending: str) -> list[Path]:
    os.mkfifo(folder / f"pipe{ending}")
    (folder / f"zero{ending}").symlink_to("/dev/zero")
    return [folder / f"pipe{ending}", folder / f"zero{ending}"]


def test_what_has_no_end_is_not_read(tmp_path: Path) -> None:
    for file in _endless(tmp_path, ".toml"):
        with pytest.raises(ts.SpecError, match=r"toml: is a (pipe|device), not a file; save what it gives"):
            ts.Sensor.load(file)
        with pytest.raises(OptionError, match=r"toml: is a (pipe|device), not a file"):
            ColumnMapping.load(file)
    for file in _endless(tmp_path, ".csv"):
        for read in (ts.read_readings, ts.read_runs, ReadingsSource):
            with pytest.raises(ts.ReadingError, match=r"csv: is a (pipe|device), not a file"):
                read(file, SENSOR)
    for file in _endless(tmp_path, ".wkt"):
        with pytest.raises(ts.ContactError, match=r"wkt: is a (pipe|device), not a file"):
            ts.read_contact(file)
    for file in _endless(tmp_path, ".mcap"):
        with pytest.raises(ts.RecordingError, match=r"mcap: is a (pipe|device), not a file"):
            ts.Recording(file)
        with pytest.raises(ts.RecordingError, match=r"mcap: is a (pipe|device), not a file"):
            recover(file, tmp_path / "out.mcap")
    for file in _endless(tmp_path, ".stl"):
        with pytest.raises(ts.ContactError, match=r"stl: is a (pipe|device), not a file"):
            ts.Solid.from_mesh(file)
    assert why_unreadable(tmp_path) == why_unreadable(tmp_path / "none") == ""


def test_what_a_pipe_gives_without_end_is_not_read_to_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tacstrip.files._LONGEST", 100)
    monkeypatch.setattr("tacstrip.io.csv_rows._LONGEST_LINE", 100)
    for name in ("a.toml", "a.csv", "a.wkt"):
        (tmp_path / name).write_text("1" * 200)
    with pytest.raises(ts.SpecError, match="longer than 100 characters"):
        ts.Sensor.load(tmp_path / "a.toml")
    with pytest.raises(ts.ContactError, match=r"a\.wkt: cannot be read \(it is longer than 100 characters"):
        ts.read_contact(tmp_path / "a.wkt")
    for read in (ts.read_readings, ts.read_runs):
        with pytest.raises(ts.ReadingError, match="a line is longer than 100 characters"):
            read(tmp_path / "a.csv", SENSOR)


def test_a_file_is_on_the_disk_before_it_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a power cut may leave the name with nothing in it."""
    saved: list[bool] = []
    monkeypatch.setattr(os, "fsync", lambda _: saved.append((tmp_path / "a.txt").exists()))
    write_text(tmp_path / "a.txt", "text")
    assert saved == [False]


def test_what_the_caller_hands_over_is_read(tmp_path: Path) -> None:
    SENSOR.save(tmp_path / "s.toml")
    ts.write_readings(tmp_path / "r.csv", SENSOR, [ts.simulate(SENSOR, SHAPE)])
    command = "from tacstrip.cli import main; main()"
    words = ["reconstruct", "s.toml", "/dev/stdin", "--method", "profile"]
    done = subprocess.run(
        [sys.executable, "-c", command, *words], cwd=tmp_path, input=(tmp_path / "r.csv").read_text(),
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["features"][0]["geometry"]
