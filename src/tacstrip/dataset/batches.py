"""Many scans at once: simulated in one pass of the core, and fitted on all cores."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import shapely

from tacstrip.arguments import takes
from tacstrip.arrays import FloatArray, IntArray
from tacstrip.contact.footprint import footprint
from tacstrip.contact.noise import Noise, NoiseProcess, Rng, digitise
from tacstrip.contact.shape import Contact
from tacstrip.contact.strip_width import wide, wide_ends
from tacstrip.core.batch import Arrays, batch, batch_sensor, drawn_errors
from tacstrip.core.binding import BatchErrors, BatchSensor
from tacstrip.dataset.scans import Labels, Scans
from tacstrip.dataset.shapes import KINDS, Shapes
from tacstrip.errors import ArgumentError, ContactError, OptionError, one_of
from tacstrip.interrupt import worker_processes
from tacstrip.reconstruction.methods import chosen_method, quick_options, reconstruct
from tacstrip.reconstruction.result import Reconstruction
from tacstrip.scan import Scan
from tacstrip.sensor.constructions import check_closed_form
from tacstrip.sensor.left_out import leave_out
from tacstrip.sensor.spec import Sensor
from tacstrip.simulation import simulate

_IDEAL = Noise()
_TYPES = ("float32", "float64")
_MODELS = ("closed", "network")
_AT_ONCE = 4096  # contacts whose footprints are found together
_ONE_THREAD = 2_000_000  # readings that one thread has done before others have begun
_PROCESS_S = 2.0  # work that is worth starting processes
_CHUNKS = 16  # of each process, for progress and an even end
_OF_OBJECTS = ("kind", "corners", "pose", "axes", "vertices")


@takes(sensor=Sensor, noise=Noise)
def simulate_many(
    sensor: Sensor,
    contacts: Sequence[Contact] | Shapes,
    noise: Noise | None = None,
    *,
    rng: Rng = 0,
    dtype: npt.DTypeLike = "float64",
    model: Literal["closed", "network"] | None = None,
    labels: bool = True,
    first: int = 0,
    workers: int | None = None,
) -> Scans:
    """Simulate many scans: of given contacts, or of shapes drawn at random.

    Every number is drawn by counter (Philox4x32-10), from the seed and the scan's number alone: the same scans whatever
    the number of threads and however they are divided into batches. The errors are not those that `simulate` draws.

    Parameters
    ----------
    sensor
        What is touched.
    contacts
        Contacts, a scan each, or distributions, `Shapes(n=...)`.
    noise
        Errors on the readings; ideal by default. What lasts, lasts for the scans of a scene.
    rng
        A seed, or a NumPy generator, from which one is drawn.
    dtype
        "float64" or "float32", of readings and labels.
    model
        As for `simulate`. By default strips as wide as `strip_width_mm` that no closed form fits are resolved, which
        takes up to seconds a scan; "closed" takes what their edges read for all of them.
    labels
        Whether l and u and what touched are kept.
    first
        Number of the first scan: a data set made in parts is the same as made at once.
    workers
        Threads; by default one a core for large batches.

    Returns
    -------
    Scans
        Readings (scans, strips), with labels.

    Raises
    ------
    ContactError
        A contact lies outside the sensor, ties a strip's both ends to a metal sheet, or has no room on it.
    OptionError
        There is no such model or type of number.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> scans = ts.simulate_many(sensor, ts.Shapes(n=1000), ts.Noise(positional=0.002), rng=1)
    >>> scans.kh.shape, bool((scans.u - scans.l)[scans.touched].min() >= 0.0)
    ((1000, 100), True)
    """
    kind = np.dtype(dtype).name if dtype is not None else "None"
    if kind not in _TYPES:
        raise OptionError(one_of("dtype", kind, _TYPES))
    if model is not None and model not in _MODELS:
        raise OptionError(one_of("model", model, _MODELS))
    drawn = contacts if isinstance(contacts, Shapes) else None
    if drawn is None:
        given = list(contacts) if isinstance(contacts, Sequence) else []
        if not given or not all(isinstance(c, Contact) for c in given):
            raise ArgumentError(
                "simulate_many: contacts must be a list of Contacts, or shapes to draw, ts.Shapes(n=1000)"
            )
    if not sensor.kind.closed_form and model == "closed":
        check_closed_form(sensor.kind, 'model="closed"')
    run = _Run(sensor, noise or _IDEAL, _key(rng), kind, model, labels, workers)
    if isinstance(contacts, Shapes):
        return run.drawn(contacts, first)
    return run.given(list(contacts), first)


@dataclass(frozen=True)
class _Run:
    """One call of `simulate_many`."""

    sensor: Sensor
    noise: Noise
    key: tuple[int, int]
    dtype: str
    model: Literal["closed", "network"] | None
    labels: bool
    workers: int | None

    @cached_property
    def errors(self) -> BatchErrors | None:
        """The errors as the core draws them; None where some last, are shared or stray, or codes differ in width."""
        noise = self.noise
        if (
            self.sensor.converter is not None
            or not (noise.independent or replace(noise, white=0.0).independent)
            or (noise.white and noise.white_shared)
        ):
            return None
        parts, variance = (noise.quantisation, noise.positional), noise.white**2
        if noise.distribution == "normal":
            parts, variance = (0.0, 0.0), variance + (parts[0] ** 2 + parts[1] ** 2) / 3.0
        return BatchErrors(self.key, parts, math.sqrt(variance))

    @cached_property
    def closed(self) -> bool:
        """Whether readings follow from l and u alone."""
        thin = self.sensor.strip_width_mm is None or self.model == "closed"
        even = self.sensor.surface is None  # on a curved skin resistance is not even along the strips
        return self.sensor.kind.closed_form and even and self.model != "network" and thin

    def drawn(self, shapes: Shapes, first: int) -> Scans:
        """Simulate shapes drawn at random, in one pass where closed forms and the core's errors do."""
        sensor, pace = self.sensor, shapes.frames
        laws = shapes.laws(sensor)
        if self.closed and sensor.strip_width_mm is None and self.errors is not None:
            workers = self.workers or (available_cores() if shapes.n * sensor.strips > _ONE_THREAD else 1)
            by = batch_sensor(sensor, self.dtype == "float32")
            out, shorted = batch(
                by, self.errors, first, shapes.n, laws=laws, labels=self.labels, workers=workers
            )
            self._refuse(shorted, first)
            number = first + np.arange(shapes.n)
            return self._scans(out, list(out["readings"]), number // pace, _frame_s(shapes, number))
        begin, parts, step = first - first % pace, [], -(-_AT_ONCE // pace) * pace  # whole scenes
        only = BatchSensor(sensor.strips, 1, 0, sensor.pitch_mm, sensor.length_mm, (0.0, 0.0), 0.5, 0.0, 0.0)
        for start in range(begin, first + shapes.n, step):
            count = min(step, first + shapes.n - start)
            out, _ = batch(only, BatchErrors(self.key), start, count, laws=laws)
            number = start + np.arange(count)
            scene, time_s = number // pace, _frame_s(shapes, number)
            labels = Labels(scene, **{name: out[name] for name in _OF_OBJECTS})
            contacts = [labels.contact(i) if labels.kind[i].any() else None for i in range(count)]
            ends = (out["l"], out["u"]) if sensor.strip_width_mm is None else self._ends(contacts)
            parts.append(self._touched(contacts, out, start, scene, time_s, ends))
        return _joined(parts)[first - begin :]

    def given(self, contacts: list[Contact], first: int) -> Scans:
        """Simulate contacts, a scan each."""
        corners = [shapely.get_num_coordinates(list(c.shapes)).max() for c in contacts]
        most = max(len(c.shapes) for c in contacts), int(max(corners))
        parts = []
        for start in range(0, len(contacts), _AT_ONCE):
            part = contacts[start : start + _AT_ONCE]
            scene = first + start + np.arange(len(part))
            out = _labels_of(part, *most) if self.labels else {}
            parts.append(
                self._touched(part, out, first + start, scene, np.zeros(len(part)), self._ends(part))
            )
        return _joined(parts)

    def _touched(
        self,
        contacts: Sequence[Contact | None],
        labels: Arrays,
        first: int,
        scene: IntArray,
        time_s: FloatArray,
        ends_mm: tuple[FloatArray, FloatArray],
    ) -> Scans:
        """Return the scans of contacts with known l and u, number `first` and following."""
        sensor, errors, names = self.sensor, self.errors, self.sensor.signatures
        if self.closed:
            by = batch_sensor(sensor)
            by.top = by.top if errors else 0.0
            given, workers = errors or BatchErrors(), self.workers or 1
            out, shorted = batch(
                by, given, first, len(contacts), ends_mm=ends_mm, labels=False, workers=workers
            )
            self._refuse(shorted, first)
            readings = dict(zip(names, out["readings"], strict=True))
        else:
            readings = self._one_by_one(contacts)
            if errors:
                more = drawn_errors(len(names), sensor.strips, errors, first + np.arange(len(contacts)))
                readings = {
                    n: digitise(readings[n] + e, sensor.adc_bits) for n, e in zip(names, more, strict=True)
                }
        if errors is None:
            readings = self._lasting(readings, scene, time_s, ends_mm)
        l, u = ends_mm
        return self._scans({**labels, "l": l, "u": u}, [readings[name] for name in names], scene, time_s)

    def _one_by_one(self, contacts: Sequence[Contact | None]) -> dict[str, FloatArray]:
        """Return ideal readings (scans, strips), not digitised, of contacts that no closed form covers."""
        ideal = replace(self.sensor, adc_bits=None, converter=None, without=())
        found = {name: np.full((len(contacts), ideal.strips), np.nan) for name in ideal.signatures}
        for i, contact in enumerate(contacts):
            if contact is not None:
                scan = simulate(ideal, contact, model=self.model)
                for name, k in found.items():
                    k[i] = scan[name]
        return found

    def _lasting(
        self,
        ideal: dict[str, FloatArray],
        scene: IntArray,
        time_s: FloatArray,
        ends_mm: tuple[FloatArray, FloatArray],
    ) -> dict[str, FloatArray]:
        """Return readings with errors of which some last for the scans of a scene."""
        found = {name: np.empty_like(k) for name, k in ideal.items()}
        seed = self.key[0] + (self.key[1] << 32)
        for begin, end in pairwise([*np.flatnonzero(np.diff(scene, prepend=-1)), len(scene)]):
            part = slice(begin, end)
            own = np.random.Philox(key=seed, counter=[0, 0, int(scene[begin]), 1])
            process = NoiseProcess(self.noise, self.sensor, np.random.Generator(own))
            ends = (ends_mm[0][part], ends_mm[1][part])
            for name, k in process.add({n: k[part] for n, k in ideal.items()}, time_s[part], ends).items():
                found[name][part] = digitise(k, self.sensor.adc_bits, self.sensor.converter)
        return found

    def _ends(self, contacts: Sequence[Contact | None]) -> tuple[FloatArray, FloatArray]:
        """Return l and u (scans, strips) [mm]; of wide strips those of the ideal contact that reads the same."""
        l, u = np.full((2, len(contacts), self.sensor.strips), np.nan)
        across = {i: wide(self.sensor, [c]) for i, c in enumerate(contacts) if c is not None}
        for is_wide in set(across.values()):
            which = [i for i, w in across.items() if w == is_wide]
            some = [c for i in which if (c := contacts[i]) is not None]
            found = wide_ends(self.sensor, some) if is_wide else footprint(self.sensor, some)
            l[which], u[which] = found.l, found.u
        return l, u

    def _scans(self, out: Arrays, readings: Sequence[Any], scene: IntArray, time_s: FloatArray) -> Scans:
        """Put a batch's arrays together."""
        of = dict(zip(self.sensor.signatures, readings, strict=True))
        kept: dict[str, Any] = {
            name: k.astype(self.dtype, copy=False) for name, k in leave_out(self.sensor, of).items()
        }
        if not self.labels:
            return Scans(**kept, time_s=time_s)
        floats = {
            name: out[name].astype(self.dtype, copy=False) for name in ("l", "u", "pose", "axes", "vertices")
        }
        kept |= {name: floats.pop(name) for name in ("l", "u")}
        labels = Labels(scene, kind=out["kind"], corners=out["corners"], **floats)
        return Scans(**kept, time_s=time_s, labels=labels)

    def _refuse(self, shorted: tuple[int, int] | None, first: int) -> None:
        if shorted is not None:
            raise ContactError(
                f"in scan {shorted[0] + first} a contact covers strip {shorted[1] + self.sensor.strip_base} from end "
                "to end: on metal that shorts Vref to ground, and nothing can be read; make it shorter than the strips"
            )


def _frame_s(shapes: Shapes, number: IntArray) -> FloatArray:
    """Return when scans of these numbers are made [s], from the beginning of their scene."""
    if shapes.frames == 1:
        return np.zeros(len(number))
    return np.asarray(shapes.period_s * (number % shapes.frames), dtype=float)


def _labels_of(contacts: Sequence[Contact], objects: int, corners: int) -> Arrays:
    """Return the labels of given contacts, as `core.batch` names them."""
    many = (len(contacts), objects)
    out: Arrays = {name: np.zeros(many, np.int64) for name in ("kind", "corners")}
    sizes = {"pose": (3,), "axes": (2,), "vertices": (corners, 2)}
    out |= {name: np.full((*many, *size), np.nan) for name, size in sizes.items()}
    for i, contact in enumerate(contacts):
        for o, shape in enumerate(contact.shapes):
            one = Contact((shape,))
            polygon = shape.geom_type == "Polygon"
            xy = one.vertices if polygon else shapely.get_coordinates(shape)
            kind = "polygon" if polygon else "line" if shape.geom_type == "LineString" else "points"
            out["kind"][i, o], out["corners"][i, o] = KINDS.index(kind), len(xy)
            out["pose"][i, o, :2], out["vertices"][i, o, : len(xy)] = one.centroid, xy
    return out


def _joined(parts: Sequence[Scans]) -> Scans:
    """Put batches of one run together."""
    if len(parts) == 1:
        return parts[0]
    names = [
        name for name in (*parts[0].signatures, "time_s", "l", "u") if getattr(parts[0], name) is not None
    ]
    together: dict[str, Any] = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
    labels = [p.labels for p in parts if p.labels is not None]
    if labels:
        together["labels"] = Labels(
            **{n: np.concatenate([vars(p)[n] for p in labels]) for n in vars(labels[0])}
        )
    return Scans(**together)


def _key(rng: Rng) -> tuple[int, int]:
    """Return the key of the core's generator for a seed, or drawn from a generator."""
    if isinstance(rng, np.random.Generator):
        low, high = rng.integers(0, 2**32, 2)
    elif isinstance(rng, int | np.integer) and rng >= 0:
        low, high = np.random.SeedSequence(int(rng)).generate_state(2)
    else:
        raise OptionError(f"rng = {rng!r}: give a seed, a whole number from 0 on, or a NumPy generator")
    return int(low), int(high)


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def fit_many(
    scans: Scans | Sequence[Scan],
    sensor: Sensor,
    noise: Noise | None = None,
    *,
    method: str | None = "auto",
    workers: int | None = None,
    progress: Callable[[int], object] | None = None,
    **options: Any,
) -> list[Reconstruction]:
    """Reconstruct every scan, on all cores; results are in the order of the scans.

    Half of a fit's time is spent outside the compiled core, where threads wait for each other: large batches are
    divided among processes, which start in about a second. Where processes are spawned (Windows, macOS), a script that
    fits large batches needs `if __name__ == "__main__":` round what it does.

    Parameters
    ----------
    scans, sensor, noise
        What was measured, with what, and its errors, as for `reconstruct`.
    method, **options
        As for `reconstruct`; the polygon fit's assessment is "fast" by default.
    workers
        Processes; by default one a core where the batch is large enough to be worth them, and none otherwise.
    progress
        Called with the number of scans that are done, from time to time.

    Raises
    ------
    OptionError, SignatureError, ReadingError
        As of `reconstruct`.

    Examples
    --------
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-crs", strips=100, pitch_mm=1.0, length_mm=100.0)
    >>> noise = ts.Noise(positional=0.002)
    >>> scans = ts.simulate_many(sensor, ts.Shapes(n=5), noise, rng=1)
    >>> len(ts.fit_many(scans, sensor, noise))
    5
    """
    name = chosen_method(method, sensor)
    fit = partial(
        _fit_some, sensor=sensor, noise=noise, method=name, options={**quick_options(name), **options}
    )
    tell = progress or (lambda _: None)
    found: list[Reconstruction] = []
    count = available_cores() if workers is None else max(int(workers), 1)
    many = scans if isinstance(scans, Scans) else list(scans)
    begun = time.perf_counter()
    while len(found) < len(many):  # one by one, until it is sure that others are worth their start
        took = time.perf_counter() - begun
        rest_s = took / max(len(found), 1) * (len(many) - len(found))
        if count > 1 and len(found) and (rest_s > _PROCESS_S * count or workers is not None):
            break
        found += fit(many[len(found) : len(found) + 1])
        tell(len(found))
    if len(found) == len(many):
        return found
    step = max(1, (len(many) - len(found)) // (_CHUNKS * count))
    starts = range(len(found), len(many), step)
    with worker_processes(count) as processes:
        for part in processes.map(fit, (many[i : i + step] for i in starts)):
            found += part
            tell(len(found))
    return found


def _fit_some(
    scans: Scans | Sequence[Scan], sensor: Sensor, noise: Noise | None, method: str, options: dict[str, Any]
) -> list[Reconstruction]:
    return [reconstruct(scan, sensor, noise, method=method, **options) for scan in scans]
