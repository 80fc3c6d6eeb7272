"""Check a built site: every link and picture within it leads somewhere, none is fetched from the network, its size."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

MOST_MB = 40


class _Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.needed: list[str] = []
        self.anchors: set[str] = set()
        self.bare: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        needed = given.get("src") or (given.get("href", "") if tag == "link" else "")
        if needed and given.get("rel") != "canonical":
            self.needed.append(needed)
        if tag == "img" and not given.get("alt"):
            self.bare.append(given.get("src", ""))


def problems(site: Path) -> tuple[list[str], set[str]]:
    """Return what is wrong with the site, and the addresses outside that it names."""
    pages = {file: _Page(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    wrong, outside = [], set()
    for file, page in pages.items():
        here = file.relative_to(site)
        wrong += [f"{here}: a picture without an alternative text: {source}" for source in page.bare]
        for target in page.links + page.needed:
            parts = urlsplit(target)
            if parts.scheme in ("data", "mailto", "javascript"):
                continue
            if parts.scheme or parts.netloc:
                outside.add(target)
                if target in page.needed:
                    wrong.append(f"{here}: needs {target} from the network")
                continue
            aim = (file.parent / unquote(parts.path)).resolve() if parts.path else file.resolve()
            if not aim.exists():
                wrong.append(f"{here}: {target} leads nowhere")
            elif parts.fragment and aim in pages and unquote(parts.fragment) not in pages[aim].anchors:
                wrong.append(f"{here}: {target}: no such place on that page")
    return wrong, outside


def main(folder: str) -> int:
    """Print what is wrong, list what lies outside and is not fetched; return the exit code."""
    site = Path(folder).resolve()
    wrong, outside = problems(site)
    size = sum(f.stat().st_size for f in site.rglob("*") if f.is_file()) / 1e6
    if size > MOST_MB:
        wrong.append(f"the site has {size:.0f} MB, and {MOST_MB} are allowed")
    (site.parent / "outside.txt").write_text("\n".join(sorted(outside)) + "\n", encoding="utf-8")
    listed = site.parent / "outside.txt"
    print(*wrong, f"{size:.1f} MB; {len(outside)} addresses outside, not fetched: {listed}", sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
