"""What every verb makes of inputs that were bent, cut or written otherwise.

Each file that a verb reads is mutated, the verb runs in this process, and what must never be is looked for: an
exception, a hang, an exit code other than 0, 1 and 2, no sentence where it is not 0, a part of a file, or a number
that is not one and is taken for one.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import shutil
import signal
import sys
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from unittest import mock

import numpy as np
from scipy.spatial import ConvexHull

from tacstrip.arrays import FloatArray
from tacstrip.cli import main
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.io.csv_rows import csv_writer
from tacstrip.io.readings import write_readings
from tacstrip.scan import Scan
from tacstrip.sensor.calibration import Calibration
from tacstrip.sensor.channel import Channel
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.stream.codes import encode, with_converter
from tacstrip.stream.recording.recorder import Recorder
from tacstrip.stream.recording.records import Records
from tacstrip.stream.source import Shape, TrackedShape

HANG_S = 100  # of CPU; of waiting, ten times: on a busy machine a sound verb waits for its turn
_LONG = re.compile("this takes some [0-9]+ minutes")  # work whose length is told
SENSOR = Sensor(construction="crs-crs", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = Contact.polygon([(7.0, 30.0), (31.0, 22.0), (36.0, 60.0), (12.0, 70.0)])

# A word @NAME is an input file, %NAME a file that the verb writes.
COMMANDS = tuple(
    line.split()
    for line in """
simulate @s.toml @c.wkt -o %out.csv --placed %out.wkt
simulate @unit.toml @c.geojson -o %out.csv --turn 20 --at 20 50
reconstruct @s.toml @r.csv --method profile -o %out.geojson
reconstruct @unit.toml @r.csv --assessment none -o %out.geojson --truth @c.wkt
reconstruct @s.toml @codes.csv --object @c.geojson -o %out.geojson
calibrate @s.toml @runs.csv --model offset -o %out.toml
calibrate @s.toml --plan -o %out.csv --wanted 3
calibrate @s.toml --touch @rest.csv -o %out.toml
calibrate @unit.toml @rest.csv --rezero -o %out.toml
record @s.toml @c.wkt -o %out.mcap --seconds 0.1
record @s.toml @codes.csv -o %out.mcap --reconstruct profile
record @r.mcap -o %out.mcap
replay @r.mcap --fast
replay @r.mcap --summary --sensor @unit.toml
recover @r.mcap -o %out.mcap
convert @s.toml @r.csv -o %out.npz
convert @r.mcap -o %out.csv
convert @r.mcap -o %out.geojson
convert @unit.toml @r.mcap -o %out.mcap
track @s.toml @r.csv -o %out.geojson
track @r.mcap -o %out.mcap
live @s.toml @r.csv --no-view --json --speed 1000
live @r.mcap --no-view --json --speed 1000 -o %out.mcap
doctor @r.csv --sensor @s.toml --json
doctor @r.mcap
noise @still.csv @s.toml -o %out.toml
noise @r.mcap
spice @s.toml @c.wkt -o %out.cir
limits @s.toml @c.geojson --positional 0.01 --grid 2 -o %out.json
init %out.toml --like @s.toml
simulate @layers.toml @c.wkt -o %out.csv
reconstruct @layers.toml @two.csv --assessment none -o %out.geojson
simulate @noise.toml @c.wkt --noisy --still 3 -o %out.csv
reconstruct @noise.toml @codes.csv --assessment fast -o %out.geojson
press @skin.toml @ball.stl --pose 8 0 8 -1 0 -1 --depth 1.5 -o %out.csv --patch %out.json
press @skin.toml sphere:4 --path @path.csv -o %out.csv
import @log.txt @s.toml -o %out.csv --answer unit=V
import @log.txt @s.toml --mapping @map.toml -o %out.csv
generate @study.toml --out %out.d --workers 1
sweep @designs.toml --out %out.d --workers 1
""".strip().splitlines()
)
_MORE = {
    "layers.toml": """format = 1
construction = "crs-crs"
adc_bits = 12

