from .drift import DriftEstimator as DriftEstimator
from .drift import rezero as rezero
