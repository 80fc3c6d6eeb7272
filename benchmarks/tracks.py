"""How well `tacstrip.track` knows a shape and its poses, beside the bound and what a user would do otherwise.

That is single-scan fits, averaged, and a Kalman filter on their centroid and angle. Convex polygons of 3 to 6 clear
corners slide and turn over a sensor of 100 mm by 100 mm, uniform noise. RMS over corners, moved and turned onto the
true ones; of fits with the right count.
Run: python benchmarks/tracks.py [--scenes 20] [--seed 1]
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
import shapely

import tacstrip as ts
from tacstrip.arrays import FloatArray
from tacstrip.tracking.rigid.covariance import joint_bound

ROWS = (  # strips, noise, scans, signatures, motion
    (10, 0.002, 50, "both", "any"),
    (10, 0.005, 50, "both", "any"),
    (10, 0.01, 50, "both", "any"),
    (10, 0.005, 20, "both", "any"),
    (10, 0.005, 200, "both", "any"),
    (100, 0.005, 50, "both", "any"),
    (10, 0.005, 50, "kh", "any"),
    (100, 0.005, 50, "kh", "any"),
    (10, 0.005, 50, "both", "along"),
    (10, 0.005, 50, "both", "two objects"),
)


def main() -> None:
    """Print a line for every kind of scene."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--scenes", type=int, default=20)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    print(
        "| strips | noise | scans | of | motion | ok | count | RMS | 90 % | over the bound | averaged "
        "| place | filtered | angle | filtered | ms a scan |"
    )
    print("| --- " * 16 + "|")
    notes = []
    for row in ROWS:
        cells, alone = _row(*row, given.scenes, given.seed)
        print("|", " | ".join(cells), "|", flush=True)
        if alone:
            notes.append(f"{', '.join(cells[:5])}: {alone} of {given.scenes}")
    if notes:
        print("\nScenes of which no single scan gave a fit, which have no filtered pose:", "; ".join(notes))


def _row(
    strips: int, level: float, scans: int, names: str, motion: str, scenes: int, seed: int
) -> tuple[list[str], int]:
    """Return a row of the table, and how many scenes have no filtered poses."""
    sensor = ts.Sensor(construction="crs-crs", strips=strips, pitch_mm=100.0 / strips, length_mm=100.0)
    noise, random = ts.Noise(positional=level), np.random.default_rng([seed, strips, scans])
    found = np.array([_scene(random, sensor, noise, scans, names, motion) for _ in range(scenes)])
    ok, error, bound, averaged, place, other_place, angle, other_angle, spent = found.T
    right = np.isfinite(error)
    shown = [f"{strips}", f"{100 * level:g} %", f"{scans}", names, motion, f"{ok.mean():.2f}"]
    if motion != "any":
        return [*shown, *["-"] * 9, f"{np.median(spent):.1f}"], 0
    ratio = "-" if np.isnan(bound).all() else f"{np.median(error[right] / bound[right]):.2f}"
    cells = [
        *shown, f"{right.mean():.2f}", f"{np.median(error[right]):.3f}", f"{np.quantile(error[right], 0.9):.3f}",
        ratio, f"{np.nanmedian(averaged):.2f}", f"{np.median(place):.2f}", f"{np.nanmedian(other_place):.2f}",
        f"{np.median(angle):.2f}", f"{np.nanmedian(other_angle):.2f}", f"{np.median(spent):.1f}",
    ]  # fmt: skip
    return cells, int(np.isnan(other_place).sum())


