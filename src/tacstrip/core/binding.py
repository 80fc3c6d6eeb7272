"""The exported functions of `core.h` for Python: their arguments, once."""

from __future__ import annotations

import ctypes
import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from tacstrip.core.library import library

_INT, _DOUBLE, _POINTER = ctypes.c_longlong, ctypes.c_double, ctypes.c_void_p


def _fields(**kinds: Any) -> list[Any]:
    """Return the fields of a struct of core.h, in its order."""
    return list(kinds.items())


class Sendable:
    """What keeps a struct of addresses in `compiled`, and leaves it behind on the way to another process."""

    def __getstate__(self) -> dict[str, Any]:
        """Return all else."""
        return {name: value for name, value in vars(self).items() if name != "compiled"}


class Problem(ctypes.Structure):
    """`Problem` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[np.float64], ...]
    _fields_ = _fields(
        n=_INT, signatures=_INT, x=_POINTER, k=_POINTER, weight=_POINTER,
        pitch=_DOUBLE, share=_DOUBLE * 2, narrow=_DOUBLE, lam=_DOUBLE,
    )  # fmt: skip


class RunTask(ctypes.Structure):
    """`RunTask` of core.h."""

    _fields_ = _fields(
        problem=Problem,
        sigma=_DOUBLE,
        mm=_DOUBLE * 3,
        x_mm=_POINTER,
        strips=_INT,
        run=_POINTER,
        k=_POINTER,
        weight=_POINTER,
        residuals=_POINTER,
        excluded=_POINTER,
    )


class Lines(ctypes.Structure):
    """`Lines` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[Any], ...]
    _fields_ = _fields(count=_INT, lower=_INT, vertical=_INT * 2, reach=_POINTER, turns=_POINTER)


class Band(ctypes.Structure):
    """`Band` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[np.float64], ...]
    _fields_ = _fields(
        n=_INT, signatures=_INT, x=_POINTER, low=_POINTER, high=_POINTER, share=_DOUBLE * 2,
        narrow=_DOUBLE, length=_DOUBLE, lam=_DOUBLE, fade=_DOUBLE, windows=_DOUBLE * 4,
    )  # fmt: skip


class Scans(ctypes.Structure):
    """`Scans` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[np.float64], ...]
    _fields_ = _fields(
        scans=_INT, strips=_INT, signatures=_INT, x=_POINTER, k=_POINTER, gap=_POINTER, sigma=_DOUBLE,
        pitch=_DOUBLE, length=_DOUBLE, share=_DOUBLE * 2, narrow=_DOUBLE, lam=_DOUBLE,
    )  # fmt: skip


class CrossedLayer(ctypes.Structure):
    """`CrossedLayer` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[Any], ...]
    _fields_ = _fields(
        n=_INT, signatures=_INT, x=_POINTER, k=_POINTER, weight=_POINTER, touched=_POINTER, pitch=_DOUBLE,
        length=_DOUBLE, share=_DOUBLE * 2, narrow=_DOUBLE, lam=_DOUBLE, rotation=_DOUBLE * 4, origin=_DOUBLE * 2,
    )  # fmt: skip


class Loss(ctypes.Structure):
    """`Loss` of core.h."""

    _fields_ = _fields(tolerance=_DOUBLE, cauchy=_DOUBLE, end=_DOUBLE)


class CornerPrior(ctypes.Structure):
    """`CornerPrior` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[np.float64], ...]
    _fields_ = _fields(information=_POINTER, slope=_POINTER, about=_POINTER)


class OutlineBy(ctypes.Structure):
    """`OutlineBy` of core.h; `arrays` keeps alive what it points to."""

    arrays: tuple[npt.NDArray[Any], ...]
    _fields_ = _fields(count=_INT, numbers=_INT, which=_POINTER, weight=_POINTER, prior=_POINTER)


class RegularPlace(ctypes.Structure):
    """`RegularPlace` of core.h."""

    _fields_ = _fields(window=_DOUBLE * 4, aspect=_DOUBLE, borders=_INT, border=_INT * 4)


class BatchSensor(ctypes.Structure):
    """`BatchSensor` of core.h."""

    _fields_ = _fields(
        strips=_INT, signatures=_INT, single=_INT, pitch=_DOUBLE, length=_DOUBLE, share=_DOUBLE * 2,
        narrow=_DOUBLE, lam=_DOUBLE, top=_DOUBLE,
    )  # fmt: skip


