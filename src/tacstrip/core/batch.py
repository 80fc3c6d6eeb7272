"""Many scans in one pass: shapes drawn, footprint, closed form, errors, converter.

Every number that is drawn comes from Philox4x32-10 at a counter of its own: the same shapes and errors whatever the
number of threads, the size of a batch or the place of a scan in it. With a key from the seed, block b of stream s of
scan i is the counter (b, s, i mod 2^32, i div 2^32). Stream 0 has the scan's errors, stream 64 + o object o of a scene
(`i` is then the scene's number). Eight neighbouring blocks are one call: word w of block 8 c + j is number
32 c + 8 w + j.

An object takes, in this order: kind, corners, size, aspect, turn, x and y at the beginning of its way, x and y at its
end, turn on the way, an angle for every corner; the last number of object 0 is that of the objects. Errors take D
numbers for each strip: those of strips 8 v to 8 v + 7 are the eighths v D to v D + D - 1 of the stream; first the
uniform ones, signature by signature, then two for the normal ones of both signatures (Box and Muller).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import FloatArray, IntArray
from tacstrip.core.binding import (
    SHAPE_CORNERS,
    BatchErrors,
    BatchResult,
    BatchSensor,
    ShapeLaws,
    at,
    exported,
)
from tacstrip.core.block_pool import empty_arrays
from tacstrip.sensor.closed_form import fraction, sensing_share
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

ON_LINE = 1e-9  # pitches: as near as that to a centre line lies on it
BLOCKS, ROUNDS = 8, 10
SHAPE_STREAM, JITTER, COUNT_WORD = 64, 10, 31
NOTHING, POLYGON, CIRCLE, ELLIPSE = range(4)  # kinds of objects
_LEAST = 50  # scans that are worth a thread
_SLICES = 4  # of each thread, so that none waits long for another
_PLAIN = 2_000_000  # strips that NumPy works on at a time
_TAU = 2.0 * np.pi

_IDEAL = BatchErrors()
_NO_ERRORS = ctypes.addressof(_IDEAL)

Arrays = dict[str, npt.NDArray[Any]]


def batch_sensor(sensor: Sensor, single: bool = False) -> BatchSensor:
    """Return what the core takes of a sensor with a closed form; `single`: results are float32."""
    a = sensing_share(sensor.sensing_ratio)
    shares = [a if SIGNATURES[name].at_upper_end else 0.0 for name in sensor.signatures]
    top = 0.0 if sensor.adc_bits is None else 2.0**sensor.adc_bits - 1.0
    lam = sensor.contact_lambda_mm
    return BatchSensor(
        sensor.strips, len(shares), single, sensor.pitch_mm, sensor.length_mm, (shares[0], shares[-1]), 1.0 - a, lam,
        top,
    )  # fmt: skip


def batch(
    sensor: BatchSensor,
    errors: BatchErrors,
    first: int,
    scans: int,
    *,
    laws: ShapeLaws | None = None,
    ends_mm: tuple[FloatArray, FloatArray] | None = None,
    labels: bool = True,
    workers: int = 1,
) -> tuple[Arrays, tuple[int, int] | None]:
    """Simulate scans number `first` and following.

    Parameters
    ----------
    sensor, errors
        On what, and with what errors.
    first, scans
        Number of the first scan, and how many.
    laws, ends_mm
        How shapes are drawn, or else l and u (scans, strips) [mm], NaN where nothing touches.
    labels
        Whether l, u and what was drawn are in the result.
    workers
        Threads.

    Returns
    -------
    dict
        `readings` (signatures, scans, strips); with labels also l and u (scans, strips); of drawn shapes kind and
        corners (scans, objects), pose (scans, objects, 3), axes (..., 2) and vertices (scans, objects, most, 2).
    tuple or None
        Scan, from 0, and strip where a contact shorts a strip over metal; None where none does.
    """
    out = _empty(sensor, laws, scans, labels)
    core = exported("batch")
    if core is None:
        step = max(_PLAIN // sensor.strips, 1)
        found = [
            _plain_into(out, slice(i, min(i + step, scans)), sensor, errors, first, laws, ends_mm)
            for i in range(0, scans, step)
        ]
    else:
        count = min(max(workers, 1), -(-scans // _LEAST)) or 1
        edges = np.linspace(0, scans, (count if count == 1 else _SLICES * count) + 1).astype(int).tolist()
        slices = [slice(a, b) for a, b in pairwise(edges)]

        def run(part: slice) -> int:
            workspace, result = np.empty(14 * sensor.strips + 512), _result(out, part)
            ends = (None, None) if ends_mm is None else tuple(at(end[part]) for end in ends_mm)
            place = core(
                ctypes.addressof(sensor), laws and ctypes.addressof(laws), ctypes.addressof(errors),
                first + part.start, part.stop - part.start,
                *ends, ctypes.addressof(result), at(workspace),
            )  # fmt: skip
            return -1 if place < 0 else int(place) + part.start * sensor.strips

        waiting = iter(slices)

        def work() -> list[int]:
            return [run(part) for part in waiting]

        if count == 1:
            found = work()
        else:
            with ThreadPoolExecutor(count - 1) as threads:
                others = [threads.submit(work) for _ in range(count - 1)]
                found = work() + [place for other in others for place in other.result()]
    bad = [place for place in found if place >= 0]
    return out, divmod(min(bad), sensor.strips) if bad else None


def closed_forms(sensor: Sensor, l_mm: FloatArray, u_mm: FloatArray) -> dict[str, FloatArray] | None:
    """Return the ideal readings of one scan from l and u (strips,) [mm] by signature.

    None without compiled core, and on a curved skin, whose resistance is not even along the strips.
    """
    core = exported("batch")
    if core is None or sensor.surface is not None:
        return None
    by, rows, n = batch_sensor(sensor), len(sensor.signatures), sensor.strips
    by.top, block = 0.0, np.empty((16 + rows) * n + 512)  # readings, and the workspace
    out, first = block[: rows * n].reshape(rows, n), at(block)
    result = BatchResult((first, first + 8 * (rows - 1) * n))
    l, u = np.ascontiguousarray(l_mm), np.ascontiguousarray(u_mm)
    core(
        ctypes.addressof(by), None, _NO_ERRORS, 0, 1, at(l), at(u), ctypes.addressof(result), first + 8 * rows * n
    )  # fmt: skip
    return dict(zip(sensor.signatures, out, strict=True))


def _empty(sensor: BatchSensor, laws: ShapeLaws | None, scans: int, labels: bool) -> Arrays:
    kind = np.float32 if sensor.single else np.float64
    sizes: dict[str, tuple[tuple[int, ...], npt.DTypeLike]] = {
        "readings": ((sensor.signatures, scans, sensor.strips), kind)
    }
    if labels:
        sizes |= dict.fromkeys(("l", "u"), ((scans, sensor.strips), kind))
    if labels and laws is not None:
        many = (scans, laws.objects[1])
        sizes |= dict.fromkeys(("kind", "corners"), (many, np.int8))
        more = {"pose": (3,), "axes": (2,), "vertices": (laws.corners[1], 2)}
        sizes |= {name: ((*many, *size), kind) for name, size in more.items()}
    return empty_arrays(sizes)


def _result(out: Arrays, part: slice) -> BatchResult:
    """Return where a part of the scans is written."""
    places: dict[str, Any] = {name: at(array[part]) for name, array in out.items() if name != "readings"}
    readings = [at(row[part]) for row in out["readings"]]
    return BatchResult((readings[0], readings[-1]), **places)


def philox(
    key: Sequence[int], block: npt.ArrayLike, stream: npt.ArrayLike, scan: npt.ArrayLike
) -> npt.NDArray[np.uint32]:
    """Return the four words of Philox4x32-10 (..., 4) at counters that broadcast."""
    low, shift = np.uint64(0xFFFFFFFF), np.uint64(32)
    scan = np.asarray(scan, dtype=np.uint64)
    counter = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.uint64) for v in (block, stream)), scan & low, scan >> shift
    )
    a, b, c, d = (np.array(part, dtype=np.uint64) for part in counter)
    for i in range(ROUNDS):
        k0, k1 = (
            np.uint64((int(k) + i * w) & 0xFFFFFFFF)
            for k, w in zip(key, (0x9E3779B9, 0xBB67AE85), strict=True)
        )
        p, q = a * np.uint64(0xD2511F53), c * np.uint64(0xCD9E8D57)
        a, b, c, d = (q >> shift) ^ b ^ k0, q & low, (p >> shift) ^ d ^ k1, p & low
    return np.stack([a, b, c, d], axis=-1).astype(np.uint32)


def _numbers(key: Sequence[int], stream: int, scans: IntArray, first: int, count: int) -> FloatArray:
    """Return numbers 8 first to 8 (first + count) - 1 of a stream (scans, count, 8), less 2^31 - 1/2."""
    eighth = np.arange(first, first + count)
    blocks = BLOCKS * (eighth // 4)[:, None] + np.arange(BLOCKS)
    words = philox(key, blocks, stream, scans[:, None, None])  # (scans, count, 8, 4)
    which = np.broadcast_to((eighth % 4)[:, None, None], (*words.shape[:-1], 1))
    return np.take_along_axis(words, which, -1)[..., 0].astype(float) - (2.0**31 - 0.5)


def _share(centred: FloatArray) -> FloatArray:
    return (centred + 2.0**31) / 2.0**32


def drawn_scenes(laws: ShapeLaws, sensor: BatchSensor, key: Sequence[int], scenes: IntArray) -> Arrays:
    """Draw scenes: kind, corners, radius, aspect, turn, spin (scenes, objects), x, y (..., 2), angle (..., 16).

    Objects that a scene does not have are of kind `NOTHING`.
    """
    most, width = laws.objects[1], sensor.strips * sensor.pitch
    word = np.stack(
        [
            _share(_numbers(key, SHAPE_STREAM + o, scenes, 0, 4)).reshape(len(scenes), 4 * BLOCKS)
            for o in range(most)
        ],
        axis=1,
    )

    def between(at: int, low: float, high: float) -> FloatArray:
        return np.asarray(low + (high - low) * word[:, :, at])

    count = laws.objects[0] + np.floor(word[:, 0, COUNT_WORD] * (most - laws.objects[0] + 1))
    there = np.arange(most) < count[:, None]
    kind = np.where(
        word[..., 0] < laws.polygons, POLYGON, np.where(word[..., 0] < laws.circles, CIRCLE, ELLIPSE)
    )
    low, high = laws.corners
    corners = np.where(kind == POLYGON, low + np.floor(word[..., 1] * (high - low + 1)), 0.0)
    radius = 0.5 * between(2, *laws.size)
    turned = np.arange(SHAPE_CORNERS) + laws.irregularity * (word[..., JITTER : JITTER + SHAPE_CORNERS] - 0.5)
    angle = _TAU / np.maximum(corners, 1.0)[..., None] * turned
    at_x, at_y = word[..., [5, 7]], word[..., [6, 8]]
    y = _placed(at_y, laws.y, radius, sensor.length)
    x = _placed(at_x, laws.x, radius, width)
    several = (count > 1) & bool(laws.apart)
    if several.any():
        sizes = np.where(there, 2.0 * radius, 0.0)
        room = width - sizes.sum(axis=1) - laws.gap * (count - 1)
        ordered = np.sort(np.where(there[..., None], at_x, 2.0), axis=1)
        before = np.cumsum(sizes + laws.gap, axis=1) - sizes - laws.gap
        apart = (before + radius)[..., None] + room[:, None, None] * ordered
        x = np.where(several[:, None, None], apart, x)
    return {
        "kind": np.where(there, kind, NOTHING),
        "corners": np.where(there, corners, 0.0).astype(np.int64),
        "radius": radius,
        "aspect": np.where(kind == CIRCLE, 1.0, between(3, *laws.aspect)),
        "turn": between(4, *laws.turn),
        "spin": laws.spin * (2.0 * word[..., 9] - 1.0),
        "x": x,
        "y": y,
        "angle": angle,
    }


def _placed(at: FloatArray, extent: Sequence[float], radius: FloatArray, whole: float) -> FloatArray:
    low, high = np.maximum(extent[0], radius)[..., None], np.minimum(extent[1], whole - radius)[..., None]
    return np.asarray(low + at * (high - low))


def plain_shapes(laws: ShapeLaws, sensor: BatchSensor, key: Sequence[int], scans: IntArray) -> Arrays:
    """Return the labels and l, u of drawn scans, as `batch` does."""
    drawn = drawn_scenes(laws, sensor, key, scans // laws.frames)
    share = (laws.travel * (scans % laws.frames) / max(laws.frames - 1, 1))[:, None]
    x, y = (drawn[name][..., 0] + share * np.diff(drawn[name])[..., 0] for name in ("x", "y"))
    turn = drawn["turn"] + share * drawn["spin"]
    a, b = drawn["radius"], drawn["radius"] * drawn["aspect"]
    sine, cosine = np.sin(turn), np.cos(turn)
    most = laws.corners[1]
    p, q = (
        a[..., None] * np.cos(drawn["angle"][..., :most]),
        b[..., None] * np.sin(drawn["angle"][..., :most]),
    )
    vertices = np.stack(
        [
            x[..., None] + (p * cosine[..., None] - q * sine[..., None]),
            y[..., None] + (p * sine[..., None] + q * cosine[..., None]),
        ],
        axis=-1,
    )
    vertices[np.arange(most) >= drawn["corners"][..., None]] = np.nan
    l, u = np.full((2, len(scans), sensor.strips), np.nan)
    for o in range(laws.objects[1]):
        round_ = np.isin(drawn["kind"][:, o], (CIRCLE, ELLIPSE))[:, None]
        ellipse = np.stack([part[:, o, None] for part in (x, y, a, b, sine, cosine)])
        for low, high in (
            _polygon_ends(vertices[:, o], drawn["corners"][:, o], sensor),
            (np.where(round_, end, np.nan) for end in _ellipse_ends(ellipse, sensor)),
        ):
            l, u = np.fmin(l, low), np.fmax(u, high)
    gone = drawn["kind"] == NOTHING
    labels = {"pose": np.stack([x, y, turn], axis=-1), "axes": np.stack([a, b], axis=-1)}
    for values in labels.values():
        values[gone] = np.nan
    kinds = {"kind": drawn["kind"].astype(np.int8), "corners": drawn["corners"].astype(np.int8)}
    return {**kinds, **labels, "vertices": vertices, "l": l, "u": u}


def _polygon_ends(
    vertices: FloatArray, corners: IntArray, sensor: BatchSensor
) -> tuple[FloatArray, FloatArray]:
    """Return l and u (scans, strips) of polygons (scans, corners, 2) of so many corners."""
    strip, each = np.arange(sensor.strips), np.arange(len(vertices))
    l, u = np.full((2, len(vertices), sensor.strips), np.nan)
    s = vertices[..., 0] / sensor.pitch - 0.5
    nearest = np.round(s)
    s = np.where(np.abs(s - nearest) < ON_LINE, nearest, s)
    for i in range(vertices.shape[1]):
        after = np.where(i + 1 < corners, i + 1, 0)
        (s0, y0), (s1, y1) = ((s[each, j, None], vertices[each, j, 1, None]) for j in (i, after))
        t = (strip - s0) / np.where(s1 == s0, 1.0, s1 - s0)
        crossed = (strip >= np.minimum(s0, s1)) & (strip <= np.maximum(s0, s1))
        y = np.where(crossed, (1.0 - t) * y0 + t * y1, np.nan)
        l, u = np.fmin(l, y), np.fmax(u, y)
    return l, u


def _ellipse_ends(ellipses: FloatArray, sensor: BatchSensor) -> tuple[FloatArray, FloatArray]:
    """Return l and u (scans, strips) of ellipses: x, y, both axes, sine and cosine of the turn (6, scans, 1)."""
    x, y, a, b, sine, cosine = ellipses
    xx, xy = (a * cosine) ** 2 + (b * sine) ** 2, (a - b) * (a + b) * (sine * cosine)
    d = (np.arange(sensor.strips) + 0.5) * sensor.pitch - x
    near = np.abs(d) - ON_LINE * sensor.pitch <= np.sqrt(xx)
    half = np.where(near, a * b / xx * np.sqrt(np.maximum(xx - d * d, 0.0)), np.nan)
    middle = y + xy / xx * d
    return middle - half, middle + half


def drawn_errors(rows: int, strips: int, errors: BatchErrors, scans: IntArray) -> FloatArray:
    """Return the errors (rows, scans, strips) of so many signatures, of scans of these numbers."""
    widths = [half for half in errors.uniform if half > 0.0]
    parts = len(widths)
    each, eighths = parts * rows + 2 * (errors.sigma > 0.0), -(-strips // BLOCKS)
    found = np.zeros((rows, len(scans), strips))
    if each == 0:
        return found
    drawn = _numbers(tuple(errors.key), 0, scans, 0, eighths * each)  # (scans, eighths D, 8)
    drawn = drawn.reshape(len(scans), eighths, each, BLOCKS).swapaxes(1, 2)
    drawn = drawn.reshape(len(scans), each, eighths * BLOCKS)[:, :, :strips]
    for row in range(rows):
        for part, half in enumerate(widths):
            found[row] += half / 2.0**31 * drawn[:, parts * row + part]
    if errors.sigma > 0.0:
        p, q = _share(drawn[:, parts * rows]), _TAU * _share(drawn[:, parts * rows + 1])
        for row, wave in zip(range(rows), (np.cos, np.sin), strict=False):
            found[row] += errors.sigma * (np.sqrt(-2.0 * np.log(p)) * wave(q))
    return found


def plain_batch(
    sensor: BatchSensor,
    errors: BatchErrors,
    scans: IntArray,
    laws: ShapeLaws | None = None,
    ends_mm: tuple[FloatArray, FloatArray] | None = None,
) -> Arrays:
    """Do as `batch` for scans of these numbers, in NumPy and float64; `shorted` (scans, strips) says where."""
    found = {} if laws is None else plain_shapes(laws, sensor, tuple(errors.key), scans)
    l, u = (found["l"], found["u"]) if ends_mm is None else ends_mm
    shares, narrow = sensor.share[: sensor.signatures], sensor.narrow
    with np.errstate(divide="ignore", invalid="ignore"):
        readings = [
            np.divide(*fraction(l, u - l, sensor.length, share, narrow, sensor.lam)) for share in shares
        ]
    k = np.clip(readings, 0.0, 1.0)
    shorted = np.isnan(k).any(axis=0) & ~np.isnan(l)
    k = np.clip(k + drawn_errors(sensor.signatures, sensor.strips, errors, scans), 0.0, 1.0)
    if sensor.top:
        k = np.round(k * sensor.top) / sensor.top
    return {**found, "l": l, "u": u, "readings": k, "shorted": shorted}


def _plain_into(
    out: Arrays,
    part: slice,
    sensor: BatchSensor,
    errors: BatchErrors,
    first: int,
    laws: ShapeLaws | None,
    ends_mm: tuple[FloatArray, FloatArray] | None,
) -> int:
    """Write what `plain_batch` finds for a part of the scans; return the first shorted place, -1 for none."""
    ends = None if ends_mm is None else (ends_mm[0][part], ends_mm[1][part])
    found = plain_batch(sensor, errors, np.arange(first + part.start, first + part.stop), laws, ends)
    for name, array in out.items():
        array[(slice(None), part) if name == "readings" else part] = found[name]
    places = np.flatnonzero(found["shorted"])
    return int(places[0]) + part.start * sensor.strips if len(places) else -1
