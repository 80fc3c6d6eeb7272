"""The polygon fit in pictures: docs/science/estimation.md."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.contact.noise import Noise
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.geometry.outline import Outline
from tacstrip.geometry.region import ellipse, regions
from tacstrip.plot.scene import draw_contact, zoom
from tacstrip.plot.theme import COLOURS, OTHERS, RECOVERED, add_axes, legend, new_figure
from tacstrip.reconstruction.cramer_rao import reading_sigma, vertex_covariance
from tacstrip.reconstruction.polygon.estimate import fit_polygon
from tacstrip.reconstruction.result import RecoveredObject
from tacstrip.reconstruction.set_membership.estimate import Bounded
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

_SENSOR = Sensor(construction="crs-crs", strips=120, pitch_mm=3.0, length_mm=325.0, adc_bits=12)
_COARSE = replace(_SENSOR, strips=60, pitch_mm=6.0)
_SHAPE = np.array([(42.2, 150.0), (110.5, 55.0), (226.3, 80.0), (310.4, 190.0), (166.7, 265.0)])
_NOISE = Noise(positional=0.01)
_LEVELS = (0.001, 0.002, 0.005, 0.01, 0.02)
_DRAWS = 60  # scans per noise level
_BOUNDED, _GAUSS = OTHERS[1], OTHERS[0]


def fit_figure() -> Figure:
    """Draw a noisy signature with the sections and kinks fitted to it, and the polygon with its regions."""
    figure = new_figure(7.0, 7.4)
    left, right = add_axes(figure, 2, 1, 1), add_axes(figure, 2, 1, 2)
    scan = simulate(_COARSE, Contact.polygon(_SHAPE), _NOISE, rng=4)
    scan = Scan(kh=scan["kh"])
    (found,) = fit_polygon(scan, _COARSE, _NOISE).objects
    outline = Outline.of(found.vertices)
    left.plot(_COARSE.x_mm, scan["kh"], ".", color=COLOURS["kh"], markersize=4.0, label="$k_h$, as read")
    x = np.linspace(found.vertices[:, 0].min(), found.vertices[:, 0].max(), 800)
    fitted = signatures(_COARSE, *outline.ends(x))["kh"]
    left.plot(x, fitted, color="black", linewidth=1.0, label="sections of the fit")
    for chain, style, where in ((outline.lower, ":", "lower"), (outline.upper, "--", "upper")):
        for i, at in enumerate(chain[1:-1, 0]):
            left.axvline(
                at,
                color="#777777",
                linestyle=style,
                linewidth=0.9,
                label=None if i else f"kink of the {where} chain",
            )
    left.set_xlabel("x [mm]")
    left.set_ylabel("reading over Vref")
    legend(left, loc="upper right", frameon=True, framealpha=1.0, edgecolor="none")
    _draw_found(right, found)
    legend(right, loc="upper left")
    return figure


def _draw_found(axes: Axes, found: RecoveredObject) -> None:
    draw_contact(axes, Contact.polygon(_SHAPE), label="true shape")
    ring = np.concatenate([found.vertices, found.vertices[:1]])
    axes.plot(*ring.T, color=RECOVERED, linewidth=0.8, label="fit")
    for i, region in enumerate(found.guaranteed or []):
        axes.fill(
            *region.T,
            facecolor=_BOUNDED,
            alpha=0.25,
            edgecolor=_BOUNDED,
            label=None if i else "guaranteed region",
        )
    for i, region in enumerate(regions(found.vertices, found.covariance)):
        axes.plot(
            *np.concatenate([region, region[:1]]).T, color=RECOVERED, label=None if i else "95 % region"
        )
    axes.set_aspect("equal")
    zoom(axes, _SHAPE, _SENSOR, 0.1)
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")


def noise_figure() -> Figure:
    """Draw error and right counts over the noise: the fit, the bound, and Vertex Reconstruction's gradient rule."""
    figure = new_figure(7.0, 4.2)
    left, right = add_axes(figure, 1, 2, 1), add_axes(figure, 1, 2, 2)
    by_method = {method: np.array([_scores(method, a) for a in _LEVELS]) for method in _METHODS}
    percent = 100.0 * np.array(_LEVELS)
    for (method, scores), (colour, style) in zip(by_method.items(), _STYLES, strict=True):
        left.loglog(percent, scores[:, 0], style, color=colour, markersize=4.0, label=method)
        right.semilogx(percent, 100.0 * scores[:, 1], style, color=colour, markersize=4.0, label=method)
    bound = [_bound(a) for a in _LEVELS]
    left.loglog(percent, bound, color="black", linestyle=":", label="Cramer-Rao bound (normal errors)")
    left.set_ylabel("from a true inner vertex to the nearest, median [mm]")
    right.set_ylabel("scans with the right number of vertices [%]")
    right.set_ylim(-3.0, 103.0)
    for axes in (left, right):
        axes.set_xlabel("noise: half-width of uniform errors [% of Vref]")
        axes.set_xticks(percent, [f"{p:g}" for p in percent], minor=False)
        axes.minorticks_off()
    legend(left, loc="upper left")
    return figure


def _by_gradient(scan: Scan, noise: Noise) -> FloatArray:
    made = vertex_reconstruction(scan, _SENSOR, signature="kh", transitions="gradient", noise=noise).objects
    return made[0].vertices if made else np.empty((0, 2))


