"""Objects that share strips for a while: scenes drawn and read without the package, and how far `ts.track` is off.

Run: python -m studies.holdout.shared_strips_set --set unknown --cases 40 --seed 0
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass

import numpy as np
import shapely

import tacstrip as ts
from studies.holdout.readings import Unit
from studies.holdout.shapes import Array
from tacstrip.arrays import BoolArray, IntArray

SETS = {  # strips, scans, of which each is alone at its end, radius [mm], how they come and go
    "known": (100, 60, 20, (13.0, 19.0), "put"),
    "unknown": (32, 60, 15, (13.0, 19.0), "put"),
    "ten": (10, 90, 30, (17.0, 23.0), "put"),
    "meet": (40, 70, 15, (8.0, 12.0), "pass"),
    "three": (64, 90, 15, (9.0, 13.0), "one by one"),
}
HALF_WIDTH = 0.005
CLAIMS = ("ok", "likely")  # a status that promises right poses
WRONG_MM, WRONG_DEG = 1.0, 4.0  # a pose that is further off is wrong
NEAR_MM, LEAST_SHARED = 0.5, 0.3
OWN = 0.05  # of an object's strips that it has to itself


@dataclass(frozen=True, eq=False)
class Scene:
    """What lies where: outlines, poses (T, K, 3), and whether each is there (T, K)."""

    unit: Unit
    outlines: list[Array]
    poses: Array
    present: BoolArray

    def placed(self, scan: int, one: int) -> Array:
        """Return the corners of one object on the sensor."""
        return at(self.outlines[one], self.poses[scan, one])

    def scans(self, random: np.random.Generator) -> list[ts.Scan]:
        """Return what the unit reads, with noise."""
        found = []
        for i in range(len(self.poses)):
            read = self.unit.read(*self.unit.touched([self.placed(i, k) for k in _numbers(self.present[i])]))
            read = read + random.uniform(-HALF_WIDTH, HALF_WIDTH, read.shape)
            found.append(ts.Scan(**dict(zip(self.unit.names, read, strict=True)), time_s=0.02 * i))
        return found

    def strips_of(self, scan: int, one: int) -> BoolArray:
        """Return which strips one object lies on (strips,)."""
        x = self.placed(scan, one)[:, 0]
        return np.asarray((self.unit.x > x.min()) & (self.unit.x < x.max()))

    def joint(self) -> BoolArray:
        """Whether each shares strips with another in a scan (T, K)."""
        found = np.zeros(self.present.shape, dtype=bool)
        for i, there in enumerate(self.present):
            on = {k: self.strips_of(i, k) for k in _numbers(there)}
            for k, mine in on.items():
                found[i, k] = any((mine & other).any() for j, other in on.items() if j != k)
        return found

    def own_share(self, scan: int, one: int) -> float:
        """Return which share of its strips one object has to itself."""
        mine = self.strips_of(scan, one)
        others = np.zeros_like(mine)
        for k in _numbers(self.present[scan]):
            if k != one:
                others |= self.strips_of(scan, k)
        return float((mine & ~others).sum() / max(mine.sum(), 1))


def _numbers(which: BoolArray) -> list[int]:
    return [int(i) for i in np.flatnonzero(which)]


def at(corners: Array, pose: Array) -> Array:
    """Return corners (N, 2) at a pose x, y, angle."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + pose[:2])


def polygon(random: np.random.Generator, radius: tuple[float, float]) -> Array:
    """Return a convex outline of 3 to 6 clear corners about its centroid."""
    while True:
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, random.integers(3, 7)))
        gaps = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
        corners = random.uniform(*radius) * np.stack(
            [np.cos(angle), random.uniform(0.7, 1.0) * np.sin(angle)], axis=1
        )
        heading = np.arctan2(*(np.roll(corners, -1, axis=0) - corners).T[::-1])
        turns = (np.roll(heading, -1) - heading + np.pi) % (2.0 * np.pi) - np.pi
        if gaps.min() > 0.5 and gaps.max() < 2.6 and turns.min() > 0.35:
            return np.asarray(corners - shapely.get_coordinates(shapely.Polygon(corners).centroid))


def way(random: np.random.Generator, scans: int, slide: float, turn: float) -> Array:
    """Return poses (T, 3) about 0 of a smooth way so long [mm], turned by so much [rad]."""
    t, lean = np.linspace(-0.5, 0.5, scans), random.uniform(-0.8, 0.8)
    eased = t + 0.1 * np.sin(2.0 * np.pi * t + random.uniform(0.0, 6.0))
    wave = np.sin(np.outer([6.0, 5.0, 7.0], t) + random.uniform(0.0, 6.0, (3, 1))) * np.array(
        [[1.0], [1.0], [0.03]]
    )
    go = random.choice([-1, 1]) * slide * eased
    return np.stack(
        [go * math.cos(lean) + wave[0], go * math.sin(lean) + wave[1], turn * eased + wave[2]], axis=1
    )


