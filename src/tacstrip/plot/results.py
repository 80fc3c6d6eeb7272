"""What was recovered from scans: the shapes, how certain they are, and the readings they came from."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.optimize import linear_sum_assignment

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray
from tacstrip.contact.shape import Contact
from tacstrip.errors import ArgumentError
from tacstrip.geometry.region import regions
from tacstrip.plot.layers import draw_object
from tacstrip.plot.scans import how_many_drawn, say_nothing, scan, spread
from tacstrip.plot.scene import (
    LabelledObject,
    draw_contact,
    draw_piece,
    draw_polygon,
    draw_regions,
    draw_sensor,
    fill_sheet,
    labelled_objects,
    neighbourhood,
    zoom,
)
from tacstrip.plot.sensors import axes_with_sensor
from tacstrip.plot.theme import TRUE, add_axes, legend_above, legend_below, new_figure, new_panels
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.left_out import left_out
from tacstrip.sensor.spec import Sensor

_MOST_SCANS = 12  # more shapes than these overlap beyond reading
_MOST_WITH_REGIONS = 3  # scans
_OVERLAID = 3  # scans; more are frames of a film strip
_ACROSS = 3  # frames
_NEARLY_ALL = 0.5  # of the sensor: a closer view of so much shows nothing more
_SEEN = 0.08  # of an outline's extent: smaller regions are drawn larger
_SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@takes(result=(Reconstruction, Reconstruction), sensor=Sensor | LayeredSensor, truth=(Contact, Contact))
def result(
    result: Reconstruction | Sequence[Reconstruction],
    sensor: AnySensor,
    *,
    truth: Contact | Sequence[Contact] = (),
    ax: Axes | None = None,
) -> Axes:
    """Draw the shapes that were recovered, on the sensor: dashed with hollow corners where they are doubtful.

    Several results are drawn over each other, from dark to light over time, twelve at most: the title says how many of
    how many. `film_strip` gives each a frame of its own.

    Parameters
    ----------
    result
        What `reconstruct` or another method returned, or several in the order of time.
    sensor
        That made the scans.
    truth
        What touched, where that is known: one for all results, or one per result.
    ax
        Axes to draw into, whose limits stay where they were set or something is drawn; None: new ones on a figure of
        their own.

    Returns
    -------
    Axes
        x across the strips and y along them [mm].

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0)
    >>> coin = ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)])
    >>> found = ts.reconstruct(ts.simulate(sensor, coin), sensor)
    >>> ax = plot.result(found, sensor, truth=coin)
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['true shape', 'recovered: ok', '95 % region of a corner']
    """
    results = [result] if isinstance(result, Reconstruction) else list(result)
    touched = [i for i, one in enumerate(results) if one.objects]
    shown = spread(touched, _MOST_SCANS)
    own = ax is not None and (ax.has_data() or not ax.get_autoscale_on())  # limits of the caller's
    kept = {"xlim": ax.get_xlim(), "ylim": ax.get_ylim()} if ax is not None and own else None
    axes = axes_with_sensor(sensor, ax)
    objects = labelled_objects({"recovered": results}, shown)
    some = _shown_truth(truth, len(results), shown)
    with_regions = len(shown) <= _MOST_WITH_REGIONS
    _draw_shapes(axes, sensor, objects, some, with_regions)
    if entries := _explained(axes, objects, with_regions, len(shown) > 1):
        legend_above(axes, handles=list(entries.values()), labels=list(entries))
    if not objects:
        say_nothing(axes, "no strip is touched")
    if why := how_many_drawn(shown, touched, results):
        axes.set_title(why)
    if kept is None:
        fill_sheet(axes)
    else:
        axes.set(**kept)
    return axes


@takes(result=Reconstruction, sensor=Sensor | LayeredSensor, truth=Contact)
def uncertainty(
    result: Reconstruction,
    sensor: AnySensor,
    *,
    truth: Contact | None = None,
    magnify: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw how certain the corners are: their 95 % regions, and other outlines that explain the readings.

    Parameters
    ----------
    result
        What `reconstruct` or another method returned for one scan.
    sensor
        That made it.
    truth
        What touched, where that is known.
    magnify
        How many times larger the regions are drawn than they are; None: as much as it takes to see them. The legend
        says so.
    ax
        Axes to draw into; None: new ones on a figure of their own.

    Returns
    -------
    Axes
        x across the strips and y along them [mm], the neighbourhood of what was found.

    Raises
    ------
    ArgumentError
        `magnify` is no number above 0.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> coin = ts.Contact.polygon([(30, 40), (60, 35), (70, 60), (40, 70)])
    >>> noise = ts.Noise(positional=0.005)
    >>> found = ts.reconstruct(ts.simulate(sensor, coin, noise, rng=1), sensor, noise)
    >>> ax = plot.uncertainty(found, sensor)
    >>> ax.get_legend().get_texts()[-1].get_text()
    '95 % region of a corner, 5 times larger'
    """
    if magnify is not None and not (isinstance(magnify, int | float) and 0.0 < magnify < np.inf):
        raise ArgumentError(f"magnify = {magnify!r}: must be a number above 0, such as 10")
    axes = axes_with_sensor(sensor, ax)
    objects = [o for o in labelled_objects({"recovered": [result]}, [0]) if o.found.found]
    points = _points(objects, [] if truth is None else [truth])
    around = [regions(o.found.vertices, o.found.covariance) for o in objects]
    scale = _magnified(points, around) if magnify is None else magnify
    _draw_shapes(axes, sensor, objects, [] if truth is None else [truth], with_regions=True, magnify=scale)
    if len(points):
        entries = _explained(axes, objects, True, False, scale)
        if isinstance(sensor, Sensor):
            zoom(axes, points, sensor)
        legend_above(axes, handles=list(entries.values()), labels=list(entries))
    else:
        say_nothing(axes, f"no shape: {result.status}")
    fill_sheet(axes, sensor if isinstance(sensor, Sensor) else None)
    return axes