_METHODS: dict[str, Callable[[Scan, Noise], FloatArray]] = {
    "V.R., gradient rule": _by_gradient,
    "fit, least squares": lambda scan, noise: _first(scan, noise, False).vertices,
    "fit, bound of the noise used": lambda scan, noise: _first(scan, noise).vertices,
}
_STYLES = (("#999999", "s-"), (_GAUSS, "o-"), (_BOUNDED, "^-"))


def _scores(method: str, half_width: float) -> tuple[float, float]:
    """Return the median distance of inner vertices to the nearest one [mm], and the share of right counts."""
    noise, far, right = Noise(positional=half_width), [], []
    for seed in range(_DRAWS):
        truth = _shape(seed)
        scan = simulate(_SENSOR, Contact.polygon(truth), noise, rng=seed)
        vertices = _METHODS[method](Scan(kh=scan["kh"]), noise)
        right.append(vertices.shape == truth.shape)
        inner = truth[_inner(truth)]
        gaps = np.linalg.norm(inner[:, None] - vertices, axis=2).min(axis=1, initial=np.ptp(truth[:, 0]))
        far += list(gaps)
    return float(np.median(far)), float(np.mean(right))


def _bound(half_width: float) -> float:
    """Return the median distance that the bound's covariance implies [mm]."""
    sigma, distances = reading_sigma(Noise(positional=half_width), _SENSOR), []
    for seed in range(_DRAWS):
        outline = Outline.of(_shape(seed))
        covariance = vertex_covariance(outline, _SENSOR, sigma, ("kh",))
        error = np.random.default_rng(seed).multivariate_normal(np.zeros(len(covariance)), covariance, 20)
        distances.append(np.linalg.norm(error.reshape(20, -1, 2), axis=2)[:, _inner(outline.vertices)])
    return float(np.median(distances))


def _inner(vertices: FloatArray) -> BoolArray:
    """Return which vertices (N,) are not the left or the right end, whose x follows from the touched strips."""
    x = vertices[:, 0]
    return np.asarray((x > x.min()) & (x < x.max()))


def _shape(seed: int) -> FloatArray:
    """Return the shape (5, 2) [mm], turned and moved a little."""
    random = np.random.default_rng(seed)
    turn = np.deg2rad(random.uniform(-5.0, 5.0))
    cos, sin = np.cos(turn), np.sin(turn)
    middle = _SHAPE.mean(axis=0)
    return np.asarray(
        (_SHAPE - middle) @ np.array([[cos, sin], [-sin, cos]]) + middle + random.uniform(-5, 5, 2)
    )


def bounded_figure() -> Figure:
    """Draw the outlines that a bound of the noise leaves, against the region of least squares, vertex by vertex."""
    figure = new_figure(7.0, 7.6)
    noise = Noise(positional=0.005)
    scan = _scan(noise, seed=4)
    found, fit = _first(scan, noise), _first(scan, noise, False)
    bounded = found.guarantee
    assert isinstance(bounded, Bounded)
    assert fit.covariance is not None
    outlines = _outlines(bounded)
    truth = Outline.of(_SHAPE).vertices
    for i, vertex in enumerate(truth):
        axes = add_axes(figure, 3, 2, i + 1)
        normal = ellipse(fit.vertices[i], fit.covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2])
        axes.plot(*np.concatenate([normal, normal[:1]]).T, color=_GAUSS, label="least squares, 95 %")
        axes.plot(*fit.vertices[i], "x", color=_GAUSS)
        axes.plot(*outlines[:, i].T, ".", color=_BOUNDED, markersize=2.0, alpha=0.5, label="within the bound")
        own = regions(found.vertices, found.covariance)[i]
        axes.plot(*np.concatenate([own, own[:1]]).T, color=RECOVERED, label="95 % of these")
        axes.plot(*found.vertices[i], "x", color=RECOVERED, label="their mean: the estimate")
        region = (found.guaranteed or [])[i]
        ring = shapely.get_coordinates(shapely.Polygon(region))
        axes.plot(*ring.T, color="black", linestyle="--", linewidth=0.9, label="guaranteed region")
        axes.plot(*vertex, "*", color="black", markersize=9.0, label="truth")
        axes.locator_params(nbins=5)
        axes.set_xlabel("x [mm]")
        axes.set_ylabel("y [mm]")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc=(0.6, 0.08), frameon=False)
    return figure


def _outlines(bounded: Bounded) -> FloatArray:
    """Return vertices (K, V, 2) [mm] of outlines in the set."""
    lower, upper = bounded.outline.indices
    ends = np.tile(bounded.outline.lower[[0, -1], 0], (len(bounded.points), 1))
    vertices = np.empty((len(bounded.points), *bounded.outline.vertices.shape))
    vertices[:, lower], vertices[:, upper] = bounded.lines.chains(bounded.points, ends)
    return vertices


def _scan(noise: Noise, seed: int) -> Scan:
    return simulate(_SENSOR, Contact.polygon(_SHAPE), noise, rng=seed)


def _first(scan: Scan, noise: Noise, bounded: bool = True) -> RecoveredObject:
    return fit_polygon(scan, _SENSOR, noise, bounded=bounded).objects[0]


FIGURES: dict[str, Callable[[], Figure]] = {
    "estimation_fit": fit_figure,
    "estimation_noise": noise_figure,
    "estimation_bounded": bounded_figure,
}
