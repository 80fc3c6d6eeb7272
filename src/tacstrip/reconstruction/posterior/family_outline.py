"""An outline of a family that was drawn, as outline model: it is given as it is, and no reading moves its vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.core.ellipse import fit_ellipse
from tacstrip.core.outline_model import OutlineModel
from tacstrip.core.polygon_fit import PolygonFit
from tacstrip.core.problem import FitProblem
from tacstrip.geometry.outline import Outline
from tacstrip.sensor.spec import Sensor

ROUNDED = "rounded"


@dataclass(frozen=True, eq=False)
class FamilyOutline:
    """One of many outlines that explain the readings, in units of a `FitProblem`.

    Attributes
    ----------
    kind
        `ROUNDED`, or the name of a regular outline.
    lower, upper
        Its chains (M, 2), (N, 2).
    lower_off, upper_off
        How the others differ from it (K, M, 2), (K, N, 2), each by the root of its weight.
    cost
        Squared residuals over sigma^2.
    """

    kind: str
    lower: FloatArray
    upper: FloatArray
    lower_off: FloatArray
    upper_off: FloatArray
    cost: float

    @classmethod
    def fitted(cls, start: PolygonFit, problem: FitProblem) -> OutlineModel:
        """Return the ellipse near an outline, whatever its kind: scans follow that until they contradict it."""
        return fit_ellipse(start, problem)

    @property
    def n_parameters(self) -> int:
        """Numbers that the readings determine: place, height, slant and two of the family; the ends have a prior."""
        return 5

    @property
    def complexity(self) -> int:
        """What it counts for in the criterion: two vertices."""
        return 2

    def residuals(self, problem: FitProblem) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is left out."""
        l, u = (np.interp(problem.x, *chain.T) for chain in (self.lower, self.upper))
        return np.asarray((problem.k - problem.readings_of(l, u)) * problem.root_weight)

    def chains_mm(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper chain (M, 2), (N, 2) [mm]."""
        scale, origin = (problem.width_mm, problem.length_mm), (problem.origin_mm, 0.0)
        return self.lower * scale + origin, self.upper * scale + origin

    def covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance (2 V, 2 V) [mm^2] of the vertices: how outlines that explain the readings differ."""
        del sensor
        outline = Outline(*self.chains_mm(problem))
        off = np.zeros((len(self.lower_off), *outline.vertices.shape))
        for differ, at in zip((self.lower_off, self.upper_off), outline.indices, strict=True):
            off[:, at] = differ * (problem.width_mm, problem.length_mm)
        flat = off.reshape(len(off), -1)
        return np.asarray(flat.T @ flat)
