"""Which object was pressed into a skin: its pose, depth and radius from one scan, by how deep the skin lies in it.

The family is given: planes, edges of one angle, cylinders, spheres, or one box or mesh. A pose is a place on the skin,
the depth there, and how the object is turned about the skin's normal, along which it came. Where an object touches a
strip, its readings are compared; that it touches strips that read nothing, or none where readings are, costs depth.
What is given, and how well it is known, are mean and scatter of draws from the likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import Patch, patch_at, patch_load
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ContactError, OptionError
from tacstrip.reconstruction.noise_covariance import Averaging, averaging_advice, signature_advice
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.reconstruction.pressed.descent import descents, refined, ridge
from tacstrip.reconstruction.pressed.draws import Draws, draw
from tacstrip.reconstruction.pressed.kinds import Held
from tacstrip.reconstruction.pressed.poses import GUESS, TOUCH_MM, TURNS, Poses, cap
from tacstrip.reconstruction.result import Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor

_SEED = 20  # of the draws: the same result for the same scan
_REDRAWN = 3  # times that draws may find a pose far better than any before
_LOADS = 96  # draws whose area and force are computed
_FEW_DRAWS = 40.0  # even draws, fewer of which do not tell how well something is known
# Per parameter: the cost by which the draws' mean may be above the best pose's, else that is given.
_MEAN = 1.0
_BELIEF = 8.0  # readings that the noise given counts for, against what is left over
_ALARM = 3.5  # standard deviations of chi square
_BETTER = 9.0  # chi square of one by which another kind explains the readings better
_STRAIGHT = 0.1  # standard deviation of a bend, per 10 mm: about that of the force, relative to it
_LOST_MM = 0.1  # depth by which touch and silence may contradict the object
_LIKELY = 0.05  # share of draws
_RIVAL = 4.0  # chi square by which another pose is no rival
_WITHIN, _AT_MOST = 1.96, 3.0  # deviations: of intervals; by which no radius may lie further off than below
RADIUS_OPEN = 0.3  # of a radius' logarithm: a radius that may lie further off is open
_UNTOLD = 0.5  # relative standard deviation of a radius or force that is not told
_ROUND = ("sphere", "cylinder")  # of a radius
_AXES = ("cylinder", "edge", "box")  # a mesh may be alike turned about its own axis
_BENT = {  # what rests on the kind that was given, where readings do not tell it
    "plane": "the force holds if it is flat: a ball or a cone leaves the same patch",
    "cylinder": "radius and force hold if it is straight: a body that is curved along its axis too, as an ellipsoid, "
                "reads the same",
    "edge": "the force holds if its ridge is straight: one that is curved along it reads the same",
}  # fmt: skip
# Standard deviations from which on a result is doubtful; with 95 % area, direction, axis, radius are within twice that.
_AREA, _DIRECTION, _AXIS, _RADIUS = 0.05, math.radians(2.5), math.radians(5.0), 0.125


@dataclass(frozen=True, eq=False)
class SolidFit:
    """The object that explains a scan, with how well that is known.

    Attributes
    ----------
    status, advice
        "ok"; "doubtful": the readings leave much open, or are of another object; "no contact". In words, why.
    solid
        The object at its pose; None without contact.
    patch
        What it touches of the skin, with `l`, `u`, outline and so on.
    names, values, covariance
        What was fitted: "across_mm", "along_mm" of the place, on a plane that touches the skin where the readings are;
        "depth_mm", "log_radius", "turn_rad"; their values (P,) and covariance (P, P).
    area_mm2, area_sigma_mm2
        Of the patch, and its standard deviation.
    force_n, force_sigma_n
        By the skin's stiffness; NaN where the readings do not tell it.
    radius_mm, radius_sigma_mm
        Of a sphere or cylinder; NaN where the readings do not tell it.
    direction, direction_sigma_rad
        From the skin into the object, a unit vector (3,), and its standard deviation in the worse of two ways.
    axis_sigma_rad
        Of the axis of a cylinder or edge, or a box's first side, about the direction; else NaN.
    alternatives
        Other poses that explain the readings nearly as well.
    time_s
        The scan's time [s].
    intervals
        Within what each of "area_mm2", "force_n" and "radius_mm" lies with 95 %: (low, high), of what is told (a ball's
        radius on a tube in 8 of 10 scans only). In "direction_rad" and "axis_rad" how far the direction, and the axis
        about it, are off: (0, at most).

    Examples
    --------
    >>> import tacstrip as ts
    >>> fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.002)
    >>> patch = ts.press(fingertip, ts.Solid.plane().at((20, 0, 20), toward=(-1, 0, -1)), depth_mm=1.0)
    >>> found = ts.fit_solid(ts.simulate(fingertip, patch, noise, rng=1), fingertip, ts.Solid.plane(), noise)
    >>> bool(found.direction @ [0.7071, 0, 0.7071] > 0.9999), round(found.area_mm2)
    (True, 63)
    """

    status: Status
    advice: str
    solid: Solid | None = None
    patch: Patch | None = None
    names: tuple[str, ...] = ()
    values: FloatArray | None = None
    covariance: FloatArray | None = None
    area_mm2: float = math.nan
    area_sigma_mm2: float = math.nan
    force_n: float = math.nan
    force_sigma_n: float = math.nan
    radius_mm: float = math.nan
    radius_sigma_mm: float = math.nan
    direction: FloatArray | None = None
    direction_sigma_rad: float = math.nan
    axis_sigma_rad: float = math.nan
    alternatives: tuple[Solid, ...] = ()
    time_s: float = 0.0
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def axis(self) -> FloatArray | None:
        """Unit vector (3,) along a cylinder's axis or an edge's ridge, to either side; None of others."""
        return None if self.solid is None else self.solid.axis

    @property
    def depth_mm(self) -> float:
        """How deep the object's lowest place lies in the skin; NaN without contact, or where the radius is not told.

        The same patch is a small object's that lies deep, and a large one's that does not.
        """
        if (
            self.values is None
            or self.solid is None
            or (self.solid.kind in _ROUND and math.isnan(self.radius_mm))
        ):
            return math.nan
        return float(self.values[self.names.index("depth_mm")])

    def __repr__(self) -> str:
        if self.solid is None:
            return f"<SolidFit: {self.status}>"
        force = "force not told" if math.isnan(self.force_n) else f"{self.force_n:.4g} N"
        area = f"{self.area_mm2:.4g} +- {self.area_sigma_mm2:.2g} mm2"
        return f"<SolidFit: {self.status}, {self.solid.kind}, {area}, {force}>"


@takes(scan=Scan, sensor=Sensor, solid=Solid, noise=Noise)
def fit_solid(
    scan: Scan, sensor: Sensor, solid: Solid, noise: Noise | None = None, *, known_size: bool = False,
    start: Solid | SolidFit | None = None,
) -> SolidFit:  # fmt: skip
    """Find which object of a family was pressed, from one scan: pose, depth, and the radius of spheres and cylinders.

    Parameters
    ----------
    scan, sensor
        What was measured, with what.
    solid
        The family: its kind counts and its angle, sides or mesh; its radius is where the search begins; not its pose.
        It came along the skin's normal.
    noise
        Of the readings; None: the spec's `[noise]`, and without one estimated from what the fit leaves over.
    known_size
        True: the radius is the one given.
    start
        Where the object is about, such as the fit of the scan before: the search begins there alone, and everywhere
        where that does not explain the readings.

    Returns
    -------
    SolidFit
        With status and advice. What the readings do not tell is NaN: of a sphere on a sphere every patch is a cap, so
        that a light press of a large one reads as a hard press of a small one.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, or the construction has no closed form.

    Examples
    --------
    >>> import tacstrip as ts
    >>> fingertip, noise = ts.Sensor.load("fingertip"), ts.Noise(positional=0.005)
    >>> pen = ts.Solid.cylinder(4.0).at((20, 0, 20), toward=(-1, 0, -1), turn_rad=0.5)
    >>> scan = ts.simulate(fingertip, ts.press(fingertip, pen, depth_mm=1.5), noise, rng=1)
    >>> found = ts.fit_solid(scan, fingertip, ts.Solid.cylinder(6.0), noise)
    >>> found.status, bool(abs(found.radius_mm - 4.0) < 3 * found.radius_sigma_mm)
    ('ok', True)
    >>> bool(abs(found.axis @ pen.axis) > 0.99), bool(abs(found.depth_mm - 1.5) < 0.2)
    (True, True)
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "fit_solid")
    start = start.solid if isinstance(start, SolidFit) else start
    if start is not None and (not isinstance(start, Solid) or start.kind != solid.kind):
        raise OptionError(f"start = {start!r}: give a {solid.kind} in the skin, or the fit of one")
    if not scan.touched.any():
        return SolidFit("no contact", "no strip reads a contact; press harder", time_s=scan.time_s)
    poses = Poses.of(scan, sensor, solid, sensor.noise if noise is None else noise, known_size)
    ends, costs, along = descended(poses, start)
    for _ in range(_REDRAWN):
        left = poses.residuals(ends[:1])[0]
        squares, freedom = float(np.square(left[: poses.readings]).sum()), poses.readings - len(poses.names)
        scale = noise_scale(squares, freedom, poses.noise is None)
        random = np.random.default_rng(_SEED)
        draws = draw(poses, ends, costs, along, random, scale)
        better, its = refined(poses, draws.best[None])
        if its[0] > costs[0] - _RIVAL:
            break
        # That no descent had found.
        ends, costs, along = _with_ridge(poses, np.concatenate([better, ends]), np.concatenate([its, costs]))
    mean = draws.mean
    cost = float(np.square(poses.residuals(mean[None])).sum())
    values = mean if cost - costs[0] <= _MEAN * len(mean) * scale else ends[0]
    scatter = _Scatter.of(poses, values, draws.even(_LOADS, random))
    averaging = averaging_advice(poses.noise, sensor, Averaging.of(scan))
    return _result(
        poses, values, (ends, costs), along, draws, scatter, scale, known_size, scan.time_s, averaging
    )