def draw(name: str, random: np.random.Generator) -> Scene:
    """Return a scene of a set of `SETS`."""
    strips, total, lone, radius, kind = SETS[name]
    unit = Unit(("kh", "kl"), strips, 100.0 / strips, 100.0)
    count = 3 if kind == "one by one" else 2
    while True:
        outlines, poses = [polygon(random, radius) for _ in range(count)], np.empty((total, count, 3))
        present = np.ones((total, count), dtype=bool)
        for k in range(count):
            turn = random.choice([-1, 1]) * np.radians(random.uniform(20.0, 90.0))
            if name == "ten":  # thirty lone scans that turn by 20 degrees or more
                turn *= total / lone
            poses[:, k] = way(random, total, random.uniform(6.0, 25.0), turn)
            poses[:, k] += (*random.uniform(25.0, 75.0, 2), random.uniform(0.0, 6.3))
        if kind == "put":
            present[:lone, 1] = present[total - lone :, 0] = False
        elif kind == "one by one":
            # each by itself, then the third, with the first, with both, and without the first again
            present[:] = False
            for k in range(count):
                present[k * (lone + 2) : k * (lone + 2) + lone, k] = True
            third = count * (lone + 2) - 2
            present[third:, 2] = present[third : total - 12, 0] = present[third + 12 :, 1] = True
        else:  # from both sides past each other
            side = np.linspace(-32.0, 32.0, total)
            for k, sign in enumerate((1.0, -1.0)):
                poses[:, k, :2] -= poses[:, k, :2].mean(axis=0)
                poses[:, k, 0] = 50.0 + sign * side + 0.1 * poses[:, k, 0]
                poses[:, k, 1] = 0.3 * poses[:, k, 1] + 50.0 - sign * random.uniform(12.0, 16.0)
        scene = Scene(unit, outlines, poses, present)
        if _possible(scene, lone, kind):
            return scene


def _possible(scene: Scene, lone: int, kind: str) -> bool:
    placed = {(i, k): scene.placed(i, k) for i, k in np.argwhere(scene.present).tolist()}
    if min(p.min() for p in placed.values()) < 1.0 or max(p.max() for p in placed.values()) > 99.0:
        return False
    for i in range(0, len(scene.poses), 3):
        there = [shapely.Polygon(placed[i, k]) for k in _numbers(scene.present[i])]
        if any(a.distance(b) < NEAR_MM for j, a in enumerate(there) for b in there[:j]):
            return False
    joint = scene.joint()
    if kind == "pass":
        return bool(8 <= joint.any(axis=1).sum() <= len(joint) - 2 * lone)
    both = scene.present.sum(axis=1) > 1
    if kind == "one by one":
        return bool(joint[both].any(axis=1).all())
    shared = [1.0 - scene.own_share(i, k) for i, k in np.argwhere(scene.present & both[:, None]).tolist()]
    return bool(np.mean(shared) > LEAST_SHARED)


@dataclass(frozen=True)
class Score:
    """Of one object of a scene, in the scans in which it shares strips; errors of every scan, inf where no pose."""

    off_mm: Array
    off_deg: Array
    own: Array
    status: str
    held: BoolArray  # whether the covariance says that the pose is known

    @property
    def solved(self) -> bool:
        """Whether its poses are right nearly everywhere."""
        d, a = self.off_mm, self.off_deg
        return bool(np.median(d) < WRONG_MM and np.quantile(d, 0.9) < 3.0 and np.median(a) < WRONG_DEG)

    @property
    def silent(self) -> BoolArray:
        """Whether each pose is wrong and nothing says so."""
        wrong = np.isfinite(self.off_mm) & ((self.off_mm > WRONG_MM) | (self.off_deg > WRONG_DEG))
        return np.asarray(wrong & (self.status in CLAIMS))


def score(scene: Scene, tracks: list[ts.Track]) -> list[Score]:
    """Return how far the tracks are off, each object's being the one that is nearest where it is by itself."""
    joint = scene.joint()
    found = []
    for k in range(len(scene.outlines)):
        alone, shared = np.flatnonzero(scene.present[:, k] & ~joint[:, k]), np.flatnonzero(joint[:, k])
        off = [_off(scene, k, t, alone) for t in tracks]
        best = min(range(len(tracks)), key=lambda i: np.median(off[i][0]))
        turned = off[best][1][np.isfinite(off[best][1])]
        frame = np.angle(np.exp(1j * turned).mean()) if len(turned) else 0.0
        d, a = _off(scene, k, tracks[best], shared)
        a = np.degrees(np.abs((a - frame + np.pi) % (2.0 * np.pi) - np.pi))
        spread = tracks[best].pose_covariances[shared]
        held = (np.sqrt(spread[:, 0, 0] + spread[:, 1, 1]) < WRONG_MM / 2) & (
            spread[:, 2, 2] < np.radians(WRONG_DEG / 2) ** 2
        )
        found.append(
            Score(
                d,
                np.where(np.isfinite(a), a, np.inf),
                np.array([scene.own_share(int(i), k) for i in shared]),
                tracks[best].status,
                held,
            )
        )
    return found