[[layer]]
strips = 12
pitch_mm = 4.0
length_mm = 48.0

[[layer]]
angle_deg = 90.0
""",
    "path.csv": """x_mm,y_mm,z_mm,dx,dy,dz,time_s,depth_mm
8,0,8,-1,0,-1,0,1.5
8,1,8,-1,0,-1,0.01,1.5
8,2,8,-1,0,-1,0.02,1.25
""",
    "study.toml": """name = "first steps"
seed = 1
licence = "CC-BY-4.0"
sensor = "s.toml"
[shapes]
n = 6
size_mm = [20.0, 30.0]
corners = [3, 5]
[noise]
positional = 0.005
[dataset]
formats = ["parquet"]
split = {train = 0.5, test = 0.5}
""",
    "designs.toml": """seed = 1
sensor = "s.toml"
[shapes]
size_mm = [20.0, 30.0]
[vary.sensor]
width_mm = [40.0]
pitch_mm = [4.0, 8.0]
[latin]
samples = 2
[latin.noise]
positional = {from = 0.0005, to = 0.01, log = true}
[measure]
what = ["bound"]
scans = 2
""",
}  # more inputs, as they are
# What Python or a careless reader takes for a number, and a person does not: each must be refused.
NO_NUMBERS = (
    "1_0",
    "٣",
    "１２",
    "²",
    "½",
    "0x10",
    "1e999",
    "nan",
    "-inf",
    "--1",
    "1e",
    "3.4.5",
    "12abc",
    "1 0",
    "०.५",
)


@dataclass(frozen=True)
class Outcome:
    """What a verb did with its input.

    Attributes
    ----------
    words, mutation
        The command, and what was done to which of its files.
    code, said
        Exit code, and what stood on standard error.
    wrong
        What must not be; empty where all is well.
    """

    words: str
    mutation: str
    code: int | None
    said: str
    wrong: str


class _Hang(BaseException):
    pass


def make_inputs(folder: Path) -> None:
    """Write one good file of every kind."""
    SENSOR.save(folder / "s.toml")
    each = (1.0,) * SENSOR.strips
    channels = tuple(
        Channel(signature=n, offset=tuple(0.01 * i for i in each), rest=tuple(0.02 * i for i in each))
        for n in SENSOR.signatures
    )
    unit = replace(SENSOR, calibration=Calibration(channels=channels, unit="a"), noise=Noise(white=0.001))
    unit.save(folder / "unit.toml")
    ring = [*SHAPE.vertices.tolist(), SHAPE.vertices[0].tolist()]
    (folder / "c.wkt").write_text(SHAPE.shapes[0].wkt + "\n")
    (folder / "c.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}, indent=1) + "\n")
    noise = Noise(positional=0.002)
    scans = [simulate(SENSOR, SHAPE.moved(0.0, 0.5 * i), noise, rng=i, time_s=0.01 * i) for i in range(12)]
    write_readings(folder / "r.csv", SENSOR, scans)
    write_readings(
        folder / "still.csv",
        SENSOR,
        [simulate(SENSOR, SHAPE, noise, rng=i, time_s=0.01 * i) for i in range(80)],
    )
    rest = np.random.default_rng(0).normal(0.02, 0.001, (2, 20, SENSOR.strips)).clip(0.0)
    write_readings(folder / "rest.csv", SENSOR, [Scan(kh=h, kl=l) for h, l in zip(*rest, strict=True)])
    spec = with_converter(SENSOR)
    raws = [encode(scan, spec, number) for number, scan in enumerate(scans)]
    with csv_writer(folder / "codes.csv", ["scan", "time_s", "strip", "code_h", "code_l"]) as out:
        for raw in raws:
            for strip, codes in enumerate(
                zip(raw.codes["kh"].tolist(), raw.codes["kl"].tolist(), strict=True)
            ):
                out.writerow([raw.sequence, raw.time_s, strip, *(codes if raw.touched[strip] else ("", ""))])
    with Recorder(folder / "r.mcap", spec, ("kh", "kl"), 1_700_000_000_000_000_000) as recorder:
        for raw in raws:
            shapes, middle = (Shape("ok", SHAPE.vertices),), SHAPE.vertices.mean(axis=0)
            tracks = (TrackedShape(1, "ok", SHAPE.vertices - middle, np.array([*middle, 0.0]), 12),)
            recorder.add(replace(raw, shapes=shapes, tracks=tracks))
    for name, text in _MORE.items():
        (folder / name).write_text(text)
    replace(SENSOR, noise=Noise(white=0.001, wander_shared=0.001, hum=0.0005)).save(folder / "noise.toml")
    layers = Sensor.load(folder / "layers.toml")
    small = Contact.polygon([(10.0, 10.0), (30.0, 12.0), (20.0, 30.0)])
    write_readings(folder / "two.csv", layers, [simulate(layers, small, noise, rng=1)])
    Sensor.load("fingertip").save(folder / "skin.toml")
    (folder / "ball.stl").write_text(_ball())
    _write_log(folder, scans)
    with csv_writer(folder / "runs.csv", ["strip", "l_mm", "w_mm", "v_h", "v_l"]) as out:
        for l, w in ((10.0, 5.0), (30.0, 10.0), (50.0, 0.0), (60.0, 20.0), (90.0, 0.0)):
            k: dict[str, FloatArray] = signatures(SENSOR, np.array([l]), np.array([l + w]))
            volts = [f"{SENSOR.vref_volt * (float(k[n][0]) + 0.01):.5f}" for n in ("kh", "kl")]
            for strip in range(SENSOR.strips):
                out.writerow([strip, l, w, *volts])


def _ball() -> str:
    """Return an icosahedron as an ASCII STL."""
    long = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [np.roll([0.0, a, b * long], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    hull = ConvexHull(2.0 * np.array(corners))
    lines = ["solid ball"]
    for face in hull.points[hull.simplices]:
        out = np.cross(face[1] - face[0], face[2] - face[0]) @ face.mean(axis=0) > 0.0
        ring = [f"   vertex {x:.6f} {y:.6f} {z:.6f}" for x, y, z in (face if out else face[::-1])]
        lines += [" facet normal 0 0 0", "  outer loop", *ring, "  endloop", " endfacet"]
    return "\n".join([*lines, "endsolid ball", ""])


def _write_log(folder: Path, scans: Sequence[Scan]) -> None:
    """Write a log of another form, and how it is read."""
    names = [f"{c}{i}" for c in "hl" for i in range(SENSOR.strips)]
    rows = ["; ".join(["ms", *names])]
    for scan in scans:
        volts = SENSOR.vref_volt * np.concatenate([scan["kh"], scan["kl"]])
        fields = ["" if np.isnan(v) else f"{v:.4f}" for v in volts.tolist()]
        rows.append("; ".join([f"{1000.0 * (scan.time_s or 0.0):.1f}", *fields]))
    (folder / "log.txt").write_text("\n".join([*rows, ""]))
    columns = "".join(f'{name} = "{name[1:]}:{name[0]}"\n' for name in names)
    (folder / "map.toml").write_text(
        f'format = 1\nunit = "V"\ntime = "ms"\ntime_unit = "ms"\nstrip_base = 0\nstrips = {SENSOR.strips}\n\n'
        f"[columns]\n{columns}"
    )


def outcomes(
    folder: Path, count: int, seed: int = 0, verbs: Sequence[str] = (), keep: Path | None = None
) -> Iterator[Outcome]:
    """Yield what comes of so many mutated inputs to every verb; all in `folder`, where `make_inputs` was.

    `verbs` chooses some; `keep` is a folder for inputs with which something was wrong.
    """
    for at, words in enumerate(COMMANDS):
        if verbs and words[0] not in verbs:
            continue
        siblings = sum(other[0] == words[0] for other in COMMANDS)
        for trial in range(-(-count // siblings)):
            random = np.random.default_rng([seed, at, trial])
            outcome, data, name = _trial(folder, words, random)
            if outcome.wrong and keep is not None:
                keep.mkdir(exist_ok=True)
                (keep / f"{at}-{trial}-{name}").write_bytes(data)
            yield outcome


def _trial(folder: Path, words: list[str], random: np.random.Generator) -> tuple[Outcome, bytes, str]:
    inputs = [w[1:] for w in words if w.startswith("@")]
    outputs = [w[1:] for w in words if w.startswith("%")]
    name = inputs[random.integers(len(inputs))]
    good = (folder / name).read_bytes()
    what, data, refused = mutate(good, Path(name).suffix, random)
    try:
        (folder / name).write_bytes(data)
        code, printed, said, wrong = run(folder, [w.lstrip("@%") for w in words])
        wrong = wrong or _wrong(folder, outputs, code, printed, said)
        # `import` may ask, or leave a line or a reading out and name it; to `sweep` a design that cannot be is a row.
        aloud = {
            "sweep": ("the column problem says why",),
            "import": ("left out: line", "is empty where the strip's other channel has a reading"),
        }.get(words[0], ())
        row = code == 0 and any(text in printed + said for text in aloud)
        met = code == 2 or row or (words[0], code) == ("import", 1)
        if not wrong and refused and not met:
            wrong = f"a number that is none was taken: exit code {code}"
    finally:
        (folder / name).write_bytes(good)
        for left in [*folder.glob("out.*"), *folder.glob(".tacstrip*")]:
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    return Outcome(" ".join(words), f"{name}: {what}", code, said, wrong), data, name


def run(folder: Path, words: list[str]) -> tuple[int | None, str, str, str]:
    """Run the command line in a folder; return its exit code, what it wrote on both outputs, and what it raised."""
    printed, said, wrong = io.StringIO(), io.StringIO(), ""
    code: int | None = 0

    def hang(number: int, frame: FrameType | None) -> None:
        raise _Hang

    limits = ((signal.SIGPROF, signal.ITIMER_PROF, 1.0), (signal.SIGALRM, signal.ITIMER_REAL, 10.0))
    before = [signal.signal(number, hang) for number, _, _ in limits]
    for _, clock, times in limits:
        signal.setitimer(clock, times * HANG_S)
    try:
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(said),
            mock.patch.object(sys, "argv", ["tacstrip", *words]),
        ):
            main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else None
    except _Hang:
        if not _LONG.search(said.getvalue()):
            wrong = f"no end within {HANG_S} s of CPU"
        code = 1
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        code, wrong = None, f"{type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
    finally:
        for (number, clock, _), old in zip(limits, before, strict=True):
            signal.setitimer(clock, 0.0)
            signal.signal(number, old)
    return code, printed.getvalue(), said.getvalue(), wrong


def _wrong(folder: Path, outputs: list[str], code: int | None, printed: str, said: str) -> str:
    """Return what must not be, after a run that ended."""
    if code not in (0, 1, 2):
        return f"exit code {code}"
    if code and not (said or printed).strip():
        return f"exit code {code} without a word"
    if found := re.search(r"Traceback|\w+Warning: .*|Exception ignored.*", said):
        return f"said: {found.group()}"
    if list(folder.glob(".tacstrip*")):
        return "a temporary file is left"
    for name in outputs:
        if (file := folder / name).exists() and file.suffix in _WHOLE:
            if code == 2:
                return f"{name} was written, and the exit code is 2"
            try:
                _WHOLE[file.suffix](file)
            except Exception as error:
                return f"{name} is not whole: {error}"
    return ""


def _whole_csv(file: Path) -> None:
    _whole_text(file)
    if len({len(row) for row in csv.reader(file.read_text(encoding="utf-8").splitlines())}) != 1:
        raise ValueError("a line is cut")


def _whole_recording(file: Path) -> None:
    records = Records(file)
    for _ in records:
        pass
    if not records.condition.whole:
        raise ValueError("it was cut")


def _whole_arrays(file: Path) -> None:
    with np.load(file) as arrays:
        for name in arrays.files:
            arrays[name]


def _whole_text(file: Path) -> None:
    if not file.read_text(encoding="utf-8").endswith("\n"):
        raise ValueError("the last line has no end")


_WHOLE: dict[str, Callable[[Path], object]] = {
    ".csv": _whole_csv,
    ".npz": _whole_arrays,
    ".mcap": _whole_recording,
    ".geojson": lambda file: json.loads(file.read_text(encoding="utf-8")),
    ".json": lambda file: json.loads(file.read_text(encoding="utf-8")),
    ".toml": lambda file: tomllib.loads(file.read_text(encoding="utf-8")),
    ".wkt": _whole_text,
    ".cir": _whole_text,
}


def mutate(data: bytes, kind: str, random: np.random.Generator) -> tuple[str, bytes, bool]:
    """Return what was done to a file's bytes, what came of it, and whether it must be refused."""
    if kind == ".mcap":
        name = str(random.choice(["flips", "cut", "bytes", "empty", "zeros", "twice", "swapped"]))
        return name, _BYTES[name](data, random), False
    if random.random() < 0.15:
        name = str(random.choice(list(_BYTES)))
        return name, _BYTES[name](data, random), False
    name = str(random.choice([*_TEXTS, "no number", "no number"]))
    text = data.decode()
    if name == "no number":
        return _no_number(text, kind, random)
    return name, _TEXTS[name](text, random).encode(), False


