"""The live page in Chromium: how soon a dragged corner's recovered shape is seen, and how often the page draws.

A drag is timed inside the page, from the pointer's event to the first picture whose shape is there.
Wanted: 100 ms at most, and 50 pictures a second at 1000 scans a second.

Run: python benchmarks/page.py (needs playwright, of the group dev, and the distribution's Chromium)
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

import tacstrip as ts
from tacstrip.stream.live.pipeline import Live
from tacstrip.view.controller import Controller
from tacstrip.view.health import background_process
from tacstrip.view.server import Access, Server
from tacstrip.view.simulator import Settings, Simulator

SENSOR = ts.Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0, adc_bits=12)
RATE_HZ = 1000.0
OBJECTS = [
    [(10.0, 58.0), (26.0, 30.0), (44.0, 44.0), (36.0, 80.0)],
    [(60.0, 22.0), (88.0, 34.0), (70.0, 66.0)],
]
TARGETS = [(40.0, 86.0), (32.0, 78.0), (38.0, 90.0)] * 5
SETTLE_S = 0.6  # after a drag the page keeps its own objects for half a second
DRAWN_S = 5.0
TIMER = """([x, y]) => {
  const svg = document.getElementById("surface");
  window.timed = null;
  let moved = null;
  svg.addEventListener("pointermove", () => { moved = moved ?? performance.now(); });
  const look = () => {
    const frame = window.tacstrip.frame;
    const there = frame.objects.some((o) => o.vertices.some((v) => Math.hypot(v[0] - x, v[1] - y) < 3.0));
    if (moved !== null && there) window.timed = performance.now() - moved;
    else requestAnimationFrame(look);
  };
  look();
}"""


def drag_ms(page: Any, target: tuple[float, float]) -> float:
    """Drag a corner to a place [mm]; return how long it took to see the shape there [ms]."""
    box = page.locator("[data-key='0.3']").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    px = page.locator(".skin").bounding_box()["width"] / SENSOR.width_mm
    corner = page.evaluate("() => window.tacstrip.frame.truth[0]")[3]
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(TIMER, list(target))
    page.mouse.move(x + (target[0] - corner[0]) * px, y - (target[1] - corner[1]) * px)
    page.wait_for_function("() => window.timed !== null")
    page.mouse.up()
    time.sleep(SETTLE_S)
    return float(page.evaluate("() => window.timed"))


def main() -> None:
    """Serve the simulator, open the page and print both figures."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        print("left out: needs the distribution's Chromium (apt-get install chromium)")
        return
    simulator = Simulator(Settings(SENSOR, RATE_HZ), OBJECTS)
    with (
        tempfile.TemporaryDirectory() as folder,
        Live(simulator.source(), next_source=simulator.source) as live,
        sync_playwright() as driver,
        background_process() as executor,
    ):
        server = Server(Controller(live, executor, simulator, Path(folder)), Access("127.0.0.1"))
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        page.goto(server.urls["control"])
        page.wait_for_function("() => window.tacstrip && window.tacstrip.count > 20")
        drags = [drag_ms(page, target) for target in TARGETS]
        drawn, frames, start = page.evaluate("() => window.tacstrip.count"), live.frames, time.perf_counter()
        time.sleep(DRAWN_S)
        passed = time.perf_counter() - start
        drawn = page.evaluate("() => window.tacstrip.count") - drawn
        frames = live.frames - frames
        browser.close()
        server.close()
    print(f"a dragged corner is seen after {statistics.median(drags):.0f} ms (median), {min(drags):.0f} (least), "
          f"{max(drags):.0f} (worst of {len(drags)})")  # fmt: skip
    print(f"{drawn / passed:.0f} pictures a second at {frames / passed:.0f} scans a second")


if __name__ == "__main__":
    main()
