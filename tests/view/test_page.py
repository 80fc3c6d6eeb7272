"""The page in a real browser: the distribution's Chromium, without a window.

With TACSTRIP_PICTURES=docs/pictures in the environment the screenshots of README and docs are written there.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import tacstrip as ts
from tacstrip.core.binding import exported
from tacstrip.stream.live.pipeline import Live
from tacstrip.view.controller import Controller
from tacstrip.view.health import background_process
from tacstrip.view.server import Access, Server
from tacstrip.view.simulator import Settings, Simulator
from waiting import HANG_S, wait_until

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="the page's tests need the distribution's Chromium: apt-get install chromium"
)

SENSOR = ts.Sensor(construction="crs-crs", strips=50, pitch_mm=2.0, length_mm=100.0, adc_bits=12)
RATE_HZ = 80.0  # more than a screen draws; each scan costs the tests' processor its reconstruction
OBJECTS = [
    [(10.0, 58.0), (26.0, 30.0), (44.0, 44.0), (36.0, 80.0)],
    [(60.0, 22.0), (88.0, 34.0), (70.0, 66.0)],
]
ON_SHARED_STRIPS = [[(20.0, 20.0), (46.0, 25.0), (30.0, 50.0)], [(35.0, 60.0), (70.0, 55.0), (60.0, 80.0)]]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip(
        "playwright.sync_api",
        reason="the page's tests need playwright, of the group dev",
        exc_type=ImportError,
    )
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture
def server(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Server]:
    """One rigid outline of all scans is searched for where a test looks at it: corners that are dragged have none."""
    sensor, rate_hz, objects, tracks = getattr(request, "param", (SENSOR, RATE_HZ, OBJECTS, False))
    simulator = Simulator(Settings(sensor, rate_hz), objects)
    stream = Live(simulator.source(), next_source=simulator.source, tracks=tracks)
    with stream as live, background_process() as executor:
        made = Server(Controller(live, executor, simulator, tmp_path), Access("127.0.0.1"))
        yield made
        made.close()


def _page(browser: Any, **options: Any) -> Any:
    page = browser.new_page(**options)
    page.set_default_timeout(1e3 * HANG_S)
    return page


@pytest.fixture
def open_page(browser: Any, server: Server) -> Iterator[Callable[..., Any]]:
    faults: list[str] = []
    pages = []

    def opened(**options: Any) -> Any:
        page = _page(browser, **options)
        pages.append(page)
        page.on("console", lambda message: faults.append(message.text) if message.type != "log" else None)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("requestfailed", lambda request: faults.append(request.url))
        page.goto(server.urls["control"])
        wait_until(lambda: _drawn(page) > 20)
        return page

    yield opened
    for page in pages:
        page.close()
    assert faults == []


def _drawn(page: Any) -> int:
    return int(page.evaluate("() => window.tacstrip ? window.tacstrip.count : 0"))


def _objects(page: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = page.evaluate("() => window.tacstrip.frame.objects")
    return found


def _centre(page: Any, selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def _nearest(page: Any, place: tuple[float, float]) -> float:
    """Return how far the nearest recovered corner is [mm]."""
    corners = [v for one in _objects(page) for v in one["vertices"]]
    return min((((x - place[0]) ** 2 + (y - place[1]) ** 2) ** 0.5 for x, y in corners), default=1e9)


def _size(page: Any) -> float:
    """Return pixels a millimetre."""
    return float(page.locator(".skin").bounding_box()["width"]) / SENSOR.width_mm


def test_a_dragged_corner_changes_the_recovered_shape(open_page: Callable[..., Any]) -> None:
    page = open_page(viewport={"width": 1280, "height": 860})
    for target in ((40.0, 86.0), (32.0, 78.0), (38.0, 90.0)):
        x, y = _centre(page, "[data-key='0.3']")
        px = _size(page)
        corner = page.evaluate("() => window.tacstrip.frame.truth[0]")[3]
        assert _nearest(page, target) > 3.0
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + (target[0] - corner[0]) * px, y - (target[1] - corner[1]) * px)
        wait_until(lambda: _nearest(page, target) < 3.0)  # noqa: B023
        page.mouse.up()


def test_keys_move_turn_add_and_remove(open_page: Callable[..., Any], server: Server) -> None:
    page = open_page(viewport={"width": 1280, "height": 860})
    simulator = server.controller.simulator
    assert simulator is not None
    page.locator("[data-key='1.']").focus()
    for key in ("ArrowRight", "ArrowUp", "Shift+ArrowDown"):
        page.keyboard.press(key)
    moved = [(x + 0.5, y + 0.5 - 5.0) for x, y in OBJECTS[1]]
    wait_until(
        lambda: [round(v, 6) for p in simulator.objects[1] for v in p] == [v for p in moved for v in p]
    )
    page.keyboard.press("]")
    wait_until(lambda: abs(simulator.objects[1][0][0] - moved[0][0]) > 0.5)
    page.keyboard.press("Tab")
    page.locator("[data-key='1.2']").focus()
    page.keyboard.press("+")
    wait_until(lambda: len(simulator.objects[1]) == 4)
    page.keyboard.press("Delete")
    wait_until(lambda: len(simulator.objects[1]) == 3)
    page.locator("[data-key='1.']").focus()
    page.keyboard.press("Delete")
    wait_until(lambda: len(simulator.objects) == 1)
    wait_until(lambda: len(_objects(page)) == 1)


def test_settings_pause_theme_and_recording(
    open_page: Callable[..., Any], server: Server, tmp_path: Path
) -> None:
    page = open_page(viewport={"width": 1280, "height": 860})
    page.locator("#record").click()
    wait_until(lambda: "scans" in page.locator("#record-text").inner_text())
    some = server.controller.live.frames + 20
    wait_until(lambda: server.controller.live.frames > some)
    page.locator("#record").click()
    wait_until(lambda: page.locator("#record-text").inner_text() == "Record")
    (file,) = tmp_path.glob("*.mcap")
    assert len(list(ts.Recording(file))) > 10
    page.locator("#pause").click()
    count, came = _drawn(page), server.controller.live.frames
    # What the page writes there when the server's next numbers come, between frames.
    page.evaluate("() => { document.getElementById('draws').textContent = ''; }")
    wait_until(lambda: page.locator("#draws").inner_text() == "paused")
    wait_until(lambda: server.controller.live.frames > came)
    assert _drawn(page) == count
    page.locator("#pause").click()
    wait_until(lambda: _drawn(page) > count)
    page.locator("#construction").select_option("crs-m")
    wait_until(lambda: "crs-m" in page.locator("#what").inner_text())
    wait_until(lambda: page.evaluate("() => Object.keys(window.tacstrip.frame.readings).join()") == "k")
    page.locator("#strips").fill("30")
    page.locator("#strips").press("Enter")
    wait_until(lambda: "30 strips" in page.locator("#what").inner_text())
    page.locator("#method").select_option("vertex")
    wait_until(lambda: server.controller.live.method == "vertex")


def test_a_refused_number_says_so_at_its_field_and_deleting_keeps_the_focus(
    open_page: Callable[..., Any], server: Server
) -> None:
    page = open_page(viewport={"width": 1280, "height": 860})
    for field, wrong, words, right in (
        ("strips", "1", "strips = 1: must be 2 to 1000; 50 stays in force", "40"),
        ("hz", "6000", f"rate_hz = 6000: must be 1 to 5000; {RATE_HZ:g} stays in force", "500"),
        ("noise", "700", "positional = 7: a fraction of Vref", "1"),
        ("noise", "", "not a number; 1 stays in force", "0.5"),
    ):
        box, said = page.locator(f"#{field}"), page.locator(f"#{field}-refused")
        box.fill(wrong)
        box.press("Enter")
        said.filter(has_text=words).wait_for()
        assert box.get_attribute("aria-invalid") == "true"
        assert page.locator(f"#{field}[aria-describedby='{field}-refused']").count() == 1
        box.fill(right)
        box.press("Enter")
        wait_until(lambda: said.inner_text() == "" and box.get_attribute("aria-invalid") is None)  # noqa: B023
        box.blur()
        wait_until(lambda: float(box.input_value()) == float(right))  # noqa: B023
    focused = "() => document.activeElement.dataset.key ?? document.activeElement.id"
    page.locator("[data-key='1.2']").focus()
    assert page.locator("[data-key='1.2']").evaluate("e => getComputedStyle(e).outlineStyle") == "none"
    for after in ("0.", "add"):  # a triangle goes as a whole
        page.keyboard.press("Delete")
        wait_until(lambda: page.evaluate(focused) == after)  # noqa: B023


def test_a_page_without_news_is_dimmed_and_a_new_server_is_heard(browser: Any, server: Server) -> None:
    page = _page(browser, color_scheme="dark")
    page.goto(server.urls["control"])
    assert page.evaluate("() => document.documentElement.dataset.theme") == "dark"
    stale = "() => document.body.classList.contains('stale')"
    wait_until(lambda: _drawn(page) > 5 and not page.evaluate(stale))
    for text in ("one", "two"):
        server.controller.live.notify(text)
    page.locator("#said li").filter(has_text="two").wait_for()
    went_on = threading.Event()
    server._loop.call_soon_threadsafe(went_on.wait)  # the server hangs, and its line stays open
    page.locator("#line").filter(has_text=re.compile(r"no news for \d+ s")).wait_for()
    assert page.evaluate(stale)
    wait_until(lambda: float(page.locator("#skin").evaluate("e => getComputedStyle(e).opacity")) < 0.5)
    went_on.set()
    wait_until(lambda: not page.evaluate(stale))
    server.close()
    page.locator("#line").filter(has_text="not connected").wait_for()
    wait_until(lambda: page.evaluate(stale))
    simulator = Simulator(Settings(SENSOR, RATE_HZ), OBJECTS)
    with Live(simulator.source(), tracks=False) as live:
        live.notify("after the restart")  # its first message, as "one" was
        controller = Controller(live, server.controller.health._executor, simulator)
        again = Server(controller, Access("127.0.0.1"), server.port)
        page.locator("#said li").filter(has_text="after the restart").wait_for()
        live.stop()
        page.locator("#line").filter(has_text="the stream has ended").wait_for()
        assert page.locator("body.no-scans").count() == 1
        again.close()
    page.close()


def test_the_page_on_a_phone(open_page: Callable[..., Any], tmp_path: Path) -> None:
    page = open_page(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    wide = page.evaluate("() => document.documentElement.scrollWidth")
    assert wide <= 390
    for key in ("pause", "record", "add", "left"):
        assert page.locator(f"#{key}").bounding_box()["height"] >= 30.0
    corner = page.locator("[data-key='0.1']").bounding_box()
    assert min(corner["width"], corner["height"]) >= 24.0
    _picture(page, "live_phone", tmp_path)


def test_pictures(open_page: Callable[..., Any], server: Server, tmp_path: Path) -> None:
    page = open_page(viewport={"width": 1000, "height": 800}, color_scheme="light")
    theme = "() => document.documentElement.dataset.theme"
    assert page.evaluate(theme) == "light"
    for field, value in (("noise", "1"), ("hz", "100")):  # so that regions show
        page.locator(f"#{field}").fill(value)
        page.locator(f"#{field}").press("Enter")
    page.locator(".region").first.wait_for(state="attached")
    page.locator("#hz").blur()
    settled = server.controller.live.frames + 200
    wait_until(lambda: server.controller.live.frames > settled)
    wait_until(lambda: [(one["status"], one["advice"]) for one in _objects(page)] == [("ok", "")] * 2)
    _picture(page, "live", tmp_path)
    page.locator("#theme").click()
    assert page.evaluate(theme) == "dark"
    _picture(page, "live_dark", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "server",
    [(ts.Sensor.load("layered-crs-crs"), 50.0, ON_SHARED_STRIPS, False)],
    indirect=True,
    ids=["layered"],
)
def test_two_layers_and_their_objects_are_drawn(open_page: Callable[..., Any], tmp_path: Path) -> None:
    page = open_page(viewport={"width": 1000, "height": 860})
    wait_until(lambda: [one["status"] for one in _objects(page)] == ["ok"] * 2)
    assert page.locator(".touched").count() == 2
    _picture(page, "live_two_layers", tmp_path)


@pytest.mark.skipif(exported("rigid_descend") is None, reason="NumPy takes minutes to find the shape")
@pytest.mark.parametrize("server", [(SENSOR, 50.0, OBJECTS, True)], indirect=True, ids=[""])
def test_the_shape_from_all_scans_is_drawn_beside_the_single_one(
    open_page: Callable[..., Any], server: Server, tmp_path: Path
) -> None:
    """At a rate that leaves the processor to the search."""
    page = open_page(viewport={"width": 1000, "height": 900})
    simulator, turned = server.controller.simulator, 0.0
    known: dict[str, Any] = {}
    assert simulator is not None

    def is_known() -> bool:
        """Turn the first object a little, and say whether its shape is known well."""
        nonlocal turned, known
        turned += 0.02
        ring = ts.Contact.polygon(OBJECTS[0]).turned(0.4 * math.sin(turned)).vertices
        simulator.place([ring.tolist(), OBJECTS[1]])
        tracks = page.evaluate("() => window.tacstrip.frame.tracks") or []
        known = next((t for t in tracks if t["scans"] > 40 and t["status"] == "ok" and t["vertices"]), {})
        return bool(known) and page.locator(".known-curve").count() > 0

    wait_until(is_known)
    assert (known["corners"], page.locator(".fused").count()) == (4, 1)
    assert known["deviation_mm"] < 0.3
    assert "4 corners known to" in page.locator("#tracks").inner_text()
    _picture(page, "live_tracks", tmp_path)


def test_a_solid_is_pressed_into_a_fingertip_that_is_shown_in_space(browser: Any, tmp_path: Path) -> None:
    simulator = Simulator(Settings(ts.Sensor.load("fingertip"), 25.0, ts.Noise(positional=0.001)))
    stream = Live(simulator.source(), next_source=simulator.source, tracks=False)
    with stream as live, background_process() as executor:
        server = Server(Controller(live, executor, simulator, tmp_path), Access("127.0.0.1"))
        page, faults = _page(browser, viewport={"width": 1000, "height": 800}), list[str]()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.goto(server.urls["control"])
        wait_until(lambda: _drawn(page) > 5)
        shown = "() => document.getElementById('space').toDataURL()"
        before = page.evaluate(shown)
        assert len(before) > 5_000  # something is drawn
        page.locator("#space").press("ArrowLeft")
        assert page.evaluate(shown) != before
        solid = page.locator("#solid")
        solid.select_option("edge")

        def picked() -> bool:
            if solid.input_value() != "edge":  # taken back: as a user would, once more
                solid.select_option("edge")
            return bool(simulator.objects[0].solid == "edge")

        wait_until(picked)
        x, y = _centre(page, ".handle")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 120, y, steps=4)
        page.mouse.up()
        wait_until(lambda: simulator.objects[0].x_mm < 25.0)
        page.locator(".handle").press("+")
        wait_until(lambda: simulator.objects[0].depth_mm == 1.6)
        page.locator("#depth").fill("9")
        page.locator("#depth").press("Enter")
        wait_until(lambda: "sinks 9 mm into a skin of 3 mm" in page.locator("#said").inner_text())
        assert page.locator("#rigid").is_hidden()
        wait_until(lambda: page.locator("#depth").input_value() == "1.6" or page.locator("#depth").blur())
        page.locator("#depth").fill("2.6")
        page.locator("#depth").press("Enter")
        wait_until(lambda: simulator.objects[0].depth_mm == 2.6)
        _picture(page, "live_fingertip", tmp_path)
        page.close()
        server.close()
    assert faults == []


def _picture(page: Any, name: str, otherwise: Path) -> None:
    """Write a picture from the page's top; with letters that can be read where it is shown 600 pixels wide."""
    folder, large = Path(os.environ.get("TACSTRIP_PICTURES", otherwise)), page.viewport_size["width"] > 600
    page.evaluate(
        "large => { if (large) document.documentElement.style.fontSize = '20px'; scrollTo(0, 0); }", large
    )
    drawn = _drawn(page)
    wait_until(lambda: _drawn(page) > drawn + 1)
    page.screenshot(path=folder / f"{name}.png")
    assert (folder / f"{name}.png").stat().st_size > 20_000
