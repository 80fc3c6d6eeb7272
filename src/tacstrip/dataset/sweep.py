"""Studies of many designs: parameters of a file, batches named by what is in them, results in Parquet.

A batch is a few designs, 1 to 10 s of work. Its name is the hash of its parameters and of all else that decides its
rows, so that a study that is ended, divided among machines or extended never does a batch twice. A worker that is lost
costs the batch that it had.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tacstrip.contact.noise import Noise
from tacstrip.dataset.batches import available_cores
from tacstrip.dataset.measures import COST_S, DEFINITIONS, MEASURES, PROBLEM, Case, Row, columns, measure
from tacstrip.dataset.shapes import Shapes
from tacstrip.dataset.study import Study, optional
from tacstrip.errors import OptionError, SpecError, TacstripError, one_of
from tacstrip.files import replacing
from tacstrip.interrupt import children_end, worker_pool
from tacstrip.io.csv_rows import csv_writer
from tacstrip.sensor.constructions import construction
from tacstrip.sensor.spec import KEYS as SENSOR_KEYS
from tacstrip.sensor.spec import Sensor

KEYS = ("name", "seed", "sensor", "shapes", "noise", "vary", "latin", "measure")
_TABLES = ("sensor", "shapes", "noise")
_WHOLE = [
    f"{table}.{key}"
    for table, kind in (("sensor", Sensor), ("shapes", Shapes), ("noise", Noise))
    for key, of in kind.__annotations__.items()
    if str(of).startswith("int")
]  # parameters of whole numbers
_OF_RANGE = ("from", "to", "steps", "log", "whole")
_OF_MEASURE = ("what", "scans", "batch_designs")
_BATCH_S = 3.0  # of work in a batch, by the rough costs of measures
_MOST_DESIGNS = 10**9
_MOST = 10**6  # scans of a design, samples, steps of a range
_TRIES = 3  # of a batch whose worker is lost


@dataclass(frozen=True)
class Batch:
    """Neighbouring designs: the name, the first one's number, and how many."""

    name: str
    first: int
    designs: int


@dataclass(frozen=True)
class Work:
    """What a worker is given: all designs have the base, each its own parameters."""

    base: Case
    parameters: tuple[dict[str, Any], ...]
    measures: tuple[str, ...]
    seed: int


