"""Compiles the kernels, says so, and throws their cached machine code away when any of them was edited.

Numba looks only at a function's own file. The code of a function that it calls from another file would stay.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from numba import njit
from numba.core import event

_FILES = ("polygon_cholesky", "kernels", "polygon_descent", "polygon_score", "polygon_moves", "polygon_oval")

# Numba's names of the types that `kernels` calls FloatArray and IntArray, by dimensions, Data and Model.
F1, F2, I1, I2 = "float64[::1]", "float64[:,::1]", "int64[::1]", "int64[:,::1]"
DATA = f"Tuple(({F1},{F2},{F2},float64))"
MODEL = f"Tuple(({F1},float64,float64))"

F = TypeVar("F", bound=Callable[..., Any])


def compiled(signature: str | None = None) -> Callable[[F], F]:
    """Compile a function and keep its machine code on disk.

    Sums are taken in the order that is written: reordered for the processor at hand, the same readings would give
    other shapes on another one wherever two fits are nearly as good.

    Parameters
    ----------
    signature
        Numba's types of result and arguments; compiled on import. Without one it is compiled when first called, and
        again for each constant that it is called with.
    """
    decorate: Any = njit(signature, cache=True, nogil=True, error_model="numpy")
    done: Callable[[F], F] = decorate
    return done


class _Announcement(event.Listener):
    """Says once that kernels are compiled: whoever waits for it should know why."""

    said = False

    def on_start(self, event: event.Event) -> None:
        """Numba begins to compile a function, perhaps somebody else's."""
        if not self.said and event.data["dispatcher"].py_func.__module__.startswith("tacstrip."):
            self.said = True
            logging.getLogger(__name__).warning(
                "compiling the fit's kernels, the first time on this computer: some 15 s"
            )

    def on_end(self, event: event.Event) -> None:
        """Nothing to say."""


event.register("numba:compile", _Announcement())  # type: ignore[no-untyped-call]


def _forget(folder: Path) -> None:
    newest = max((folder / f"{name}.py").stat().st_mtime for name in _FILES)
    for index in (folder / "__pycache__").glob("*.nbi"):
        with suppress(OSError):  # another process may be doing the same
            if index.name.split(".")[0] in _FILES and index.stat().st_mtime < newest:
                index.unlink()


with suppress(OSError):
    _forget(Path(__file__).parent)
