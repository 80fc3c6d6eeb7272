"""What every outline model that is fitted to a run of strips can say: a polygon, an ellipse."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from tacstrip.arrays import FloatArray
from tacstrip.core.problem import FitProblem
from tacstrip.sensor.spec import Sensor

if TYPE_CHECKING:
    from tacstrip.core.polygon_fit import PolygonFit


class OutlineModel(Protocol):
    """An outline fitted to a `FitProblem`.

    Fit, goodness of fit, result and tracker share it: none of them asks which model it is to compute with it.
    """

    @classmethod
    def fitted(cls, start: PolygonFit, problem: FitProblem) -> OutlineModel:
        """Return the least-squares outline of this model near another one, as tracking goes on from scan to scan."""

    @property
    def kind(self) -> str:
        """What it is called, such as "polygon"."""

    @property
    def cost(self) -> float:
        """Squared residuals over sigma^2, and what the prior of the ends' x adds."""

    @property
    def n_parameters(self) -> int:
        """Numbers that the readings determine; those with a prior are not counted."""

    @property
    def complexity(self) -> int:
        """How many vertices the criterion counts it for."""

    def residuals(self, problem: FitProblem) -> FloatArray:
        """Return measured minus fitted readings over sigma (S, n); 0 where a reading is excluded."""

    def chains_mm(self, problem: FitProblem) -> tuple[FloatArray, FloatArray]:
        """Return the outline's lower and upper chain (M, 2), (N, 2) [mm], which do not cross."""

    def covariance(self, problem: FitProblem, sensor: Sensor) -> FloatArray:
        """Return the covariance of the outline's vertices (2 V, 2 V) [mm^2], in the order of `vertices.ravel()`."""
