"""Frames by `async for`, by a callback and as the scripts of examples/ take them; their time, frame and unit."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import math
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from aiohttp import web

import tacstrip as ts
from live_devices import SENSOR, Stepped, still
from tacstrip.geometry.moments import moments
from tacstrip.stream import RawScan
from waiting import HANG_S

EXAMPLES = Path(__file__).parents[2] / "examples"
SCANS = 60


def _source(scans: int = SCANS, origin_ns: int | None = None) -> ts.SimulatedSource:
    return ts.SimulatedSource(SENSOR, still, 200.0, scans, origin_ns=origin_ns)


def _example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _threads() -> set[str]:
    return {t.name for t in threading.enumerate() if t.name.startswith("tacstrip")}


def test_a_slow_consumer_gets_the_newest_and_holds_nothing_up() -> None:
    async def consume() -> tuple[list[int], list[int]]:
        stream = ts.live(source=_source(), speed=math.inf, tracks=False)
        every = stream.subscribe(SCANS)
        async with stream:
            numbers = []
            async for frame in stream:
                numbers.append(frame.number)
                assert await asyncio.to_thread(stream.wait)  # the stream runs to its end meanwhile
            return numbers, [frame.number async for frame in every]

    numbers, every = asyncio.run(consume())
    assert every == list(range(SCANS))
    assert numbers in ([numbers[0], SCANS - 1], [SCANS - 1])
    assert not _threads()


def test_a_loop_that_is_left_ends_the_stream_and_an_error_is_raised() -> None:
    class Breaks(ts.SimulatedSource):
        def __iter__(self) -> Any:
            yield from super().__iter__()
            raise OSError("the bench is on fire")

    async def leave() -> None:
        async for _ in ts.live(source=_source(10_000_000), tracks=False):
            break
        with pytest.raises(OSError, match="the bench is on fire"):
            async for _ in ts.live(
                source=Breaks(SENSOR, still, 200.0, 5), speed=math.inf, on_message=lambda text: None
            ):
                pass

    asyncio.run(leave())
    assert not _threads()


def test_a_stream_whose_closing_is_cancelled_ends_all_the_same() -> None:
    """As `asyncio.run` cancels it where its last act is to leave a loop; the pool's one thread is taken meanwhile."""
    taken = threading.Event()

    async def leave() -> None:
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        stream = ts.live(source=_source(10_000_000), tracks=False)
        await stream.__aenter__()
        busy = loop.run_in_executor(None, taken.wait)
        closing = asyncio.create_task(stream.__aexit__())
        await asyncio.sleep(0)
        closing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await closing
        taken.set()
        await busy

    asyncio.run(leave())
    assert not _threads()


def test_two_tasks_wait_without_a_thread_each() -> None:
    before = set(threading.enumerate())  # other tests' pools live on

    async def watch() -> list[int]:
        stream = ts.live(source=_source(), speed=math.inf, tracks=False)
        boxes = [stream.subscribe(SCANS) for _ in range(2)]

        async def count(box: Any) -> int:
            return sum([1 async for _ in box])

        async with stream:
            found = await asyncio.gather(*map(count, boxes))
            assert not [t for t in set(threading.enumerate()) - before if t.name.startswith("asyncio")]
            return [*found]

    assert asyncio.run(watch()) == [SCANS, SCANS]


def test_a_callback_may_end_the_stream_and_one_that_breaks_off_is_told() -> None:
    stream = ts.live(source=_source(10_000_000), tracks=False, on_frame=lambda frame: stream.stop())
    with stream:
        assert stream.wait()
    told: list[str] = []

    def fault(frame: ts.Frame) -> None:
        raise ZeroDivisionError("in your function")

    with ts.live(source=_source(), speed=math.inf, on_message=told.append, on_frame=fault) as stream:
        assert stream.wait()
    assert told == ["the callback ended: ZeroDivisionError: in your function"]
    assert stream.frames == SCANS


def test_every_frame_has_an_absolute_time_by_a_clock_that_is_named(tmp_path: Path) -> None:
    origin_ns = 1_700_000_000_123_456_789
    with ts.live(source=_source(origin_ns=origin_ns), speed=math.inf, record=tmp_path / "a.mcap") as stream:
        frames = list(stream.subscribe(SCANS))
    assert [f.time_ns for f in frames] == [origin_ns + 5_000_000 * f.number for f in frames]
    assert {(f.clock, f.frame_id, f.unit, f.device) for f in frames} == {("simulation", "tacstrip", "mm", "")}
    with ts.live(source=ts.Recording(tmp_path / "a.mcap"), speed=math.inf) as stream:
        again = list(stream.subscribe(SCANS))
    assert [(f.clock, f.time_ns) for f in again[-5:]] == [("recording", f.time_ns) for f in frames[-5:]]
    before_ns = time.time_ns()
    with ts.live(source=ts.SerialSource(lambda: Stepped(200.0), SENSOR), tracks=False) as stream:
        frame = next(iter(stream))
    assert (frame.clock, frame.device) == ("device", "virtual")
    assert frame.time_ns >= before_ns


def test_the_grasp_loop_closes_until_the_area_is_enough() -> None:
    words = asyncio.run(_example("grasp_loop").main())
    assert words.startswith("held with "), words


def test_the_table_has_a_row_an_object_with_its_time() -> None:
    with ts.live(source=_source(origin_ns=10**18), speed=math.inf, tracks=False) as stream:
        found = _example("log_to_pandas").rows(stream.subscribe(SCANS))
    assert found[-1]["time"] == 10**18 + 5_000_000 * (SCANS - 1)
    assert found[-1]["area_mm2"] == pytest.approx(moments(still(0.0).vertices)[0], rel=0.01)
    assert {row["object"] for row in found} == {1}


def test_frames_are_pushed_to_a_service_that_is_away_at_first(capsys: pytest.CaptureFixture[str]) -> None:
    taken: list[dict[str, Any]] = []
    example = _example("http_push")
    vars(example).update(EVERY_S=0.0, GIVE_UP_S=HANG_S)

    class UntilTaken(ts.SimulatedSource):
        """Ends once the service has taken some, however long the busy computer needs to send them."""

        def __iter__(self) -> Iterator[RawScan]:
            for raw in super().__iter__():
                if len(taken) > 3:
                    return
                yield raw

    async def take(request: web.Request) -> web.Response:
        taken.append(json.loads(await request.text()))
        return web.Response(status=503 if len(taken) == 1 else 204)

    async def run() -> int:
        app = web.Application()
        app.router.add_post("/touch", take)
        runner = web.AppRunner(app)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        async with ts.live(source=UntilTaken(SENSOR, still, 200.0), tracks=False) as stream:
            number: int = await example.push(stream, f"http://127.0.0.1:{port}/touch")
        async with ts.live(source=_source(3), speed=math.inf, tracks=False) as stream:
            assert await example.push(stream, "http://127.0.0.1:9/touch") == 0
        await runner.cleanup()
        return number

    count = asyncio.run(run())
    assert count == len(taken) - 1 > 2
    assert taken[-1].keys() == {"time_ns", "clock", "frame_id", "unit", "scan", "objects"}
    assert len(taken[-1]["objects"][0]["vertices"]) == 4
    assert "the next frame is tried" in capsys.readouterr().err
