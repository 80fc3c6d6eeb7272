"""How well the inversion of CRS-CRP does: tables of docs/science/physics.md.

Run: python benchmarks/crp_accuracy.py [neighbours | polygons | constants | sheet ...]
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from _tables import head, print_asked, row
from crp_bounds import LENGTH, SCHEMES, span, wide
from shapely import MultiPoint, Polygon

import tacstrip as ts
from studies import crp_spans
from studies.crp import SHAPES, SIGMA, a_sensor, end_bounds
from studies.crp_sheet import fine_sheet, spans, wide_ends
from tacstrip.arrays import FloatArray
from tacstrip.network.crp import inversion as crp
from tacstrip.network.crp.cramer_rao import Electrodes
from tacstrip.network.crp.mesh import SheetMesh

POLYGONS, TAKES = 40, 2  # random contacts, and noisy scans of each


def invert(
    sensor: ts.Sensor,
    readings: FloatArray,
    electrodes: Electrodes,
    convex: bool = False,
    rows: int | None = None,
) -> crp.InversionResult:
    """Invert readings of all electrodes (strips, 2 strips) by either scheme."""
    if electrodes == "all":
        return crp.invert_all(sensor, readings, SIGMA, convex, rows)
    each = np.arange(sensor.strips)
    kh, kl = readings[each, sensor.strips + each], readings[each, each]
    return crp.invert(sensor, kh, kl, SIGMA, convex, rows)


def off(found: crp.InversionResult, l: FloatArray, u: FloatArray) -> FloatArray:
    """Return the error of both ends of the strips with w >= 5 % of L (2, those strips) [% of L]."""
    return np.asarray(100.0 * np.abs(np.stack([found.l - l, found.u - u]))[:, wide(l, u)] / LENGTH)


def only(strip: int, strips: int) -> FloatArray:
    """Return 0 on one strip and NaN on all others."""
    return np.where(np.arange(strips) == strip, 0.0, np.nan)


def random_spans() -> Iterator[tuple[FloatArray, FloatArray]]:
    """Draw convex polygons of 3 to 8 points over 10 strips or more with w >= 5 % of L."""
    sensor, random = a_sensor(), np.random.default_rng(1)
    count = POLYGONS
    while count:
        points = random.uniform(0.03, 0.97, (random.integers(3, 9), 2)) * (sensor.width_mm, sensor.length_mm)
        hull = MultiPoint(points).convex_hull
        assert isinstance(hull, Polygon)
        l, u = ts.footprint(sensor, ts.Contact.polygon(list(hull.exterior.coords)[:-1]))
        if wide(l, u).sum() >= 10:
            count -= 1
            yield l, u


def neighbours_table() -> None:
    """Show what the other strips' contacts shift, and what an inversion costs that ignores them."""
    sensor = a_sensor()
    head(
        "contact",
        "largest shift of k_h [Vref]",
        "strip by strip: median [% of L]",
        "worst",
        "together: worst [L]",
    )
    for shape in SHAPES:
        l, u = span(sensor, shape)
        readings = crp_spans.all_electrodes(sensor, l, u)
        shift, error = [], []
        for i in np.flatnonzero(np.isfinite(l)):
            one = only(int(i), sensor.strips)
            lone = crp_spans.own_electrodes(sensor, l + one, u + one)[0][i]
            shift.append(abs(lone - readings[i, sensor.strips + i]))
            found = invert(sensor, readings + one[:, None], "own")
            error.append(max(abs(found.l[i] - l[i]), abs(found.u[i] - u[i])) / LENGTH * 100.0)
        together = off(invert(sensor, readings, "own"), l, u).max() / 100.0
        row(shape, f"{max(shift):.3f}", f"{np.median(error):.1f}", f"{max(error):.1f}", f"{together:.1e}")


