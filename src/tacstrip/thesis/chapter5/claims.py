"""The conclusions of section 5.6 as claims that our own tables can refute."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import gt, lt
from typing import Any

import numpy as np

from tacstrip.arrays import FloatArray
from tacstrip.data.published import METRICS, Row, rows
from tacstrip.reconstruction.vertex.estimate import vertex_reconstruction
from tacstrip.scan import Scan
from tacstrip.simulation import simulate
from tacstrip.thesis.chapter5.ambiguity import AMBIGUOUS, ambiguity_facts
from tacstrip.thesis.chapter5.tables import WITHIN
from tacstrip.thesis.claims import Claim, checked, counted, passing
from tacstrip.thesis.shapes import POSITIONS, SHAPES, SIMULATED

Tables = list[dict[str, Any]]  # `ours` of each row, in the order of rows()
_STEP = 1e-6  # of Vref, for derivatives


def judge_claims(ours: Tables) -> list[Claim]:
    """Judge every claim on the rows' results."""
    medians = {_key(row): row_ours for row, row_ours in zip(rows(), ours, strict=True)}
    return [
        _ideal(ours),
        _better(medians, "profile", "kh", "P.R. beats V.R. with k_h"),
        _better(medians, "profile", "kl", "P.R. beats V.R. with k_l"),
        _better(medians, "profile", "k", "P.R. beats V.R. with k"),
        _better(medians, "kl", "kh", "V.R. with k_l beats V.R. with k_h"),
        _better(medians, "k", "kh", "V.R. with k beats V.R. with k_h"),
        _alike(medians),
        _regions(medians, 0, "the lower region suffers, with k_h"),
        _regions(medians, POSITIONS - 1, "the upper region suffers, with k_h"),
        *_reasons(),
        _concave_profile(medians),
        _ambiguous(),
        *_polygon_fit(ours),
    ]


@cache
def amplification(signature: str, shape: str, position: int) -> FloatArray:
    """Return, per vertex left to right, how far its y moves for an error of its own reading [L per Vref].

    The derivative of Vertex Reconstruction at the ideal readings: the norm, over all vertices' readings, of
    dy_i / dk_j. Independent errors of standard deviation s Vref move vertex i by s times this times L.
    """
    construction = "crs-m" if signature == "k" else "crs-crs"
    sensor, contact = SIMULATED[construction], SHAPES[shape].contact(position)
    k, x = simulate(sensor, contact)[signature], SHAPES[shape].transitions(position)

    def solve(readings: FloatArray) -> FloatArray:
        scan = Scan(time_s=0.0, **{signature: readings})
        result = vertex_reconstruction(scan, sensor, signature=signature, transitions=x, reading="strip")
        found = result.objects[0].vertices
        return np.asarray(found[np.argsort(found[:, 0]), 1])

    columns = []
    for strip in np.rint(x / sensor.pitch_mm - 0.5).astype(int):
        up, down = k.copy(), k.copy()
        up[strip] += _STEP
        down[strip] -= _STEP
        columns.append((solve(up) - solve(down)) / (2.0 * _STEP * sensor.length_mm))
    return np.asarray(np.linalg.norm(np.array(columns), axis=0))


def _key(row: Row) -> tuple[str, str, str]:
    return row.signature or "profile", row.shape, row.noise


def _ideal(ours: Tables) -> Claim:
    ideal = [o for row, o in zip(rows(), ours, strict=True) if row.noise == "ideal"]
    worst = max(v for o in ideal for m in METRICS for v in o[m]["median"])
    evidence = f"largest mismatch of any ideal cell: {worst:.1e}"
    return checked("ideal readings give the shape back exactly", worst <= 1e-9, evidence)


def _compare(
    medians: dict[Any, Any], a: str, b: str, test: Callable[[float, float], bool]
) -> tuple[int, int]:
    """Count the noisy cells of M.C. and A.P.E. in which a test holds of the medians of a and of b."""
    shapes = [
        (s, n) for signature, s, n in medians if signature == a and n != "ideal" and (b, s, n) in medians
    ]
    values = [[medians[(k, *shape)][m]["median"] for k in (a, b)] for shape in shapes for m in ("mc", "ape")]
    return passing((pair for both in values for pair in zip(*both, strict=True)), test)


def _better(medians: dict[Any, Any], a: str, b: str, claim: str) -> Claim:
    good, total = _compare(medians, a, b, lt)
    evidence = f"smaller median in {good} of {total} noisy cells (M.C. and A.P.E.)"
    return counted(claim, good, total, evidence)


def _alike(medians: dict[Any, Any]) -> Claim:
    good, total = _compare(medians, "k", "kl", lambda one, other: 0.5 <= one / other <= 2.0)
    evidence = f"medians within a factor of 2 in {good} of {total} noisy cells"
    return counted("V.R. with k_l and with k give similar errors", good, total, evidence)


