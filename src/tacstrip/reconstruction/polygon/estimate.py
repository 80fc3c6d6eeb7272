"""The best estimate that the readings allow: a polygon fitted to all strips by least squares.

The vertices' number is chosen by a criterion, their places by the fit, and the covariance says how sure they are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from threading import Lock

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.core.binding import MAX_VERTICES, taking_turns
from tacstrip.core.problem import FLOOR
from tacstrip.errors import OptionError
from tacstrip.reconstruction.implausible import doubt_implausible
from tacstrip.reconstruction.noise_covariance import Averaging, fit_sigma
from tacstrip.reconstruction.on_surface import on_surface, refuse_surface
from tacstrip.reconstruction.polygon.chi_square import ALARM, squares_score
from tacstrip.reconstruction.polygon.convexity import NEAR_ENOUGH, nearest_convex
from tacstrip.reconstruction.polygon.faulty_channel import contradictory, fit_without, without_one
from tacstrip.reconstruction.polygon.objects import Asked, reconstruct_object
from tacstrip.reconstruction.polygon.outline_estimate import FittedContact
from tacstrip.reconstruction.polygon.run import (
    MOST_SIGMA,
    RunFit,
    RunReadings,
    fit_runs,
    gain_of_one,
)
from tacstrip.reconstruction.polygon.unknown_noise import noise_beside_jumps
from tacstrip.reconstruction.polygon.wide_fit import fitted_to_wide_strips
from tacstrip.reconstruction.posterior.assessment import HELD_STRIPS, Effort, check_effort
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.reconstruction.seam import BRIDGED, unrolled
from tacstrip.reconstruction.strip_width import fitted_strips
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import left_out_wholly
from tacstrip.sensor.spec import Sensor

_AT_ONCE, _PARTS = 16, 4  # scans that the core takes in one call, and calls for each thread at least
_ABOUT = 0.2  # of an area that is given without its standard deviation
_TOGETHER = 6.0  # in the criterion: neighbours of a broken strip are broken too in one of 20
_LEAST_AREA = 1e-4  # of a strip's: smaller ones no reading tells


@takes(scan=Scan, sensor=Sensor, noise=Noise)
def fit_polygon(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None = None,
    *,
    max_vertices: int = MAX_VERTICES,
    bounded: bool = True,
    vertices: int | None = None,
    assessment: Effort = "thorough",
    area_mm2: float | tuple[float, float] | None = None,
    one_object: bool = False,
) -> Reconstruction:
    """Recover a polygon from each contact by least squares over all strips and all signatures of the scan.

    Parameters
    ----------
    scan, sensor
        What was measured, with what; strips are as wide as `strip_width_mm` says, which takes some .1 s longer, and
        without it they are their centre lines. From one signature the polygon is convex; from k_h and k_l it is
        x-monotone, and its ends may be vertical edges.
    noise
        Of the readings; the A/D converter's steps come on top. None: the spec's `[noise]`, and without one estimated
        from what the fit leaves over. Parts that strips share or that last are in the covariance; of a scan that is a
        mean (`Scan.mean`) they stay. "uniform" noise of independent readings of a single scan has a bound, and outlines
        that stay within it are far fewer than least squares leaves: the estimate is then their mean, and `guaranteed`
        holds the regions that no such outline's vertices leave. All other noise: least squares.
    max_vertices
        Vertices at most, those at the ends not counted.
    bounded
        False: least squares for uniform noise too, 2 to 13 ms faster.
    vertices
        Of each contact, ends included, where that is known; None: found. Weak corners, which noise hides, then add
        to the uncertainty instead of being left out.
    assessment
        How sure the shape is, found by drawing other outlines that explain the readings: "thorough" (.1 s where it is
        not plain), "fast" (10 ms; with one signature "likely" is the best status), or "none" ("likely" at best).
    area_mm2
        Area of each contact, where that is known: to within 20 %, or with its standard deviation. It tells much of what
        one signature leaves open.
    one_object
        Whether it is known that no two objects touch the same strips. They read as a concave one does: a concave
        outline that both signatures tell is `doubtful` for that alone where nobody says so.

    Returns
    -------
    Reconstruction
        Objects with vertices, covariance, profile, status and advice. Outliers are left out and named; up to
        three strips that read nothing inside a contact are bridged.

    Raises
    ------
    ReadingError, SignatureError, OptionError
        The scan is not of this sensor, the construction has no closed form, or there are no polygons of so many
        vertices.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> noise = ts.Noise(positional=0.002)
    >>> thing = ts.fit_polygon(ts.simulate(sensor, contact, noise, rng=1), sensor, noise).objects[0]
    >>> thing.status, thing.vertices.round(0).tolist()
    ('ok', [[20.0, 40.0], [55.0, 20.0], [80.0, 50.0], [45.0, 75.0]])
    """
    return _fit_polygon(
        scan, sensor, noise, max_vertices, bounded, vertices, assessment, area_mm2, one_object
    )


def _fit_polygon(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None,
    max_vertices: int = MAX_VERTICES,
    bounded: bool = True,
    vertices: int | None = None,
    assessment: Effort = "thorough",
    area_mm2: float | tuple[float, float] | None = None,
    one_object: bool = False,
    ready: _Fitted | None = None,
) -> Reconstruction:
    """Do as `fit_polygon`; `ready`: what is fitted of the scan already."""
    scan = scan.checked(sensor) if ready is None else ready.scan
    check_closed_form(sensor.kind, "fit_polygon")
    check_effort(assessment)
    if vertices is not None and not isinstance(vertices, int | np.integer):
        raise OptionError(f"vertices = {vertices!r}: give a whole number")
    noise = sensor.noise if noise is None else noise
    if sensor.surface is not None:
        if area_mm2 is not None:
            refuse_surface(sensor, "area_mm2", "leave it out")
        return on_surface(
            scan, sensor, lambda scan, even: fit_polygon(
                scan, even, noise, max_vertices=max_vertices, bounded=bounded, vertices=vertices,
                assessment=assessment, one_object=one_object,
            ),
        )  # fmt: skip
    if vertices is not None and not 3 <= vertices <= MAX_VERTICES + 2:
        raise OptionError(
            f"vertices = {vertices}: a polygon has 3 or more, and here {MAX_VERTICES + 2} at most"
        )
    area = _known_area(area_mm2, sensor)
    laid_out, surface = unrolled(scan, sensor, BRIDGED)
    contacts = _contacts(laid_out, surface, noise, max_vertices, vertices, ready)
    if contacts and contacts[-1].strips.start >= sensor.strips:  # near the seam, not across it
        laid_out, surface = unrolled(scan, sensor)
        contacts = _contacts(laid_out, surface, noise, max_vertices, vertices)
    asked = Asked(
        surface, noise, bounded and _has_bound(noise, scan), sensor.strips, assessment, area, one_object
    )
    found = tuple(reconstruct_object(laid_out.read_on(c.strips), c, asked) for c in contacts)
    result = Reconstruction("polygon", found, scan.time_s)
    return doubt_implausible(result, scan, sensor)


@takes(scans=(Scan,), sensor=Sensor, noise=Noise)
def fit_polygons(
    scans: Sequence[Scan],
    sensor: Sensor,
    noise: Noise | None = None,
    *,
    workers: int = 1,
    assessment: Effort = "fast",
) -> list[Reconstruction]:
    """Fit many scans; arguments and errors as for `fit_polygon` by default, but for a fast assessment.

    `workers` threads share the interpreter outside the compiled core, which takes the runs of several scans at once.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> contact = ts.Contact.polygon([(20, 40), (55, 20), (80, 50), (45, 75)])
    >>> noise = ts.Noise(positional=0.002)
    >>> scans = [ts.simulate(sensor, contact, noise, rng=seed) for seed in range(3)]
    >>> [found.status for found in ts.fit_polygons(scans, sensor, noise)]
    ['ok', 'ok', 'ok']
    """
    noise = sensor.noise if noise is None else noise

    turn = Lock()

    def fit(part: Sequence[Scan]) -> list[Reconstruction]:
        with taking_turns(turn):
            ready = _first_fits(part, sensor, noise)
            return [
                _fit_polygon(scan, sensor, noise, assessment=assessment, ready=of_scan)
                for scan, of_scan in zip(part, ready, strict=True)
            ]

    size = max(1, min(_AT_ONCE, len(scans) // (_PARTS * workers)))
    parts = [scans[i : i + size] for i in range(0, len(scans), size)]
    if workers == 1 or len(parts) < 2:
        return [found for part in parts for found in fit(part)]
    with ThreadPoolExecutor(workers) as threads:
        return [found for many in threads.map(fit, parts) for found in many]


@dataclass(frozen=True, eq=False)
class _Fitted:
    """What counts of a scan, the sigma of its readings if known, and its runs of strips, each with its fit."""

    scan: Scan
    sigma: float | None
    runs: list[tuple[slice, RunFit | None]]


def _first_fits(scans: Sequence[Scan], sensor: Sensor, noise: Noise | None) -> list[_Fitted | None]:
    """Fit all runs of scans in one call of the core; None for each where runs are not fitted as they are read."""
    flat = sensor.kind.closed_form and sensor.surface is None and not sensor.closed
    if not flat or sensor.strip_width_mm is not None:
        return [None for _ in scans]
    x_mm, begun, read = sensor.x_mm, [], []
    for scan in (scan.checked(sensor) for scan in scans):
        sigma, runs = _sigma(noise, scan, sensor), scan.runs()
        begun.append((scan, sigma, runs))
        for run in runs:
            own = scan.read_on(run)
            read.append(RunReadings(x_mm[run], {name: own[name][run] for name in own.signatures}, sigma))
    fits = iter(fit_runs(sensor, read))
    return [_Fitted(scan, sigma, [(run, next(fits)) for run in runs]) for scan, sigma, runs in begun]


def fitted_transitions(
    scan: Scan, sensor: Sensor, signature: str, noise: Noise | None = None
) -> list[FloatArray]:
    """Return the x [mm] of all vertices, ends included and ascending, of the polygon fitted to each run of strips.

    Only one signature is used, as Vertex Reconstruction does. A run with too few strips gives its two ends.
    """
    scan = scan.checked(sensor)
    check_closed_form(sensor.kind, "fit_polygon")
    name = sensor.check_signature(signature)
    sigma = _sigma(sensor.noise if noise is None else noise, scan, sensor)
    found = []
    for run in scan.runs():
        (of_run,) = fit_runs(sensor, [RunReadings(sensor.x_mm[run], {name: scan[name][run]}, sigma)])
        x = np.array([0.0, 1.0]) if of_run.selection is None else of_run.selection.chosen.transitions
        found.append(x * of_run.problem.width_mm + of_run.problem.origin_mm)
    return found


def _contacts(
    scan: Scan,
    sensor: Sensor,
    noise: Noise | None,
    max_vertices: int,
    vertices: int | None,
    ready: _Fitted | None = None,
) -> list[FittedContact]:
    if ready is None:
        ready = _Fitted(scan, _sigma(noise, scan, sensor), [(run, None) for run in scan.runs()])
    sigma = ready.sigma

    def fit(strips: slice, missing: tuple[int, ...] = (), run: RunFit | None = None) -> FittedContact:
        fitted, margin_mm = fitted_strips(sensor, strips)
        own = scan.read_on(strips)
        readings = {name: own[name][fitted] for name in own.signatures}
        x = sensor.x_mm[fitted]

        def runs_of(many: Sequence[Mapping[str, FloatArray]], sigma: float | None = sigma) -> list[RunFit]:
            tasks = [RunReadings(x, each, sigma, margin_mm) for each in many]
            return fit_runs(sensor, tasks, max_vertices, vertices)

        def checked(run: RunFit, readings: dict[str, FloatArray]) -> RunFit:
            return without_one(runs_of, run, sensor, readings, sigma is not None)

        run = checked(runs_of([readings])[0] if run is None else run, readings)
        if sensor.strip_width_mm is not None:

            def fit_thin(thin: dict[str, FloatArray]) -> RunFit:
                return checked(runs_of([thin])[0], thin)

            every, within = (
                sensor.x_mm[strips],
                slice(fitted.start - strips.start, fitted.stop - strips.start),
            )
            measured = {name: own[name][strips] for name in own.signatures}
            run, readings = fitted_to_wide_strips(
                fit_thin, run, sensor, every, measured, within, sigma is not None
            )
        if sigma is None and len(readings) > 1 and run.sigma > MOST_SIGMA:  # do corners pass for noise?
            at, near = run.singled_out, False
            if run.selection is not None and len(x) >= HELD_STRIPS:
                # Noise makes no ends convex that are off by so little.
                faulty = contradictory(run, sensor, readings)
                convex = nearest_convex(run, sensor, readings, faulty, NEAR_ENOUGH)
                near = convex is not None and convex[1].explains
            likely = partial(runs_of, sigma=NEAR_ENOUGH if near else MOST_SIGMA)
            again = likely([readings])[0] if at is None else fit_without(likely, readings, at)
            corners = again.residual_sums[0] <= again.problem.readings
            if again.selection is not None and (corners or run.outline is None):  # nor does a width
                run = again
        if sigma is None:
            run = _at_least_a_step(_beside_jumps(run, runs_of, sensor, readings), sensor)
        return FittedContact(strips, missing, fitted, readings, margin_mm, vertices, run)

    found: list[FittedContact] = []
    for strips, first in ready.runs:
        contact = fit(strips, run=first)
        if found and strips.start - found[-1].strips.stop <= BRIDGED:
            before = found[-1]
            gap = range(before.strips.stop, strips.start)
            joint = fit(slice(before.strips.start, strips.stop), (*before.missing, *gap))
            unknown = bool(left_out_wholly(sensor)[list(gap)].all()) and joint.run.selection is not None
            if unknown or gain_of_one(before.run, contact.run, joint.run) > _TOGETHER * (len(gap) - 1):
                contact = joint
                found.pop()
        found.append(contact)
    return found


def _known_area(area_mm2: float | tuple[float, float] | None, sensor: Sensor) -> tuple[float, float] | None:
    """Return the area's mean and standard deviation [mm^2]."""
    if area_mm2 is None:
        return None
    given = area_mm2 if isinstance(area_mm2, tuple) else (area_mm2,)
    if len(given) not in (1, 2) or not all(isinstance(a, Real) and not isinstance(a, bool) for a in given):
        raise OptionError(
            f"area_mm2 = {area_mm2!r}: give a number, or two, the area and its standard deviation"
        )
    mean, sigma = float(given[0]), float(given[1]) if len(given) == 2 else _ABOUT * float(given[0])
    most = sensor.width_mm * sensor.length_mm
    least = _LEAST_AREA * sensor.pitch_mm * sensor.length_mm
    if not (least <= mean <= most and 0.0 < sigma <= most):
        raise OptionError(
            f"area_mm2 = {area_mm2}: an area on this sensor is {least:.3g} to {most:.6g} mm2, a ten-thousandth of a "
            f"strip to all of it, and its standard deviation above 0, to {most:.6g} mm2"
        )
    return mean, sigma