class BatchErrors(ctypes.Structure):
    """`BatchErrors` of core.h."""

    _fields_ = _fields(key=ctypes.c_uint * 2, uniform=_DOUBLE * 2, sigma=_DOUBLE)


class ShapeLaws(ctypes.Structure):
    """`ShapeLaws` of core.h."""

    _fields_ = _fields(
        polygons=_DOUBLE, circles=_DOUBLE, corners=_INT * 2, objects=_INT * 2, frames=_INT, apart=_INT,
        size=_DOUBLE * 2, aspect=_DOUBLE * 2, turn=_DOUBLE * 2, x=_DOUBLE * 2, y=_DOUBLE * 2,
        irregularity=_DOUBLE, gap=_DOUBLE, travel=_DOUBLE, spin=_DOUBLE,
    )  # fmt: skip


class BatchResult(ctypes.Structure):
    """`BatchResult` of core.h."""

    _fields_ = _fields(
        readings=_POINTER * 2, l=_POINTER, u=_POINTER, vertices=_POINTER, pose=_POINTER, axes=_POINTER,
        kind=_POINTER, corners=_POINTER,
    )  # fmt: skip


MAX_VERTICES = 16  # interior vertices of a polygon
END_ENTRIES = 6  # entries of theta before the first vertex
SIZE = END_ENTRIES + 2 * MAX_VERTICES
# `Polygon` of core.h.
POLYGON = np.dtype(
    _fields(m="i8", vertical="2i8", upper=f"{MAX_VERTICES}i8", theta=f"{SIZE}f8", cost="f8", score="f8")
)
SHAPE_CORNERS, SHAPE_OBJECTS = 16, 8  # of a drawn polygon and of a drawn scene
KNOTS, MOST_CORNERS = 20, 26  # points of a chain and vertices of a sampled outline
HOTTEST = 6  # temperatures of a sampler
REGULAR_STRIPS, REGULAR_KINDS, REGULAR_NUMBERS, REGULAR_VALUES = 32, 7, 8, 3  # of regular outlines
RIGID_CORNERS = 64  # corners of an outline that keeps its shape
HULL_OBJECTS = 8  # objects on the same strips
SOLID_FRAME = 15  # numbers of a pressed object
# `Outline` and `OutlinePrior` of core.h.
OUTLINE = np.dtype(_fields(count="2i8", x=f"(2,{KNOTS})f8", y=f"(2,{KNOTS})f8"))
OUTLINE_PRIOR = np.dtype(
    _fields(
        window="4f8", ends="4f8", reflex="f8", finest="f8", vertices=f"(3,{MOST_CORNERS + 1})f8",
        area="f8", area_sigma="f8", sigma="2f8",
    )
)  # fmt: skip
# `Run` of core.h.
RUN = np.dtype(
    _fields(
        count="i8", best="i8", equal="i8", sigma="f8", advantage="f8", ellipse_cost="f8",
        ellipse="5f8", information="(5,5)f8", squares="f8", pairs="f8", inward="i8", told="i8",
        height="f8", swept="f8", points=f"{2 * MAX_VERTICES + 8}f8",
        covariance=f"{(SIZE + 2) ** 2}f8", found=(POLYGON, MAX_VERTICES + 1),
    )
)  # fmt: skip

