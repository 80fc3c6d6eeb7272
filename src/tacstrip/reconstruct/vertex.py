"""Vertex Reconstruction (thesis, 4.2): a convex polygon from one signature and its vertices' x."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import OptionError, one_of
from tacstrip.reconstruct.result import RecoveredObject, Reconstruction, Status, close_chains
from tacstrip.reconstruct.sections import Section, fit_sections, noise_level
from tacstrip.reconstruct.transitions import transitions_of_runs
from tacstrip.scan import Scan
from tacstrip.sensor.circuit import chain_weights, erosion
from tacstrip.sensor.constructions import SIGNATURES
from tacstrip.sensor.spec import Sensor

_READINGS = ("section", "strip")
_SAME_X = 1e-9  # of the strip length
_WEAK = 2.0  # standard deviations below which a kink's sign is not to be trusted
_OFF_SENSOR = 1e-6  # of the strip length: rounding, not noise


def vertex_reconstruction(
    scan: Scan,
    sensor: Sensor,
    signature: str | None = None,
    transitions: str | npt.ArrayLike = "auto",
    reading: Literal["section", "strip"] = "section",
) -> Reconstruction:
    """Recover a strictly convex polygon from each run of touched strips.

    Parameters
    ----------
    scan, sensor
        What was measured, with what.
    signature
        "kh", "kl" or "k"; by default the last of these that the scan has (5.6: k_l beats k_h).
    transitions
        Ascending x [mm] of all vertices, ends included; or "auto" or "gradient" to find them.
    reading
        "section" fits (p x + q) / (r x + s) to each section's strips and evaluates it at the vertex; a
        kink's sign is that of the slopes' difference there. "strip" reads the strip nearest to the vertex
        and takes the slopes of the chords between vertices, as the thesis does.

    Returns
    -------
    Reconstruction
        Its objects carry a status; a shape that cannot be trusted is "doubtful", one that is wrong for
        certain (sides that cross, corners off the sensor) is not given.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, lacks the signature, or an option does not exist.
    """
    scan.check(sensor)
    name = sensor.check_signature(scan.signatures[-1] if signature is None else signature)
    if reading not in _READINGS:
        raise OptionError(one_of("reading", reading, _READINGS))
    k = scan[name]
    found = transitions_of_runs(scan, sensor, name, transitions)
    runs = zip(scan.runs(), found, strict=True)
    return Reconstruction("vertex", tuple(_recover(sensor, name, run, k[run], x, reading) for run, x in runs), scan.time_s)


def linear_system(
    x: FloatArray, k: FloatArray, upper: BoolArray, y_ends: tuple[float, float], sensor: Sensor, signature: str
) -> tuple[FloatArray, FloatArray]:
    """Set up A y = b for the interior vertices' y: steps 3 and 4 of section 4.2.4.

    A row says c_own y_i + c_opposite y_edge = k_i L. The thesis' row is this one over c_opposite, which
    would divide by zero at k_l = 0.

    Parameters
    ----------
    x
        The vertices' x (N,) [mm].
    k
        Readings at the vertices (N,).
    upper
        Whether each vertex is on the upper chain (N,); the ends' entries do not count.
    y_ends
        y of the left-most and the right-most vertex [mm].
    sensor, signature
        Which closed form.

    Returns
    -------
    tuple
        A (N - 2, N - 2) and b (N - 2,) [mm].
    """
    n = len(x)
    c_l, c_u = chain_weights(k, SIGNATURES[signature].at_upper_end, sensor.sensing_ratio)
    own, opposite = np.where(upper, c_u, c_l), np.where(upper, c_l, c_u)
    matrix = np.diag(own[1:-1])
    right = k[1:-1] * sensor.length_mm
    for start, end in blocks(upper):
        inside = np.arange(start + 1, end)
        to_end = (x[inside] - x[start]) / (x[end] - x[start])
        # The four block types of table 4.1: an end of the block is known where it is an end of the polygon.
        for vertex, weight in ((start, 1.0 - to_end), (end, to_end)):
            if vertex in (0, n - 1):
                right[inside - 1] -= opposite[inside] * weight * y_ends[0 if vertex == 0 else 1]
            else:
                matrix[inside - 1, vertex - 1] += opposite[inside] * weight
    return matrix, right


def blocks(upper: BoolArray) -> list[tuple[int, int]]:
    """Return the blocks of 4.2.4 as (start, end) vertex indices; neighbouring blocks share one section.

    Between a block's start and end all vertices are on one chain, and start and end are neighbours on the
    other chain, so that the edge opposite the block's vertices runs from start to end.
    """
    n = len(upper)
    turns = [i for i in range(2, n - 1) if upper[i] != upper[i - 1]]
    starts = [0, *(i - 1 for i in turns)]
    ends = [*turns, n - 1]
    return list(zip(starts, ends, strict=True))


def _recover(
    sensor: Sensor, signature: str, run: slice, k: FloatArray, x: FloatArray, reading: str
) -> RecoveredObject:
    """Recover one object from the readings of its strips and its vertices' x."""

    def failed(status: Status, advice: str) -> RecoveredObject:
        return RecoveredObject(run, status=status, advice=advice)

    strips = sensor.x_mm[run]
    if len(strips) < 2:
        return failed("too few strips", f"only the strip at x = {strips[0]:.6g} mm is touched: no shape shows across one strip")
    if len(x) < 3:
        return failed("too few transitions", f"{len(x)} transitions are a line at most; a polygon needs 3 or more. Give them by hand, or use both signatures")
    near = np.flatnonzero(np.diff(x) <= _SAME_X * sensor.length_mm)
    if len(near):
        return failed("shared x", f"two vertices share x = {x[near[0]]:.6g} mm: Vertex Reconstruction is singular there; turn the object a little")
    sections = fit_sections(strips, k, x, sensor.sensing_ratio)
    k_at, jump, deviation = _by_section(sections, x) if reading == "section" else _by_strip(strips, k, x)
    if np.any(np.isnan(k_at)):
        bad = x[np.flatnonzero(np.isnan(k_at))[0]]
        return failed("too few strips", f"no strip is touched beside the vertex at x = {bad:.6g} mm; give transitions within the contact, or use finer strips")
    upper = np.concatenate(([False], jump < 0.0, [False]))  # the slope drops at an upper vertex (4.2.2)
    y = _solve(sensor, signature, x, k_at, upper)
    if y is None:
        return failed("singular", "the readings do not determine the vertices; turn or move the object a little")
    vertices = np.stack([x, y], axis=1)
    ends = np.zeros(len(x), dtype=bool)
    ends[[0, -1]] = True
    polygon = close_chains(vertices[~upper | ends], vertices[upper | ends])
    sigma = noise_level(sections)
    weak = x[1:-1][np.abs(jump) < _WEAK * deviation * sigma]  # NaN sigma: nothing known, nothing weak
    status, advice = _judge(sensor, polygon, weak)
    if status == "too noisy":
        return failed(status, advice)
    low = np.interp(strips, *vertices[~upper | ends].T)
    high = np.interp(strips, *vertices[upper | ends].T)
    return RecoveredObject(run, polygon, (strips, low, high), None, status, advice)


