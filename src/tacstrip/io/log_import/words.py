"""Words that logs are written in, by what they mean, from `data/log_words.toml`."""

from __future__ import annotations

import re
import tomllib
from functools import cache

from tacstrip.data import data_path

_LETTER = re.compile(r"[^\W\d_]")


@cache
def _table() -> dict[str, dict[str, str]]:
    return tomllib.loads(data_path("log_words.toml").read_text(encoding="utf-8"))


def words_of(concept: str) -> list[str]:
    """Return the words of a concept, in all languages; with stars, as the table has them."""
    return [" ".join(word.split()) for said in _table()[concept].values() for word in said.split(",")]


def any_of(*concepts: str) -> str:
    """Return an expression of the words of concepts, the longest first, for case to be ignored.

    Examples
    --------
    >>> import re
    >>> re.findall(any_of("battery"), "Akkustand, Batterie leer", re.IGNORECASE)
    ['Akkustand', 'Batterie']
    """
    words = {word for concept in concepts for word in words_of(concept)}
    return "(?:" + "|".join(map(_as_expression, sorted(words, key=lambda w: (-len(w), w)))) + ")"


def names_of(kind: str) -> list[str]:
    """Return the words of columns' names that are of a kind, such as "time".

    Examples
    --------
    >>> "zeit" in names_of("time"), "zeit" in names_of("strip")
    (True, False)
    """
    return _table()["names"][kind].split()


def translated() -> dict[str, list[str]]:
    """Return English word -> what other scripts have for it."""
    return {english: alike.split() for english, alike in _table()["translated"].items()}


@cache
def finder(*concepts: str) -> re.Pattern[str]:
    """Return what finds a word of concepts; compiled once."""
    return re.compile(any_of(*concepts), re.IGNORECASE)


def _as_expression(word: str) -> str:
    """Return a word's expression: whole, but for a star, which stands for any letters."""
    body = r"\w*".join(r"\s+".join(map(re.escape, part.split())) for part in word.strip("*").split("*"))
    before = "" if word.startswith("*") and not word[1].isascii() else r"(?<!\w)"
    return before + r"\w*" * word.startswith("*") + body + (r"\w*" if word.endswith("*") else r"(?!\w)")


def all_are(text: str, *concepts: str) -> bool:
    """Return whether all words of a text, of which there are some, are of concepts.

    Examples
    --------
    >>> all_are("Akku, Batterie 2", "battery"), all_are("Akku leer", "battery")
    (True, False)
    """
    return bool(_LETTER.search(text)) and not _LETTER.search(finder(*concepts).sub(" ", text))