@dataclass(frozen=True)
class Sweep:
    """What a study file asks for.

    Attributes
    ----------
    name, seed, base, measures, batch_designs
        Its name, the seed of shapes and errors, the design that parameters are changed of, some of `MEASURES`, and how
        many designs a batch has.
    vary
        Values by parameter, such as "sensor.pitch_mm": every combination is a design.
    latin
        Parameters of the Latin hypercube, and a row of values for each of its points; combined with all of `vary`.

    Raises
    ------
    SpecError
        The study cannot be; the message names the table and the key.
    """

    name: str
    seed: int
    base: Case
    measures: tuple[str, ...]
    batch_designs: int
    vary: dict[str, tuple[Any, ...]]
    latin: tuple[tuple[str, ...], tuple[tuple[Any, ...], ...]]

    @classmethod
    def load(cls, path: Path) -> Sweep:
        """Read a study file."""
        study = Study.load(path, KEYS)
        sensor = study.sensor()
        wanted = study.table("measure", _OF_MEASURE, needed=True)
        with study.naming("measure"):
            what = wanted.get("what", ["bound"])
            if not isinstance(what, list) or not what:
                raise OptionError(f'what = {what!r}: give a list, such as ["bound", "polygon"]')
            for one in what:
                if one not in MEASURES:
                    raise OptionError(one_of("measure", one, MEASURES))
            scans = _count("scans", wanted.get("scans", 20))
        with study.naming("shapes"):
            if "n" in study.table("shapes"):
                raise OptionError("n: how many scans a design is tried with is `scans` in [measure]")
            shapes = Shapes.from_dict({**study.table("shapes"), "n": scans})
        base = Case(sensor, shapes, study.noise(sensor))
        vary: dict[str, tuple[Any, ...]] = {}
        with study.naming("vary"):
            for key, given in _parameters(study.table("vary")):
                vary[key] = _values(key, given)
        seed = study.whole("seed", 0)
        with study.naming("latin"):
            table = dict(study.table("latin"))
            samples = _count("samples", table.pop("samples", 100)) if table else 0
            latin = _latin(dict(_parameters(table)), samples, seed)
        if twice := [key for key in latin[0] if key in vary]:
            raise SpecError(f"{path}: {twice[0]} stands in [vary] and in [latin]; leave one out")
        if not vary and not latin[0]:
            raise SpecError(
                f"{path}: nothing varies; give parameters in [vary.sensor], [latin.noise] or the like"
            )
        cost_s = scans * sum(COST_S.get(m, 0.0) for m in what)
        default = max(1, min(round(_BATCH_S / max(cost_s, 1e-3)), 1000))
        with study.naming("measure"):
            designs = _count("batch_designs", wanted.get("batch_designs", default))
        sweep = cls(study.text("name", path.stem), seed, base, tuple(what), designs, vary, latin)
        if sweep.designs > _MOST_DESIGNS:
            raise SpecError(f"{path}: {sweep.designs} designs are more than {_MOST_DESIGNS}; vary less")
        return sweep

    @cached_property
    def axes(self) -> list[tuple[tuple[str, ...], list[tuple[Any, ...]]]]:
        """What is combined: names, and the values that they have together."""
        found: list[tuple[tuple[str, ...], list[tuple[Any, ...]]]]
        found = [((name,), [(v,) for v in values]) for name, values in self.vary.items()]
        return [*found, (self.latin[0], list(self.latin[1]))] if self.latin[0] else found

    @property
    def designs(self) -> int:
        """Number of designs."""
        return math.prod(len(values) for _, values in self.axes)

    @property
    def parameters(self) -> list[str]:
        """Names of what varies."""
        return [name for names, _ in self.axes for name in names]

    def design(self, number: int) -> dict[str, Any]:
        """Return the parameters of a design; the last axis runs fastest."""
        found: dict[str, Any] = {}
        for names, values in reversed(self.axes):
            number, place = divmod(number, len(values))
            found |= zip(names, values[place], strict=True)
        return {name: found[name] for name in self.parameters}

    def batches(self, shard: tuple[int, int] = (1, 1)) -> Iterator[Batch]:
        """Yield all batches, or every N-th from the I-th on, in the order of the designs."""
        content = {
            "base": [self.base.sensor.to_toml(), self.base.shapes.to_dict(), asdict(self.base.noise)],
            "measures": self.measures,
            "seed": self.seed,
            "parameters": self.parameters,
            "tacstrip": version("tacstrip"),
            "definitions": DEFINITIONS,
        }
        common = hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), digest_size=10)
        texts = itertools.product(*([json.dumps(value) for value in values] for _, values in self.axes))
        for i, first in enumerate(range(0, self.designs, self.batch_designs)):
            lines = [";".join(text) for text in itertools.islice(texts, self.batch_designs)]
            if i % shard[1] == shard[0] - 1:
                name = common.copy()
                name.update("\n".join(lines).encode())
                yield Batch(name.hexdigest(), first, len(lines))

    def work(self, batch: Batch) -> Work:
        """Return what a worker is given for a batch."""
        numbers = range(batch.first, batch.first + batch.designs)
        return Work(self.base, tuple(self.design(i) for i in numbers), self.measures, self.seed)


def changed(base: Case, parameters: Mapping[str, Any]) -> Case:
    """Return a design with its own parameters; errors as of sensor, shapes and noise."""
    sensor, shapes, noise = base.sensor, base.shapes.to_dict(), base.noise
    for table in _TABLES:
        own: dict[str, Any] = {
            name.partition(".")[2]: tuple(v) if isinstance(v, list) else v
            for name, v in parameters.items()
            if name.startswith(table + ".")
        }
        if not own:
            continue
        if table == "sensor":
            width = own.pop("width_mm", None)
            if "construction" in own:
                keys = construction(own["construction"]).keys
                own = {
                    "resistivity_ratio": sensor.resistivity_ratio if "resistivity_ratio" in keys else 1.0,
                    "radius_mm": sensor.radius_mm if "radius_mm" in keys else None,
                } | own
            if width is not None:
                own["strips"] = _strips(width, own.get("pitch_mm", sensor.pitch_mm))
            own.setdefault("calibration", None)  # a design is no unit
            sensor = replace(sensor, **own)
        elif table == "shapes":
            shapes |= own
        else:
            noise = replace(noise, **own)
    return Case(sensor, Shapes.from_dict(shapes), noise)


