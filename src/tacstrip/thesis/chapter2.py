"""The figures of chapter 2 that a model stands behind: 2.3 and 2.4, reproduced."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.network.devices.digital_array import ISOLATIONS, phantoms, scan_array, switch_currents
from tacstrip.network.devices.four_wire import four_wire
from tacstrip.network.grid import check_count, tactels
from tacstrip.plot.scene import draw_contact, draw_polygon, draw_sensor
from tacstrip.plot.theme import COLOURS, OTHERS, RECOVERED, SENSOR, STRIP, TRUE, add_axes, legend, new_figure
from tacstrip.reconstruction.profile import profile_reconstruction
from tacstrip.sensor.constructions import construction
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate
from tacstrip.thesis.captions import by_number

OBJECT = Contact.polygon([(16, 34), (42, 12), (86, 36), (74, 74), (55, 52), (31, 68)])  # [mm]
SIDE_MM, N = 100.0, 20
HYBRID = Sensor(construction="crs-crs", strips=N, pitch_mm=SIDE_MM / N, length_mm=SIDE_MM, strip_width_mm=3.6)
PARALLEL_PATH = np.zeros((4, 4), dtype=bool)  # figure 2.4: row i is 1, column j is 1
PARALLEL_PATH[[2, 2, 1], [1, 2, 2]] = True
SAMPLE_US = 100.0  # about a 10-bit conversion of a small microcontroller

_CURRENT = OTHERS[0]
_NO_CURRENT = 1e-9


def figure_2_3() -> Figure:
    """One object through the analog four-wire, the hybrid CRS-CRS and the digital sensor; costs at 100 us a sample."""
    figure = new_figure(7.0, 4.8)
    grid = figure.add_gridspec(2, 3, height_ratios=(2.0, 1.4))
    reads = {"one point": _draw_analog, "a profile": _draw_hybrid, "an image": _draw_digital}
    names = ("(a) analog", "(b) hybrid", "(c) digital")
    for k, (output, draw) in enumerate(reads.items()):
        axes = figure.add_subplot(grid[0, k])
        axes.add_patch(Rectangle((0, 0), SIDE_MM, SIDE_MM, facecolor=SENSOR, edgecolor="none", zorder=0))
        draw(axes)
        draw_contact(axes, OBJECT, "object")
        axes.set(xlim=(-2, SIDE_MM + 2), ylim=(-2, 1.4 * SIDE_MM), aspect="equal", yticks=range(0, 101, 25))
        axes.set(xlabel="x [mm]", ylabel="y [mm]")
        axes.set_title(f"{names[k]}: {output}", fontsize=9.0)
        axes.spines[["top", "right"]].set_visible(False)
        legend(axes, loc="upper left", fontsize=8.0, borderaxespad=0.0, handlelength=1.2)
    _draw_table(figure.add_subplot(grid[1, :]), (N, 100, 1000))
    return figure


def figure_2_4() -> Figure:
    """Parallel path: row i is driven; what its columns read, and where current flows, for each kind of isolation."""
    figure = new_figure(7.0, 3.6)
    for number, isolation in enumerate(ISOLATIONS, start=1):
        axes = add_axes(figure, 1, 3, number)
        _draw_array(axes, PARALLEL_PATH, 1, isolation)
        count = phantoms(PARALLEL_PATH, isolation=isolation)
        axes.set_title(f"isolation: {isolation}\n{count or 'no'} phantom", fontsize=9.0)
    figure.legend(handles=_array_key(), loc="outside lower center", ncols=2, frameon=False, fontsize=8.0)
    return figure


def comparison_table(n: int, sample_us: float = SAMPLE_US) -> list[dict[str, Any]]:
    """Compare what a scan of n x n sites costs (2.1, 2.2, 3.1, 3.2, 7.4).

    A row per sensor: `sensor`, `gives`, `samples` per scan, `connectors`, and `scan_ms`, the scan's time [ms] if
    samples are taken one after the other, `sample_us` [us] each. `OptionError` where n is not a whole number
    of 1 to 10^6.
    """
    n = check_count("n", n, 1_000_000)
    double, metal = construction("crs-crs").connectors(n), construction("crs-m").connectors(n)
    rows = [
        ("analog four-wire", "one point", 2, 4),
        ("hybrid CRS-CRS, k_h or k_l", "a number per strip", n, n + 2),  # single-measurement, 3.1
        ("hybrid CRS-M, k", "a number per strip", n, metal),
        ("hybrid CRS-CRS, k_h and k_l", "both ends per strip", 2 * n, double),
        ("digital", "a bit per tactel", n * n, 2 * n),
    ]
    keys = ("sensor", "gives", "samples", "connectors")
    return [dict(zip(keys, row, strict=True)) | {"scan_ms": row[2] * sample_us / 1000.0} for row in rows]


def _draw_analog(axes: Axes) -> None:
    point = four_wire(SIDE_MM, SIDE_MM, OBJECT, cells=100)
    label = f"reads ({point.x_mm:.1f}, {point.y_mm:.1f}) mm"
    axes.plot(point.x_mm, point.y_mm, "P", color=RECOVERED, markersize=9.0, label=label, zorder=4)


def _draw_hybrid(axes: Axes) -> None:
    draw_sensor(axes, HYBRID)
    for found in profile_reconstruction(simulate(HYBRID, OBJECT), HYBRID).objects:
        draw_polygon(axes, found.vertices, COLOURS["profile"], f"profile from {HYBRID.strips} strips")


def _draw_digital(axes: Axes) -> None:
    """Draw the image with isolation; outline what else reads closed without it."""
    pitch = SIDE_MM / N
    pattern = tactels(OBJECT, N, N, pitch)
    image, raw = scan_array(pattern, isolation="zero-potential").closed, scan_array(pattern).closed
    outline = {"facecolor": "none", "edgecolor": RECOVERED, "linewidth": 0.6}
    squares: list[tuple[BoolArray, str, dict[str, Any]]] = [
        (image, f"closed: {image.sum()} tactels", {"facecolor": COLOURS["k"], "alpha": 0.75}),
        (raw & ~image, f"{np.sum(raw & ~image)} phantoms else", outline),
    ]  # fmt: skip
    for where, label, look in squares:
        for number, (i, j) in enumerate(np.argwhere(where)):
            corner, side = ((j + 0.08) * pitch, (i + 0.08) * pitch), 0.84 * pitch
            axes.add_patch(Rectangle(corner, side, side, **look, label="" if number else label))


def _draw_table(axes: Axes, sizes: Sequence[int]) -> None:
    tables = [comparison_table(n) for n in sizes]
    costs = ("samples", "wires", "scan")
    head = ["sensor", *(f"n = {n:,}\n{c}" if c == "samples" else f"\n{c}" for n in sizes for c in costs)]
    rows = zip(*tables, strict=True)  # of one sensor at all sizes
    cells = [[row[0]["sensor"], *(text for each in row for text in _costs(each))] for row in rows]
    widths = [0.26, *([0.105, 0.063, 0.077] * len(sizes))]
    table = axes.table(cells, colLabels=head, colWidths=widths, loc="center", edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(8.0)
    for (row, column), cell in table.get_celld().items():
        cell.set(height=0.26 if row == 0 else 0.16, linewidth=0.5)
        cell.set_text_props(ha="left" if column == 0 else "right")
        cell.PAD = 0.04
    axes.set(xlabel="what a scan costs", ylabel="sensor")
    axes.set_axis_off()


def _costs(row: dict[str, Any]) -> list[str]:
    ms = row["scan_ms"]
    scan = f"{ms / 1000:g} s" if ms >= 1000 else f"{ms:g} ms"
    return [f"{row['samples']:,}", f"{row['connectors']:,}", scan]


def _draw_array(axes: Axes, pattern: BoolArray, row: int, isolation: str) -> None:
    """Draw wires and switches, what reads closed, and the currents while one row is driven."""
    scan = scan_array(pattern, isolation=isolation)
    rows, columns = pattern.shape
    for i, j in np.ndindex(rows, columns):
        if scan.closed[i, j]:
            colour = COLOURS["k"] if pattern[i, j] else RECOVERED
            look: dict[str, Any] = {"facecolor": colour, "alpha": 0.25, "edgecolor": "none"}
            axes.add_patch(Rectangle((j - 0.36, i - 0.36), 0.72, 0.72, **look))
        face, size = (TRUE, 7.0) if pattern[i, j] else ("w", 4.0)
        axes.plot(j, i, "o", color=TRUE, markerfacecolor=face, markersize=size, zorder=5)
    for i in range(rows):
        axes.plot([-0.7, columns - 0.5], [i, i], color=STRIP, linewidth=1.6, zorder=1)
        other = "0 V" if isolation == "zero-potential" else "floats"
        axes.text(-0.8, i, "Vref" if i == row else other, ha="right", va="center", fontsize=8.0,
                  color=_CURRENT if i == row else TRUE)  # fmt: skip
    for j in range(columns):
        axes.plot([j, j], [-0.5, rows - 0.3], color=STRIP, linewidth=1.6, zorder=1)
        axes.text(j, rows - 0.12, f"{scan.volts[row, j]:.3f}", ha="center", va="center", fontsize=8.0)
    _draw_currents(axes, switch_currents(pattern, row, isolation))
    what = "current" if isolation == "zero-potential" else "voltage"
    axes.set(xlim=(-1.7, columns - 0.4), ylim=(rows + 0.1, -0.6), aspect="equal", ylabel="row")
    axes.set_xlabel(f"column; the {what} it\nreads while row i is driven", fontsize=8.0)
    axes.set_xticks(range(columns), _names("j", columns))
    axes.set_yticks(range(rows), _names("i", rows))
    axes.tick_params(length=0.0, labelsize=8.0)
    for side in axes.spines.values():
        side.set_visible(False)


def _names(letter: str, count: int) -> list[str]:
    return [letter if k == 1 else f"{letter} {k - 1:+d}".replace("-", "\N{MINUS SIGN}") for k in range(count)]


def _draw_currents(axes: Axes, flow: FloatArray) -> None:
    """Draw the pieces of wire that carry current, by Kirchhoff from the switches' currents (rows, columns)."""
    # From the left neighbour, or the source, into column j.
    rightwards = np.cumsum(flow[:, ::-1], axis=1)[:, ::-1]
    downwards = np.cumsum(flow, axis=0)  # from row i to the next one, or to the end that is read
    for i, j in np.argwhere(np.abs(rightwards) > _NO_CURRENT):
        _arrow(axes, (max(j - 1, -0.7), i), (j, i), rightwards[i, j] > 0.0)
    for i, j in np.argwhere(np.abs(downwards) > _NO_CURRENT):
        _arrow(axes, (j, i), (j, min(i + 1, len(flow) - 0.3)), downwards[i, j] > 0.0)


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], forward: bool) -> None:
    (x0, y0), (x1, y1) = (start, end) if forward else (end, start)
    axes.plot([x0, x1], [y0, y1], color=_CURRENT, linewidth=2.4, zorder=3)
    middle = (0.45 * x0 + 0.55 * x1, 0.45 * y0 + 0.55 * y1)
    tail = (0.55 * x0 + 0.45 * x1, 0.55 * y0 + 0.45 * y1)
    look = {"arrowstyle": "-|>", "color": _CURRENT, "linewidth": 1.5}
    axes.annotate("", middle, tail, arrowprops=look, zorder=4)


def _array_key() -> list[Any]:
    return [
        Line2D([], [], marker="o", linestyle="none", color=TRUE, markersize=7.0, label="closed switch"),
        Patch(facecolor=COLOURS["k"], alpha=0.25, label="reads closed, rightly"),
        Patch(facecolor=RECOVERED, alpha=0.25, label="reads closed, but is open: phantom"),
        Line2D([], [], color=_CURRENT, linewidth=2.4, label="current while row i is driven"),
    ]


FIGURES = by_number(globals())
