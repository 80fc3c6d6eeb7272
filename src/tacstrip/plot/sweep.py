"""A sweep as pictures: the Pareto front, and the error over each parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tacstrip.arrays import FloatArray
from tacstrip.plot.theme import RECOVERED, TRUE, legend_above, new_panels, plain_ticks, save

_MOST = 12  # parameters that have a panel
_ACROSS = 3
_SPAN = 8.0  # greatest over least, from which an axis is logarithmic


def draw_sweep(
    results: Mapping[str, Sequence[Any]],
    parameters: Sequence[str],
    error: str,
    front: Sequence[int],
    folder: Path,
) -> list[tuple[str, Path]]:
    """Draw all designs into a folder; return captions and files.

    Parameters
    ----------
    results
        Columns of a sweep.
    parameters, error
        Columns: what varied, and the error that designs are compared by [mm].
    front
        Rows of the Pareto front.
    folder
        Where pictures go; made if it is missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    errors = _numbers(results[error])
    costs = {"connectors": "connectors", "rate_hz": "full scans a second"}
    known = {name: at for name in costs if np.isfinite(at := _numbers(results[name])).any()}
    words = " and ".join(name.removesuffix("_hz") for name in known)
    made = [(f"Error of all designs over {words}, and the Pareto front", folder / "pareto.png")]
    figure, pair = new_panels(4.5 * len(known), 4.0, 1, len(known))
    for axes, (name, across) in zip(pair, known.items(), strict=True):
        axes.scatter(across, errors, s=12, color="0.7", label="designs")
        axes.scatter(across[list(front)], errors[list(front)], s=22, color=RECOVERED, label="Pareto front")
        axes.set_xlabel(costs[name])
        _logarithmic(axes, "x", across)
        _error_axis(axes, error, errors)
    legend_above(pair[0])
    save(figure, made[0][1])
    shown = [name for name in parameters if len({str(v) for v in results[name]}) > 1][:_MOST]
    if not shown:
        return made
    made.append(("Error over each parameter; dark dots are medians", folder / "parameters.png"))
    save(_over_parameters(results, shown, errors, lambda axes: _error_axis(axes, error, errors)), made[-1][1])
    iou = error.removesuffix("_mm") + "_iou"
    if iou in results:
        caption = "Overlap (IoU) over each parameter, 0 where no outline was found; dark dots are medians"
        made.append((caption, folder / "overlap.png"))
        save(_over_parameters(results, shown, _numbers(results[iou]), _overlap_axis), made[-1][1])
    return made


def _over_parameters(
    results: Mapping[str, Sequence[Any]], shown: Sequence[str], ys: FloatArray, prepare: Callable[[Any], None]
) -> Figure:
    """Draw a column (designs,) over each parameter; `prepare` sets up each panel's y axis."""
    rows = -(-len(shown) // _ACROSS)
    figure, panels = new_panels(3.3 * min(len(shown), _ACROSS), 2.9 * rows, rows, min(len(shown), _ACROSS))
    for axes, name in zip(panels, shown, strict=False):
        values = results[name]
        if all(isinstance(v, int | float) for v in values):
            at, ticks = _numbers(values), None
        else:
            ticks = sorted({str(v) for v in values})
            at = np.array([ticks.index(str(v)) for v in values], dtype=float)
        few = len(set(at.tolist())) <= _MOST
        axes.plot(at, ys, ".", color="0.75", markersize=3.0)
        if few:  # the medians, joined where there is something between, say what the parameter does
            places = np.array(sorted(set(at.tolist())))
            middle = [np.nanmedian(ys[at == p]) if np.isfinite(ys[at == p]).any() else np.nan for p in places]
            axes.plot(places, middle, "o-" if ticks is None else "o", color=TRUE, markersize=4.0)
        if ticks is not None:
            axes.set_xticks(range(len(ticks)), ticks)
        else:
            _logarithmic(axes, "x", at)
        axes.set_xlabel(name)
        prepare(axes)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    return figure


def _overlap_axis(axes: Any) -> None:
    axes.set_ylabel("overlap (IoU)")
    axes.set_ylim(-0.03, 1.03)


def _error_axis(axes: Any, name: str, errors: FloatArray) -> None:
    axes.set_ylabel(
        name.replace("p90_mm", "(nine of ten)").replace("_mm", "").replace("_", " ") + ": error [mm]"
    )
    _logarithmic(axes, "y", errors)


def _logarithmic(axes: Any, which: str, values: np.ndarray[Any, Any]) -> None:
    """Make an axis logarithmic whose values span much, with plain numbers at its ticks."""
    known = values[np.isfinite(values)]
    if len(known) and known.min() > 0.0 and known.max() > _SPAN * known.min():
        getattr(axes, f"set_{which}scale")("log")
        plain_ticks(getattr(axes, f"{which}axis"))


def _numbers(values: Sequence[Any]) -> np.ndarray[Any, Any]:
    return np.array([np.nan if v is None or not np.isfinite(v) else v for v in values], dtype=float)