def _strips(width_mm: float, pitch_mm: float) -> int:
    """Return how many strips a width takes; `SpecError` where that is no number of strips."""
    try:
        return max(1, round(width_mm / pitch_mm))
    except (TypeError, ArithmeticError, ValueError):
        raise SpecError(f"width_mm = {width_mm}, pitch_mm = {pitch_mm}: no number of strips") from None


def do(work: Work) -> tuple[list[Row], float]:
    """Measure a batch's designs; return a row each, and the seconds that it took. Workers call this."""
    begun, rows = time.perf_counter(), []
    for parameters in work.parameters:
        empty: Row = dict.fromkeys(columns(work.measures))
        try:
            rows.append({**empty, **measure(changed(work.base, parameters), work.measures, work.seed)})
        except TacstripError as error:
            rows.append({**empty, PROBLEM: str(error)})
    return rows, time.perf_counter() - begun


@dataclass
class Progress:
    """How far a sweep is: batches that are there, of how many; seconds of work, and of the clock times workers."""

    done: int
    total: int
    work_s: float = 0.0
    paid_s: float = 0.0


def sweep(
    study: Sweep,
    out: Path,
    shard: tuple[int, int] = (1, 1),
    workers: int | None = None,
    dask: str | None = None,
    progress: Callable[[Progress], object] | None = None,
) -> Progress:
    """Measure all designs whose batches are not in a folder yet, and write them there.

    Parameters
    ----------
    study
        What to measure.
    out
        The folder; it may hold batches of other studies, and of this one made elsewhere.
    shard
        Which batches: every N-th from the I-th on, as (I, N).
    workers
        Processes, by default one a core; on a cluster as many batches at once as it has threads.
    dask
        Address of a Dask scheduler, such as tcp://10.0.0.1:8786; its workers need tacstrip.
    progress
        Called after each batch.

    Raises
    ------
    OptionError
        pyarrow, or distributed, is not installed, or the address does not answer.
    RuntimeError
        The worker of one batch was lost three times.
    """
    optional("pyarrow.parquet")
    there = batches_there(out)
    plan = list(study.batches(shard))
    waiting = deque((b, 1) for b in plan if b.name not in there)
    state, tell = Progress(len(plan) - len(waiting), len(plan)), progress or (lambda _: None)
    tell(state)
    if not waiting:
        return state
    begun = time.perf_counter()
    with ExitStack() as stack:
        count = workers or available_cores()
        pools = _dask_pools(dask, stack) if dask else _local_pools(count, len(waiting), stack)
        free = deque(range(len(pools)))
        running: dict[Future[tuple[list[Row], float]], tuple[Batch, int, int]] = {}
        while waiting or running:
            while waiting and free:
                (batch, tries), slot = waiting.popleft(), free.popleft()
                running[pools[slot].submit(do, study.work(batch))] = batch, tries, slot
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                batch, tries, slot = running.pop(future)
                free.append(slot)
                rows = _result(future)
                if rows is None:  # its worker is lost
                    if tries == _TRIES:
                        raise RuntimeError(
                            f"batch {batch.name}, from design {batch.first} on, lost its worker {tries} times"
                        )
                    waiting.append((batch, tries + 1))
                    if not dask:
                        pools[slot] = worker_pool(1)
                    continue
                _write(study, batch, rows[0], _file(out, batch.name))
                state.done, state.work_s = state.done + 1, state.work_s + rows[1]
                state.paid_s = len(pools) * (time.perf_counter() - begun)
                tell(state)
    return state


