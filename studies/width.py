"""What the width of a strip does to l and u: how good the centre line is, the mean over the width, and the hull.

The thesis takes a strip to read the "average position" of a slanted edge (5.1.1). `python -m studies.width` prints how
far simulation, the closed form and plain networks are off the resolved strip.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from matplotlib.figure import Figure

from studies.budget import PROFILE_I, PROFILE_II
from tacstrip.arrays import FloatArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.shape import Contact
from tacstrip.contact.signature import signatures
from tacstrip.contact.slant import slant_shift
from tacstrip.contact.strip_width import wide_ends
from tacstrip.network.strips.resolved import mesh_limit, wide_readings
from tacstrip.plot.theme import COLOURS, DASHES, OTHERS, add_axes, legend, new_figure
from tacstrip.sensor.closed_form import lower_and_width
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

RULES = ("centre line", "mean over the width", "mean, slant counted", "hull")
_FINE = 200  # lines over the width for mean and hull


def edge_shift(slope: float, lambda_widths: float, across: int | None = None) -> float:
    """Return how far beyond its mean position a slanted edge reads, over the strip width, once lambda is undone.

    One strip 1 mm wide, whose contact is long enough for its ends not to know of each other.

    Parameters
    ----------
    slope
        dy/dx of the edge.
    lambda_widths
        Decay length of the contact resistance over the strip width; 0: ideal.
    across
        Cells over the width; see `wide_measurements`.
    """
    margin = 0.5 * abs(slope) + 5.0 + 20.0 * lambda_widths
    sensor = Sensor(
        construction="crs-crs",
        strips=1,
        pitch_mm=1.0,
        length_mm=4.0 * margin,
        contact_lambda_mm=lambda_widths,
    )
    low, high, half = margin, 3.0 * margin, 0.5 * slope
    edge = Contact.polygon([(0, low), (1, low), (1, high + half), (0, high - half)])
    read = wide_readings(sensor, edge, across=across)
    l, w = lower_and_width(read["kh"], read["kl"], sensor.length_mm, contact_lambda=lambda_widths)
    return float(l[0] + w[0] - high)


def steepest(limit_of_length: float, width_of_length: float) -> float:
    """Return up to which angle [deg] an edge reads within a part of L of its centre line, under ideal contact."""
    slopes = np.geomspace(1e-3, 1e3, 20_001)
    good = slant_shift(slopes) * width_of_length <= limit_of_length
    return float(np.rad2deg(np.arctan(slopes[good][-1])))


def rule_errors(
    sensor: Sensor,
    contacts: int,
    size_mm: float,
    across: int | None = None,
    seed: int = 0,
    part: bool = False,
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Compare footprints of random convex contacts with what strips of finite width read.

    Parameters
    ----------
    sensor
        A CRS-CRS spec; its strip width and lambda count.
    contacts
        How many.
    size_mm
        The contacts' corners are drawn in a circle of this diameter, wholly on the sensor.
    across, seed
        Cells over the width; of the random contacts.
    part
        Look at the strips that are touched over a part of their width, instead of the whole.

    Returns
    -------
    dict
        Rule to (errors of l and u (ends,) [mm], errors of k_h and k_l (ends,) [Vref]), NaN where the rule sees no
        contact. An end's error is how far the rule lies outside of what is read.
    """
    random = np.random.default_rng(seed)
    errors: dict[str, list[tuple[FloatArray, FloatArray]]] = {rule: [] for rule in RULES}
    for _ in range(contacts):
        contact = _convex(sensor, size_mm, random)
        read = wide_readings(sensor, contact, across=across)
        l, w = lower_and_width(
            read["kh"], read["kl"], sensor.length_mm, sensor.sensing_ratio, sensor.contact_lambda_mm
        )
        covered, by_rule = footprints(sensor, contact)
        these = np.flatnonzero((covered > 0.0) & ((covered < 1.0) == part))
        for rule, (low, high) in by_rule.items():
            modelled = signatures(sensor, low, high)
            ends = np.concatenate([(l - low)[these], (high - l - w)[these]])
            volts = np.concatenate([(modelled[name] - read[name])[these] for name in ("kh", "kl")])
            errors[rule].append((ends, volts))
    return {rule: tuple(np.concatenate(c) for c in zip(*e, strict=True)) for rule, e in errors.items()}  # type: ignore[misc]


