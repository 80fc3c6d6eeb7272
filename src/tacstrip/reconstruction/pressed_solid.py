"""Which object was pressed into a skin: its pose, depth and radius from one scan, by how deep the skin lies in it.

The family is given: planes, edges of one angle, cylinders, spheres, or one box or mesh. A pose is a place on the skin,
the depth there, and how the object is turned about the skin's normal, along which it came. Where an object touches a
strip, its readings are compared; that it touches strips that read nothing, or none where readings are, costs depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.patch import Patch, patch_at, patch_load, samples
from tacstrip.contact.press.solid import Solid
from tacstrip.contact.signature import signatures
from tacstrip.errors import ContactError
from tacstrip.reconstruction.noise_covariance import Averaging, reading_covariance
from tacstrip.reconstruction.polygon.goodness_of_fit import chi_square_score
from tacstrip.reconstruction.result import Status
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.resistance import ends_from_electrical
from tacstrip.sensor.spec import Sensor
from tacstrip.surface.skin import Skin, skin_of

_SAMPLES = 96  # along a strip
_TOUCH_MM = 0.02  # depth to within which a strip that begins to be touched is known to be so
_LOG_RADIUS = 1.5  # how far, as a logarithm, the radius may be from the one given: hardly a prior
_BEST, _FOLLOWED = 16, 5  # starts from which a rough descent begins; of their ends, those that are followed
_TURNS = {"cylinder": (9, math.pi), "edge": (9, math.pi), "box": (8, math.pi), "mesh": (12, 2.0 * math.pi)}
_STEP, _LONG_STEP = 1e-4, 0.01  # mm or rad: of differences; of areas and forces, which come from a grid
_TOUCHES_MM = (0.3, 0.06, _TOUCH_MM)  # what touch is known to in the descents of one start
_ITERATIONS, _ROUGH, _SETTLED, _MOST_DAMPING = 40, 0.03, 1e-4, 1e8
_GUESS = 0.005  # of Vref: sigma where the noise is not known and too few readings are left to tell it
_ALARM = 3.5  # standard deviations of chi square
_RIVAL, _APART = (
    4.0,
    4.0,
)  # chi square by which another pose is no rival; standard deviations that make it another
_UNTOLD = 0.5  # relative standard deviation of a radius or force that is not told
_AREA, _DIRECTION = 0.1, math.radians(5.0)  # standard deviations beyond which the result is doubtful


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
        What was fitted: "across_mm", "along_mm" of the place on the skin, about where the readings are; "depth_mm",
        "log_radius", "turn_rad"; their values (P,) and covariance (P, P).
    area_mm2, area_sigma_mm2
        Of the patch, and its standard deviation.
    force_n, force_sigma_n
        By the skin's stiffness; NaN where the readings do not tell it.
    radius_mm, radius_sigma_mm
        Of a sphere or cylinder; NaN where the readings do not tell it.
    direction, direction_sigma_rad
        From the skin into the object, a unit vector (3,), and its standard deviation in the worse of two ways.
    axis_sigma_rad
        Of the axis (`solid.axes[0]`) of a cylinder, edge, box or mesh, about the direction; else NaN.
    alternatives
        Other poses that explain the readings nearly as well.
    time_s
        The scan's time [s].

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

    def __repr__(self) -> str:
        if self.solid is None:
            return f"<SolidFit: {self.status}>"
        return (
            f"<SolidFit: {self.status}, {self.solid.kind}, {self.area_mm2:.4g} +- {self.area_sigma_mm2:.2g} mm2, "
            f"{self.force_n:.4g} N>"
        )


@takes(scan=Scan, sensor=Sensor, solid=Solid, noise=Noise)
def fit_solid(
    scan: Scan, sensor: Sensor, solid: Solid, noise: Noise | None = None, *, known_size: bool = False
) -> SolidFit:
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
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "fit_solid")
    if not scan.touched.any():
        return SolidFit("no contact", "no strip reads a contact; press harder", time_s=scan.time_s)
    fit = _Fit.of(scan, sensor, solid, sensor.noise if noise is None else noise, known_size)
    rough = sorted(
        (fit.descend(s, _TOUCHES_MM[:1], _ROUGH) for s in fit.best_starts()), key=lambda end: end[1]
    )
    ends = [fit.descend(values, _TOUCHES_MM[1:], _SETTLED) for values, _ in rough[:_FOLLOWED]]
    values, cost = min(ends, key=lambda end: end[1])
    return _result(fit, values, cost, ends, scan)


@dataclass(frozen=True, eq=False)
class _Fit:
    """One scan's readings k (S, n), which of them count, and the family of objects."""

    sensor: Sensor
    skin: Skin
    solid: Solid
    k: FloatArray
    touched: BoolArray
    silent: BoolArray
    white: FloatArray
    read: tuple[str, ...]
    names: tuple[str, ...]
    origin: tuple[float, float]
    noise: Noise | None

    @classmethod
    def of(cls, scan: Scan, sensor: Sensor, solid: Solid, noise: Noise | None, known_size: bool) -> _Fit:
        """Prepare a fit."""
        names = ["across_mm", "along_mm", "depth_mm"]
        names += ["log_radius"] * (solid.kind in ("sphere", "cylinder") and not known_size)
        names += ["turn_rad"] * (solid.kind in _TURNS)
        skin, k = skin_of(sensor), np.stack([scan[name] for name in scan.signatures])
        place, ends = _middle(sensor, skin, scan)
        read = ~np.isnan(k)
        white = np.eye(int(read.sum())) / _GUESS
        if noise is not None:
            errors = reading_covariance(
                noise, sensor, sensor.x_mm, ends, scan.signatures, Averaging.of(scan)
            )[np.ix_(read.ravel(), read.ravel())]  # fmt: skip
            white = np.linalg.inv(np.linalg.cholesky(errors))
        silent = ~scan.touched & ~left_out_wholly(sensor)
        return cls(
            sensor, skin, solid, k, scan.touched, silent, white, scan.signatures, tuple(names), place, noise
        )

    def posed(self, values: FloatArray) -> Solid:
        """Return the object of parameters (P,)."""
        given = dict(zip(self.names, values.tolist(), strict=True))
        a, t = self.origin
        per = float(abs(self.skin.stretch(np.array(t))))
        at = np.array(a + given["across_mm"] / per), np.array(t + given["along_mm"])
        normal = self.skin.normals(*at)
        solid = self.solid
        if "log_radius" in given:
            solid = replace(solid, size=(math.exp(min(max(given["log_radius"], -5.0), 8.0)),))
        return solid.at(
            self.skin.points(*at) - given["depth_mm"] * normal, -normal, given.get("turn_rad", 0.0)
        )

    def residuals(self, values: FloatArray, touch_mm: float = _TOUCH_MM) -> FloatArray:
        """Return what is left of the readings, whitened, then of silence and touch, then of what is hardly a prior."""
        _, y, points, normals = samples(self.skin, _SAMPLES)
        solid = self.posed(values)
        g = solid.touch(points, normals, self.skin.thickness_mm)
        l, u, deepest = _ends(y, g, touch_mm)
        read = signatures(self.sensor, l, u)
        with np.errstate(invalid="ignore"):
            off = self.k - np.stack([read[name] for name in self.read])
        left = self.white @ np.nan_to_num(off[~np.isnan(self.k)], nan=1.0)
        lost = np.where(
            self.touched, np.minimum(deepest, 0.0), np.where(self.silent, np.maximum(deepest, 0.0), 0.0)
        )
        given = dict(zip(self.names, values.tolist(), strict=True))
        depth, thick = given["depth_mm"], self.skin.thickness_mm
        beyond = max(depth - thick, 0.0) + max(-depth, 0.0)
        prior = [beyond / touch_mm]
        if "log_radius" in given:
            prior.append((given["log_radius"] - math.log(self.solid.size[0])) / _LOG_RADIUS)
        reach = max(self.sensor.length_mm, self.sensor.width_mm)
        prior += [given["across_mm"] / reach, given["along_mm"] / reach, depth / thick]
        prior.append(given.get("turn_rad", 0.0) / (2.0 * math.pi))
        return np.concatenate([left, lost / touch_mm, prior])

    def jacobian(
        self, values: FloatArray, touch_mm: float = _TOUCH_MM, left: FloatArray | None = None
    ) -> FloatArray:
        """Return the slopes of the residuals (R, P), by differences; from `left`, the residuals here, to one side."""
        steps = np.eye(len(values)) * _STEP
        if left is not None:
            return np.stack([(self.residuals(values + s, touch_mm) - left) / _STEP for s in steps], axis=1)
        ends = [[self.residuals(values + sign * s, touch_mm) for sign in (1.0, -1.0)] for s in steps]
        return np.stack([(a - b) / (2.0 * _STEP) for a, b in ends], axis=1)

    def descend(
        self, values: FloatArray, touches_mm: tuple[float, ...], settled: float
    ) -> tuple[FloatArray, float]:
        """Return where descents (Levenberg-Marquardt) end, and the cost; touch counts more from one to the next."""
        cost = math.inf
        for touch_mm in touches_mm:
            left = self.residuals(values, touch_mm)
            cost, damping = float(left @ left), 1e-2
            for _ in range(_ITERATIONS):
                slopes = self.jacobian(values, touch_mm, left)
                normal, gradient = slopes.T @ slopes, slopes.T @ left
                gained = 0.0
                while damping < _MOST_DAMPING:
                    step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
                    trial = values - np.clip(step, -1.0, 1.0)
                    new = self.residuals(trial, touch_mm)
                    if (its := float(new @ new)) < cost:
                        gained, damping = cost - its, 0.2 * damping
                        values, left, cost = trial, new, its
                        break
                    damping *= 5.0
                if gained < settled * max(1.0, cost):
                    break
        return values, cost

    def best_starts(self) -> list[FloatArray]:
        """Return the best of many poses to begin with, of which no two differ in their depth and radius alone."""
        pitch, thick = self.sensor.pitch_mm, self.skin.thickness_mm
        count, turn = _TURNS.get(self.solid.kind, (1, 0.0))
        grids: dict[str, Any] = {
            "across_mm": (0.0, -0.5 * pitch, 0.5 * pitch),
            "along_mm": (0.0, -0.1 * self.sensor.length_mm, 0.1 * self.sensor.length_mm),
            "turn_rad": np.arange(count) * turn / count,
            "depth_mm": np.array([0.1, 0.3, 0.6]) * thick,
            "log_radius": math.log(self.solid.size[0]) + np.array([-0.7, 0.0, 0.7])
            if self.solid.size
            else (),
        }
        places = [n for n in grids if n in self.names]
        grid = np.stack(np.meshgrid(*(grids[n] for n in places), indexing="ij"), axis=-1)
        starts = grid.reshape(-1, len(places))[:, [places.index(n) for n in self.names]]
        costs = np.array([np.square(self.residuals(s, _TOUCHES_MM[0])).sum() for s in starts])
        sizes = math.prod(len(grids[n]) for n in ("depth_mm", "log_radius") if n in self.names)
        each = costs.reshape(-1, sizes)
        best = np.argsort(each.min(axis=1))[:_BEST]
        return [starts[i * sizes + int(each[i].argmin())] for i in best]