def _result(future: Future[tuple[list[Row], float]]) -> tuple[list[Row], float] | None:
    """Return a batch's rows and time; None where its worker was lost."""
    try:
        return future.result()
    except BrokenProcessPool:
        return None
    except Exception as error:
        if type(error).__name__ in ("KilledWorker", "CancelledError", "FutureCancelledError"):
            return None  # Dask's, which may not be installed
        raise


def _local_pools(count: int, batches: int, stack: ExitStack) -> list[Executor]:
    """Return a pool of one process each, for a lost process breaks its pool."""
    stack.enter_context(children_end())
    return [worker_pool(1) for _ in range(max(min(count, batches), 1))]


def _dask_pools(address: str, stack: ExitStack) -> list[Executor]:
    """Return a cluster's executor as often as it has threads."""
    distributed = optional("distributed")
    try:
        client = stack.enter_context(distributed.Client(address, timeout="10s", set_as_default=False))
    except (OSError, ValueError, TimeoutError) as error:
        raise OptionError(
            f"no Dask scheduler answers at {address} ({error}); give its address, tcp://host:8786"
        ) from None
    threads = sum(client.ncores().values())
    executor = stack.enter_context(client.get_executor(pure=False, retries=0))
    return [executor] * max(threads, 1)


def _file(out: Path, name: str) -> Path:
    return out / "batches" / name[:2] / f"{name}.parquet"


def batches_there(out: Path) -> set[str]:
    """Return the names of the batches that are in a folder."""
    folders = out / "batches"
    return {
        f.stem for folder in (folders.iterdir() if folders.exists() else ()) for f in folder.glob("*.parquet")
    }


def _schema(study: Sweep) -> Any:
    pa = optional("pyarrow")
    fields = [("design", pa.int64())]
    for names, values in study.axes:
        for name, of_name in zip(names, zip(*values, strict=True), strict=True):
            numeric = all(isinstance(v, int | float) and not isinstance(v, bool) for v in of_name)
            fields.append((name, pa.float64() if numeric else pa.string()))
    return pa.schema(
        [*fields, *((name, pa.float64()) for name in columns(study.measures)), (PROBLEM, pa.string())]
    )


def _write(study: Sweep, batch: Batch, rows: Sequence[Row], file: Path) -> None:
    pa, pq, schema = optional("pyarrow"), optional("pyarrow.parquet"), _schema(study)
    texts = [f.name for f in schema if f.type == pa.string() and f.name != PROBLEM]
    table = []
    for i, row in enumerate(rows):
        own = study.design(batch.first + i)
        own = {
            k: float(v) if k not in texts else v if isinstance(v, str) else json.dumps(v)
            for k, v in own.items()
        }
        table.append({"design": batch.first + i, **own, **row})
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file) as new:
        pq.write_table(pa.Table.from_pylist(table, schema), new)


def collect(study: Sweep, out: Path) -> dict[str, list[Any]] | None:
    """Write all designs to results.parquet and results.csv, return the columns; None while batches are missing."""
    there, plan = batches_there(out), list(study.batches())
    if any(batch.name not in there for batch in plan):
        return None
    pa, pq, schema = optional("pyarrow"), optional("pyarrow.parquet"), _schema(study)
    tables = []
    for batch in plan:
        table = pq.ParquetFile(_file(out, batch.name)).read()
        # As they are counted here.
        numbers = pa.array(range(batch.first, batch.first + batch.designs), pa.int64())
        tables.append(table.set_column(0, "design", numbers).cast(schema))
    with replacing(out / "results.parquet") as new:
        pq.write_table(pa.concat_tables(tables), new)
    found: dict[str, list[Any]] = pa.concat_tables(tables).to_pydict()
    with csv_writer(out / "results.csv", list(found)) as lines:
        lines.writerows(zip(*found.values(), strict=True))
    return found


def error_column(study: Sweep) -> str | None:
    """Return the column that designs are compared by: of the polygon fit, else another method's, else the bound."""
    names = [f"{m}_mm" for m in ("polygon", "vertex", "profile", "bound")]
    return next((name for name in names if name in columns(study.measures)), None)