def _beside_jumps(
    run: RunFit,
    runs_of: Callable[[Sequence[Mapping[str, FloatArray]], float | None], list[RunFit]],
    sensor: Sensor,
    readings: Mapping[str, FloatArray],
) -> RunFit:
    """Return a run, or its fit with less noise, where jumps passed for noise.

    Of one that left more than noise may be, only where the fit explains the readings.
    """
    less = noise_beside_jumps(run, sensor, readings) if len(readings) > 1 else None
    if less is None:
        return run
    (again,) = runs_of([readings], less)
    score = squares_score(again.residual_sums[0], again.problem.readings)
    return run if again.selection is None or (run.sigma >= MOST_SIGMA and score > ALARM) else again


def _at_least_a_step(run: RunFit, sensor: Sensor) -> RunFit:
    """Return a run with a sigma of the A/D converter's steps at least: few readings are fitted better by chance."""
    least = sensor.adc_step / np.sqrt(12.0)
    if run.sigma >= least:
        return run
    return replace(run, problem=run.problem.scaled(least / run.sigma), sigma=float(least))


def _sigma(noise: Noise | None, scan: Scan, sensor: Sensor) -> float | None:
    return None if noise is None else max(fit_sigma(noise, sensor, Averaging.of(scan)), FLOOR)


def _has_bound(noise: Noise | None, scan: Scan) -> bool:
    """Whether no reading is off by more than so much, and each by itself: of a mean of scans that says little."""
    return (
        noise is not None
        and noise.independent
        and scan.averaged == 1
        and noise.distribution == "uniform"
        and noise.quantisation + noise.positional > FLOOR
    )
