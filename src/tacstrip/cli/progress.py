"""How far a verb has come: a bar on standard error, where a person looks at it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

_Item = TypeVar("_Item")


def progress_bar() -> Progress:
    """Return a bar that is gone when it ends; standard output is left to results, and a file gets nothing of it."""
    console = Console(stderr=True)
    return Progress(transient=True, console=console, disable=not console.is_terminal)


def followed(items: Sequence[_Item], what: str) -> Iterator[_Item]:
    """Yield items, and show how many of them have been taken."""
    with progress_bar() as bar:
        yield from bar.track(items, description=what)
