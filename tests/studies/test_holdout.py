"""The hold-out sets: physics against a ladder, shapes, noise, and that each set is scored; not what they find."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import bmat, diags
from scipy.sparse.linalg import spsolve

from studies.holdout import cases, concave, score, shapes, tracks_bound, tracks_set
from studies.holdout.convexity import best_convex
from studies.holdout.material import Press
from studies.holdout.readings import Unit
from studies.holdout.shapes import CONCAVE, CONVEX, Array

UNIT = Unit(("kh", "kl"), 40, 2.5, 100.0)


@pytest.mark.parametrize(("names", "ratio"), [(("kh", "kl"), 1.7), (("k",), 1e-6)])
@pytest.mark.parametrize(("low", "high"), [(20.0, 50.0), (70.0, 74.0)])
def test_closed_forms_agree_with_a_ladder(
    names: tuple[str, ...], ratio: float, low: float, high: float
) -> None:
    unit = Unit(names, 1, 1.0, 100.0, contact_lambda=2.0, ratio=ratio)
    read = unit.read(np.array([low]), np.array([high]))[:, 0]
    bottom, top = ladder(low, high, unit)
    assert read == pytest.approx([top, bottom] if len(names) == 2 else [bottom], abs=1e-5)


def ladder(low: float, high: float, unit: Unit, step: float = 0.02) -> tuple[float, float]:
    """Return the second layer's voltages at a contact's ends: two chains, one from 0 to Vref, joined in between."""
    n, first, last = (round(y / step) for y in (unit.length, low, high))
    joint = np.zeros(n + 1)
    joint[first : last + 1] = step / ((1.0 + unit.ratio) * unit.contact_lambda**2)
    joint[[first, last]] *= 0.5
    inner = np.r_[0.0, np.ones(n - 1), 0.0]  # the energised strip's ends are held
    chain = diags([-np.ones(n), np.r_[1.0, np.full(n - 1, 2.0), 1.0], -np.ones(n)], [-1, 0, 1]) / step
    upper = [diags(inner) @ (chain + diags(joint)) + diags(1.0 - inner), -diags(inner * joint)]
    given = np.zeros(2 * n + 2)
    given[n] = 1.0
    voltage = spsolve(bmat([upper, [-diags(joint), chain / unit.ratio + diags(joint)]]).tocsr(), given)[
        n + 1 :
    ]
    return float(voltage[first]), float(voltage[last])


@pytest.mark.parametrize("category", [*CONVEX, *CONCAVE, *concave.FAMILIES])
def test_outlines_are_what_they_are_called(category: str) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        case = cases.single(random, category, 15, ("kh", "kl"), 0.002)
        outline, on = shapely.Polygon(case.outlines[0]), np.isfinite(case.low)
        assert shapes.is_convex(case.outlines[0]) == (category in CONVEX)
        beyond = outline.difference(
            shapely.box(0.0, 0.0, case.unit.strips * case.unit.pitch, case.unit.length)
        ).area
        assert (beyond > 1e-6 * outline.area) == category.startswith("over")
        for x, low, high in zip(case.unit.x[on], case.low[on], case.high[on], strict=True):
            chord = outline.intersection(shapely.LineString([(x, 0.0), (x, case.unit.length)])).bounds
            assert (chord[1], chord[3]) == pytest.approx((low, high), abs=1e-6)


def test_a_weak_corner_shows_by_what_was_asked_for() -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        case = cases.single(random, "weak corner", 30, ("k",), 0.001)
        assert 0.5 <= case.weakest <= 8.0
        assert cases.weakest_corner(case.unit, case.outlines[0], 0.001) <= 1.05 * case.weakest


def test_convex_shapes_are_never_told_from_convex_ones_and_two_apart_are() -> None:
    random = np.random.default_rng(3)
    for number in range(8):
        case = cases.regions(random, (12, 31))
        chi_square, p, *_ = best_convex(*_readings(case))
        assert p > 0.01
        noise = (case.read - case.unit.read(case.low, case.high)) / case.unit.sigma(case.half_width)
        assert chi_square <= np.nansum(noise**2) + 1e-3, number  # of the truth, which is one of them
    left, right = box(20.0, 60.0, 60.0, 80.0), box(40.0, 10.0, 80.0, 30.0)
    low, high = UNIT.touched([left, right])
    assert best_convex(UNIT, UNIT.read(low, high), 0.003, low, high).p < 1e-6


def _readings(case: cases.Case) -> tuple[Unit, Array, float, Array, Array]:
    return case.unit, case.read, case.unit.sigma(case.half_width), case.low, case.high


def box(left: float, bottom: float, right: float, top: float) -> Array:
    return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])


def test_means_of_wandering_noise_have_a_floor_and_edges_err_alike() -> None:
    low, high = UNIT.touched([box(10.0, 30.0, 90.0, 60.0)])
    on = np.isfinite(low)
    random, ideal = np.random.default_rng(4), UNIT.read(low, high)[:, on]
    off = {
        kind: np.array([
            Press(UNIT, kind, 0.004).scans(low, high, 64, random)[:, :, on] - ideal for _ in range(40)
        ])
        for kind in ("white", "wander", "edges")
    }  # fmt: skip
    one, mean = (
        {k: np.std(v) / 0.004 for k, v in some.items()}
        for some in (off, {k: v.mean(axis=1) for k, v in off.items()})
    )
    assert one["white"] == pytest.approx(1.0, abs=0.02)
    assert mean["white"] == pytest.approx(1.0 / 8.0, abs=0.01)
    assert one["wander"] == pytest.approx(1.08, abs=0.03)
    assert 0.25 < mean["wander"] < 0.45
    still = off["edges"].mean(axis=1)
    assert np.mean(still[..., 1:] * still[..., :-1]) / np.mean(still**2) == pytest.approx(0.4, abs=0.1)


def test_moments_of_a_turned_rectangle() -> None:
    outline = shapes.turned(box(-3.0, -1.0, 3.0, 1.0), 0.5) + np.array([7.0, 2.0])
    area, centroid, angle, ratio = score.moments(outline)
    assert (area, *centroid, angle % np.pi, ratio) == pytest.approx((12.0, 7.0, 2.0, 0.5, 3.0))


@pytest.mark.parametrize("which", [which for which in cases.SETS if which != "wide"])  # a second a case
def test_each_set_is_scored(which: str) -> None:
    lines = score.table(which, 4)
    assert lines[-1] == "0 errors"
    assert len(lines) > 4
    assert lines == score.table(which, 4)


def test_wide_strips_read_nearly_as_their_centre_lines() -> None:
    case = cases.wide(cases.rng("wide", 0, 1))
    assert case.unit.sensor.strip_width_mm == pytest.approx(0.9 * case.unit.pitch)
    off = (case.read - case.unit.read(case.low, case.high))[:, np.isfinite(case.low)]
    assert np.median(np.abs(off)) < case.half_width + 0.002
    (row,) = score.attempt("wide", 0, "none", 1)
    assert (row["names"], row["group"]) == ("k", case.group)


def test_unusual_outlines_are_filled_along_the_strips() -> None:
    random = np.random.default_rng(5)
    for category in shapes.UNUSUAL:
        case = cases.single(random, category, 15, ("kh", "kl"), 0.002)
        whole, outline = cases.filled(case.unit, case.outlines[0]), shapely.Polygon(case.outlines[0])
        assert outline.difference(shapely.Polygon(whole).buffer(0.0)).area < 0.03 * outline.area
        low, high = case.unit.touched([whole])
        on = np.isfinite(low)
        assert np.median(np.abs([low - case.low, high - case.high])[:, on]) < 0.002 * case.unit.length


def test_what_the_estimator_raises_is_counted_and_final_seeds_are_locked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr(score, "fit", broken)
    assert score.table("convex", 2)[-3:] == ["2 errors", *(f"case {i}: RuntimeError: broken" for i in (0, 1))]
    with pytest.raises(SystemExit):
        score.main(["--seed", "1000"])
    assert "--final" in capsys.readouterr().err


def test_a_rigid_track_is_judged_by_the_truth() -> None:
    of = tracks_set.scene("ten", 0, 2)
    assert of.outline is not None
    verdict = tracks_set.judged(of)
    assert (verdict.right, verdict.status) == (True, "ok")
    assert verdict.rms < 3.0 * verdict.bound


def test_what_scans_tell_of_a_shape() -> None:
    """Draws within bounds are a truncated normal distribution's; touched strips never tell less than nothing."""
    drawn = tracks_bound._truncated(np.array([[1.0, 0.0]]), np.array([0.5]), np.random.default_rng(0), 1500)
    assert drawn.max(axis=0)[0] <= 0.5 < drawn.max(axis=0)[1]
    assert drawn.mean(axis=0) == pytest.approx([-0.509, 0.0], abs=0.07)  # of x < 0.5: - phi(0.5) / Phi(0.5)
    assert drawn.var(axis=0) == pytest.approx([0.486, 1.0], rel=0.12)
    known = tracks_set.told(tracks_set.scene("ten", 0, 2))
    bound = known.cramer_rao().trace()
    least = np.square(known.draws(np.random.default_rng(0), 60)).sum(axis=(1, 2)).mean()
    assert 0.4 * bound < least < 1.2 * bound
