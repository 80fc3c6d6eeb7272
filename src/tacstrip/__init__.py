"""tacstrip: from the voltages of a resistive hybrid tactile sensor to the shape that touches it.

The names that `import tacstrip as ts` gives are listed in `__init__.pyi`, once, and loaded when first used.
"""

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Where names went that version 0.1 had here; the sentence about them goes with version 0.3.
_MOVED = {
    "calibrate": "DriftEstimator rezero",
    "contact": "geometric_centre pseudo_centres",
    "io": "feature_collection",
    "network": "ArrayScan ArrayWiring Break Imperfections FourWire Readout Short Wiring four_wire phantoms "
    "scan_array wide_readings",
    "reconstruction": "profile_at reading_sigma",
    "sensor": "Channel apply_calibration invert_calibration lower_and_width lower_from_width width_from_lower",
    "stream": "Drag RawScan ReadingsSource Shape Source VirtualDevice decode encode paced recover",
    "surface": "from_cartesian to_cartesian",
    "tracking": "LiveObject Tracker",
}
# What some of them are called now.
_RENAMED = {
    "Build": "Imperfections",
    "corrected": "apply_calibration",
    "distorted": "invert_calibration",
    "from_space": "from_cartesian",
    "to_space": "to_cartesian",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    now = _RENAMED.get(name, name)
    for room, names in _MOVED.items():
        if now in names.split():
            raise AttributeError(f"tacstrip.{name} moved: write `from tacstrip.{room} import {now}`")
    return _load(name)