def noise_scale(squares: float, freedom: int, unknown: bool) -> float:
    """Return by what the readings' variance is larger than given, from squares left over and degrees of freedom."""
    if unknown and freedom >= 3:  # sigma is what is left over
        return max(squares / freedom, 1e-6)
    # Strips, skin and object are never quite those of the model: what they leave over counts as noise.
    return max(1.0, (_BELIEF + squares) / (_BELIEF + max(freedom, 0)))


_Ridge: TypeAlias = tuple[FloatArray, FloatArray]


def descended(poses: Poses, start: Solid | None) -> tuple[FloatArray, FloatArray, _Ridge]:
    """Return where descents end (M, P), best first, their costs (M,), and a ridge: from one near, else everywhere."""
    if start is not None:
        ends, costs = refined(poses, poses.values_of(start)[None])
        ends, costs, along = _with_ridge(poses, ends, costs)
        if explains(poses, ends[:1]):
            return ends, costs, along
    return _with_ridge(poses, *descents(poses))


def _with_ridge(poses: Poses, ends: FloatArray, costs: FloatArray) -> tuple[FloatArray, FloatArray, _Ridge]:
    """Return ends and costs, the best first, and the ridge through it: another radius may be better."""
    along = ridge(poses, ends[0])
    for _ in range(_REDRAWN):
        if not along[1].min(initial=math.inf) < costs[0] - _RIVAL:
            break
        better, its = refined(poses, along[0][along[1].argmin()][None])
        ends, costs = np.concatenate([better, ends]), np.concatenate([its, costs])
        along = ridge(poses, ends[0])
    return ends, costs, along