def _by_section(sections: list[Section | None], x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return k at the vertices (N,), the slope's jumps and their deviations over the noise's (N - 2,)."""
    k_at = np.full(len(x), np.nan)
    jump, deviation = np.zeros(len(x) - 2), np.zeros(len(x) - 2)
    for i, at in enumerate(x):
        sides = [s for s in (sections[i - 1] if i else None, sections[i] if i < len(sections) else None) if s]
        if sides:
            values, variances = np.array([s.reading(at) for s in sides]).T
            k_at[i] = np.average(values, weights=1.0 / np.maximum(variances, 1e-12))
        if 0 < i < len(x) - 1 and len(sides) == 2:
            (left, v_left), (right, v_right) = (s.slope(at) for s in sides)
            jump[i - 1], deviation[i - 1] = right - left, np.sqrt(v_left + v_right)
    return k_at, jump, deviation


def _by_strip(strips: FloatArray, k: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same by the thesis' rules: nearest strip, chords between vertices."""
    k_at = k[np.abs(strips[:, None] - x).argmin(axis=0)]
    run = np.diff(x)
    a, b = 1.0 / run[:-1], 1.0 / run[1:]
    return k_at, np.diff(np.diff(k_at) / run), np.sqrt(a**2 + (a + b) ** 2 + b**2)


def _solve(
    sensor: Sensor, signature: str, x: FloatArray, k: FloatArray, upper: BoolArray
) -> FloatArray | None:
    """Solve for all vertices' y; None where the system is singular."""
    y = k * sensor.length_mm  # w = 0 at the ends (4.2.2)
    weights = chain_weights(k, SIGNATURES[signature].at_upper_end, sensor.sensing_ratio)
    for _ in range(1 if sensor.contact_lambda_mm == 0.0 else 50):
        matrix, right = linear_system(x, k, upper, (y[0], y[-1]), sensor, signature)
        # Contact resistance: the reading is that of [l + T, u - T], so (c_l - c_u) T moves to the right.
        eaten = erosion(_width(x, y, upper), sensor.contact_lambda_mm)
        right -= ((weights[0] - weights[1]) * eaten)[1:-1]
        if not np.all(np.isfinite(matrix)) or np.linalg.cond(matrix) > 1e12:
            return None
        before = y[1:-1].copy()
        y[1:-1] = np.linalg.solve(matrix, right)
        if np.abs(y[1:-1] - before).max() <= 1e-12 * sensor.length_mm:
            break
    return y


def _width(x: FloatArray, y: FloatArray, upper: BoolArray) -> FloatArray:
    """Return the contact's length at each vertex, not below 0."""
    on_low, on_high = ~upper, upper.copy()
    on_high[[0, -1]] = True
    return np.maximum(np.interp(x, x[on_high], y[on_high]) - np.interp(x, x[on_low], y[on_low]), 0.0)


def _judge(sensor: Sensor, polygon: FloatArray, weak: FloatArray) -> tuple[Status, str]:
    """Say whether the polygon can be what touched the sensor."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    off = np.maximum(-polygon[:, 1], polygon[:, 1] - sensor.length_mm)
    advice = "average more scans, recalibrate, or use both signatures"
    if off.max() > _OFF_SENSOR * sensor.length_mm:
        x, y = polygon[off.argmax()]
        return "too noisy", f"a vertex falls off the sensor, at x = {x:.6g}, y = {y:.6g} mm; {advice}"
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    angle = np.arctan2(edge[:, 1], edge[:, 0])
    total = (np.remainder(np.diff(np.append(angle, angle[0])) + np.pi, 2.0 * np.pi) - np.pi).sum()
    if _crosses(polygon) or abs(total - 2.0 * np.pi) > 1e-6:
        return "too noisy", f"the vertices found do not make a polygon: upper and lower sides cross; {advice}"
    np.clip(polygon[:, 1], 0.0, sensor.length_mm, out=polygon[:, 1])
    if len(weak):
        return "doubtful", f"the kink at x = {weak[0]:.6g} mm hides in the noise: its vertex may be on the other side; {advice}"
    if turn.min() < 0.0:
        x, y = np.roll(polygon, -1, axis=0)[turn.argmin()]
        return "doubtful", f"the corner at x = {x:.6g}, y = {y:.6g} mm is not convex, which Vertex Reconstruction assumes; {advice}"
    return "ok", ""


def _crosses(polygon: FloatArray) -> bool:
    """Whether the chains of an x-monotone polygon cross: the upper one falls below the lower."""
    turn = int(polygon[:, 0].argmax())
    low, high = polygon[: turn + 1], np.concatenate([polygon[turn:], polygon[:1]])[::-1]
    x = polygon[1:, 0][polygon[1:, 0] < polygon[turn, 0]]
    return bool(np.any(np.interp(x, *high.T) <= np.interp(x, *low.T)))