@takes(results=(Reconstruction,), sensor=Sensor, truth=(Contact, Contact))
def film_strip(
    results: Sequence[Reconstruction],
    sensor: Sensor,
    *,
    truth: Contact | Sequence[Contact] = (),
    most: int = _MOST_SCANS,
) -> tuple[Axes, ...]:
    """Draw many results as the frames of a film, each in axes of its own, on one new figure.

    Parameters
    ----------
    results
        In the order of time.
    sensor
        That made the scans, of one layer.
    truth
        What touched, where that is known: one for all results, or one per result.
    most
        Frames; of more results so many are drawn, evenly spread, and the figure's title says of how many.

    Returns
    -------
    tuple of Axes
        A frame each, of the same part of the sensor; `axes[0].figure` is the picture.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip import plot
    >>> sensor = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0)
    >>> pen = ts.Contact.polygon([(10, 20), (25, 20), (25, 80), (10, 80)])
    >>> scans = [ts.simulate(sensor, pen.moved(4 * i, 0), time_s=0.1 * i) for i in range(8)]
    >>> frames = plot.film_strip([ts.profile_reconstruction(scan, sensor) for scan in scans], sensor)
    >>> len(frames), frames[3].get_title()
    (8, 'scan 3, 0.3 s')
    """
    if not isinstance(most, int) or most < 1:
        raise ArgumentError(f"most = {most!r}: draw 1 frame or more")
    touched = [i for i, one in enumerate(results) if one.objects]
    shown = spread(touched, most)
    rows, columns = _grid(max(len(shown), 1))
    figure = new_figure(2.4 * columns + 0.6, _frame_height(sensor) * rows + 0.8)
    named = {"recovered": results}
    times = [one.time_s for one in results]
    frames = _draw_frames(figure, (rows, columns), sensor, named, shown, times, truth, len(results))
    if why := how_many_drawn(shown, touched, results):
        figure.suptitle(why)
    _settle(figure)
    return frames