def _regions(medians: dict[Any, Any], position: int, claim: str) -> Claim:
    noisy = [
        ours for (signature, _, noise), ours in medians.items() if signature == "kh" and noise != "ideal"
    ]
    values = (ours[metric]["median"] for ours in noisy for metric in ("mc", "ape"))
    good, total = passing(((v[position], v[POSITIONS // 2]) for v in values), gt)
    evidence = f"position {position + 1} worse than 3 in {good} of {total} medians"
    return counted(claim, good, total, evidence)


def _reasons() -> list[Claim]:
    """Test the thesis' two reasons against the derivative of Vertex Reconstruction."""
    shapes = ("triangle", "tetragon", "hexagon")
    typical = {
        s: [float(np.median([amplification(s, f, p).max() for f in shapes])) for p in range(POSITIONS)]
        for s in ("kh", "kl", "k")
    }
    listed = "; ".join(f"{s}: " + ", ".join(f"{v:.1f}" for v in typical[s]) for s in typical)
    numbers = f"worst vertex's y moves by so many L per Vref of reading error, positions 1-5, {listed}"
    return [
        checked(
            "the lower region suffers because the same error is larger relative to a small k_h",
            typical["kh"][0] > 1.5 * typical["kh"][2],
            f"{numbers}. Relative size does not enter the equations: what counts is how the kink fades, and with "
            "k_h it fades for lower vertices near the top, with k_l for upper vertices near the ground",
        ),
        checked(
            "the upper region suffers because k_h hardly varies there",
            typical["kh"][-1] > 1.5 * typical["kh"][2],
            f"k_h: {typical['kh'][-1]:.1f} at position 5 against {typical['kh'][2]:.1f} at position 3: a lower "
            "vertex moves k_h by 2 (L - u) / D^2 only, so the signature is flat and an error moves the vertex far",
        ),
        checked(
            "k_l and k are better than k_h because constants in A and b carry no error",
            np.mean(typical["kl"]) < 0.9 * np.mean(typical["kh"]),
            f"mean over the positions: k_h {np.mean(typical['kh']):.1f}, k_l {np.mean(typical['kl']):.1f}, "
            f"k {np.mean(typical['k']):.1f}; the order depends on where the shape lies: k_l is worst where k_h is best",
        ),
    ]


def _concave_profile(medians: dict[Any, Any]) -> Claim:
    ours = medians["profile", "concave tetragon", "quantisation + profile II"]
    worst = max(ours["mc"]["median"])
    claim = "P.R. recovers a concave shape that meets every strip in one piece"
    return checked(claim, worst < 0.15, f"largest median M.C. under profile II: {worst:.3f} rad")


def _ambiguous() -> Claim:
    all_facts = [fact for figure in AMBIGUOUS for fact in ambiguity_facts(figure)]
    best = max(f["iou"] for f in all_facts)
    apart = sorted(100.0 * f["signature_difference"] for f in all_facts)
    evidence = (
        f"V.R. gives a convex shape in {len(all_facts)} of {len(AMBIGUOUS) * POSITIONS} ideal cells, overlapping the "
        f"true one with IoU {best:.2f} at best; their signatures differ by {apart[0]:.2f} to {apart[-1]:.2f} % of Vref"
    )
    claim = "V.R. must assume convexity: a concave shape comes back as another one"
    return checked(claim, best < 0.9, evidence)


def _polygon_fit(ours: Tables) -> list[Claim]:
    """Judge the polygon fit, which the thesis does not have, on the noisy cells."""
    fits = [(row, o["polygon"]) for row, o in zip(rows(), ours, strict=True) if o["polygon"]]
    known = [(row.printed["mc"], fit["failed"]) for row, fit in fits if np.isfinite(row.printed["mc"]).any()]
    failed = [share for mc, shares in known for share, v in zip(shares, mc, strict=True) if np.isnan(v)]
    worst, least = max(failed, default=0.0), "errs less than print, or as little as can be"
    return [
        _fit_reaches(f"beyond the thesis: the polygon fit {least}", [fit for _, fit in fits]),
        _fit_reaches(
            f"beyond the thesis: the polygon fit with the number of vertices known {least}",
            [fit["known_count"] for _, fit in fits],
        ),
        checked(
            "beyond the thesis: the polygon fit gives a shape where the thesis prints none",
            worst == 0.0,
            f"largest share without a shape in {len(failed)} such cells: {worst:.2f}",
            "5.4",
        ),
    ]


def _fit_reaches(claim: str, fits: list[dict[str, Any]]) -> Claim:
    judged = [v for fit in fits for m in METRICS for v in fit["reached"][m] if v is not None]
    below, at = (sum(v[i] for v in judged) for i in (0, 1))
    either = sum(any(v) for v in judged)
    evidence = (
        f"median below the printed value in {below}, within {WITHIN} of the Cramer-Rao bound's in {at}, either in "
        f"{either} of {len(judged)} noisy values"
    )
    return counted(claim, either, len(judged), evidence, "5.4")
