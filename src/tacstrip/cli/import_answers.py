"""Questions that a log of any form leaves open, and their answers: of `tacstrip import` and `tacstrip init --from`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from tacstrip.errors import OptionError, ReadingError

ANSWERS = click.option(
    "--answer",
    "answers",
    multiple=True,
    metavar="KEY=VALUE",
    help="Answer a question, or say what a column is; repeat.",
)


def answered(texts: tuple[str, ...]) -> dict[str, str]:
    """Return answers by their key; `OptionError` where one has none."""
    found = {}
    for text in texts:
        key, equals, value = text.rpartition("=")
        if not equals or not key.strip():
            raise OptionError(f"--answer {text}: write KEY=VALUE, such as --answer time_unit=ms")
        found[key.strip()] = value.strip()
    return found


@contextmanager
def asked_of(log: Path) -> Iterator[None]:
    """Turn questions into a failure with exit code 1 that asks them; name the log in errors."""
    # Late: they load NumPy.
    from tacstrip.io.log_import.containers import SeveralSheets
    from tacstrip.io.log_import.questions import Question, Unanswered

    try:
        yield
    except SeveralSheets as several:
        which = Question(
            "sheet", "several sheets hold something: which one?", tuple(str(several).split(", "))
        )
        raise click.ClickException(f"{log} does not say:\n  {which}") from None
    except Unanswered as open_:
        raise click.ClickException(
            "\n  ".join([f"{log} does not say:", *map(str, open_.questions)])
        ) from None
    except ReadingError as error:
        raise ReadingError(f"{log}: {error}" if not str(error).startswith(str(log)) else str(error)) from None
