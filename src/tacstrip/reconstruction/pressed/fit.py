"""Which object was pressed into a skin: its pose, depth and radius from one scan, by how deep the skin lies in it.

The family is given: planes, edges of one angle, cylinders, spheres, or one box or mesh. A pose is a place on the skin,
the depth there, and how the object is turned about the skin's normal, along which it came. Where an object touches a
strip, its readings are compared; that it touches strips that read nothing, or none where readings are, costs depth.
What is given, and how well it is known, are mean and scatter of draws from the likelihood.
"""

from __future__ import annotations

import math

import numpy as np

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.press.solid import Solid
from tacstrip.errors import OptionError
from tacstrip.reconstruction.noise_covariance import Averaging, averaging_advice
from tacstrip.reconstruction.pressed.agreement import RIVAL, explains, noise_scale
from tacstrip.reconstruction.pressed.descent import Ridge, descents, refined, ridge
from tacstrip.reconstruction.pressed.draws import draw
from tacstrip.reconstruction.pressed.judged import Scatter, judged
from tacstrip.reconstruction.pressed.poses import Poses
from tacstrip.reconstruction.pressed.result import SolidFit
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.spec import Sensor

_SEED = 20  # of the draws: the same result for the same scan
_REDRAWN = 3  # times that draws may find a pose far better than any before
_LOADS = 96  # draws whose area and force are computed
# Per parameter: the cost by which the draws' mean may be above the best pose's, else that is given.
_MEAN = 1.0


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
        if its[0] > costs[0] - RIVAL:
            break
        # That no descent had found.
        ends, costs, along = _with_ridge(poses, np.concatenate([better, ends]), np.concatenate([its, costs]))
    mean = draws.mean
    cost = float(np.square(poses.residuals(mean[None])).sum())
    values = mean if cost - costs[0] <= _MEAN * len(mean) * scale else ends[0]
    scatter = Scatter.of(poses, values, draws.even(_LOADS, random))
    averaging = averaging_advice(poses.noise, sensor, Averaging.of(scan))
    return judged(
        poses, values, (ends, costs), along, draws, scatter, scale, known_size, scan.time_s, averaging
    )


def descended(poses: Poses, start: Solid | None) -> tuple[FloatArray, FloatArray, Ridge]:
    """Return where descents end (M, P), best first, their costs (M,), and a ridge: from one near, else everywhere."""
    if start is not None:
        ends, costs = refined(poses, poses.values_of(start)[None])
        ends, costs, along = _with_ridge(poses, ends, costs)
        if explains(poses, ends[:1]):
            return ends, costs, along
    return _with_ridge(poses, *descents(poses))


def _with_ridge(poses: Poses, ends: FloatArray, costs: FloatArray) -> tuple[FloatArray, FloatArray, Ridge]:
    """Return ends and costs, the best first, and the ridge through it: another radius may be better."""
    along = ridge(poses, ends[0])
    for _ in range(_REDRAWN):
        if not along[1].min(initial=math.inf) < costs[0] - RIVAL:
            break
        better, its = refined(poses, along[0][along[1].argmin()][None])
        ends, costs = np.concatenate([better, ends]), np.concatenate([its, costs])
        along = ridge(poses, ends[0])
    return ends, costs, along
