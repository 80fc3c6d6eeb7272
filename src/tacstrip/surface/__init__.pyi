from .cylinder import from_cartesian as from_cartesian
from .cylinder import to_cartesian as to_cartesian