_PROBLEM, _LINES, _BAND = (ctypes.POINTER(struct) for struct in (Problem, Lines, Band))
_SCANS, _LOSS, _PRIOR = (ctypes.POINTER(struct) for struct in (Scans, Loss, CornerPrior))
_BY, _PLACE = ctypes.POINTER(OutlineBy), ctypes.POINTER(RegularPlace)
_NOTHING = ctypes.c_char * 0
_SEARCH_WORKSPACE = 3613  # doubles: SEARCH_WORKSPACE of core.h
# What each one returns and takes; a pointer stands for the array that core.h describes.
_FUNCTIONS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "normal_equations": (_DOUBLE, (_PROBLEM, _POINTER, _INT, _POINTER, _POINTER)),
    "residuals": (None, (_PROBLEM, _POINTER, _POINTER)),
    "vertex_covariance": (_INT, (_PROBLEM, _POINTER, _INT, *[_DOUBLE] * 3, _POINTER, _INT, _POINTER)),
    "descend": (_DOUBLE, (_PROBLEM, _POINTER, _INT, _DOUBLE, _DOUBLE)),
    "refine": (None, (_PROBLEM, _POINTER)),
    "chains": (None, (_POINTER, *[_DOUBLE] * 3, _INT, _POINTER, _POINTER)),
    "places": (_INT, (_PROBLEM, _POINTER, _INT, _POINTER, _POINTER)),
    "fit_counts": (_INT, (_PROBLEM, _INT, _INT, _INT, _INT, _POINTER, _POINTER, _POINTER)),
    "fit_runs": (None, (_POINTER, _INT, _DOUBLE, _INT, _INT, _POINTER, _INT, _POINTER)),
    "fit_ellipse": (_DOUBLE, (_PROBLEM, _POINTER, _DOUBLE, _POINTER, _POINTER)),
    "lowest": (_DOUBLE, (*[_POINTER] * 5, _INT, _INT, _POINTER)),
    "minimax": (_INT, (*[_POINTER] * 3, _DOUBLE, _INT, _INT, _POINTER, _POINTER)),
    "analytic_centre": (None, (*[_POINTER] * 4, _INT, _INT, _POINTER)),
    "feasible_part": (_INT, (*[_POINTER] * 6, _DOUBLE, *[_INT] * 4, _POINTER)),
    "hit_and_run": (_INT, (*[_POINTER] * 9, *[_INT] * 4, _POINTER)),
    "sample_outlines": (_INT, (_PROBLEM, *[_POINTER] * 3, *[_INT] * 4, _POINTER, _POINTER)),
    "outline_ends": (None, (_POINTER, _INT, _POINTER, _INT, _POINTER)),
    "regular_values": (None, (_PROBLEM, _PLACE, *[_POINTER] * 3, _INT, _POINTER)),
    "sample_regular": (None, (_PROBLEM, _PLACE, _INT, _DOUBLE, _INT, *[_POINTER] * 5)),
    "feasible_set": (None, (_LINES, _BAND, *[_POINTER] * 10)),
    "outlines": (_INT, (_LINES, _POINTER, _DOUBLE, _POINTER, _POINTER, _INT, *[_POINTER] * 3)),
    "bounded": (
        _INT,
        (_BAND, _DOUBLE, _POINTER, _INT, _POINTER, _INT, *[_POINTER] * 2, _INT, *[_POINTER] * 6, _INT),
    ),
    "scatter": (None, (*[_POINTER] * 4, _INT, _INT, _POINTER, _INT, _INT, *[_POINTER] * 4)),
    "rigid_equations": (_DOUBLE, (_SCANS, _LOSS, _POINTER, _INT, *[_POINTER] * 7)),
    "rigid_linearised": (None, (_SCANS, _POINTER, _INT, _POINTER, _INT, _INT, _POINTER, _POINTER)),
    "rigid_poses": (None, (_SCANS, _LOSS, _POINTER, _INT, _POINTER, _INT, _INT, _POINTER)),
    "rigid_walk": (
        None,
        (_SCANS, _LOSS, _POINTER, _INT, *[_POINTER] * 5, _INT, *[_POINTER] * 2, _INT, *[_POINTER] * 2),
    ),
    "rigid_descend": (
        _DOUBLE,
        (_SCANS, _LOSS, _PRIOR, _POINTER, _INT, _POINTER, _INT, _DOUBLE, _POINTER, _POINTER),
    ),
    "rigid_path": (
        _DOUBLE,
        (_SCANS, _LOSS, _BY, _POINTER, _POINTER, _INT, _POINTER, _INT, _DOUBLE, _DOUBLE, _POINTER, _POINTER),
    ),
    "refine_scene": (
        _DOUBLE,
        (_POINTER, _INT, _POINTER, _INT, _DOUBLE, _DOUBLE, _INT, _DOUBLE, _DOUBLE, *[_POINTER] * 4),
    ),
    "hull_equations": (_DOUBLE, (_SCANS, _LOSS, _POINTER, _INT, *[_POINTER] * 10)),
    "hull_poses": (None, (_SCANS, _LOSS, _POINTER, _INT, *[_POINTER] * 5, _INT, _INT, _POINTER)),
    "convex_regression": (_INT, (*[_POINTER] * 3, _INT, _DOUBLE, *[_POINTER] * 3)),
    "best_lines": (_INT, (*[_POINTER] * 3, _INT, _DOUBLE, _DOUBLE, *[_POINTER] * 4)),
    "convex_cuts": (_INT, (*[_POINTER] * 3, _INT, *[_POINTER] * 4)),
    "convex_polyline": (_INT, (*[_POINTER] * 3, _INT, _DOUBLE, *[_POINTER] * 5)),
    "sure_strips": (_INT, (*[_POINTER] * 3, _INT, _POINTER, _INT, *[_POINTER] * 3)),
    "hull_ends": (None, (_POINTER, _INT, _POINTER, _INT, _POINTER, _POINTER)),
    "convex_reach": (
        _INT,
        (_POINTER, _INT, _POINTER, *[_INT] * 3, _POINTER, _DOUBLE, _POINTER, _POINTER),
    ),
    "convex_overlap": (_INT, (_POINTER, _INT, _POINTER, _INT, _POINTER, _POINTER)),
    "isolated_outliers": (_INT, (_POINTER, _INT, _INT, _POINTER)),
    "swept_areas": (None, (_POINTER, _POINTER, _INT, _POINTER, _INT, *[_POINTER] * 3)),
    "batch": (_INT, (*[_POINTER] * 3, _INT, _INT, *[_POINTER] * 4)),
    "footprint": (None, (*[_POINTER] * 3, _INT, _DOUBLE, _INT, _POINTER, _POINTER)),
    "solid_touch": (
        None,
        (_INT, _POINTER, _INT, _POINTER, _POINTER, _INT, _INT, _DOUBLE, _POINTER, _POINTER),
    ),
    "solid_gap": (None, (_INT, *[_POINTER] * 3, _INT, _DOUBLE, _POINTER)),
    "patch_sums": (None, (*[_POINTER] * 4, _INT, _INT, *[_POINTER] * 3)),
    "spikes": (None, (_POINTER, _INT, _DOUBLE, _POINTER, _POINTER)),
}