def _off(scene: Scene, one: int, track: ts.Track, scans: IntArray) -> tuple[Array, Array]:
    """Return distances of the centroids [mm], inf where there is no pose, and differences of the angles."""
    d, a = np.full(len(scans), np.inf), np.full(len(scans), np.nan)
    for row, i in enumerate(scans):
        if len(track.outline) and np.isfinite(track.poses[i]).all():
            (x, y), (x0, y0) = (
                shapely.get_coordinates(shapely.Polygon(p).centroid)[0]
                for p in (track.placed(int(i)), scene.placed(i, one))
            )
            d[row], a[row] = math.hypot(x - x0, y - y0), track.poses[i, 2] - scene.poses[i, one, 2]
    return d, a


def main() -> None:
    """Print a line for a set."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--set", default="unknown", choices=SETS)
    options.add_argument("--cases", type=int, default=20)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--verbose", action="store_true")
    given = options.parse_args()
    rows: list[tuple[Scene, list[ts.Track], list[Score]]] = []
    spent, scans = 0.0, 0
    for case in range(given.first, given.first + given.cases):
        random = np.random.default_rng([given.seed, list(SETS).index(given.set), case])
        scene = draw(given.set, random)
        read = scene.scans(random)
        begun = time.thread_time()
        tracks = ts.track(read, scene.unit.sensor, ts.Noise(positional=HALF_WIDTH))
        own = time.thread_time() - begun
        spent, scans = spent + own, scans + len(read)
        rows.append((scene, tracks, score(scene, tracks)))
        if given.verbose:
            _tell(case, tracks, rows[-1][2], 1e3 * own / len(read))
    every = [s for _, _, ss in rows for s in ss]
    good = [ss for _, _, ss in rows if all(s.solved for s in ss)]
    d, a, alone = (
        np.concatenate([getattr(s, n) for ss in good for s in ss] or [np.array([np.nan])])
        for n in ("off_mm", "off_deg", "own")
    )
    far = np.quantile(d[alone >= OWN], 0.95) if bool(np.any(alone >= OWN)) else math.nan
    wrong = [any(not s.solved and s.status in CLAIMS for s in ss) for _, _, ss in rows]
    # A wrong scene of which no track is doubtful; poses that are not given are told by the track that has these scans.
    silent = [w and all(one.status in CLAIMS for one in t) for w, (_, t, _) in zip(wrong, rows, strict=True)]
    doubted = [all(s.solved for s in ss) and any(s.status not in CLAIMS for s in ss) for _, _, ss in rows]
    counted = [len(t) == len(s.outlines) for s, t, _ in rows]
    line = (
        f"{given.set}: {len(rows)} scenes, solved {len(good) / len(rows):.2f}, wrong and ok {np.mean(wrong):.3f}, "
        f"no track doubtful {np.mean(silent):.3f}; "
        f"of all poses silently wrong {np.concatenate([s.silent for s in every]).mean():.4f}; solved and doubtful "
        f"{np.mean(doubted):.2f}; count of tracks right {np.mean(counted):.2f}; solved: median {np.median(d):.3f} mm "
        f"{np.median(a):.2f} deg, 90 % {np.quantile(d, 0.9):.3f} mm, 95 % where 5 % own {far:.3f} mm; "
        f"{1e3 * spent / scans:.0f} ms a scan\n"
    )
    sys.stdout.write(line)


def _tell(case: int, tracks: list[ts.Track], scores: list[Score], spent: float) -> None:
    sys.stdout.write(f"{case} {len(tracks)} tracks {spent:.0f} ms a scan\n")
    for one in scores:
        far = np.quantile(one.off_mm, 0.9, method="lower")
        sys.stdout.write(
            f"   {one.status:9} solved {one.solved} silent {one.silent.mean():.2f} pose {np.median(one.off_mm):.3f} "
            f"p90 {far:.2f} mm {np.median(one.off_deg):.2f} deg; held {one.held.mean():.2f}\n"
        )
    for t in tracks:
        sys.stdout.write(f"      {t.id} {t.status} {len(t.outline)} {t.advice}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
