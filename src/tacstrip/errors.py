"""One root for every error that a user can cause, so that one `except` catches them all.

A message names the place, what was found there and what to do about it. Each error is also of the built-in kind that
a Python user looks for: a value that cannot be is a `ValueError`, a device that cannot be used an `OSError`.
"""

from __future__ import annotations


class TacstripError(Exception):
    """Root of all errors raised on purpose by tacstrip."""


class SpecError(TacstripError, ValueError):
    """A sensor specification that cannot be: unknown key, impossible value, unreadable file."""


class ContactError(TacstripError, ValueError):
    """A contact that cannot be used: unreadable, crossing itself, off the sensor."""


class ReadingError(TacstripError, ValueError):
    """Readings that cannot be used: missing column or strip, volts out of range, broken file."""


class SignatureError(TacstripError, ValueError):
    """A signature that the construction or the scan does not have."""


class NetworkError(TacstripError, ValueError):
    """A network of resistors that cannot be solved: a resistance of 0 or less, a node that floats."""


class RecordingError(TacstripError, ValueError):
    """A recording that cannot be read or made: not one, damaged, already there, of another sensor."""


class PortError(TacstripError, OSError):
    """A device that cannot be used: no such port, no tacstrip firmware on it, another sensor than the spec."""


class OptionError(TacstripError, ValueError):
    """An option with a value that does not exist or cannot be."""


class ArgumentError(TacstripError, TypeError):
    """An argument of another type than the function takes; the message says what to write instead."""


def one_of(what: str, value: object, choices: object) -> str:
    """Say that `value` is not one of `choices`, which are listed in the message."""
    names = ", ".join(str(c) for c in choices)  # type: ignore[attr-defined]
    return f"{what} {value!r} does not exist; choose one of: {names}"


def number(text: str) -> float:
    """Return the number that a text of a file is, in the digits 0 to 9; Python takes more: 1_0, and others' digits.

    Raises
    ------
    ValueError
        It is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"not a number: {text!r}")
    return float(text)


def in_words(error: BaseException) -> str:
    """Say what an exception means: a message of ours as it is, of a system call what and where, else its kind too."""
    if isinstance(error, TacstripError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def is_number(text: str) -> bool:
    """Whether a text that was to be a number is one; else messages say what it is."""
    try:
        number(text)
    except ValueError:
        return False
    return True