def radii_within(logs: FloatArray, costs: FloatArray, deviations: float) -> tuple[float, float]:
    """Return the least and the greatest logarithm (M,), in order, of costs that are so little above the least."""
    root = np.sqrt(costs - costs.min())  # of a parabola a line on either side
    inside = np.flatnonzero(root <= deviations)
    first, last = inside[0], inside[-1]
    low, high = float(logs[first]), float(logs[last])
    if first > 0:
        low = float(np.interp(deviations, root[[first, first - 1]], logs[[first, first - 1]]))
    if last < len(logs) - 1:
        high = float(np.interp(deviations, root[[last, last + 1]], logs[[last, last + 1]]))
    return low, high


def explains(poses: Poses, values: FloatArray) -> bool:
    """Whether an object (1, P) touches the strips that read and no others, and chi square is one of the noise."""
    return contradiction(poses, values) <= _LOST_MM and in_noise(poses, values)


def in_noise(poses: Poses, values: FloatArray) -> bool:
    """Whether chi square of an object (1, P) is one of the noise; True where that is not known, or nothing is left."""
    left, freedom = poses.residuals(values)[0][: poses.readings], poses.readings - len(poses.names)
    # By normal noise also where it is uniform, whose squares spread less: the model is not exact enough for that.
    return poses.noise is None or freedom < 1 or chi_square_score(left, freedom, "normal") <= _ALARM