def footprints(
    sensor: Sensor, contact: Contact
) -> tuple[FloatArray, dict[str, tuple[FloatArray, FloatArray]]]:
    """Return the touched part of each strip's width (strips,), and l and u (strips,) [mm] by each rule."""
    width = sensor.strip_width
    fine = replace(sensor, strips=_FINE, pitch_mm=width / _FINE, strip_width_mm=None)
    ends = {rule: np.full((2, sensor.strips), np.nan) for rule in RULES}
    ends["centre line"] = np.stack(list(footprint(sensor, contact)))
    covered = np.zeros(sensor.strips)
    x0, x1 = (f(s.bounds[i] for s in contact.shapes) for f, i in ((min, 0), (max, 2)))
    for strip in np.flatnonzero((sensor.x_mm > x0 - 0.5 * width) & (sensor.x_mm < x1 + 0.5 * width)):
        over = np.stack(list(footprint(fine, contact.moved(0.5 * width - float(sensor.x_mm[strip]), 0.0))))
        over = over[:, ~np.isnan(over[0])]  # (2, lines in touch)
        if over.size:
            covered[strip] = over.shape[1] / _FINE
            mean = over.mean(axis=1)
            shift = width * slant_shift((over[:, -1] - over[:, 0]) / width)
            ends["mean over the width"][:, strip] = mean
            ends["mean, slant counted"][:, strip] = mean + shift * (-1.0, 1.0)
            ends["hull"][:, strip] = over[0].min(), over[1].max()
    return covered, {rule: (low, high) for rule, (low, high) in ends.items()}


SENSORS = {
    "crs-crs": ("crs-crs", 1.0),
    "crs-crs, ratio .2": ("crs-crs", 0.2),
    "crs-m": ("crs-m", 0.0),
    "cyl-crs-m": ("cyl-crs-m", 0.0),
}
_STRIPS, _LENGTH = 12, 100.0


def agreement(
    name: str, lambda_widths: float, width_of_length: float, kind: str, seed: int
) -> dict[str, FloatArray]:
    """Return errors of readings [Vref] on strips without gaps, by what is off the resolved strip.

    "simulate" and "closed form" (which streams take) against `wide_readings`, which networks of 64 cells
    and fewer, extrapolated, check as "resolved strip"; "32 cells" are plain networks.
    """
    construction, ratio = SENSORS[name]
    width = width_of_length * _LENGTH
    keys: dict[str, float] = {"resistivity_ratio": ratio} if construction == "crs-crs" else {}
    if construction == "cyl-crs-m":
        keys["radius_mm"] = _STRIPS * width
    sensor = Sensor(
        construction=construction, strips=_STRIPS, pitch_mm=width, length_mm=_LENGTH, strip_width_mm=width,
        contact_lambda_mm=lambda_widths * width, **keys,  # type: ignore[arg-type]
    )  # fmt: skip
    contact = _contact(sensor, kind, np.random.default_rng(seed))
    read, ends, made = wide_readings(sensor, contact), wide_ends(sensor, [contact]), simulate(sensor, contact)
    closed = signatures(sensor, ends.l[0], ends.u[0])
    coarse, middle, fine = (wide_readings(sensor, contact, across=n) for n in (16, 32, 64))
    errors: dict[str, list[FloatArray]] = {}
    for signature, k in read.items():
        on = np.isfinite(k)
        known = mesh_limit(coarse[signature], middle[signature], fine[signature])
        for what, off in (
            ("simulate", made[signature] - k),
            ("closed form, straight edges", np.where(ends.exact[0], closed[signature] - k, np.nan)),
            ("closed form, others", np.where(ends.exact[0], np.nan, closed[signature] - k)),
            ("32 cells", middle[signature] - k),
            ("resolved strip", known - k),
        ):
            errors.setdefault(what, []).append(np.abs(off)[on & np.isfinite(off)])
    return {what: np.concatenate(off) for what, off in errors.items()}


def _contact(sensor: Sensor, kind: str, random: np.random.Generator) -> Contact:
    """Draw a slanted band, the hull of eight points, or a pointed triangle."""
    wide, long = sensor.width_mm, sensor.length_mm
    if kind == "convex":
        hull = shapely.MultiPoint(random.uniform(0.05, 0.95, (8, 2)) * (wide, long)).convex_hull
        return Contact.polygon(shapely.get_coordinates(hull)[:-1])
    if kind == "slanted":
        (x0, x1), rise = wide * random.uniform((0.05, 0.7), (0.3, 0.95)), 0.3 * random.uniform(-1.0, 1.0, 2)
        (a, b), (c, d) = (
            long * (0.35 + rise[0] * (x - 0.5 * wide) / wide) for x in (x0, x1)
        ), (long * (0.7 + rise[1] * (x - 0.5 * wide) / wide) for x in (x0, x1))  # fmt: skip
        return Contact.polygon([(x0, a), (x1, b), (x1, d), (x0, c)])
    angle = random.uniform(0.0, 2.0 * np.pi)
    tip = 0.4 * np.array([np.cos(angle), np.sin(angle)]) * (wide, long)
    base = random.uniform(0.1, 0.3) * np.array([-np.sin(angle), np.cos(angle)]) * (wide, long)
    return Contact.polygon(
        0.5 * np.array([wide, long]) + np.stack([tip, base - 0.8 * tip, -base - 0.8 * tip])
    )