def _middle(
    sensor: Sensor, skin: Skin, scan: Scan
) -> tuple[tuple[float, float], tuple[FloatArray, FloatArray]]:
    """Return about where on the skin the readings are, and about where contacts end on strips."""
    length = sensor.length_mm
    k = np.stack([scan[name] for name in scan.signatures])
    low, high = (
        f(np.where(np.isnan(k), fill, k), axis=0) * length
        for f, fill in ((np.min, np.inf), (np.max, -np.inf))
    )
    low, high = (np.where(scan.touched, v, np.nan) for v in (low, high))
    l, u = (low, high) if sensor.surface is None else ends_from_electrical(sensor, low, high)
    on = np.flatnonzero(scan.touched)
    place = skin.places(on.astype(float), 0.5 * (l + u)[on])
    a, t = skin.places_near(skin.points(*place).mean(axis=0))
    return (float(a), float(t)), (l, np.maximum(u, l))


def _ends(y: FloatArray, g: FloatArray, touch_mm: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return l and u (strips,) of touch g at y (strips, samples), and how deep it is where it is deepest.

    Of a strip that is not touched, or less deep than `touch_mm`, ends are those of what lies so much higher at most, so
    that they move as the object does.
    """
    rows, last = np.arange(len(g)), g.shape[1] - 1
    deepest = g.max(axis=1)
    g = g - np.minimum(deepest - touch_mm, 0.0)[:, None]
    on = g > 0.0
    first, final = on.argmax(axis=1), last - on[:, ::-1].argmax(axis=1)
    found = []
    for inner, outer in ((first, np.maximum(first - 1, 0)), (final, np.minimum(final + 1, last))):
        a, b = g[rows, inner], g[rows, outer]
        share = np.where((b < a) & (b <= 0.0), a / np.where(a > b, a - b, 1.0), 0.0)
        found.append(y[rows, inner] + share * (y[rows, outer] - y[rows, inner]))
    return found[0], found[1], deepest


def _result(
    fit: _Fit, values: FloatArray, cost: float, ends: list[tuple[FloatArray, float]], scan: Scan
) -> SolidFit:
    """Put together what was found, and judge it."""
    readings = len(fit.white)
    slopes, left = fit.jacobian(values), fit.residuals(values)[:readings]
    freedom = readings - len(values)
    scale = 1.0
    if fit.noise is None:  # sigma is what is left over
        scale = float(left @ left) / freedom if freedom >= 3 else 1.0
    covariance = np.asarray(np.linalg.pinv(slopes.T @ slopes, hermitian=True) * scale, dtype=np.float64)
    solid = fit.posed(values)
    sigma = np.sqrt(np.diag(covariance))
    told = dict(zip(fit.names, sigma, strict=True))
    moments = _Slopes.of(fit, values)
    area_sigma, force_sigma = (
        math.sqrt(max(float(s @ covariance @ s), 0.0)) for s in (moments.area, moments.force)
    )
    direction = np.sqrt(np.linalg.eigvalsh(moments.direction @ covariance @ moments.direction.T)[-1])
    try:
        patch: Patch | None = patch_at(fit.sensor, solid)
    except ContactError:
        patch = None
    area, force = moments.values
    radius, radius_sigma = (math.nan, math.nan)
    if solid.kind in ("sphere", "cylinder"):
        radius, radius_sigma = solid.size[0], solid.size[0] * told.get("log_radius", 0.0)
    notes, doubtful = [], False
    if radius_sigma > _UNTOLD * radius:
        radius, why = (
            math.nan,
            "every patch of a sphere on this skin is alike" if solid.kind == "sphere" else "it is open",
        )
        notes.append(
            f"the radius and the force cannot be told from this contact ({why}): area and direction hold; give a known "
            "radius with known_size=True"
        )
        force = math.nan
    elif force_sigma > _UNTOLD * abs(force):
        force = math.nan
        notes.append("the force cannot be told from this contact")
    chi = chi_square_score(
        left / math.sqrt(scale), max(freedom, 1), fit.noise.distribution if fit.noise else "normal"
    )
    if fit.noise is not None and freedom >= 1 and chi > _ALARM:
        doubtful = True
        notes.append(
            "no such object explains the readings: it is another one, there are several, or the noise is larger"
        )
    lost = np.abs(fit.residuals(values)[readings : readings + fit.sensor.strips]).max() * _TOUCH_MM
    if lost > 5.0 * _TOUCH_MM:
        doubtful = True
        notes.append(
            "strips are touched where this object would not, or silent where it would: it is another one"
        )
    if fit.noise is None and freedom < 3:
        notes.append(f"the noise is taken for {100 * _GUESS:g} % of Vref; give it")
    if patch is None or not area_sigma <= _AREA * area or not direction <= _DIRECTION:
        doubtful = True
        notes.append("few strips tell of it: its pose is open; press harder, or across more strips")
    turn = told.get("turn_rad", math.nan)
    others = _alternatives(fit, values, cost, ends, area, (area_sigma, float(direction), turn), scale)
    if others:
        doubtful = True
        notes.append("other poses explain the readings as well; see the alternatives")
    return SolidFit(
        "doubtful" if doubtful else "ok", "; ".join(notes), solid, patch, fit.names, values, covariance,
        area, area_sigma, force, force_sigma, radius, radius_sigma,
        -solid.toward, float(direction), turn, others, scan.time_s,
    )  # fmt: skip


def _alternatives(
    fit: _Fit,
    values: FloatArray,
    cost: float,
    ends: list[tuple[FloatArray, float]],
    area: float,
    sigmas: tuple[float, float, float],
    scale: float,
) -> tuple[Solid, ...]:
    """Return poses of other descents that are as likely, and not the same."""
    found = [(values, area, fit.posed(values))]
    for other, its in sorted(ends, key=lambda end: end[1]):
        if its - cost > _RIVAL * scale:
            break
        solid, size = fit.posed(other), patch_load(fit.skin, fit.posed(other), limited=False).area_mm2
        if all(_differ(solid, its_solid, abs(size - its_area), sigmas) for _, its_area, its_solid in found):
            found.append((other, size, solid))
    return tuple(solid for _, _, solid in found[1:])


def _differ(a: Solid, b: Solid, area: float, sigmas: tuple[float, float, float]) -> bool:
    """Whether two objects differ in their patches' area, direction or axis by more than chance makes them."""
    of_area, of_direction, of_axis = sigmas
    tilted = math.acos(min(1.0, float(a.toward @ b.toward)))
    turned = math.asin(min(1.0, float(np.linalg.norm(np.cross(a.axes[0], b.axes[0])))))
    axis = math.isfinite(of_axis) and turned > _APART * (of_axis + of_direction)
    return bool(area > _APART * of_area or tilted > _APART * of_direction or axis)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """Area and force, their slopes by the parameters (P,), and those of the direction (3, P)."""

    values: tuple[float, float]
    area: FloatArray
    force: FloatArray
    direction: FloatArray

    @classmethod
    def of(cls, fit: _Fit, values: FloatArray) -> _Slopes:
        """Return them by differences, over steps that move the patch's border by more than its grid's error."""
        sides = [[values + sign * _LONG_STEP * unit for sign in (1.0, -1.0)] for unit in np.eye(len(values))]
        slope = np.array([np.subtract(_load_of(fit, side[0]), _load_of(fit, side[1])) for side in sides]) / (
            2.0 * _LONG_STEP
        )
        ways = np.array([fit.posed(side[1]).toward - fit.posed(side[0]).toward for side in sides])
        return cls(_load_of(fit, values), slope[:, 0], slope[:, 1], ways.T / (2.0 * _LONG_STEP))


def _load_of(fit: _Fit, values: FloatArray) -> tuple[float, float]:
    load = patch_load(fit.skin, fit.posed(values), limited=False)
    return load.area_mm2, load.force_n