def _flips(data: bytes, random: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for at in random.integers(0, len(data), random.integers(1, 9)):
        changed[at] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _blot(data: bytes, random: np.random.Generator, fill: Callable[[int], bytes]) -> bytes:
    at, size = int(random.integers(len(data))), int(random.integers(1, 60))
    return data[:at] + fill(size) + data[at + size :]


def _swapped(data: bytes, random: np.random.Generator) -> bytes:
    a, b, c = sorted(random.integers(0, len(data), 3).tolist())
    return data[:a] + data[b:c] + data[a:b] + data[c:]


_BYTES: dict[str, Callable[[bytes, np.random.Generator], bytes]] = {
    "flips": _flips,
    "cut": lambda d, r: d[: int(r.integers(len(d)))],
    "bytes": lambda d, r: _blot(d, r, lambda n: r.bytes(n)),
    "zeros": lambda d, r: _blot(d, r, bytes),
    "empty": lambda d, r: b"",
    "twice": lambda d, r: d + d,
    "swapped": _swapped,
    "UTF-16": lambda d, r: d.decode(errors="replace").encode("utf-16"),
    "UTF-16 without mark": lambda d, r: d.decode(errors="replace").encode("utf-16-le"),
    "mark": lambda d, r: b"\xef\xbb\xbf" + d,
    "Latin-1": lambda d, r: d + "# é\n".encode("latin-1"),
}
_NUMBER = re.compile(r"(?<![\w.+-])-?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?(?![\w.])")
_ODD = ("0", "-1", "1e308", "-1e308", "1e-320", "99999999999999999999", "2147483648", "-0.0", "0.1e1", "1e6", "", '""',
        "null", "true", "[]", "'5'", "1,5")  # fmt: skip


def _numbers(text: str) -> list[re.Match[str]]:
    """Return the numbers of a text, those in comments, of the names of keys and of a mesh's normals left out."""
    marks = list(re.finditer(r"#[^\n]*|facet normal[^\n]*", text))
    return [m for m in _NUMBER.finditer(text) if not any(a.start() <= m.start() < a.end() for a in marks)]


def _odd(text: str, random: np.random.Generator) -> str:
    found = _numbers(text)
    if not found:
        return text
    at = found[random.integers(len(found))]
    return text[: at.start()] + str(random.choice(_ODD)) + text[at.end() :]


def _no_number(text: str, kind: str, random: np.random.Generator) -> tuple[str, bytes, bool]:
    """Put something that is no number in the place of one."""
    found = _numbers(text)
    if kind == ".csv":  # the columns that every verb reads: all but time_s and the scan's name
        starts = {m.start() for m in re.finditer(r"(?m)(?<=,)[^,\n]*$", text)}
        found = [m for m in found if m.start() in starts]
    at = found[random.integers(len(found))]
    told = str(random.choice(NO_NUMBERS))
    refused = not (kind == ".toml" and told in ("1_0", "0x10"))  # numbers of TOML
    return f"{at.group()} as {told}", (text[: at.start()] + told + text[at.end() :]).encode(), refused


def _lines(text: str, random: np.random.Generator, change: Callable[[list[str], int, int], None]) -> str:
    lines = text.split("\n")
    a, b = random.integers(0, len(lines), 2).tolist()
    change(lines, a, b)
    return "\n".join(lines)


def _exchange(lines: list[str], a: int, b: int) -> None:
    lines[a], lines[b] = lines[b], lines[a]


def _columns(text: str, random: np.random.Generator) -> str:
    """Exchange two columns' contents below their names."""
    header, *rows = text.split("\n")
    count = header.count(",") + 1
    a, b = random.integers(0, count, 2).tolist()
    for at, row in enumerate(rows):
        if len(fields := row.split(",")) == count:
            fields[a], fields[b] = fields[b], fields[a]
            rows[at] = ",".join(fields)
    return "\n".join([header, *rows])


def _scaled(text: str, random: np.random.Generator) -> str:
    by = float(random.choice([0.001, 0.1, 10.0, 1000.0, -1.0]))
    return _NUMBER.sub(lambda m: f"{float(m.group()) * by:.6g}" if "." in m.group() else m.group(), text)


_TEXTS: dict[str, Callable[[str, np.random.Generator], str]] = {
    "odd number": _odd,
    "a line twice": lambda t, r: _lines(t, r, lambda lines, a, b: lines.insert(a, lines[b])),
    "a line missing": lambda t, r: _lines(t, r, lambda lines, a, b: lines.__delitem__(a)),
    "lines exchanged": lambda t, r: _lines(t, r, _exchange),
    "lines in reverse": lambda t, r: "\n".join([*t.split("\n")[:1], *t.split("\n")[:0:-1]]),
    "columns exchanged": _columns,
    "scaled": _scaled,
    "CR LF": lambda t, r: t.replace("\n", "\r\n"),
    "CR": lambda t, r: t.replace("\n", "\r"),
    "NUL": lambda t, r: t[: (at := int(r.integers(len(t))))] + "\0" + t[at:],
    "semicolons": lambda t, r: t.replace(",", ";"),
    "decimal commas": lambda t, r: t.replace(".", ","),
    "capitals": lambda t, r: t.upper(),
    "a quote": lambda t, r: t[: (at := int(r.integers(len(t))))] + '"' + t[at:],
    "a long line": lambda t, r: t + "1" * 200_000,
    "spaces": lambda t, r: " \n\t",
    "text at the end": lambda t, r: t + "the end",
}


def table(found: Sequence[Outcome]) -> str:
    """Return the exit codes by verb, and what was wrong."""
    codes: dict[str, Counter[int | None]] = {}
    for one in found:
        codes.setdefault(one.words.split()[0], Counter())[one.code] += 1
    lines = [f"{verb:<12}" + "".join(f"{count[c]:>7}" for c in (0, 1, 2)) for verb, count in codes.items()]
    wrong = [f"{o.words} | {o.mutation} | {o.wrong}" for o in found if o.wrong]
    return "\n".join([f"{'exit code':<12}      0      1      2", *lines, f"wrong: {len(wrong)}", *wrong])


if __name__ == "__main__":  # [inputs to every verb] [seed] [verb] ...
    import tempfile

    many, start, *chosen = [*sys.argv[1:], "40", "0"][: max(2, len(sys.argv) - 1)]
    with tempfile.TemporaryDirectory() as made:
        make_inputs(Path(made))
        everything = list(outcomes(Path(made), int(many), int(start), chosen, Path("mutations")))
    sys.stdout.write(table(everything) + "\n")
    sys.exit(any(one.wrong for one in everything))
