"""What every build of the core must compute to the same bits. Add a case: a function without arguments, under `@case`,
that calls the core as the package does and returns arrays or numbers, always of the same input.

TACSTRIP_CORE names the build; tests/core/test_build_bits.py runs them in a process for each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from hashlib import sha256

import numpy as np
from numpy.typing import ArrayLike

import tacstrip as ts
from layered_scenes import two_triangles
from polygons import convex_polygon
from rigid_scenes import rigid_scene
from tacstrip.contact.press.patch import samples
from tacstrip.core.convex_chain import (
    best_lines,
    convex_cuts,
    convex_regression,
    hull_ends,
    polyline,
    sure_strips,
)
from tacstrip.core.convex_overlap import convex_overlap
from tacstrip.core.convex_reach import convex_reach
from tacstrip.core.ellipse import fit_ellipse
from tacstrip.core.hit_and_run import hit_and_run
from tacstrip.core.hull import HullScans, fit_hull_poses, hull_equations
from tacstrip.core.library import library
from tacstrip.core.polytope import analytic_centre, feasible_part, lowest, minimax
from tacstrip.core.posterior import OutlinePrior, outline_ends, outline_record, sample_outlines
from tacstrip.core.problem import FitProblem
from tacstrip.core.regular import sample_regular
from tacstrip.core.rigid import descend, equations, fit_poses, linearised, loss
from tacstrip.core.search import fit_counts
from tacstrip.core.solid import patch_sums, solid_gap, solid_yields
from tacstrip.reconstruction.posterior.regular.placement import Placement
from tacstrip.surface.skin import skin_of
from tacstrip.tracking.rigid.smooth_path import circle, fit_corners, fit_path, spline_basis

Case = Callable[[], Iterable[ArrayLike]]
CASES: dict[str, Case] = {}


def case(function: Case) -> Case:
    """Add a case."""
    CASES[function.__name__] = function
    return function


@case
def version() -> Iterable[ArrayLike]:
    core = library()
    assert core is not None
    return [core.tacstrip_core_version()]


@case
def polygon_fits() -> Iterable[ArrayLike]:
    """ModelSelection as users make them, of few and many strips, one signature and both, with their covariances."""
    for seed, strips in enumerate((8, 10, 16, 40, 100, 300)):
        for construction in ("crs-crs", "crs-m"):
            sensor = ts.Sensor(
                construction=construction, strips=strips, pitch_mm=1000.0 / strips, length_mm=1000.0
            )
            contact = ts.Contact.polygon(convex_polygon(seed, 4 + seed % 3))
            noise = ts.Noise(positional=0.002)
            for found in ts.fit_polygon(ts.simulate(sensor, contact, noise, rng=seed), sensor, noise).objects:
                yield found.vertices
                if found.covariance is not None:
                    yield found.covariance


@case
def pressed_solids() -> Iterable[ArrayLike]:
    """Solids of every kind in a fingertip: ends on strips, and what the patch sums up to."""
    tip, pose = ts.Sensor.load("fingertip"), ((10.0, 3.0, 10.0), (-1.0, -0.3, -1.0), 0.4)
    solids = (
        ts.Solid.plane(),
        ts.Solid.sphere(5.0),
        ts.Solid.cylinder(4.0),
        ts.Solid.edge(),
        ts.Solid.box((12, 6, 8)),
        ts.Solid.cone(),
    )
    _, _, at, out = samples(skin_of(tip))
    points, normals = (np.moveaxis(v, -1, 0).reshape(3, 1, -1) for v in (at, out))
    across, up = np.ones(len(at)), np.ones(at.shape[1] - 1)
    for solid in solids:
        frame = solid.at(*pose).moved(-4.0).frame
        touch, yields = solid_yields(solid.kind, frame[None], points, normals, 3.0)
        yield from (touch, yields, solid_gap(solid.kind, frame, points[:, 0], normals[:, 0], 0.0))
        yield patch_sums(touch.reshape(at.shape[:2]), yields.reshape(at.shape[:2]), at, out, across, up)


@case
def rigid_outlines() -> Iterable[ArrayLike]:
    """Corners and poses of one outline in many scans, of both signatures and of k, hard and soft."""
    for construction, lam in (("crs-crs", 0.0), ("crs-crs", 2.0), ("crs-m", 0.0)):
        scans, corners, poses = rigid_scene(construction, lam)
        yield from vars(linearised(scans, corners, poses)).values()
        for how in (loss(scans), loss(scans, 0.5, 3.0, 0.25)):
            yield from vars(equations(scans, corners, poses, how)).values()
            yield from descend(scans, corners, poses, how)
            yield from fit_poses(scans, corners, poses[:, None] + np.zeros((3, 1)), how)
            hull, two = HullScans(scans, np.ones(scans.k.shape[::2])), [corners, 0.5 * corners]
            both = np.stack([poses, poses + 0.5], axis=1)
            yield from vars(
                hull_equations(hull, two, both, np.ones(both.shape[:2], dtype=bool), how)
            ).values()
            yield from fit_hull_poses(hull, two, both[:, None], both[:, None], np.full(1, 0.1), how)


@case
def rigid_paths() -> Iterable[ArrayLike]:
    """A rough outline on a spline, and with a knot for each scan; corners on a spline."""
    scans, corners, poses = rigid_scene("crs-crs", 2.0)
    for knots in (5, len(poses)):
        basis = spline_basis(np.linspace(0.0, 1.0, len(poses)), knots)
        path = fit_path(
            scans, circle(scans, basis).turning(1.0), 8, tolerance=0.07, cauchy=3.0, rough=0.07, end=0.25
        )
        yield from (path.radii, path.knots, path.cost)
        at_knots = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0].round(9), dtype=np.float64)
        yield from fit_corners(scans, corners, at_knots, basis, loss(scans), 8)


@case
def convex_chains() -> Iterable[ArrayLike]:
    """Ends of one to a hundred strips, convex in parts."""
    random = np.random.default_rng(4)
    for n in (1, 2, 3, 12, 100):
        x = np.linspace(0.0, 1.5 * (n - 1), n)
        y = 0.02 * (x - 30.0) ** 2 + 8.0 * (x > 60.0) + random.normal(0.0, 0.2, n)
        weight = random.uniform(10.0, 40.0, n)
        yield from (*convex_regression(x, y, weight), *convex_regression(x, y, weight, -1.0))
        cuts, gains = convex_cuts(x, y, weight)
        yield from (*best_lines(x, y, weight, 20.0, 6.0), cuts, gains, sure_strips(x, y, weight, cuts))
        yield from (*polyline(x, y, weight, 1.5), hull_ends(np.column_stack([x, y])[::-1], x))


@case
def reaches() -> Iterable[ArrayLike]:
    """How far a box may reach between readings, and what a triangle shares with that."""
    box = np.array([(40.0, 40.0), (50.0, 40.0), (50.0, 50.0), (40.0, 50.0)])
    triangle = np.array([(30.0, 30.0), (70.0, 35.0), (45.0, 65.0)])
    for strips in (5, 40):
        x = np.linspace(2.0, 98.0, strips)
        below, above = np.column_stack([x, 10.0 + 0.2 * x]), np.column_stack([x, 85.0 - 0.15 * x])
        reached = convex_reach(box, below, above, np.array([[60.0, 55.0]]), (0.0, 100.0, 0.0, 100.0), 1e-3)
        yield from (reached, convex_overlap(triangle, reached))


@case
def crossed_layers() -> Iterable[ArrayLike]:
    """Scenes under two layers, of both signatures and of k, hard and soft."""
    for construction, lam in (("crs-crs", 0.0), ("crs-crs", 2.0), ("crs-m", 0.0)):
        problem, scene = two_triangles(construction, lam)
        for soft_mm, reach in ((0.0, 0.0), (1.0, 4.0)):
            found = problem.refine(scene, 12, soft_mm, reach)
            yield from (found.scene.corners, found.cost, found.information, found.gradient)


@case
def round_contacts() -> Iterable[ArrayLike]:
    """Ellipses, with contact resistance too, and what is left over of readings with faults."""
    for seed, lam in enumerate((0.0, 0.0, 2.0)):
        sensor = ts.Sensor(
            construction="crs-crs", strips=90, pitch_mm=1.0, length_mm=60.0, contact_lambda_mm=lam
        )
        x, random = sensor.x_mm, np.random.default_rng(seed)
        t = (x - x.mean()) / (0.5 * len(x))
        half = 0.2 * np.sqrt(1.0 - t * t)
        empty = FitProblem.of(sensor, x, {"kh": 0.0 * x, "kl": 0.0 * x}, 0.002)
        k = empty.readings_of(0.5 - half, 0.5 + half) + random.normal(0.0, 0.002, (2, len(x)))
        k[0, 30] += 0.1
        problem = FitProblem.of(sensor, x, {"kh": k[0], "kl": k[1]}, 0.002)
        fits = fit_counts(problem, every=True)
        ellipse = fit_ellipse(fits.chosen, problem)
        yield from (fit.theta for fit in fits.fits)
        yield from (fits.scores, ellipse.parameters, ellipse.information, fits.chosen.residuals(problem))


@case
def sets() -> Iterable[ArrayLike]:
    """Linear programs, points inside, centres and walks, with and without pairs and fading errors."""
    random = np.random.default_rng(0)
    for size, rows, pairs in ((5, 60, 0), (7, 301, 9), (24, 1500, 90)):
        a, slack = random.normal(size=(rows, size)), random.uniform(0.5, 1.0, rows)
        pair_a, pair_slack = random.normal(size=(pairs, 2, size)), random.uniform(-0.2, 1.0, (pairs, 2))
        pair_slack[:, 1] = np.abs(pair_slack[:, 1])
        at, active = np.zeros(size), np.full(size, -1)
        yield [lowest(form, a, slack, at, active) for form in random.normal(size=(5, size))]
        yield at
        for lack in (0.0, 3.0):
            at, outside, empty = minimax(a, slack - lack, random.normal(size=size), 1.0)
            yield from (at, outside, empty)
        found, rounds = feasible_part((a, slack), (pair_a, pair_slack), random.normal(size=size), 1.0, 8)
        yield rounds
        at, curvature = found or analytic_centre(a, slack, np.zeros(size))
        yield from (at, curvature)
        edges = np.linspace(0.0, 0.1, rows), np.linspace(0.0, 0.1, pairs)
        yield hit_and_run((a, slack, edges[0]), (pair_a, pair_slack, edges[1]), at, curvature, 50)


@case
def bounded_fits() -> Iterable[ArrayLike]:
    """Means and scatters of sets, with contact resistance too."""
    for seed, strips in enumerate((20, 60, 300)):
        sensor = ts.Sensor(
            construction="crs-crs",
            strips=strips,
            pitch_mm=1000.0 / strips,
            length_mm=1000.0,
            contact_lambda_mm=10.0 * (seed == 1),
        )
        contact = ts.Contact.polygon(convex_polygon(seed, 4 + seed % 3))
        noise = ts.Noise(positional=0.004, quantisation=0.001)
        scan = ts.simulate(sensor, contact, noise, rng=seed)
        for found in ts.fit_polygon(scan, sensor, noise).objects:
            assert found.guarantee is not None
            assert found.covariance is not None
            assert found.deviations is not None
            yield from (found.vertices, found.covariance, np.hstack(found.deviations))


def checksums() -> dict[str, str]:
    """Return a checksum of the bytes of each case's results."""
    return {
        name: sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in function())).hexdigest()
        for name, function in CASES.items()
    }


