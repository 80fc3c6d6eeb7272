"""CRS-CRP (3.3): readings against the plain solver, the Jacobian against differences, l and u back again."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from studies import crp_spans
from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.errors import ContactError, NetworkError, ReadingError, SpecError
from tacstrip.network.crp import inversion as crp
from tacstrip.network.crp.cramer_rao import Electrodes
from tacstrip.network.crp.dissection import elimination_order
from tacstrip.network.crp.factored import FactoredScan
from tacstrip.network.crp.inversion import constrained_step
from tacstrip.network.crp.mesh import SheetMesh, Wiring
from tacstrip.network.crp.readings import contact_electrodes, measurements
from tacstrip.network.crp.spectral import exponential_lobatto
from tacstrip.network.nodal import solve, solve_measurement

L = 100.0
WIRINGS = [
    Wiring(),
    Wiring(common_bars=True),
    Wiring("tied grounds"),
    Wiring("tied grounds", common_bars=True),
    Wiring("grounded"),
]
SHAPES = {
    "hexagon": [(12, 15), (30, 5), (70, 10), (90, 40), (60, 85), (20, 70)],
    "triangle": [(10, 20), (90, 30), (50, 90)],
    "slanted band": [(15, 20), (85, 60), (85, 85), (15, 45)],
}  # 12 to 15 of 20 strips wide


def a_sensor(**changed: Any) -> ts.Sensor:
    """20 strips of 100 mm, a sheet of 100 times their resistivity: the prototype of design.md."""
    spec = {
        "strips": 20,
        "pitch_mm": 5.0,
        "length_mm": L,
        "resistivity_ratio": 100.0,
        "contact_lambda_mm": 2.0,
    }
    return ts.Sensor(construction="crs-crp", **(spec | changed))


def span(sensor: ts.Sensor, shape: str = "hexagon") -> tuple[FloatArray, FloatArray]:
    l, u = ts.footprint(sensor, ts.Contact.polygon(SHAPES[shape]))
    return l, u


def a_small_case() -> tuple[ts.Sensor, FloatArray, FloatArray]:
    """8 strips with gaps between them; contacts reach both edges, one strip is untouched."""
    random = np.random.default_rng(0)
    l = random.uniform(1.0, 50.0, 8)
    u = l + random.uniform(5.0, 45.0, 8)
    l[3], u[4], l[6], u[6] = 0.0, L, np.nan, np.nan
    return a_sensor(strips=8, strip_width_mm=3.0, contact_lambda_mm=3.0), l, u


# Forward


@pytest.mark.parametrize("wiring", WIRINGS, ids=str)
def test_a_scan_agrees_with_the_plain_solver_strip_by_strip(wiring: Wiring) -> None:
    sensor, l, u = a_small_case()
    kh, kl = crp_spans.own_electrodes(sensor, l, u, 30, wiring)
    every = crp_spans.all_electrodes(sensor, l, u, 30, wiring)
    scan = crp_spans.factored_span(sensor, l, u, 30, wiring)
    asked = measurements(scan.resistors, wiring)
    assert list(asked) == np.flatnonzero(np.isfinite(l)).tolist()
    for i, measurement in asked.items():
        plain = solve_measurement(measurement)
        assert kh[i] == pytest.approx(plain["kh"], abs=1e-12)
        assert kl[i] == pytest.approx(plain["kl"], abs=1e-12)
        np.testing.assert_allclose(every[i], solve(measurement)[scan.resistors.electrode], rtol=0, atol=1e-12)
    assert np.isnan([kh[6], kl[6], *every[6]]).all()


@pytest.mark.parametrize("wiring", WIRINGS, ids=str)
def test_every_node_is_eliminated_once_and_ports_last(wiring: Wiring) -> None:
    sensor, l, u = a_small_case()
    scan = crp_spans.factored_span(sensor, l, u, 30, wiring)
    nodes = scan.resistors
    ports = np.unique(np.concatenate([nodes.electrode, nodes.bottom, nodes.top]))
    order = elimination_order(nodes.line, len(scan.mesh.pitch.widths), ports)
    joined = np.union1d(nodes.network.start, nodes.network.end)
    np.testing.assert_array_equal(np.sort(order), joined)
    np.testing.assert_array_equal(order[-len(ports) :], ports)


def test_a_scan_is_read_from_the_last_block_of_its_factor() -> None:
    """Solutions of all nodes, a strip at a time, took up to two thirds of a scan."""
    sensor, l, u = a_small_case()
    scan = crp_spans.factored_span(sensor, l, u, 60)
    place, _ = scan.factored._solver(scan.resistors.top, scan.resistors.electrode)
    assert place.max() < 2 * len(scan.resistors.electrode) < 0.1 * scan.resistors.network.nodes


def test_one_strip_worked_by_hand() -> None:
    """Two rows of cells, a whole strip touched: five resistors to a mirror-symmetric ladder of three rungs."""
    sensor = a_sensor(strips=1, pitch_mm=4.0, contact_lambda_mm=50.0, resistivity_ratio=3.0)
    r1, z = 3.0, 1.0
    g = 1.0 / ((1.0 + r1) * 50.0**2)
    inwards = 50.0**2 / (8.0 * 50.0) * (np.tanh(z) - z / np.cosh(z) ** 2)
    # Half of the antisymmetric ladder: the middle is at 1/2. From an end at 0: rung, then r1 h to the middle.
    rung, along = 1.0 / (g * (50.0 - inwards) ** 2 / 100.0), r1 * 50.0
    expected = 0.5 * rung / (rung + along)
    kh, kl = crp_spans.own_electrodes(sensor, np.array([0.0]), np.array([L]), rows=2)
    assert kl[0] == pytest.approx(expected, abs=1e-14)
    assert kh[0] == pytest.approx(1.0 - expected, abs=1e-14)


def test_a_mirrored_contact_reads_mirrored() -> None:
    sensor = a_sensor()
    l, u = span(sensor)
    kh, kl = crp_spans.own_electrodes(sensor, l, u)
    kh2, kl2 = crp_spans.own_electrodes(sensor, L - u[::-1], L - l[::-1])
    np.testing.assert_allclose(kh2, 1.0 - kl[::-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(kl2, 1.0 - kh[::-1], rtol=0, atol=1e-11)


def test_a_point_reads_its_place_whatever_the_sheet() -> None:
    """No current flows through one point: the whole sheet takes the potential under it."""
    sensor = a_sensor()
    l = np.full(20, np.nan)
    l[7] = 31.4
    every = crp_spans.all_electrodes(sensor, l, l)
    np.testing.assert_allclose(every[7], 0.314, rtol=0, atol=1e-6)


def test_readings_converge_with_the_square_of_the_cell() -> None:
    sensor = a_sensor(contact_lambda_mm=8.0)
    l, u = span(sensor)
    fine = np.stack(crp_spans.own_electrodes(sensor, l, u, 1600))
    error = [
        np.nanmax(np.abs(crp_spans.own_electrodes(sensor, l, u, rows) - fine)) for rows in (25, 50, 100, 200)
    ]
    order = np.log2(np.array(error[:-1]) / error[1:])
    assert np.all((order > 1.7) & (order < 2.4)), order


def test_two_pieces_on_a_strip_count_as_two() -> None:
    sensor = a_sensor()
    both = ts.Contact.from_wkt(
        "MULTIPOLYGON(((10 10,90 10,90 30,10 30,10 10)),((10 60,90 60,90 80,10 80,10 60)))"
    )
    hull = crp_spans.all_electrodes(sensor, *ts.footprint(sensor, both))
    pieces = contact_electrodes(sensor, both)
    assert np.nanmax(np.abs(hull - pieces)) > 1e-3
    one = ts.Contact.polygon(SHAPES["triangle"])
    np.testing.assert_allclose(
        contact_electrodes(sensor, one),
        crp_spans.all_electrodes(sensor, *ts.footprint(sensor, one)),
        atol=1e-13,
    )


def test_neighbours_shift_readings_by_a_tenth_of_vref() -> None:
    sensor = a_sensor()
    l, u = span(sensor)
    kh, _ = crp_spans.own_electrodes(sensor, l, u)
    alone = np.full(20, np.nan)
    for i in np.flatnonzero(np.isfinite(l)):
        only = np.where(np.arange(20) == i, 0.0, np.nan)
        alone[i] = crp_spans.own_electrodes(sensor, l + only, u + only)[0][i]
    assert 0.05 < np.nanmax(np.abs(kh - alone)) < 0.3


# Slopes


@pytest.mark.parametrize("wiring", WIRINGS, ids=str)
def test_the_adjoint_jacobian_agrees_with_differences(wiring: Wiring) -> None:
    sensor, l, u = a_small_case()
    l[3], u[4] = 2.0, 97.0  # differences need room on both sides
    touched = np.flatnonzero(np.isfinite(l))
    scan = crp_spans.factored_span(sensor, l, u, 30, wiring)
    slope = scan.jacobian(np.r_[l[touched], u[touched]], np.tile(np.arange(16), (7, 1)))
    assert slope.shape == (7, 16, 14)
    for at in range(14):
        step = np.zeros((2, 8))
        step[at // 7, touched[at % 7]] = 1e-4
        after, before = (
            crp_spans.all_electrodes(sensor, l + sign * step[0], u + sign * step[1], 30, wiring)
            for sign in (1, -1)
        )
        np.testing.assert_allclose(slope[:, :, at], (after - before)[touched] / 2e-4, rtol=0, atol=1e-9)


def test_slopes_do_not_jump_where_an_end_passes_a_node() -> None:
    sensor, l, u = a_small_case()
    touched = np.flatnonzero(np.isfinite(l))
    columns = np.tile(np.arange(16), (7, 1))

    def at(end: float) -> FloatArray:
        l[0] = end
        return crp_spans.factored_span(sensor, l, u, 50).jacobian(np.r_[l[touched], u[touched]], columns)

    before, on, after = (at(20.0 + d) for d in (-1e-7, 0.0, 1e-7))
    np.testing.assert_allclose(before, after, rtol=0, atol=1e-8)
    np.testing.assert_allclose(before, on, rtol=0, atol=1e-8)


# Back


def error(sensor: ts.Sensor, found: crp.InversionResult, l: FloatArray, u: FloatArray) -> FloatArray:
    """The larger error of both ends, over L (strips,)."""
    assert set(np.flatnonzero(np.isnan(found.l))) == set(np.flatnonzero(np.isnan(l)))
    return np.fmax(np.abs(found.l - l), np.abs(found.u - u)) / sensor.length_mm


@pytest.mark.parametrize(("shape", "convex"), [*((shape, False) for shape in SHAPES), ("triangle", True)])
def test_clean_readings_give_l_and_u_back(shape: str, convex: bool) -> None:
    sensor = a_sensor()
    l, u = span(sensor, shape)
    own = crp.invert(sensor, *crp_spans.own_electrodes(sensor, l, u, 40), convex=convex, rows=40)
    every = crp.invert_all(sensor, crp_spans.all_electrodes(sensor, l, u, 40), convex=convex, rows=40)
    for found in (own, every):
        assert np.nanmax(error(sensor, found, l, u)) < 1e-9
        assert "not converged" not in found.status
        assert found.residual_rms < 1e-6
        assert found.iterations < 40


@pytest.mark.parametrize("contact_lambda_mm", [1.5, 6.0])
def test_most_of_the_way_is_gone_on_a_coarser_mesh(
    contact_lambda_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    sensor = a_sensor(contact_lambda_mm=contact_lambda_mm)
    l, u = span(sensor, "triangle")
    kh, kl = crp_spans.own_electrodes(sensor, l, u)
    rows: list[int] = []

    def counted(mesh: SheetMesh, *rest: Any) -> FactoredScan:
        rows.append(mesh.rows)
        return FactoredScan(mesh, *rest)

    monkeypatch.setattr("tacstrip.network.crp.inversion.FactoredScan", counted)
    found = crp.invert(sensor, kh, kl)
    assert np.nanmax(error(sensor, found, l, u)) < 1e-9
    assert len(rows) == found.iterations <= 16
    assert rows.count(SheetMesh.of(sensor).rows) <= 6


def test_another_wiring_inverts_too() -> None:
    sensor, wiring = a_sensor(), Wiring("tied grounds")
    l, u = span(sensor)
    readings = crp_spans.all_electrodes(sensor, l, u, 40, wiring)
    found = crp.invert_all(sensor, readings, rows=40, wiring=wiring)
    assert np.nanmax(error(sensor, found, l, u)) < 1e-9


def test_readings_of_a_mesh_twice_as_fine() -> None:
    sensor = a_sensor(contact_lambda_mm=3.0)
    l, u = span(sensor)
    rows = SheetMesh.of(sensor).rows
    found = crp.invert(sensor, *crp_spans.own_electrodes(sensor, l, u, 2 * rows))
    assert np.nanmax(error(sensor, found, l, u)) < 1e-3


def test_strip_by_strip_fails() -> None:
    """Each strip alone on the sheet, neighbours ignored: wrong by far more than noise would explain."""
    sensor = a_sensor()
    l, u = span(sensor)
    kh, kl = crp_spans.own_electrodes(sensor, l, u, 25)
    alone = np.full(20, np.nan)
    for i in np.flatnonzero(np.isfinite(kh))[::3]:
        only = np.where(np.arange(20) == i, 0.0, np.nan)
        found = crp.invert(sensor, kh + only, kl + only, rows=25)
        alone[i] = error(sensor, found, l + only, u + only)[i]
    together = error(sensor, crp.invert(sensor, kh, kl, rows=25), l, u)
    assert np.nanmax(together) < 1e-9
    assert np.nanmedian(alone) > 0.1
    assert np.nanmax(alone) > 0.15


@dataclass(frozen=True, eq=False)
class Noisy:
    """Errors (trials, ends), the bound (ends,) and what each inversion stated (trials, ends), of ends of a contact.

    `firm` (ends,): the strip's contact is five deviations or more long. The bound is of readings that are linear in l
    and u; a shorter contact reads none at all once in a while, and no linear bound tells of that.
    """

    errors: FloatArray
    bound: FloatArray
    stated: FloatArray
    firm: BoolArray


@cache
def noise_over_bound(shape: str, electrodes: Electrodes, trials: int, rows: int = 50) -> Noisy:
    """Invert a contact at 0.1 % noise; of strips with w >= 5 % of L."""
    sensor, sigma, random = a_sensor(contact_lambda_mm=4.0), 1e-3, np.random.default_rng(5)
    l, u = span(sensor, shape)
    wide: BoolArray = np.tile(u - l >= 0.05 * L, 2)
    covariance = crp_spans.covariance(sensor, l, u, sigma, electrodes, rows)
    variance, off = np.diag(covariance), np.diag(covariance, 20)
    length = np.sqrt(variance[:20] + variance[20:] - 2.0 * off)
    clean = crp_spans.all_electrodes(sensor, l, u, rows)
    each, errors, stated = np.arange(20), [], []
    for _ in range(trials):
        k = clean + sigma * random.normal(size=clean.shape)
        if electrodes == "own":
            found = crp.invert(sensor, k[each, 20 + each], k[each, each], sigma, rows=rows)
        else:
            found = crp.invert_all(sensor, k, sigma, rows=rows)
        errors.append(np.concatenate([found.l - l, found.u - u])[wide])
        stated.append(np.sqrt(np.diag(found.covariance))[wide])
    firm: BoolArray = np.tile(u - l >= 5.0 * length, 2)
    return Noisy(np.array(errors), np.sqrt(variance)[wide], np.array(stated), firm[wide])


@pytest.mark.parametrize("electrodes", ["own", "all"])
def test_noise_costs_what_the_bound_says(electrodes: Electrodes) -> None:
    found = noise_over_bound("hexagon", electrodes, 30, rows=20)
    over = np.sqrt((found.errors**2).mean(axis=0)) / found.bound
    assert 0.8 < np.sqrt((over**2).mean()) < 1.25
    assert over.max() < 1.6  # of 30 trials


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("electrodes", ["own", "all"])
def test_noise_costs_what_the_bound_says_end_by_end(shape: str, electrodes: Electrodes) -> None:
    found = noise_over_bound(shape, electrodes, 200)
    over = np.sqrt((found.errors**2).mean(axis=0)) / found.bound
    assert over[found.firm].max() < 1.25
    assert over.max() < 1.5
    held = (np.abs(found.errors) < 1.96 * found.stated).mean(axis=0)  # short ones too: each states its own
    assert 0.93 < held.mean() < 0.98
    assert held.min() > 0.89  # 95 % less four deviations of 200


def test_all_electrodes_of_a_wide_contact_reach_half_a_permille() -> None:
    found = noise_over_bound("hexagon", "all", 30, rows=20)
    assert np.median(np.abs(found.errors)) < 5e-4 * L
    assert np.median(found.bound) < 5e-4 * L


def test_convexity_helps() -> None:
    sensor, random = a_sensor(contact_lambda_mm=4.0), np.random.default_rng(3)
    l, u = span(sensor, "slanted band")
    clean = np.stack(crp_spans.own_electrodes(sensor, l, u, 25))
    total = {False: 0.0, True: 0.0}
    for _ in range(6):
        kh, kl = clean + 1e-3 * random.normal(size=clean.shape)
        for convex in total:
            found = crp.invert(sensor, kh, kl, convex=convex, rows=25)
            total[convex] += float(np.nansum(error(sensor, found, l, u) ** 2))
            if convex:
                on = np.isfinite(l)
                assert np.diff(found.l[on], 2).min() > -1e-9
                assert np.diff(found.u[on], 2).max() < 1e-9
    assert total[True] < 0.8 * total[False]


def test_a_wrong_lambda_moves_both_ends_outwards_or_inwards() -> None:
    sensor = a_sensor()
    l, u = span(sensor, "triangle")
    kh, kl = crp_spans.own_electrodes(sensor, l, u, 50)
    for wrong in (0.9, 1.1):
        found = crp.invert(a_sensor(contact_lambda_mm=2.0 * wrong), kh, kl, rows=50)
        shift = np.nanmedian(np.stack([l - found.l, found.u - u]), axis=1)
        np.testing.assert_allclose(shift / (wrong - 1.0), 3.2, atol=0.3)  # [mm]: 1.6 lambda
        assert found.residual_rms < 1e-6  # own electrodes cannot tell


def test_floating_strips_and_free_edges_are_the_best_wiring() -> None:
    sensor = a_sensor()
    l, u = span(sensor)
    bound = [
        np.nanmedian(np.diag(crp_spans.covariance(sensor, l, u, rows=50, wiring=wiring))) ** 0.5
        for wiring in (Wiring(), Wiring(common_bars=True), Wiring("grounded"))
    ]
    assert 2.0 * bound[0] < bound[1] < bound[2] / 2.0


def test_a_point_has_a_bound_that_is_large_and_finite() -> None:
    sensor = a_sensor(strips=5)
    l = np.full(5, 40.0)
    bound = np.diag(crp_spans.covariance(sensor, l, l, rows=50))
    assert np.isfinite(bound).all()
    assert bound.min() > L**2


def test_short_contacts_say_so() -> None:
    sensor = a_sensor()
    l, u = np.full((2, 20), np.nan)
    l[3:16] = 40.0
    u[3:16] = 60.0
    u[3] = 42.0
    found = crp.invert(sensor, *crp_spans.own_electrodes(sensor, l, u, 50), rows=50)
    assert found.status[2:5] == ("no contact", "short contact", "ok")
    assert found.advice.startswith("1 strips have a contact shorter than 5 % of their length")
    sigma = np.sqrt(np.diag(found.covariance)[:20])
    assert sigma[3] > 2.0 * np.nanmedian(sigma)


def test_the_covariance_is_that_of_the_noise() -> None:
    sensor = a_sensor()
    l, u = span(sensor)
    found = crp.invert(sensor, *crp_spans.own_electrodes(sensor, l, u, 50), sigma=2e-3, rows=50)
    expected = crp_spans.covariance(sensor, l, u, 2e-3, "own", 50)
    expected += SheetMesh.of(sensor, 50).error_mm ** 2 * np.eye(40)
    assert found.covariance.shape == (40, 40)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-5)
    np.testing.assert_array_equal(np.isnan(np.diag(found.covariance)[:20]), np.isnan(l))
    np.testing.assert_allclose(np.diag(found.covariance)[20:], np.diag(expected)[20:], rtol=1e-5)


def test_noise_beyond_all_measure_ends_on_the_sensor() -> None:
    sensor, random = a_sensor(strips=12), np.random.default_rng(0)
    kh, kl = random.uniform(0.0, 1.0, (2, 12))
    for convex in (False, True):
        found = crp.invert(sensor, kh, kl, convex=convex, rows=20, max_networks=15)
        assert np.all((found.l >= -1e-9) & (found.l <= found.u) & (found.u <= L + 1e-9))
        assert not np.isnan(found.covariance).any()
        assert found.advice


def test_a_step_within_limits_is_the_best_one() -> None:
    """Against a brute-force search: x^2 + 2 y^2 - ... with x + y >= 3 and x <= 1."""
    curvature, downhill = np.diag([2.0, 4.0]), np.array([0.0, 0.0])
    step = constrained_step(curvature, downhill, np.array([[1.0, 1.0], [-1.0, 0.0]]), np.array([3.0, -1.0]))
    np.testing.assert_allclose(step, [1.0, 2.0], atol=1e-12)  # unbounded it is (2, 1)


# Bad input


@pytest.mark.parametrize(
    ("l", "u", "message"),
    [
        ([np.nan] * 3, [np.nan] * 3, "nothing touches a strip"),
        ([10, 20, 30], [20, 30, 120], "strip 2: a contact from 30 to 120 mm is not on the sensor"),
        ([-1, 20, 30], [20, 30, 40], "strip 0: a contact from -1 to 20 mm"),
        ([10, 40, 30], [20, 30, 40], "strip 1: a contact from 40 to 30 mm"),
        ([10, np.nan, 30], [20, 30, 40], "NaN on the same strips"),
        ([10, np.inf, 30], [20, np.inf, 40], "NaN on the same strips, and finite elsewhere"),
        ([10, 20], [20, 30], "give two of (3,)"),
    ],
)
def test_contacts_that_cannot_be(l: list[float], u: list[float], message: str) -> None:
    with pytest.raises(ContactError, match=re.escape(message)):
        crp_spans.own_electrodes(a_sensor(strips=3), np.array(l, dtype=float), np.array(u, dtype=float))


def test_sensors_that_cannot_be() -> None:
    l, u = np.array([10.0]), np.array([20.0])
    with pytest.raises(SpecError, match="contact_lambda_mm is missing: a crs-crp sensor needs it"):
        a_sensor(contact_lambda_mm=0.0)
    ideal = ts.Sensor(construction="crs-crs", strips=1, pitch_mm=1.0, length_mm=L)
    with pytest.raises(SpecError, match=r"contact_lambda_mm = 0.0: .*set it above 0"):
        crp_spans.own_electrodes(ideal, l, u)
    metal = ts.Sensor(construction="crs-m", strips=1, pitch_mm=1.0, length_mm=L, contact_lambda_mm=1.0)
    with pytest.raises(SpecError, match=r"resistivity_ratio = 0.0: .*metal is a CRS-M sensor"):
        crp_spans.own_electrodes(metal, l, u)
    for ratio in (0.0, -2.0):
        with pytest.raises(SpecError, match="resistivity_ratio"):
            a_sensor(resistivity_ratio=ratio)
    with pytest.raises(SpecError, match="rows = 1: a mesh needs 2"):
        crp_spans.own_electrodes(a_sensor(strips=1), l, u, rows=1)


def test_readings_that_cannot_be() -> None:
    sensor, k = a_sensor(strips=3), np.array([0.5, 0.4, np.nan])
    with pytest.raises(ReadingError, match="no strip reads a contact"):
        crp.invert(sensor, np.full(3, np.nan), np.full(3, np.nan))
    with pytest.raises(ReadingError, match="strip 2: some readings are finite"):
        crp.invert(sensor, k, np.array([0.5, 0.4, 0.3]))
    with pytest.raises(ReadingError, match=r"give two of \(3,\)"):
        crp.invert(sensor, k, k[:2])
    with pytest.raises(ReadingError, match=r"give \(3, 6\)"):
        crp.invert_all(sensor, np.stack([k, k]))
    with pytest.raises(ReadingError, match="sigma = 0"):
        crp.invert(sensor, k, k, sigma=0.0)


def test_options_that_do_not_exist() -> None:
    with pytest.raises(NetworkError, match="others 'earthed' does not exist; choose one of: floating"):
        Wiring("earthed")  # type: ignore[arg-type]
    sensor = a_sensor(strips=2)
    l, u = np.array([10.0, np.nan]), np.array([30.0, np.nan])
    with pytest.raises(NetworkError, match="electrodes 'some' does not exist; choose one of: own, all"):
        crp_spans.covariance(sensor, l, u, electrodes="some")  # type: ignore[arg-type]


@pytest.mark.parametrize("width_over_decay", [2.0, 10.0, 80.0])
def test_a_strip_across_holds_what_a_contact_makes_there(width_over_decay: float) -> None:
    """Energy and mean square of x^2 and of what decays from a side, against their integrals over [-1/2, 1/2]."""
    weights, stiffness = exponential_lobatto(width_over_decay)
    # The nodes between are where the mean square of x comes out.
    inner = np.sqrt((1.0 / 12.0 - 0.5 * weights[0]) / (2.0 * weights[1]))
    x = np.array([-0.5, -inner, 0.0, inner, 0.5])
    t = width_over_decay
    decaying = np.exp(-t * (0.5 - x))
    assert weights.sum() == pytest.approx(1.0)
    assert x**2 @ stiffness @ x**2 == pytest.approx(1.0 / 3.0)
    assert decaying @ stiffness @ decaying == pytest.approx(0.5 * t * -np.expm1(-2.0 * t))
    even = decaying + decaying[::-1]
    assert weights @ even**2 == pytest.approx(-np.expm1(-2.0 * t) / t + 2.0 * np.exp(-t))