def _scene(
    random: np.random.Generator, sensor: ts.Sensor, noise: ts.Noise, scans: int, names: str, motion: str
) -> tuple[float, ...]:
    """Return whether it was called ok, errors and the time.

    RMS errors of the corners, their bound, those of averaged fits [mm]; of the place [mm] and of the angle [deg], each
    of the track and of a filter; the time [ms a scan].
    """
    sizes = (10.0, 14.0) if motion == "two objects" else (22.0, 30.0) if sensor.strips < 20 else (14.0, 20.0)
    while True:
        shapes = [_polygon(random, sizes) for _ in range(1 + (motion == "two objects"))]
        ways = [_way(random, scans, motion, i - 0.5 * (len(shapes) - 1)) for i in range(len(shapes))]
        placed = [np.array([_at(v, p) for p in way]) for v, way in zip(shapes, ways, strict=True)]
        inside = all(p.min() > 1.0 and p.max() < 99.0 for p in placed)
        if inside and (len(placed) == 1 or placed[0][..., 1].max() < placed[1][..., 1].min()):
            break
    read = []
    for i in range(scans):
        contact = ts.Contact(tuple(ts.Contact.polygon(p[i]).shapes[0] for p in placed))
        scan = ts.simulate(sensor, contact, noise, rng=int(random.integers(1 << 30)), time_s=0.01 * i)
        read.append(scan if names == "both" else ts.Scan(kh=scan["kh"], time_s=scan.time_s))
    begun = time.thread_time()
    tracks = ts.track(read, sensor, noise)
    spent = 1e3 * (time.thread_time() - begun) / scans
    ok = float(any(t.status == "ok" for t in tracks))
    if motion != "any":
        return ok, *[math.nan] * 7, spent
    turn = float(np.ptp(ways[0][:, 2]))
    bound = joint_bound(
        sensor, placed[0][scans // 2], scans, float(np.ptp(ways[0][:, 0])), turn, noise.positional / math.sqrt(3.0)
    ) if names == "both" else np.full((2, 2), np.nan)  # fmt: skip
    fits = [ts.fit_polygon(s, sensor, noise, bounded=False, assessment="none").objects[0] for s in read]
    averaged = _averaged([fit.vertices for fit in fits], shapes[0])
    own = np.array([_centre(track_outline) for track_outline in map(tracks[0].placed, range(scans))])
    filtered = _filtered([(*fit.centroid, fit.orientation) for fit in fits])
    poses = [
        error
        for places, angles in ((own, tracks[0].poses[:, 2]), (filtered[:, :2], filtered[:, 2]))
        for error in _pose_errors(places, angles, ways[0])
    ]
    error = _error(tracks[0].outline, shapes[0])
    return ok, error, ts.vertex_rms(bound), averaged, poses[0], poses[2], poses[1], poses[3], spent


def _centre(outline: FloatArray) -> tuple[float, float]:
    middle = shapely.Polygon(outline).centroid
    return middle.x, middle.y


def _pose_errors(places: FloatArray, angles: FloatArray, way: FloatArray) -> tuple[float, float]:
    """Return the RMS errors of a centroid [mm] and of an angle [deg], whose zero is free, over a way."""
    off = places - way[:, :2]
    turned = np.angle(np.exp(1j * (angles - way[:, 2])))
    turned = np.angle(np.exp(1j * (turned - np.angle(np.exp(1j * turned).mean()))))
    return math.sqrt(float((off**2).sum(axis=1).mean())), math.degrees(math.sqrt(float((turned**2).mean())))


def _filtered(measured: list[tuple[float, float, float]]) -> FloatArray:
    """Return x, y and angle (T, 3) after a Kalman filter of constant velocity, forwards and back (Rauch-Tung-Striebel).

    Its noise is what the measurements scatter by about their own smooth way, its acceleration the one of several that
    explains them best: as well as it can be tuned. Angles of a principal axis are followed over half turns.
    """
    z, every = np.array(measured), np.arange(len(measured))
    seen = np.isfinite(z).all(axis=1)  # a scan that gives no shape is bridged
    if not seen.any():
        return np.full_like(z, math.nan)
    z = np.stack([np.interp(every, every[seen], column[seen]) for column in z.T], axis=1)
    z[:, 2] = 0.5 * np.unwrap(2.0 * z[:, 2])
    found = np.empty_like(z)
    for axis in range(3):
        noise = max(float(np.var(np.diff(z[:, axis], 2))) / 6.0, 1e-9)
        tries = (_smoothed(z[:, axis], noise, noise * share) for share in np.geomspace(1e-6, 1.0, 7))
        found[:, axis] = max(tries, key=lambda t: t[1])[0]
    return found


def _smoothed(z: FloatArray, noise: float, change: float) -> tuple[FloatArray, float]:
    """Return a smoothed series (T,) and its log likelihood: variances of a value and of a velocity's change."""
    step, drift = np.array([[1.0, 1.0], [0.0, 1.0]]), change * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    state, spread = np.array([z[0], 0.0]), np.diag([noise, 1e2 * noise])
    before, after, likelihood = [], [], 0.0
    for i, value in enumerate(z):
        if i:
            state, spread = step @ state, step @ spread @ step.T + drift
        before.append((state, spread))
        off, total = value - state[0], spread[0, 0] + noise
        likelihood -= 0.5 * (off**2 / total + math.log(total))
        gain = spread[:, 0] / total
        state, spread = state + gain * off, spread - np.outer(gain, spread[0])
        after.append((state, spread))
    found, smooth = np.empty(len(z)), after[-1][0]
    found[-1] = smooth[0]
    for i in range(len(z) - 2, -1, -1):
        state, spread = after[i]
        back = spread @ step.T @ np.linalg.inv(before[i + 1][1])
        smooth = state + back @ (smooth - before[i + 1][0])
        found[i] = smooth[0]
    return found, likelihood


def _polygon(random: np.random.Generator, sizes: tuple[float, float]) -> FloatArray:
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 7)))
        gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
        radius, flat = random.uniform(*sizes), random.uniform(0.7, 1.0)
        corners = np.stack([radius * np.cos(angle), flat * radius * np.sin(angle)], axis=1)
        edge = np.roll(corners, -1, axis=0) - corners
        heading = np.arctan2(edge[:, 1], edge[:, 0])
        turns = (np.roll(heading, -1) - heading + np.pi) % (2.0 * np.pi) - np.pi
        if gaps.min() > 0.5 and gaps.max() < 2.6 and turns.min() > 0.35:
            return np.asarray(corners - shapely.get_coordinates(shapely.Polygon(corners).centroid))