@dataclass(frozen=True, eq=False)
class _Scatter:
    """An object's area and force (1 + N,), first as given, then of draws; how its direction and axis scatter [rad]."""

    area: FloatArray
    force: FloatArray
    radius: FloatArray
    direction: float
    axis: float
    intervals: dict[str, tuple[float, float]]  # of direction and axis
    elsewhere: float  # the share of draws that differ by more than a result may that is not doubtful

    @classmethod
    def of(cls, poses: Poses, values: FloatArray, draws: FloatArray) -> _Scatter:
        """Return them about parameters (P,), of draws (N, P)."""
        every = np.concatenate([values[None], draws])
        _, axes = poses.frames(every)
        loads = [patch_load(poses.skin, solid, limited=False) for solid in poses.solids(every)]
        x, y, _ = axes[0]
        tilt = np.stack([axes[1:, 2] @ x, axes[1:, 2] @ y])
        turn = np.arctan2(axes[1:, 0] @ y, axes[1:, 0] @ x)
        period = TURNS.get(poses.solid.kind, 2.0 * math.pi)
        turn = np.remainder(turn + 0.5 * period, period) - 0.5 * period
        area, turns = np.array([load.area_mm2 for load in loads]), poses.solid.kind in _AXES
        off = (np.abs(area[1:] - area[0]) > 2.0 * _AREA * area[0]) | (np.hypot(*tilt) > 2.0 * _DIRECTION)
        off |= turns & (np.abs(turn) > 2.0 * _AXIS)
        of = {"direction_rad": np.hypot(*tilt)} | ({"axis_rad": np.abs(turn)} if turns else {})
        intervals = {name: (0.0, float(_quantiles(v, 0.95))) for name, v in of.items()}
        return cls(
            area, np.array([load.force_n for load in loads]), poses.radii(every),
            math.sqrt(np.linalg.eigvalsh(tilt @ tilt.T / len(draws))[-1]),
            math.sqrt(float(np.square(turn).mean())) if turns else math.nan, intervals, float(off.mean()),
        )  # fmt: skip


def _quantiles(draws: FloatArray, share: float | tuple[float, ...]) -> FloatArray:
    """Return what another draw is below with these shares."""
    # Where a mesh sinks in deeper than the skin is thick, its force is inf.
    with np.errstate(invalid="ignore"):
        return np.asarray(np.quantile(draws, share, method="weibull"))


def _about(values: FloatArray) -> tuple[float, float, tuple[float, float]]:
    """Return the first of values, the others' root mean square from it, and what 95 % of them lie within."""
    low, high = _quantiles(values[1:], (0.025, 0.975))
    with np.errstate(invalid="ignore"):
        sigma = math.sqrt(float(np.square(values[1:] - values[0]).mean()))
    return float(values[0]), sigma, (float(low), float(high))


def _joined(interval: tuple[float, float], others: FloatArray) -> tuple[float, float]:
    """Return an interval that holds other values too."""
    return min(interval[0], float(others.min())), max(interval[1], float(others.max()))