# These take long and let other threads run meanwhile; the others, over sooner than a thread wakes up, would only have
# to wait until that one lets go.
_LONG = frozenset(
    (
        "batch",
        "bounded",
        "fit_runs",
        "fit_counts",
        "feasible_part",
        "minimax",
        "hit_and_run",
        "outlines",
        "scatter",
        "sample_regular",
        "rigid_poses",
        "rigid_walk",
        "rigid_descend",
        "rigid_path",
        "hull_poses",
        "refine_scene",
    )
)


@functools.cache
def exported(name: str) -> Callable[..., Any] | None:
    """Return a function of the compiled core, its name without `tacstrip_`; None where NumPy has to do."""
    core = library()
    if core is None:
        return None
    by: ctypes.CDLL = core if name in _LONG else ctypes.PyDLL(core._name)
    function: Any = getattr(by, f"tacstrip_{name}")
    function.restype, function.argtypes = _FUNCTIONS[name]
    found: Callable[..., Any] = _without_turn(function) if name in _LONG else function
    return found


_own = threading.local()  # .turn: the lock of this thread's turn


@contextmanager
def taking_turns(turn: threading.Lock) -> Iterator[None]:
    """Hold a lock but in the core's long calls: of the threads that share it one is in Python at a time.

    NumPy gives Python's own lock away at every array of some 500 numbers, and to wake a thread that waits for it takes
    longer than the work; so none waits for that one.
    """
    before = getattr(_own, "turn", None)
    with turn:
        _own.turn = turn
        try:
            yield
        finally:
            _own.turn = before


def _without_turn(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function during which others of `taking_turns` go on."""

    def call(*given: Any) -> Any:
        turn: threading.Lock | None = getattr(_own, "turn", None)
        if turn is None:
            return function(*given)
        turn.release()
        try:
            return function(*given)
        finally:
            turn.acquire()

    return call


def at(array: npt.NDArray[Any]) -> int:
    """Return where an array lies; it must be contiguous, and outlive the call that is given this."""
    if array.flags.writeable:
        return ctypes.addressof(_NOTHING.from_buffer(array.data))  # half the time of array.ctypes.data
    return array.ctypes.data


def search_workspace(more: int = 0) -> npt.NDArray[np.float64]:
    """Return what a search works in, and so much more."""
    return np.empty(_SEARCH_WORKSPACE + more)