def reconstruction_figure(
    sensor: Sensor,
    scans: Sequence[Scan],
    results: Mapping[str, Sequence[Reconstruction]],
    truth: Sequence[Contact] = (),
) -> Figure:
    """Draw scans and what was recovered from them: few in one scene, many as a film strip of some, evenly spread.

    Parameters
    ----------
    sensor, scans
        What was measured, with what.
    results
        Reconstructions to compare, one per scan, by the name for the legend.
    truth
        What touched, where that is known: one for all scans, or one per scan.
    """
    touched = [i for i, scan in enumerate(scans) if scan.touched.any()]
    if len(touched) > _OVERLAID:
        return _film_figure(sensor, scans, results, truth, touched)
    some = _shown_truth(truth, len(scans), touched)
    objects = labelled_objects(results, touched)
    points = _points(objects, some)
    closer = len(points) > 0 and not _nearly_all(sensor, points)
    figure, panels = new_panels(9.5, 5.2, 1, 2 + closer)
    for axes in panels[:-1]:
        axes_with_sensor(sensor, axes)
        axes.set_aspect("equal", adjustable="box")
        _draw_shapes(axes, sensor, objects, some, with_regions=True)
    if closer:
        zoom(panels[1], points, sensor)
        panels[0].set_title("sensor")
    panels[-2].set_title("shapes")
    _draw_readings(panels[-1], sensor, scans)
    _name_faulty(panels[-1], sensor, scans, next(iter(results.values()), ()))
    legend_below(figure, _explained(panels[0], objects, True, len(touched) > 1), 3)
    return figure


def _film_figure(
    sensor: Sensor,
    scans: Sequence[Scan],
    results: Mapping[str, Sequence[Reconstruction]],
    truth: Sequence[Contact],
    touched: Sequence[int],
) -> Figure:
    shown = spread(touched, _MOST_SCANS)
    rows, columns = _grid(len(shown))
    figure = new_figure(9.5, _frame_height(sensor) * rows + 3.4)
    times = [one.time_s for one in scans]
    _draw_frames(figure, (rows + 1, columns), sensor, results, shown, times, truth, len(scans))
    if why := how_many_drawn(shown, touched, scans):
        figure.suptitle(f"shapes of {why}")
    _draw_readings(
        add_axes(figure, rows + 1, columns, (rows * columns + 1, (rows + 1) * columns)), sensor, scans
    )
    _settle(figure)
    return figure


def _draw_readings(axes: Axes, sensor: Sensor, scans: Sequence[Scan]) -> None:
    scan(scans, sensor, ax=axes)
    some = axes.get_title()
    axes.set_title(f"readings of {some}" if some else "readings")


def _name_faulty(
    axes: Axes, sensor: Sensor, scans: Sequence[Scan], results: Sequence[Reconstruction]
) -> None:
    """Write beside the readings that were not used whose they are."""
    named = {name: n for n, result in enumerate(results) for o in result.objects for name in o.faulty}
    for name, n in named.items():
        for signature, strips in left_out(replace(sensor, without=(name,))).items():
            at = int(strips.argmax())
            axes.annotate(
                f"{name} not used", (sensor.x_mm[at], scans[n][signature][at]), (5, 0),
                textcoords="offset points", fontsize="small", color=TRUE, va="center",
            )  # fmt: skip


def _draw_frames(
    figure: Figure,
    grid: tuple[int, int],
    sensor: Sensor,
    results: Mapping[str, Sequence[Reconstruction]],
    shown: Sequence[int],
    times: Sequence[float],
    truth: Contact | Sequence[Contact],
    count: int,
) -> tuple[Axes, ...]:
    """Draw a frame per scan that is shown, and one legend for all."""
    contacts = _shown_truth(truth, count, shown)
    followed = _followed([next(iter(results.values()))[i] for i in shown]) if len(results) == 1 else {}
    scenes = [labelled_objects(results, [i], followed.get(order)) for order, i in enumerate(shown)]
    every = [o for scene in scenes for o in scene]
    points = _points(every, contacts)
    part = len(points) > 0 and not _nearly_all(sensor, points)
    frames: list[Axes] = []
    entries: dict[str, Artist] = {}
    timed = any(times)
    for order, (i, scene) in enumerate(zip(shown, scenes, strict=True)):
        axes = add_axes(figure, *grid, order + 1)
        draw_sensor(axes, sensor)
        if part:
            zoom(axes, points, sensor)
        each = contacts if len(contacts) != len(shown) else contacts[order : order + 1]
        _draw_shapes(axes, sensor, scene, each, with_regions=True, several=len(shown) > 1)
        axes.set_title(f"scan {i}, {times[i]:.4g} s" if timed else f"scan {i}")
        if order % grid[1]:
            axes.set_ylabel("")
            axes.tick_params(labelleft=False)
        if order + grid[1] < len(shown):  # another frame lies below
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
        entries |= _explained(axes, scene, True, False)
        frames.append(axes)
    legend_below(figure, entries)
    return tuple(frames)


