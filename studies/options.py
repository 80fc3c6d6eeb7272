"""The command line of a study: how many cases, of which seed."""

from __future__ import annotations

import argparse


def of_cases(study: str, about: str | None, cases: int, seed: int = 1) -> argparse.ArgumentParser:
    """Return a parser of --cases and --seed with these defaults, to which a study adds what it has besides.

    `study` is what stands after `python -m`, `about` its docstring.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m {study}", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=cases)
    parser.add_argument("--seed", type=int, default=seed)
    return parser