@dataclass(frozen=True, eq=False)
class Trials:
    """What inversions of random contacts gave, of one scheme.

    Attributes
    ----------
    clean, finer
        Worst end of each contact, without noise, from readings of the same mesh and of one twice as fine [% of L].
    bound
        Of each contact's ends (2, strips) [% of L].
    error
        Of each contact's ends, convexity not used and used (2, takes, 2, strips) [% of L].
    networks
        Factored for each clean inversion.
    lost, seconds
        Noisy inversions that did not converge, and the time of each.
    """

    clean: list[float] = field(default_factory=list)
    finer: list[float] = field(default_factory=list)
    bound: list[FloatArray] = field(default_factory=list)
    error: list[FloatArray] = field(default_factory=list)
    networks: list[int] = field(default_factory=list)
    lost: list[bool] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def errors(self, convex: bool) -> FloatArray:
        """Return the errors of all ends and takes [% of L]."""
        return np.concatenate([error[int(convex)].ravel() for error in self.error])

    def within(self, convex: bool, limit: float = 0.05) -> float:
        """Return the share of contacts whose median error keeps to a limit [%]."""
        return 100.0 * float(np.mean([np.median(error[int(convex)]) <= limit for error in self.error]))

    def over_bound(self) -> float:
        """Return the root mean square of errors over their bounds."""
        over = [(error[0] / bound).ravel() for error, bound in zip(self.error, self.bound, strict=True)]
        return float(np.sqrt(np.mean(np.concatenate(over) ** 2)))


def try_out(electrodes: Electrodes) -> Trials:
    """Invert readings of the random contacts."""
    sensor, random, trials = a_sensor(), np.random.default_rng(2), Trials()
    rows = SheetMesh.of(sensor).rows
    for l, u in random_spans():
        on = wide(l, u)
        readings = crp_spans.all_electrodes(sensor, l, u, rows)
        found = invert(sensor, readings, electrodes)
        trials.networks.append(found.iterations)
        trials.clean.append(float(off(found, l, u).max()))
        fine = invert(sensor, crp_spans.all_electrodes(sensor, l, u, 2 * rows), electrodes)
        trials.finer.append(float(off(fine, l, u).max()))
        trials.bound.append(end_bounds(sensor, l, u, electrodes)[:, on])
        error = np.empty((2, TAKES, 2, on.sum()))
        for take in range(TAKES):
            noisy = readings + SIGMA * random.normal(size=readings.shape)
            for convex in (False, True):
                start = time.perf_counter()
                found = invert(sensor, noisy, electrodes, convex)
                trials.seconds.append(time.perf_counter() - start)
                trials.lost.append("not converged" in found.status)
                error[int(convex), take] = off(found, l, u)
        trials.error.append(error)
    return trials


def polygons_table() -> None:
    """Invert random convex polygons over 10 strips or more: clean, from a finer mesh, and with noise."""
    both = [try_out(e) for e in SCHEMES]
    head(f"{POLYGONS} random convex polygons", *(f"{e} electrodes" for e in SCHEMES))
    row("same mesh, no noise: worst end [L]", *(f"{max(t.clean) / 100.0:.1e}" for t in both))
    row("readings of a mesh twice as fine: worst end [% of L]", *(f"{max(t.finer):.3f}" for t in both))
    row("0.1 % noise: median error [% of L]", *(f"{np.median(t.errors(False)):.3f}" for t in both))
    spread = [(np.percentile(t.errors(False), 95), t.errors(False).max()) for t in both]
    row("- 95th percentile / worst", *(f"{p:.2f} / {most:.2f}" for p, most in spread))
    tight = [(np.median(t.errors(True)), np.percentile(t.errors(True), 95)) for t in both]
    row("- `convex=True`: median / 95th percentile", *(f"{m:.3f} / {p:.2f}" for m, p in tight))
    row("Cramer-Rao bound, median", *(f"{np.median(np.concatenate(t.bound, axis=1)):.3f}" for t in both))
    row("root mean square error over the bound", *(f"{t.over_bound():.2f}" for t in both))
    for convex in (False, True):
        what = "contacts with a median error of at most .05 % of L" + (", `convex=True`" if convex else "")
        row(what, *(f"{t.within(convex):.0f} %" for t in both))
    networks, seconds = (np.concatenate([getattr(t, name) for t in both]) for name in ("networks", "seconds"))
    lost = sum(sum(t.lost) for t in both)
    print(
        f"\nNetworks, clean: {np.median(networks):.0f} in the median, {networks.max():.0f} at most. "
        f"Not converged: {lost} of {len(seconds)} noisy ones; {np.median(seconds):.3f} s each in the median."
    )


