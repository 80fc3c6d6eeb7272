"""Check contrast, names and alternative texts of a built site with axe-core in Chromium, in light and dark.

axe-core comes from npm into .tools/axe at a pinned version; what is missing is named, and then nothing is checked.

Run: python tools/docs_site/axe.py docs/_build/html [PAGE ...]; "all" for all pages, without one the sample.
The frame that all pages share is checked on the sample alone.
"""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.async_api import Browser

AXE = "axe-core@4.14.1"
_TOOLS = Path(__file__).parents[2] / ".tools" / "axe"
# A page of every kind: tables, code, formulas, pictures, options, signatures, figures with captions.
SAMPLE = (
    *("index.html", "start/what-is-this-sensor.html", "start/ten-minutes.html", "guide/index.html"),
    *("guide/build.html", "examples/index.html", "examples/plot_01_one_scan.html", "reference/index.html"),
    *("reference/python.html", "reference/commands/simulate.html", "reference/statuses.html"),
    *("science/index.html", "science/physics.html", "reproduction/chapter-5.html", "glossary.html"),
)
TABS = 2
# Both schemes from one load; in the dark only colours differ. A page without a <main>, as a redirection is, is
# checked whole.
_RUN = """async whole => {
    const part = whole ? document : document.querySelector('main') ?? document, found = [];
    const still = document.head.appendChild(document.createElement('style'));
    still.textContent = '* {transition: none !important}';
    for (const scheme of ['light', 'dark']) {
        document.documentElement.dataset.theme = document.documentElement.dataset.mode = scheme;
        const runOnly = scheme === 'dark' ? {runOnly: ['color-contrast']} : {};
        const {violations} = await axe.run(part, {resultTypes: ['violations'], preload: false, ...runOnly});
        for (const {id, nodes} of violations)
            for (const {html, failureSummary} of nodes)
                found.push(`${scheme}: ${id}: ${html.slice(0, 100)}: ${failureSummary.split('\\n').at(-1).trim()}`);
    }
    return found;
}"""


def script() -> Path:
    """Return axe-core's file, fetched by npm when it is not there.

    Raises
    ------
    OSError
        npm is missing, or cannot fetch it.
    """
    file = _TOOLS / "node_modules" / "axe-core" / "axe.min.js"
    if not file.exists():
        if shutil.which("npm") is None:
            raise OSError("npm is not installed (apt-get install npm)")
        command = [
            "npm",
            "install",
            "--silent",
            "--no-save",
            "--ignore-scripts",
            "--prefix",
            str(_TOOLS),
            AXE,
        ]
        if subprocess.run(command, capture_output=True, check=False).returncode or not file.exists():
            raise OSError(f"npm cannot fetch {AXE}")
    return file


def violations(site: Path, pages: list[str], axe: Path) -> list[str]:
    """Return what axe finds on pages of a site, a line each: page, scheme, rule, place.

    Raises
    ------
    OSError
        Playwright or Chromium is missing.
    """
    try:
        from playwright.async_api import async_playwright
    except ImportError:
        raise OSError("playwright is not installed (it is of the group dev)") from None
    if (chromium := shutil.which("chromium") or shutil.which("chromium-browser")) is None:
        raise OSError("Chromium is not installed (apt-get install chromium)")
    code, waiting, found = axe.read_text(encoding="utf-8"), iter(pages), {}

    async def look(browser: Browser) -> None:
        page = await browser.new_page()
        page.set_default_timeout(0)
        for name in waiting:
            await page.goto((site / name).resolve().as_uri(), wait_until="domcontentloaded")
            await page.evaluate(code)
            found[name] = [f"{name}, {said}" for said in await page.evaluate(_RUN, name in SAMPLE)]

    async def look_at_all() -> None:
        async with async_playwright() as driver:
            browser = await driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            await asyncio.gather(*(look(browser) for _ in range(TABS)))
            await browser.close()

    asyncio.run(look_at_all())
    return [said for name in pages for said in found[name]]


def main(folder: str, *pages: str) -> int:
    """Print what axe finds; return the exit code."""
    site = Path(folder)
    chosen = list(pages or SAMPLE)
    if chosen == ["all"]:
        chosen = [str(f.relative_to(site)) for f in sorted(site.rglob("*.html")) if "_static" not in f.parts]
    try:
        found = violations(site, chosen, script())
    except OSError as error:
        print(f"contrast and alternative texts were not checked: {error}")
        return 0
    print(*found, f"axe: {len(found)} violations on {len(chosen)} pages, in light and dark", sep="\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
