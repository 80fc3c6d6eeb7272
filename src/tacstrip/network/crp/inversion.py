"""CRS-CRP inverted: l and u of all touched strips from what the sheet's electrodes read.

There is no closed form (3.3), and neighbours shift a reading by up to a tenth of Vref, so all strips are solved
together: Levenberg-Marquardt on the network itself with its adjoint Jacobian (`factored`), first on a coarser mesh,
started from bands that read about the same. Every step keeps to 0 <= l <= u <= L and, if asked to, to convex contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.errors import ReadingError
from tacstrip.fisher import covariance as covariance_bound
from tacstrip.network.crp.cramer_rao import embed_touched
from tacstrip.network.crp.descent import POOR_FIT, InversionProblem
from tacstrip.network.crp.mesh import Wiring
from tacstrip.sensor.spec import Sensor

StripStatus: TypeAlias = Literal["ok", "no contact", "short contact", "not converged"]

SHORT = 0.05  # of L: below, l and u are poorly known one by one, only their middle is well known


@dataclass(frozen=True, eq=False)
class InversionResult:
    """The l and u of one scan, with their uncertainty.

    Attributes
    ----------
    l, u
        Ends of the contact (strips,) [mm]; NaN on untouched strips.
    covariance
        Of l of all strips, then u of all strips (2 strips, 2 strips) [mm^2]: the inverse of the Fisher information
        of the readings at l and u, without constraints, and the mesh's own error; NaN on untouched strips.
    status
        Per strip: "ok", "no contact", "short contact" (w < 5 % of L) or "not converged".
    advice
        In words, what to do; empty when all is well.
    iterations
        Networks that were factored, those of coarser meshes included.
    residual_rms
        Root mean square of the residuals, in units of sigma: about 1, or 0 with own electrodes,
        where there are as many readings as unknowns.
    """

    l: FloatArray
    u: FloatArray
    covariance: FloatArray
    status: tuple[StripStatus, ...]
    advice: str
    iterations: int
    residual_rms: float


def invert(
    sensor: Sensor,
    kh: FloatArray,
    kl: FloatArray,
    sigma: float = 1e-3,
    convex: bool = False,
    rows: int | None = None,
    wiring: Wiring | None = None,
    max_networks: int = 60,
) -> InversionResult:
    """Find l and u of all strips from each strip's own two electrodes.

    Parameters
    ----------
    sensor
        The sensor; what matters most is a right `contact_lambda_mm`.
    kh, kl
        Readings at y = L and y = 0 while each strip is energised (strips,) [Vref]; NaN where untouched.
    sigma
        Standard deviation of a reading's noise [Vref]; it scales covariance and residual_rms, not l and u.
    convex
        Whether each run of touched strips is taken for one convex contact: l(x) bends up only, u(x) down only.
    rows, wiring
        Cells of the mesh over the length, by default 4 per lambda, 100 to 400; what the other strips and the sheet's
        edges are joined to, nothing by default.
    max_networks
        Networks to factor at most, for each of three starts.

    Raises
    ------
    SpecError
        The sensor cannot be: ratio or lambda is not above 0.
    ReadingError
        No strip reads a contact, or shapes or NaN do not fit.
    """
    kh, kl = np.asarray(kh, dtype=float), np.asarray(kl, dtype=float)
    if kh.shape != (sensor.strips,) or kl.shape != (sensor.strips,):
        raise ReadingError(f"kh and kl have shapes {kh.shape} and {kl.shape}; give two of ({sensor.strips},)")
    readings = np.stack([kh, kl], axis=1)
    return _invert(InversionProblem(sensor, readings, "own", sigma, convex, rows, wiring), max_networks)


def invert_all(
    sensor: Sensor,
    readings: FloatArray,
    sigma: float = 1e-3,
    convex: bool = False,
    rows: int | None = None,
    wiring: Wiring | None = None,
    max_networks: int = 60,
) -> InversionResult:
    """Find l and u of all strips from all electrodes, read while each strip is energised.

    `readings` (strips, 2 strips) [Vref] are in the order of `contact_electrodes`, a row of NaN where a strip is
    untouched. The rest is as for `invert`.
    """
    readings = np.asarray(readings, dtype=float)
    if readings.shape != (sensor.strips, 2 * sensor.strips):
        raise ReadingError(
            f"readings have shape {readings.shape}; give ({sensor.strips}, {2 * sensor.strips}): "
            "all electrodes at y = 0, then all at y = L, a row per energised strip"
        )
    return _invert(InversionProblem(sensor, readings, "all", sigma, convex, rows, wiring), max_networks)


def _invert(problem: InversionProblem, max_networks: int) -> InversionResult:
    found, strips, length = problem.invert(max_networks), problem.sensor.strips, problem.sensor.length_mm
    l, u = np.full((2, strips), np.nan)
    l[problem.strip], u[problem.strip] = np.split(found.x, 2)
    own = covariance_bound(found.jacobian) + problem.mesh.error_mm**2 * np.eye(len(found.x))
    bound = embed_touched(own, problem.strip, strips)
    residual_rms = float(np.sqrt(found.cost / problem.readings.size))
    status = _statuses(l, u, length, found.converged)
    return InversionResult(l, u, bound, status, _advice(status, residual_rms), found.steps, residual_rms)


def _statuses(l: FloatArray, u: FloatArray, length: float, converged: bool) -> tuple[StripStatus, ...]:
    touched: list[StripStatus] = ["ok", "short contact"] if converged else ["not converged"] * 2
    return tuple("no contact" if np.isnan(w) else touched[int(w < SHORT * length)] for w in u - l)


def _advice(status: Sequence[StripStatus], residual_rms: float) -> str:
    lines = []
    if "not converged" in status:
        lines.append(
            "the iteration stopped early; try a larger `max_networks`, or check contact_lambda_mm and the ratio"
        )
    elif residual_rms > POOR_FIT:
        lines.append(
            f"the model misses the readings by {residual_rms:.3g} sigma; check contact_lambda_mm, "
            "resistivity_ratio and sigma"
        )
    if short := status.count("short contact"):
        lines.append(
            f"{short} strips have a contact shorter than 5 % of their length: only its middle is well known"
        )
    return "\n".join(lines)