def _way(random: np.random.Generator, scans: int, motion: str, side: float) -> FloatArray:
    """Return poses (T, 3): across the strips by 6 to 25 mm, turning by 20 to 90 degrees, or both; or along them."""
    t, angle = np.linspace(0.0, 1.0, scans), random.uniform(0.0, 2.0 * np.pi)
    eased = t + 0.12 * np.sin(2.0 * np.pi * t + random.uniform(0.0, 6.0)) - 0.5
    if motion == "along":
        middle = 50.0 + random.uniform(-6.0, 6.0)
        return np.stack(
            [np.full(scans, middle), 50.0 + random.uniform(6.0, 25.0) * (t - 0.5), np.full(scans, angle)],
            axis=1,
        )
    kind = random.integers(3) if motion == "any" else 2
    turn = 0.0 if kind == 0 else random.choice([-1, 1]) * np.radians(random.uniform(20.0, 90.0))
    go = 0.0 if kind == 1 else random.choice([-1, 1]) * random.uniform(6.0, 25.0)
    lean, start = random.uniform(-0.7, 0.7), random.uniform(-6.0, 6.0, 2)
    wave = np.sin(np.outer([6.0, 5.0, 7.0], t) + random.uniform(0.0, 6.0, (3, 1))) * np.array(
        [[1.0], [1.0], [0.03]]
    )
    x = 50.0 + start[0] + go * np.cos(lean) * eased + wave[0]
    y = 50.0 + start[1] + 44.0 * side + go * np.sin(lean) * eased + wave[1]
    return np.stack([x, y, angle + turn * eased + wave[2]], axis=1)


def _at(corners: FloatArray, pose: FloatArray) -> FloatArray:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def _onto(found: FloatArray, true: FloatArray) -> FloatArray:
    """Return corners moved and turned onto the true ones, in their order and about their mean."""
    b, best = true - true.mean(axis=0), (math.inf, true)
    for shift in range(len(true)):
        a = np.roll(found, shift, axis=0)
        a = a - a.mean(axis=0)
        u, _, v = np.linalg.svd(a.T @ b)
        moved = a @ u @ np.diag([1.0, np.sign(np.linalg.det(u @ v))]) @ v
        best = min(best, (float(((moved - b) ** 2).sum()), moved), key=lambda pair: pair[0])
    return best[1]


def _error(found: FloatArray, true: FloatArray) -> float:
    if len(found) != len(true):
        return math.nan
    return math.sqrt(float(((_onto(found, true) - (true - true.mean(axis=0))) ** 2).sum(axis=1).mean()))


def _averaged(fits: list[FloatArray], true: FloatArray) -> float:
    """Return the error of the mean of single-scan fits of the right count, each moved onto the true shape."""
    alike = [_onto(f, true) for f in fits if len(f) == len(true)]
    if not alike:
        return math.nan
    return _error(np.mean(alike, axis=0), true)


if __name__ == "__main__":
    main()
