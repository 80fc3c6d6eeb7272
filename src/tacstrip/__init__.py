"""tacstrip: from the voltages of a resistive hybrid tactile sensor to the shape that touches it.

The names that `import tacstrip as ts` gives are listed in `__init__.pyi`, once, and loaded when first used.
"""

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    return _load(name)
