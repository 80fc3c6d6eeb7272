"""What a scan tells of the object that was pressed, and of what it leaves open: the verdict on a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.contact.press.patch import Patch, patch_at, patch_load
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ContactError
from tacstrip.reconstruction.noise_covariance import signature_advice
from tacstrip.reconstruction.pressed.agreement import LOST_MM, RIVAL, contradiction, in_noise, noise_scale
from tacstrip.reconstruction.pressed.descent import Ridge, radii_within
from tacstrip.reconstruction.pressed.draws import Draws
from tacstrip.reconstruction.pressed.kinds import Held
from tacstrip.reconstruction.pressed.poses import GUESS, TURNS, Poses, cap
from tacstrip.reconstruction.pressed.result import ROUND, SolidFit

_FEW_DRAWS = 40.0  # even draws, fewer of which do not tell how well something is known
_BETTER = 9.0  # chi square of one by which another kind explains the readings better
_STRAIGHT = 0.1  # standard deviation of a bend, per 10 mm: about that of the force, relative to it
_LIKELY = 0.05  # share of draws
_WITHIN, _AT_MOST = 1.96, 3.0  # deviations: of intervals; by which no radius may lie further off than below
RADIUS_OPEN = 0.3  # of a radius' logarithm: a radius that may lie further off is open
_UNTOLD = 0.5  # relative standard deviation of a radius or force that is not told
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
class Scatter:
    """An object's area and force (1 + N,), first as given, then of draws; how its direction and axis scatter [rad]."""

    area: FloatArray
    force: FloatArray
    radius: FloatArray
    direction: float
    axis: float
    intervals: dict[str, tuple[float, float]]  # of direction and axis
    elsewhere: float  # the share of draws that differ by more than a result may that is not doubtful

    @classmethod
    def of(cls, poses: Poses, values: FloatArray, draws: FloatArray) -> Scatter:
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


@dataclass
class _Told:
    """What a contact tells of the radius and the force, which go together: NaN where it does not."""

    radius: float
    radius_sigma: float
    force: float
    force_sigma: float
    radius_open: bool
    intervals: dict[str, tuple[float, float]]
    notes: list[str]


def _told(
    poses: Poses, along: Ridge, scatter: Scatter, scale: float, known_size: bool, others_open: bool
) -> _Told:
    """Return what draws and the ridge tell of radius and force; `others_open`: whether area or direction are."""
    force, force_sigma, of_force = _about(scatter.force)
    told = _Told(math.nan, math.nan, force, force_sigma, False, {}, [])
    if poses.solid.kind in ROUND:
        radius, radius_sigma, of_radius = _about(scatter.radius)
        alike = poses.solid.kind == "sphere" and cap(poses.skin) and not known_size
        told.radius_open = not alike and not radius_sigma <= _RADIUS * radius
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
            told.radius_open |= bool(furthest > RADIUS_OPEN)
        if alike or radius_sigma > _UNTOLD * radius:
            low, high = of_radius
            hold = "" if others_open else "area and direction hold; "
            why = (
                "every patch of a sphere on this skin is alike"
                if alike
                else f"95 % from {low:.2g} to {high:.2g} mm"
            )
            told.notes.append(
                f"the radius, the depth and the force cannot be told from this contact ({why}): {hold}give a known "
                "radius with known_size=True"
            )
            told.force = told.force_sigma = math.nan
        else:
            told.radius, told.radius_sigma = radius, radius_sigma
            told.intervals["radius_mm"] = of_radius
    if not math.isnan(told.force) and not told.force_sigma <= _UNTOLD * abs(told.force) < math.inf:
        told.force = math.nan
        told.notes.append("the force cannot be told from this contact")
    if math.isfinite(told.force):
        told.intervals["force_n"] = of_force
    return told


