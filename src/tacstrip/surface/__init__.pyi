from .cylinder import from_space as from_space
from .cylinder import to_space as to_space