def pareto(results: Mapping[str, Sequence[Any]], error: str) -> list[int]:
    """Return the rows that no other one is as good as in error, strips, connectors and rate, and better in one."""
    rate = [-(v or 0.0) for v in results["rate_hz"]]
    goals = np.array(
        [[np.inf if v is None else v for v in results[n]] for n in (error, "strips", "connectors")] + [rate]
    )
    able = np.flatnonzero(np.isfinite(goals).all(axis=0))
    front: list[int] = []
    # By error first: later ones never beat earlier ones in it.
    for i in able[np.lexsort(goals[:, able][::-1])]:
        kept = goals[:, front]
        if not ((kept <= goals[:, [i]]).all(axis=0) & (kept < goals[:, [i]]).any(axis=0)).any():
            front.append(int(i))
    return front


def _parameters(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, of_table in table.items():
        if name not in _TABLES or not isinstance(of_table, dict):
            raise OptionError(
                f"{name}: give parameters by table, such as [vary.sensor] with pitch_mm = [1.0, 2.0]"
            )
        known = {
            "sensor": (*SENSOR_KEYS, "width_mm"),
            "shapes": tuple(k for k in Shapes.__dataclass_fields__ if k != "n"),
            "noise": tuple(Noise.__dataclass_fields__),
        }[name]
        for key, given in of_table.items():
            if key not in known:
                raise OptionError(f"unknown parameter {name}.{key}; there are: {', '.join(known)}")
            yield f"{name}.{key}", given


def _values(name: str, given: Any) -> tuple[Any, ...]:
    if isinstance(given, dict):
        low, high, log, whole = _range(name, given)
        steps = _count(f"{name}.steps", given.get("steps", 5))
        at = np.linspace(0.0, 1.0, steps) if steps > 1 else np.zeros(1)
        return tuple(dict.fromkeys(_within(at, low, high, log, whole)))
    if not isinstance(given, list) or not given:
        raise OptionError(f"{name} = {given!r}: give a list, or a range {{from = 1.0, to = 4.0, steps = 4}}")
    return tuple(given)


def _latin(
    table: dict[str, Any], samples: int, seed: int
) -> tuple[tuple[str, ...], tuple[tuple[Any, ...], ...]]:
    if not table:
        return (), ()
    (random,) = np.random.default_rng(seed).spawn(
        1
    )  # as scipy.stats.qmc does, which takes a second to import
    within = random.uniform(size=(samples, len(table)))
    points = (1 + np.stack([random.permutation(samples) for _ in table], axis=1) - within) / samples
    found = []
    for (name, given), at in zip(table.items(), points.T, strict=True):
        if isinstance(given, list) and given:
            found.append([given[int(a * len(given))] for a in at])
        elif isinstance(given, dict):
            found.append(_within(at, *_range(name, given)))
        else:
            raise OptionError(
                f"{name} = {given!r}: give a range {{from = 1.0, to = 4.0}}, or a list to choose from"
            )
    return tuple(table), tuple(zip(*found, strict=True))


def _range(name: str, given: Mapping[str, Any]) -> tuple[float, float, bool, bool]:
    if unknown := [key for key in given if key not in _OF_RANGE]:
        raise OptionError(f"{name}: unknown key {unknown[0]!r}; a range has: {', '.join(_OF_RANGE)}")
    low, high = (given.get(name, math.nan) for name in ("from", "to"))
    if not all(
        isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in (low, high)
    ):
        raise OptionError(f"{name} = {dict(given)}: a range needs two numbers, {{from = 1.0, to = 4.0}}")
    log = bool(given.get("log", False))
    if log and min(low, high) <= 0.0:
        raise OptionError(f"{name} = {dict(given)}: a logarithmic range lies above 0")
    whole = bool(given.get("whole", name in _WHOLE))
    return float(low), float(high), log, whole


def _within(at: Any, low: float, high: float, log: bool, whole: bool) -> list[Any]:
    values = low * (high / low) ** at if log else low + (high - low) * at
    return [round(v) if whole else float(f"{v:.12g}") for v in values.tolist()]


def _count(name: str, value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= _MOST:
        raise OptionError(f"{name} = {value!r}: must be a whole number from 1 to {_MOST}")
    return value