def _contradicted(poses: Poses, best: FloatArray, held: Held) -> list[str]:
    """Say what speaks against the best pose (1, P): that it is another object, or that nothing can tell."""
    kind, unknowns = poses.solid.kind, best.shape[1]
    squares = float(np.square(poses.residuals(best)[0, : poses.readings]).sum())
    other = noise_scale(squares - held.gain, poses.readings - unknowns - 1, poses.noise is None)
    notes = []
    if not in_noise(poses, best):
        notes.append(
            "no such object explains the readings: it is another one, there are several, or the noise is larger"
        )
    elif held.gain > _BETTER * other:
        notes.append(
            f"a body of another kind explains the readings better than this one, {kind}: one that is curved otherwise, "
            "or has another angle"
        )
    if contradiction(poses, best) > LOST_MM:
        notes.append(
            "strips are touched where this object would not, or silent where it would: it is another one"
        )
    if poses.readings <= unknowns:
        finer = signature_advice(poses.sensor) if len(poses.k) == 1 else "use finer strips"
        notes.append(
            f"{poses.readings} readings for {unknowns} unknowns: nothing tells whether it is of the kind given, "
            f"{kind}, and averaging changes nothing in that; press across more strips, or {finer}"
        )
    return notes


def _rests_on(poses: Poses, held: Held, force: float) -> list[str]:
    """Say what the result rests on that readings do not tell: the kind, and a noise that was not given."""
    kind, notes = poses.solid.kind, []
    bent = held.bend > _STRAIGHT or (kind == "plane" and cap(poses.skin))
    if math.isfinite(force) and kind in _BENT and bent:
        notes.append(_BENT[kind])
    if poses.noise is None and poses.readings - len(poses.names) < 3:
        notes.append(f"the noise is taken for {100 * GUESS:g} % of Vref; give it")
    return notes


def judged(
    poses: Poses, values: FloatArray, descended: tuple[FloatArray, FloatArray], along: Ridge, draws: Draws,
    scatter: Scatter, scale: float, known_size: bool, time_s: float, averaging: str,
) -> SolidFit:  # fmt: skip
    """Put together what was found, and judge it.

    Parameters
    ----------
    poses, values
        What many poses would read, and the parameters (P,) that are given.
    descended, along
        Where descents ended and their costs, the best first; the ridge through it.
    draws, scatter
        From the likelihood; what follows from them.
    scale
        By what the readings' variance is larger than given.
    known_size, time_s
        Whether the radius was given; the scan's time [s].
    averaging
        What to say of averaging.
    """
    (solid,), (ends, costs) = poses.solids(values[None]), descended
    area, area_sigma, of_area = _about(scatter.area)
    loose = {"radius": False, "area": not area_sigma <= _AREA * area,
             "direction": not scatter.direction <= _DIRECTION, "axis": scatter.axis > _AXIS}  # fmt: skip
    told = _told(poses, along, scatter, scale, known_size, loose["area"] or loose["direction"])
    loose["radius"] = told.radius_open
    try:
        patch: Patch | None = patch_at(poses.sensor, solid)
    except ContactError:
        patch = None
    held = Held.of(poses, ends[0], scale)
    against = _contradicted(poses, ends[:1], held)
    if patch is None or draws.effective < _FEW_DRAWS or any(loose.values()):
        what = " and its ".join(name for name, is_so in loose.items() if is_so) or "pose"
        still = "" if poses.readings <= len(values) else f"hold it still and {averaging}, or "
        unsure = [f"the readings leave its {what} open: {still}press harder, or across more strips"]
    else:
        unsure = []
    near = ends[(costs - costs[0] < RIVAL * scale) & (scatter.elsewhere > _LIKELY)]
    others = _alternatives(poses, values, near, area)
    if others:
        unsure.append("other poses explain the readings as well; see the alternatives")
    return SolidFit(
        "doubtful" if against or unsure else "ok",
        "; ".join([*told.notes, *against, *_rests_on(poses, held, told.force), *unsure]),
        solid, patch, poses.names, values, draws.covariance, area, area_sigma, told.force, told.force_sigma,
        told.radius, told.radius_sigma, -solid.toward, scatter.direction, scatter.axis, others, time_s,
        {"area_mm2": of_area} | scatter.intervals | told.intervals,
    )  # fmt: skip


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