@case
def batches() -> Iterable[ArrayLike]:
    """Many scans in one pass: all kinds of shapes and errors, in both precisions; footprints of given contacts."""
    shapes = ts.Shapes(
        n=200, kinds={"polygon": 1, "circle": 1, "ellipse": 1}, objects=(0, 3), frames=3, spin_rad=1.0
    )
    noises = (ts.Noise(positional=0.005, quantisation=0.001), ts.Noise(positional=0.002, white=0.003))
    for lam, dtype, noise in ((0.0, "float32", noises[0]), (2.0, "float64", noises[1])):
        sensor = ts.Sensor(
            construction="crs-crs",
            strips=61,
            pitch_mm=2.0,
            length_mm=90.0,
            contact_lambda_mm=lam,
            adc_bits=12,
        )
        scans = ts.simulate_many(sensor, shapes, noise, rng=5, dtype=dtype)
        assert scans.labels is not None
        assert scans.l is not None
        yield from (scans["kh"], scans["kl"], scans.l)
        yield from vars(scans.labels).values()
    yield from ts.footprint(sensor, [ts.Contact.polygon(convex_polygon(s, 5) / 12.0) for s in range(20)])


@case
def regular_outlines() -> Iterable[ArrayLike]:
    """Particles of a disc, with contact resistance too, of which some kinds are given up."""
    for lam in (0.0, 2.0):
        sensor = ts.Sensor(
            construction="crs-crs", strips=25, pitch_mm=2.0, length_mm=60.0, contact_lambda_mm=lam
        )
        half = np.sqrt(25.0**2 - (sensor.x_mm - 25.0) ** 2) / 60.0
        k = ts.signatures(sensor, 30.0 - 60.0 * half, 30.0 + 60.0 * half)["kh"]
        problem = FitProblem.of(sensor, sensor.x_mm, {"kh": k}, 0.003)
        place = Placement.of(problem, (-0.02, 0.02, 0.98, 1.02))
        drawn = sample_regular(problem, place.compiled, 24, -40.0)
        assert drawn is not None
        yield from (drawn.numbers, drawn.log_prior, drawn.misfit, drawn.lowest, drawn.evidence, drawn.done)