def _followed(frames: Sequence[Reconstruction]) -> dict[int, list[int]]:
    """Return the numbers of each frame's objects: those of the nearest ones before, new ones for new objects."""
    numbers: dict[int, list[int]] = {}
    places: dict[int, FloatArray] = {}  # where each number was last
    for order, frame in enumerate(frames):
        here = [
            np.asarray(o.centroid if o.found else (o.strips.start, 0.0), dtype=float) for o in frame.objects
        ]
        before = list(places)
        cost = [[float(np.hypot(*(place - places[number]))) for number in before] for place in here]
        own = dict(zip(*linear_sum_assignment(np.reshape(cost, (len(here), len(before)))), strict=True))
        free = (n for n in itertools.count() if n not in before)
        numbers[order] = [before[own[k]] if k in own else next(free) for k in range(len(here))]
        places |= dict(zip(numbers[order], here, strict=True))
    return numbers


def _settle(figure: Figure) -> None:
    """Lay a figure out once: frames of fixed shape take two rounds to find their places, and drawing is the second."""
    if layout := figure.get_layout_engine():
        layout.execute(figure)


def _grid(frames: int) -> tuple[int, int]:
    """Return rows and columns of a film strip."""
    columns = min(frames, _ACROSS)
    return -(-frames // columns), columns


def _frame_height(sensor: Sensor) -> float:
    return float(min(max(2.0 * sensor.length_mm / sensor.width_mm, 1.2), 2.6)) + 0.4


def _shown_truth(truth: Contact | Sequence[Contact], count: int, shown: Sequence[int]) -> list[Contact]:
    """Return what touched in the scans that are shown: one for all, or one each."""
    several = [truth] if isinstance(truth, Contact) else list(truth)
    return [several[i] for i in shown] if len(several) == count and count > 1 else several


def _draw_shapes(
    axes: Axes,
    sensor: AnySensor,
    objects: Sequence[LabelledObject],
    truth: Sequence[Contact],
    with_regions: bool,
    magnify: float = 1.0,
    several: bool = False,
) -> None:
    weights = not several and sum(bool(drawn.found.alternatives) for drawn in objects) <= 1
    for i, contact in enumerate(truth):
        draw_contact(axes, contact, label=None if i else "true shape")
    for drawn in objects:
        found, colour = drawn.found, drawn.colour
        if isinstance(sensor, LayeredSensor):
            if found.found:
                draw_object(axes, drawn)
            continue
        if found.found:
            if found.hidden is None:
                draw_polygon(axes, found.vertices, colour, drawn.label, status=found.status)
            else:
                draw_piece(axes, found, colour, drawn.label)
            for k, other in enumerate(found.alternatives if with_regions else ()):
                label = f"alternative {k + 1}" + (f": {other.weight:.2f}" if weights else "")
                dashes = (0, (1, 1 + k))  # dotted: what is doubtful is dashed
                for outline in (other.vertices, *other.others):
                    ring = np.concatenate([outline, outline[:1]])
                    axes.plot(*ring.T, color=colour, linestyle=dashes, linewidth=1.0, label=label, zorder=3.5)
                    label = ""
            if sensor.closed and found.vertices[:, 0].max() > sensor.width_mm:  # it goes on beyond the seam
                again = found.vertices - (sensor.width_mm, 0.0)
                draw_polygon(axes, again, colour, status=found.status)
            if with_regions:
                around = _regions(found.vertices, found.covariance, magnify)
                draw_regions(axes, sensor, around, colour)
        elif found.profile is not None:
            x, l, u = found.profile
            axes.vlines(x, l, u, color=colour, linewidth=2.0, label=drawn.label or "")
            axes.plot(x, l, "_", color=colour)
        else:
            ends = np.array([found.strips.start, found.strips.stop]) * sensor.pitch_mm
            axes.axvspan(*ends, color=colour, alpha=0.12, label=drawn.label)
    if not isinstance(sensor, LayeredSensor):
        _number(axes, sensor, objects)


def _number(axes: Axes, sensor: Sensor, objects: Iterable[LabelledObject]) -> None:
    """Write objects' numbers where they lie, but not over each other."""
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    width, height = axes.bbox.width / axes.figure.dpi, axes.bbox.height / axes.figure.dpi
    inch = max((x1 - x0) / width, (y1 - y0) / height)  # [mm]: the scale is the same across and along
    written: list[tuple[float, float]] = []
    for drawn in objects:
        x, y = drawn.place(sensor)
        near = 0.09 * max(len(drawn.number), 2) * inch
        if not drawn.number or any(abs(x - a) < near and abs(y - b) < 0.18 * inch for a, b in written):
            continue
        written.append((x, y))
        axes.annotate(
            drawn.number, (x, y), color=drawn.colour, ha="center", va="center", zorder=6, clip_on=True,
            fontsize="small", bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.5},
        )  # fmt: skip


