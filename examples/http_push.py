"""Post what touches the sensor to a web service as JSON, ten times a second at most, whatever the service does.

Run: python examples/http_push.py http://127.0.0.1:8000/touch [PORT]; without a port with a simulated sensor.
"""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import aiohttp

import tacstrip as ts
from tacstrip.stream import Drag

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(-16, -12), (18, -14), (12, 15), (-14, 12)])
EVERY_S, GIVE_UP_S = 0.1, 2.0


def message(frame: ts.Frame) -> dict[str, Any]:
    """Return what is sent of a frame."""
    objects = [
        {"id": one.id, "status": one.shape.status, "vertices": one.shape.vertices.round(3).tolist()}
        for one in frame.objects
    ]
    about = {"time_ns": frame.time_ns, "clock": frame.clock, "frame_id": frame.frame_id, "unit": frame.unit}
    return {**about, "scan": frame.number, "objects": objects}


async def push(stream: ts.Live, url: str) -> int:
    """Post the newest frames until the stream ends; return how many the service took."""
    taken, timeout = 0, aiohttp.ClientTimeout(total=GIVE_UP_S)
    async with aiohttp.ClientSession(timeout=timeout) as session:
        async for frame in stream:
            try:
                async with session.post(url, json=message(frame)) as answer:
                    taken += answer.status < 300
            except (aiohttp.ClientError, TimeoutError) as error:
                print(f"{url}: {error or 'no answer'}; the next frame is tried", file=sys.stderr)
            await asyncio.sleep(EVERY_S)
    return taken


async def main(url: str, port: str | None = None) -> int:
    """Post from the sensor on a port, or from a simulated one."""
    if port is not None:
        stream = await asyncio.to_thread(ts.live, port)  # opening takes up to 5 s
    else:
        drag = Drag(SHAPE, [(30, 50), (70, 50)], seconds=2.0)
        stream = ts.live(source=ts.SimulatedSource(SENSOR, drag, 200.0, 400), tracks=False)
    async with stream:
        return await push(stream, url)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    print(f"{asyncio.run(main(*sys.argv[1:3]))} frames were taken")