@case
def outlines_drawn() -> Iterable[ArrayLike]:
    """The sampler of outlines, with one signature and both, known and unknown sigma, contact resistance and an area."""
    for signatures, lam, sigma in ((1, 0.0, (1.0, 1.0)), (2, 0.0, (0.1, 2.0)), (1, 2.0, (1.0, 1.0))):
        sensor = ts.Sensor(
            construction="crs-crs", strips=60, pitch_mm=1.0, length_mm=60.0, contact_lambda_mm=lam
        )
        t = (sensor.x_mm - 30.0) / 30.0
        k = 0.4 + 0.1 * t, 0.3 + 0.1 * np.abs(t)
        readings = dict(zip(("kh", "kl"), k[:signatures], strict=False))
        problem = FitProblem.of(sensor, sensor.x_mm, readings, 0.003)
        prior = OutlinePrior((-0.008, 0.008, 0.992, 1.008), sigma=sigma, area=0.2, area_sigma=0.05)
        chains = np.array([(0.0, 0.4), (1.0, 0.4)]), np.array([(0.0, 0.4), (0.5, 0.6), (1.0, 0.4)])
        drawn = sample_outlines(problem, prior, [outline_record(*chains)], 3000, 40)
        assert drawn is not None
        yield from (drawn.outlines["x"], drawn.outlines["y"], drawn.squares, drawn.log_prior, drawn.sigma)
        yield outline_ends(drawn.outlines, problem.x)