def _explained(
    axes: Axes, objects: Sequence[LabelledObject], with_regions: bool, several: bool, magnify: float = 1.0
) -> dict[str, Artist]:
    """Return what the legend of shapes explains: artists by their labels."""
    entries: dict[str, Artist] = {}
    for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
        entries.setdefault(str(label), handle)
    if with_regions and any(regions(o.found.vertices, o.found.covariance) for o in objects):
        point = "corner" if all(o.found.kind == "polygon" for o in objects) else "point"
        larger = "" if magnify == 1.0 else f", {magnify:g} times larger"
        colours = {o.colour for o in objects}  # of several, as over time, none stands for all
        colour = colours.pop() if len(colours) == 1 else TRUE
        entries[f"95 % region of a {point}{larger}"] = Patch(facecolor=colour, alpha=0.25)
    if any(o.found.bounds is not None for o in objects):
        entries["hidden behind another piece"] = Line2D([], [], color=TRUE, linestyle="--")
        entries["smallest and largest"] = Line2D([], [], color=TRUE, linestyle=":")
    elif any(o.found.hidden is not None and o.found.hidden.any() for o in objects):
        entries["hidden corner"] = Line2D([], [], color=TRUE, linestyle="--", marker="o", mfc="white")
    if several and objects:
        entries["numbers: scans"] = Patch(alpha=0.0)
    return entries


def _regions(vertices: FloatArray, covariance: FloatArray | None, magnify: float) -> list[FloatArray]:
    """Return the corners' 95 % regions, each so many times larger about its corner."""
    around = regions(vertices, covariance)
    if magnify == 1.0:
        return around
    # A region lies about its corner, its mean; a corner whose covariance is not finite has none.
    return [magnify * region + (1.0 - magnify) * region.mean(axis=0) for region in around]


def _magnified(points: FloatArray, around: Sequence[Sequence[FloatArray]]) -> float:
    """Return how many times larger regions must be drawn to be seen."""
    sizes = [float(np.ptp(region, axis=0).max()) for regions_ in around for region in regions_]
    if not sizes or not len(points):
        return 1.0
    wanted = _SEEN * float(np.ptp(points, axis=0).max()) / max(float(np.median(sizes)), 1e-12)
    return float(next((s for s in _SCALES if s >= wanted), _SCALES[-1]))


def _points(objects: Sequence[LabelledObject], truth: Sequence[Contact]) -> FloatArray:
    corners = [o.found.vertices for o in objects if o.found.found]
    corners += [shapely.get_coordinates(list(c.shapes)) for c in truth]
    return np.concatenate(corners) if corners else np.empty((0, 2))


def _nearly_all(sensor: Sensor, points: FloatArray) -> bool:
    """Tell whether a closer view of points would show most of the sensor."""
    x, y = neighbourhood(points, sensor)
    seen = (min(x[1], sensor.width_mm) - max(x[0], 0.0)) * (min(y[1], sensor.length_mm) - max(y[0], 0.0))
    return seen > _NEARLY_ALL * sensor.width_mm * sensor.length_mm
