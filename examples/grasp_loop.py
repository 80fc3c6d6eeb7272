"""Close a gripper until the object's area on the sensor is large enough, and open it when the object slips.

Run: python examples/grasp_loop.py [PORT]; without a port with a simulated sensor, on which the contact grows with the
gripper's force.
"""

from __future__ import annotations

import asyncio
import math
import sys

import tacstrip as ts

SENSOR = ts.Sensor(construction="crs-crs", strips=20, pitch_mm=5.0, length_mm=100.0, adc_bits=12)
SHAPE = ts.Contact.polygon([(-16, -12), (18, -14), (12, 15), (-14, 12)])
ENOUGH_MM2, SLIP_MM, STEP_N, MOST_N = 800.0, 2.0, 0.5, 20.0


class Gripper:
    """Put your gripper's commands here; this one only remembers its force."""

    force_n = 0.5

    async def set_force(self, force_n: float) -> None:
        """Set the force [N]."""
        self.force_n = force_n
        await asyncio.sleep(0.0)  # what a bus takes


async def grasp(stream: ts.Live, gripper: Gripper) -> str:
    """Close the gripper until one object is held well; return how that ended."""
    start = None
    async for frame in stream:  # always the newest scan, however long a command takes
        if len(frame.objects) != 1:
            continue
        shape = frame.objects[0].shape
        if shape.status in (
            "ok",
            "likely",
        ):  # a doubtful shape decides nothing; with more force it may be sure
            start = shape.centroid if start is None else start
            if math.dist(start, shape.centroid) > SLIP_MM:
                await gripper.set_force(0.0)
                return "it slipped: let go"
            if shape.area >= ENOUGH_MM2:
                time_s = frame.raw.time_s
                return (
                    f"held with {gripper.force_n:g} N on {shape.area:.0f} mm2, {time_s:.2f} s after the start"
                )
        if gripper.force_n >= MOST_N:
            return f"{MOST_N:g} N are not enough"
        await gripper.set_force(gripper.force_n + STEP_N)
    return "the stream has ended"


async def main(port: str | None = None) -> str:
    """Grasp with the sensor on a port, or with a simulated one."""
    gripper = Gripper()
    if port is not None:
        stream = await asyncio.to_thread(ts.live, port)  # opening takes up to 5 s
    else:

        def contact(time_s: float) -> ts.Contact:
            size = 0.7 + 0.1 * math.sqrt(gripper.force_n)
            return ts.Contact.polygon((50.0, 50.0) + size * SHAPE.vertices)

        stream = ts.live(source=ts.SimulatedSource(SENSOR, contact, 200.0, ahead=1), tracks=False)
    async with stream:
        return await grasp(stream, gripper)


if __name__ == "__main__":
    print(asyncio.run(main(*sys.argv[1:2])))
