"""Strip sensors as networks: the independent check of the closed forms, and what they leave out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tacstrip as ts
from tacstrip.network import Break, Imperfections, Readout, Short
from tacstrip.network.nodal import Factored, Measurement, Network, currents, solve, solve_measurement
from tacstrip.network.strips.ladder import fast_readings
from tacstrip.network.strips.measurements import measurements, network_readings

CONTACT = ts.Contact.polygon([(2, 120), (60, 100), (50, 160)])
FLAT: dict[str, Any] = {"strips": 10, "pitch_mm": 6.5, "length_mm": 325.0}
KINDS = {
    "equal": ts.Sensor(construction="crs-crs", **FLAT),
    "unequal": ts.Sensor(construction="crs-crs", resistivity_ratio=0.3, **FLAT),
    "metal": ts.Sensor(construction="crs-m", **FLAT),
    "tube": ts.Sensor(construction="cyl-crs-m", radius_mm=30.0, **FLAT),
}


def _with_lambda(sensor: ts.Sensor, contact_lambda_mm: float) -> ts.Sensor:
    raw = {
        key: getattr(sensor, key) for key in ("construction", "strips", "pitch_mm", "length_mm", "radius_mm")
    }
    return ts.Sensor(**raw, resistivity_ratio=sensor.resistivity_ratio, contact_lambda_mm=contact_lambda_mm)


def _off(sensor: ts.Sensor, cells: int | None = None, contact: ts.Contact = CONTACT) -> float:
    """Return the largest difference between network and closed form, in Vref."""
    closed = ts.signatures(sensor, *ts.footprint(sensor, contact))
    network = network_readings(sensor, contact, cells=cells)
    for name in closed:
        np.testing.assert_array_equal(np.isnan(network[name]), np.isnan(closed[name]))
    return max(float(np.nanmax(np.abs(network[name] - closed[name]))) for name in closed)


@pytest.mark.parametrize("kind", KINDS)
def test_ideal_contact_is_exact(kind: str) -> None:
    assert _off(KINDS[kind]) < 1e-10
    assert _off(KINDS[kind], contact=ts.Contact.points([(10.0, 50.0), (30.0, 200.0)])) < 1e-10


@pytest.mark.parametrize("kind", KINDS)
def test_contact_resistance_agrees_by_default(kind: str) -> None:
    assert _off(_with_lambda(KINDS[kind], 2.0)) < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_the_mesh_converges_with_its_second_power(kind: str) -> None:
    sensor = _with_lambda(KINDS[kind], 2.0)
    errors = np.array([_off(sensor, cells) for cells in (100, 200, 400, 800)])
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders[1:], 2.0, atol=0.05)


def test_two_pieces_read_as_their_hull_with_ideal_contact() -> None:
    fork = ts.Contact.polygon(
        [(0, 60), (60, 60), (60, 160), (0, 160), (0, 140), (50, 140), (50, 80), (0, 80)]
    )
    for kind in ("equal", "unequal", "metal"):
        assert _off(KINDS[kind], contact=fork) < 1e-10
        # Long pieces stay so with contact resistance: the gap shares the current as the contact does.
        assert _off(_with_lambda(KINDS[kind], 2.0), contact=fork) < 1e-6
        # Pieces as short as lambda do not.
        assert _off(_with_lambda(KINDS[kind], 20.0), contact=fork) > 1e-4


def test_tied_grounds_follow_the_parallel_path() -> None:
    """k = lp / (lp + L - u), 1 / lp = sum of 1 / l_j over the touched strips (design.md, Physics)."""
    sensor = KINDS["metal"]
    l, u = ts.footprint(sensor, CONTACT)
    lp = 1.0 / np.nansum(1.0 / l)
    tied = network_readings(sensor, CONTACT, readout=Readout(tied_grounds=True))["k"]
    np.testing.assert_allclose(tied, lp / (lp + 325.0 - u), atol=1e-10)
    assert np.nanmin(ts.signatures(sensor, l, u)["k"] - tied) > 0.2  # not a small error


def test_a_uniformly_stretched_strip_changes_nothing_but_a_part_does() -> None:
    sensor = KINDS["equal"]
    ideal = network_readings(sensor, CONTACT)
    both = Imperfections(energised=np.linspace(0.8, 1.2, 10), sensing=np.linspace(0.8, 1.2, 10))
    np.testing.assert_allclose(network_readings(sensor, CONTACT, both)["kh"], ideal["kh"], atol=1e-10)
    profile = np.ones((10, 13))
    profile[3, :4] = 1.5  # 100 mm near the ground, below the contact, half as much again
    bent = network_readings(sensor, CONTACT, Imperfections(energised=profile))
    l, u = ts.footprint(sensor, CONTACT)
    a, w = l[3] + 50.0, (u - l)[3]
    assert bent["kl"][3] == pytest.approx(a / (375.0 - w / 2), abs=1e-10)
    np.testing.assert_allclose(np.delete(bent["kl"], 3), np.delete(ideal["kl"], 3), atol=1e-12)


def test_misaligned_pairs_touch_where_they_overlap() -> None:
    sensor = KINDS["equal"]
    contact = ts.Contact.polygon([(0, 300), (65, 300), (65, 325), (0, 325)])
    lowered = network_readings(sensor, contact, Imperfections(shift_mm=-10.0))
    shorter = ts.Contact.polygon([(0, 300), (65, 300), (65, 315), (0, 315)])
    np.testing.assert_allclose(lowered["kh"], network_readings(sensor, shorter)["kh"], atol=1e-10)
    gone = network_readings(sensor, contact, Imperfections(shift_mm=-40.0))
    assert np.isnan(gone["kh"]).all()


def test_a_broken_energised_strip_reads_a_pole() -> None:
    below = network_readings(KINDS["equal"], CONTACT, Imperfections(breaks=[Break(3, 50.0)]))
    above = network_readings(KINDS["equal"], CONTACT, Imperfections(breaks=[Break(3, 300.0)]))
    assert (below["kh"][3], above["kh"][3]) == (pytest.approx(1.0), pytest.approx(0.0))
    whole = network_readings(KINDS["equal"], CONTACT)
    np.testing.assert_allclose(np.delete(below["kh"], 3), np.delete(whole["kh"], 3), atol=1e-12)


def test_a_sensing_strip_cut_off_from_its_reading_is_named() -> None:
    cut = Imperfections(breaks=[Break(3, 250.0, "sensing")])
    with pytest.raises(ts.NetworkError, match="kh floats"):
        network_readings(KINDS["equal"], CONTACT, cut)
    pulled = network_readings(KINDS["equal"], CONTACT, cut, Readout(adc_ohm=1e9))
    assert pulled["kh"][3] == pytest.approx(0.0)  # the converter's input pulls it to ground


def test_a_short_between_neighbours_pulls_both_together() -> None:
    sensor = KINDS["equal"]
    ideal = network_readings(sensor, CONTACT)["kl"]
    for ohm, least in ((1e5, 0.0), (10.0, 1e-3)):
        short = network_readings(sensor, CONTACT, Imperfections(shorts=[Short(3, 20.0, ohm, "sensing")]))[
            "kl"
        ]
        assert abs(short[3] - short[4]) < abs(ideal[3] - ideal[4])
        assert abs(short[3] - ideal[3]) > least
        np.testing.assert_allclose(np.delete(short, [3, 4]), np.delete(ideal, [3, 4]), atol=1e-12)
    # Over metal the other strip floats: one bridge carries nothing.
    metal = network_readings(KINDS["metal"], CONTACT, Imperfections(shorts=[Short(3, 20.0, 10.0)]))["k"]
    assert np.nanmax(np.abs(metal - network_readings(KINDS["metal"], CONTACT)["k"])) > 1e-4


def test_switches_and_inputs_load_the_reading() -> None:
    sensor = KINDS["metal"]
    l, u = ts.footprint(sensor, CONTACT)
    ohm, mux, adc = 10_000.0, 200.0, 1e6
    low, high = l / 325.0 * ohm + mux, (325.0 - u) / 325.0 * ohm + mux
    loaded = 1.0 / (1.0 / low + 1.0 / adc)
    read = network_readings(sensor, CONTACT, readout=Readout(ohm, mux, adc))["k"]
    np.testing.assert_allclose(read, loaded / (loaded + high), atol=1e-10)


def test_simulate_takes_the_network() -> None:
    sensor = _with_lambda(KINDS["equal"], 2.0)
    closed, network = (
        ts.simulate(sensor, CONTACT, ts.Noise(positional=0.005), rng=3, model=m)
        for m in ("closed", "network")
    )
    np.testing.assert_allclose(network["kh"], closed["kh"], atol=1e-6)  # the same noise on both
    with pytest.raises(ts.OptionError, match='imperfections and readout need model="network"'):
        ts.simulate(sensor, CONTACT, imperfections=Imperfections())


EQUAL = KINDS["equal"]
WALL = ts.Contact.polygon([(0, 0), (20, 0), (20, 325), (0, 325)])
IMPOSSIBLE: dict[str, tuple[Imperfections, str]] = {
    "negative resistivity": (
        Imperfections(energised=-1.0),
        "energised: strip 0 has a value that is not a finite number above 0",
    ),
    "wrong shape": (
        Imperfections(sensing=np.ones(3)),
        r"sensing: an array of shape \(3,\); give a number, \(10,\)",
    ),
    "break off the sensor": (Imperfections(breaks=[Break(10, 5.0)]), "is not on the sensor: strips 0 to 9"),
    "short off the sensor": (
        Imperfections(shorts=[Short(9, 5.0, 1.0)]),
        "is not on the sensor: strips 0 to 8",
    ),
    "short of 0 ohm": (Imperfections(shorts=[Short(2, 5.0, 0.0)]), "ohm must be a finite number above 0"),
    "no such layer": (Imperfections(breaks=[Break(2, 5.0, "lower")]), "layer 'lower' does not exist"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_builds_that_cannot_be_are_named(name: str) -> None:
    imperfections, message = IMPOSSIBLE[name]
    with pytest.raises(ts.NetworkError, match=message):
        network_readings(EQUAL, CONTACT, imperfections)


def test_readouts_and_contacts_that_cannot_be_are_named() -> None:
    with pytest.raises(ts.NetworkError, match=r"strip_ohm = 0.0: must be above 0"):
        Readout(strip_ohm=0.0)
    with pytest.raises(ts.NetworkError, match=r"mux_ohm = -1.0: must be 0 or more"):
        Readout(mux_ohm=-1.0)
    with pytest.raises(ts.NetworkError, match="shorts Vref to ground; make it shorter than the strip"):
        network_readings(KINDS["metal"], WALL)
    with pytest.raises(ts.ContactError, match="lies outside the sensor"):
        network_readings(EQUAL, ts.Contact.points([900.0, 5.0]))


def _random_network(seed: int, nodes: int = 30) -> Network:
    random = np.random.default_rng(seed)
    start = np.concatenate([np.arange(nodes - 1), random.integers(0, nodes, 40)])
    end = np.concatenate([np.arange(1, nodes), random.integers(0, nodes, 40)])
    real = start != end
    return Network(nodes, start[real], end[real], random.uniform(0.1, 10.0, int(real.sum())))


def test_potentials_obey_kirchhoff() -> None:
    for seed in range(10):
        network = _random_network(seed)
        potentials = solve(Measurement(network, {0: 0.0, 17: 1.0, 29: -0.5}, {}))
        into = np.bincount(network.start, -currents(network, potentials), 30)
        into += np.bincount(network.end, currents(network, potentials), 30)
        np.testing.assert_allclose(np.delete(into, [0, 17, 29]), 0.0, atol=1e-12)


def test_one_factor_serves_many_questions() -> None:
    network = _random_network(3)
    factored = Factored(network, [0, 29])
    many = factored.solve(np.array([[0.0, 1.0, 2.0], [1.0, 0.0, -1.0]]))
    for i, volts in enumerate(([0.0, 1.0], [1.0, 0.0], [2.0, -1.0])):
        np.testing.assert_allclose(many[:, i], factored.solve(volts))
    fed = np.zeros(30)
    fed[7] = 1.0  # reciprocity: what 7 does to 11, 11 does to 7
    other = np.zeros(30)
    other[11] = 1.0
    assert factored.solve([0.0, 0.0], fed)[11] == pytest.approx(factored.solve([0.0, 0.0], other)[7])


def test_floating_nodes_and_bad_resistors_are_named() -> None:
    chain = Network(4, np.array([0, 2]), np.array([1, 3]), np.array([1.0, 1.0]))
    assert solve_measurement(Measurement(chain, {0: 1.0}, {"near": 1})) == {"near": pytest.approx(1.0)}
    with pytest.raises(ts.NetworkError, match="far floats: no resistor joins node 3"):
        solve_measurement(Measurement(chain, {0: 1.0}, {"far": 3}))
    with pytest.raises(ts.NetworkError, match="hold at least one node"):
        solve(Measurement(chain, {}, {}))
    for siemens in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ts.NetworkError, match=r"the resistor between nodes 0 and 1 has a conductance of"):
            Network(2, np.array([0]), np.array([1]), np.array([siemens]))
    with pytest.raises(ts.NetworkError, match="nodes are 0 to 1"):
        Network(2, np.array([0]), np.array([2]), np.array([1.0]))


def test_a_question_has_only_what_carries_current() -> None:
    asked = measurements(KINDS["metal"], CONTACT)
    assert list(asked) == list(range(9))
    assert asked[0].network.nodes < 40
    tied = measurements(KINDS["metal"], CONTACT, readout=Readout(tied_grounds=True))
    assert len(tied[0].network.siemens) == 2 * 9  # every touched strip's two ends, through the metal


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("contact_lambda_mm", [0.0, 2.0])
def test_the_fast_ladder_agrees_with_the_network(kind: str, contact_lambda_mm: float) -> None:
    """Non-uniform, shifted strips, switches, several pieces: the same mesh solved two ways."""
    sensor = _with_lambda(KINDS[kind], contact_lambda_mm)
    random = np.random.default_rng(0)
    imperfections = Imperfections(
        random.uniform(0.8, 1.2, (10, 20)), random.uniform(0.8, 1.2, (10, 20)), random.uniform(-3, 3, 10)
    )
    fork = ts.Contact.polygon(
        [(0, 60), (60, 60), (60, 160), (0, 160), (0, 140), (50, 140), (50, 80), (0, 80)]
    )
    for contact in (CONTACT, fork):
        for unit, readout in (
            (imperfections, Readout(mux_ohm=300.0)),
            (None, None),
            (None, Readout(adc_ohm=1e6)),
        ):
            general = network_readings(sensor, contact, unit, readout, cells=60)
            fast = fast_readings(sensor, contact, unit, readout, cells=60)
            for name, values in general.items():
                np.testing.assert_allclose(fast[name], values, atol=1e-9)