def main() -> None:
    """Print the largest and the median error of each cell [1e-6 Vref]; constructions and lambdas may be named."""
    asked = sys.argv[1:]
    for name in asked[:1] or SENSORS:
        for lam in map(float, asked[1:] or ("0", "0.3", "1")):
            for width in (0.01, 0.05):
                for kind in ("slanted", "convex", "pointed"):
                    each = [agreement(name, lam, width, kind, seed) for seed in range(2)]
                    cells = []
                    for what in each[0]:
                        off = 1e6 * np.concatenate([errors[what] for errors in each])
                        cells.append(
                            f"{what} {off.max(initial=0.0):.0f} / {np.median(off) if off.size else 0:.0f}"
                        )
                    where = f"{name}, lambda {lam:g} b, b {100 * width:g} % of L, {kind}"
                    sys.stdout.write(f"{where}: {'; '.join(cells)}\n")


def _convex(sensor: Sensor, size_mm: float, random: np.random.Generator) -> Contact:
    """Draw the hull of six points in a circle."""
    radius = 0.5 * size_mm
    angle, out = random.uniform(0.0, 2.0 * np.pi, 6), radius * np.sqrt(random.uniform(0.0, 1.0, 6))
    x, y = (random.uniform(radius, side - radius) for side in (sensor.width_mm, sensor.length_mm))
    hull = shapely.MultiPoint(
        np.stack([x + out * np.cos(angle), y + out * np.sin(angle)], axis=1)
    ).convex_hull
    return Contact.polygon(shapely.get_coordinates(hull)[:-1])


def width_figure() -> Figure:
    """Draw what a slanted edge reads, and from which slope on the centre line is not good enough."""
    figure = new_figure(7.0, 7.4)
    left, right = add_axes(figure, 2, 1, 1), add_axes(figure, 2, 1, 2)
    angle = np.linspace(0.0, 75.0, 151)
    slope = np.tan(np.deg2rad(angle))
    left.plot(angle, 0.5 * slope, color="#999999", linestyle=":", label="hull")
    left.plot(angle, slant_shift(slope), color="black", label="ideal contact: closed form")
    at = np.arange(5.0, 75.1, 5.0)
    looks = zip((0.0, 0.1, 0.5, 2.0), ("black", COLOURS["kh"], *OTHERS[:2]), "oos^", strict=True)
    for lam, colour, marker in looks:
        shifts = [edge_shift(s, lam, 40) for s in np.tan(np.deg2rad(at))]
        label = f"lambda = {lam:g} b" if lam else "the same, resolved across the width"
        left.plot(at, shifts, marker + "-" * (lam > 0.0), color=colour, markersize=4.0, label=label)
    left.axhline(0.0, color="#999999", linestyle="--", label="centre line = mean")
    left.set_ylim(-0.05, 1.2)
    left.set_xlabel("angle of the edge [deg]")
    left.set_ylabel("read beyond the edge's middle, over b")
    legend(left, loc="upper left")
    widths = np.geomspace(1e-3, 0.2, 60)
    limits = (
        (PROFILE_II, "1 % of L (P.U. profile II)"),
        (PROFILE_I, "0.5 % (profile I)"),
        (0.0005, "0.05 % (C.Q.E.)"),
    )
    for (limit, label), name in zip(limits, ("kl", "kh", "k"), strict=True):
        look = {"color": COLOURS[name], "linestyle": DASHES[name], "label": label}
        right.semilogx(100.0 * widths, [steepest(limit, b) for b in widths], **look)
    right.axvline(100.0 * 3.0 / 325.0, color="#999999", linestyle=":", label="the CRS-CRS prototype")
    right.set_xlabel("strip width b [% of L]")
    right.set_ylabel("steepest edge [deg]")
    right.set_title("the centre line is good enough below, ideal contact", fontsize=9.0)
    legend(right, loc="lower left")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {"width": width_figure}

if __name__ == "__main__":
    main()