def direction(out: FloatArray) -> str:
    """Put a median shift in words."""
    size = float(np.median(np.abs(out)))
    if abs(np.median(out)) < 0.9 * size:
        return f"{size:.2g} either way"
    return f"{size:.2g} " + ("out" if np.median(out) > 0.0 else "in")


def constants_table() -> None:
    """Show how far ends move outwards when the spec's lambda or ratio is wrong, and what all electrodes leave over."""
    head("", *(f"{shape}, {e}" for shape in SHAPES for e in SCHEMES), "residual, all [sigma]")
    wrongs = [("lambda", "contact_lambda_mm", f) for f in (1.05, 1.1, 0.9, 2.0, 0.5)]
    wrongs += [("ratio", "resistivity_ratio", f) for f in (1.1, 0.9, 2.0, 0.5)]
    true = a_sensor()
    for name, key, factor in wrongs:
        sensor, cells, over = a_sensor(**{key: factor * getattr(true, key)}), [], []
        for shape in SHAPES:
            l, u = span(true, shape)
            rows = SheetMesh.of(true).rows
            readings = crp_spans.all_electrodes(true, l, u, rows)
            for e in SCHEMES:
                found = invert(sensor, readings, e, rows=rows)
                out = 100.0 * np.stack([l - found.l, found.u - u])[:, wide(l, u)] / LENGTH
                cells.append(direction(out))
                over += [found.residual_rms] if e == "all" else []
        row(f"{name} x {factor:g}", *cells, f"{min(over):.2f} to {max(over):.2f}")


def sheet_table() -> None:
    """Compare with a sheet of nine columns a pitch and 400 rows, clean and at 0.1 % noise, by lambda."""
    random = np.random.default_rng(0)
    head(
        "lambda [mm], electrodes",
        "clean: median [% of L]",
        "95 %",
        "0.1 %: median",
        "said",
        "RMS / said",
        "within 1.96 said",
    )
    for lam in (5.0, 2.0, 1.0, 0.5):
        sensor = a_sensor(contact_lambda_mm=lam)
        clean: dict[str, list[float]] = {scheme: [] for scheme in SCHEMES}
        noisy: dict[str, list[float]] = {scheme: [] for scheme in SCHEMES}
        said: dict[str, list[float]] = {scheme: [] for scheme in SCHEMES}
        for l, u in spans(sensor, 10, seed=11):
            k, ends = fine_sheet(lam, l, u, 400), wide_ends(l, u)
            noise = SIGMA * random.normal(size=k.shape)
            for scheme in SCHEMES:
                for readings, errors in ((k, clean), (k + noise, noisy)):
                    found = invert(sensor, readings, scheme)
                    errors[scheme] += (np.r_[found.l - l, found.u - u][ends] / LENGTH * 100.0).tolist()
                said[scheme] += (np.sqrt(np.diag(found.covariance))[ends] / LENGTH * 100.0).tolist()
        for scheme in SCHEMES:
            exact, error, stated = np.abs(clean[scheme]), np.array(noisy[scheme]), np.array(said[scheme])
            over = np.abs(error) / stated
            row(
                f"{lam:g}, {scheme}", f"{np.median(exact):.3f}", f"{np.percentile(exact, 95):.3f}",
                f"{np.median(np.abs(error)):.3f}", f"{np.median(stated):.3f}", f"{np.sqrt(np.mean(over**2)):.2f}",
                f"{np.mean(over < 1.96):.3f}",
            )  # fmt: skip


if __name__ == "__main__":
    print_asked(
        {
            "neighbours": neighbours_table,
            "polygons": polygons_table,
            "constants": constants_table,
            "sheet": sheet_table,
        }
    )
