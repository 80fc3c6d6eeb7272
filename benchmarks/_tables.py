"""Tables in markdown, shared by the benchmarks: print the ones that are asked for."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping


def row(*cells: object) -> None:
    """Print a row of a markdown table."""
    print("| " + " | ".join(f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells) + " |")


def head(*cells: str) -> None:
    """Print the head of a markdown table."""
    row(*cells)
    row(*["---"] * len(cells))


def print_asked(tables: Mapping[str, Callable[[], None]]) -> None:
    """Print the tables that the command line names, all by default, each with its time."""
    parser = argparse.ArgumentParser()
    parser.add_argument("tables", nargs="*", choices=[[], *tables], help="all by default")
    for name in parser.parse_args().tables or tables:
        start = time.perf_counter()
        print(f"\n{name}: {(tables[name].__doc__ or '').strip()}\n")
        tables[name]()
        print(f"\n({time.perf_counter() - start:.0f} s)", flush=True)