def _result(
    poses: Poses, values: FloatArray, descended: tuple[FloatArray, FloatArray], along: _Ridge, draws: Draws,
    scatter: _Scatter, scale: float, known_size: bool, time_s: float, averaging: str,
) -> SolidFit:  # fmt: skip
    """Put together what was found, and judge it."""
    (solid,), kind = poses.solids(values[None]), poses.solid.kind
    (area, area_sigma, of_area), (force, force_sigma, of_force) = _about(scatter.area), _about(scatter.force)
    intervals = {"area_mm2": of_area} | scatter.intervals
    radius = radius_sigma = math.nan
    notes, doubtful = [], False
    loose = {  # what readings leave open
        "radius": False, "area": not area_sigma <= _AREA * area, "direction": not scatter.direction <= _DIRECTION,
        "axis": scatter.axis > _AXIS,
    }  # fmt: skip
    if kind in _ROUND:
        radius, radius_sigma, of_radius = _about(scatter.radius)
        alike = kind == "sphere" and cap(poses.skin) and not known_size
        loose["radius"] = not alike and not radius_sigma <= _RADIUS * radius
        if (at := poses.column("log_radius")) is not None:
            # Also of a radius that few poses have but one explains the readings: by the best pose with each radius.
            logs, above = along[0][:, at], along[1] / scale
            within = radii_within(logs, above, _WITHIN)
            of_radius = _joined(of_radius, np.exp(within))
            forces = np.array(
                [patch_load(poses.skin, s, limited=False).force_n for s in poses.solids(along[0])]
            )
            known = np.isfinite(forces)
            of_force = _joined(of_force, np.interp(within, logs[known], forces[known]))
            furthest = np.abs(np.array(radii_within(logs, above, _AT_MOST)) - math.log(radius)).max()
            loose["radius"] |= bool(furthest > RADIUS_OPEN)
        if alike or radius_sigma > _UNTOLD * radius:
            low, high = of_radius
            hold = "" if loose["area"] or loose["direction"] else "area and direction hold; "
            why = (
                "every patch of a sphere on this skin is alike"
                if alike
                else f"95 % from {low:.2g} to {high:.2g} mm"
            )
            notes.append(
                f"the radius, the depth and the force cannot be told from this contact ({why}): {hold}give a known "
                "radius with known_size=True"
            )
            radius = radius_sigma = force = force_sigma = math.nan
        else:
            intervals["radius_mm"] = of_radius
    if not math.isnan(force) and not force_sigma <= _UNTOLD * abs(force) < math.inf:
        force = math.nan
        notes.append("the force cannot be told from this contact")
    if math.isfinite(force):
        intervals["force_n"] = of_force
    try:
        patch: Patch | None = patch_at(poses.sensor, solid)
    except ContactError:
        patch = None
    ends, costs = descended
    if not in_noise(poses, ends[:1]):
        doubtful = True
        notes.append(
            "no such object explains the readings: it is another one, there are several, or the noise is larger"
        )
    held = Held.of(poses, ends[0], scale)
    squares = float(np.square(poses.residuals(ends[:1])[0, : poses.readings]).sum())
    other = noise_scale(squares - held.gain, poses.readings - len(values) - 1, poses.noise is None)
    if held.gain > _BETTER * other and not doubtful:
        doubtful = True
        notes.append(
            f"a body of another kind explains the readings better than this one, {kind}: one that is curved otherwise, "
            "or has another angle"
        )
    if contradiction(poses, ends[:1]) > _LOST_MM:
        doubtful = True
        notes.append(
            "strips are touched where this object would not, or silent where it would: it is another one"
        )
    if poses.readings <= len(values):
        doubtful = True
        finer = signature_advice(poses.sensor) if len(poses.k) == 1 else "use finer strips"
        notes.append(
            f"{poses.readings} readings for {len(values)} unknowns: nothing tells whether it is of the kind given, "
            f"{kind}, and averaging changes nothing in that; press across more strips, or {finer}"
        )
    bent = held.bend > _STRAIGHT or (kind == "plane" and cap(poses.skin))
    if math.isfinite(force) and kind in _BENT and bent:
        notes.append(_BENT[kind])
    if poses.noise is None and poses.readings - len(values) < 3:
        notes.append(f"the noise is taken for {100 * GUESS:g} % of Vref; give it")
    if patch is None or draws.effective < _FEW_DRAWS or any(loose.values()):
        doubtful = True
        what = " and its ".join(name for name, is_so in loose.items() if is_so) or "pose"
        still = "" if poses.readings <= len(values) else f"hold it still and {averaging}, or "
        notes.append(f"the readings leave its {what} open: {still}press harder, or across more strips")
    near = ends[(costs - costs[0] < _RIVAL * scale) & (scatter.elsewhere > _LIKELY)]
    others = _alternatives(poses, values, near, area)
    if others:
        doubtful = True
        notes.append("other poses explain the readings as well; see the alternatives")
    return SolidFit(
        "doubtful" if doubtful else "ok", "; ".join(notes), solid, patch, poses.names, values, draws.covariance,
        area, area_sigma, force, force_sigma, radius, radius_sigma,
        -solid.toward, scatter.direction, scatter.axis, others, time_s, intervals,
    )  # fmt: skip


def contradiction(poses: Poses, values: FloatArray) -> float:
    """Return the most depth [mm] that strips touched or silent lack or have too much."""
    deepest = poses.ends(values, TOUCH_MM)[2][0]
    return float(np.where(poses.touched, -deepest, np.where(poses.silent, deepest, 0.0)).max())


def _alternatives(poses: Poses, values: FloatArray, ends: FloatArray, area: float) -> tuple[Solid, ...]:
    """Return the objects of other descents' ends (M, P) that differ by more than a result may that is not doubtful."""
    found = [(poses.solids(values[None])[0], area)]
    for solid in poses.solids(ends):
        size = patch_load(poses.skin, solid, limited=False).area_mm2
        if all(_differ(solid, its, abs(size / its_area - 1.0)) for its, its_area in found):
            found.append((solid, size))
    return tuple(solid for solid, _ in found[1:])


def _differ(a: Solid, b: Solid, area: float) -> bool:
    """Whether two objects differ in their patches' area, direction or axis."""
    tilted = math.acos(min(1.0, float(a.toward @ b.toward)))
    turned = math.asin(min(1.0, float(np.linalg.norm(np.cross(a.axes[0], b.axes[0])))))
    return bool(area > 2.0 * _AREA or tilted > 2.0 * _DIRECTION or (a.kind in _AXES and turned > 2.0 * _AXIS))
