"""One root for every error that a user can cause, so that one `except` catches them all.

A message names the place, what was found there and what to do about it. Each error is also of the built-in kind that
a Python user looks for: a value that cannot be is a `ValueError`, a device that cannot be used an `OSError`.
"""

from __future__ import annotations

from collections.abc import Iterable


class TacstripError(Exception):
    """Root of all errors raised on purpose by tacstrip.

    Examples
    --------
    >>> import tacstrip as ts
    >>> try:
    ...     ts.Sensor.load("none.toml")
    ... except ts.TacstripError as error:
    ...     print(error)
    none.toml: no such file...
    """


class SpecError(TacstripError, ValueError):
    """A sensor specification that cannot be: unknown key, impossible value, unreadable file.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Sensor(construction="crs-m", strips=4, pitch_mm=5.0, length_mm=-9.0)
    Traceback (most recent call last):
        ...
    tacstrip.errors.SpecError: length_mm = -9.0: must be above 0...
    """


class ContactError(TacstripError, ValueError):
    """A contact that cannot be used: unreadable, crossing itself, off the sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Contact.from_wkt("POLYGON ((0 0")
    Traceback (most recent call last):
        ...
    tacstrip.errors.ContactError: ...
    """


class ReadingError(TacstripError, ValueError):
    """Readings that cannot be used: missing column or strip, volts out of range, broken file.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Scan(k=[0.5, 1.7])
    Traceback (most recent call last):
        ...
    tacstrip.errors.ReadingError: k of strip 1 is 1.7, outside 0..1: it is a voltage over Vref
    """


class ReadingWarning(UserWarning):
    """Readings that were read, and are probably not what was meant: another unit, exchanged channels, a cut file.

    Examples
    --------
    >>> import warnings
    >>> import tacstrip as ts
    >>> warnings.simplefilter("error", ts.ReadingWarning)  # to stop at the first
    """


class SignatureError(TacstripError, ValueError):
    """A signature that the construction or the scan does not have.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Scan(k=[0.5, 0.6])["kh"]
    Traceback (most recent call last):
        ...
    tacstrip.errors.SignatureError: the scan has no 'kh'; it has: k
    """


class NetworkError(TacstripError, ValueError):
    """A network of resistors that cannot be solved: a resistance of 0 or less, a node that floats.

    Examples
    --------
    >>> import tacstrip as ts
    >>> from tacstrip.network import Readout
    >>> Readout(strip_ohm=0.0)
    Traceback (most recent call last):
        ...
    tacstrip.errors.NetworkError: strip_ohm = 0.0: must be above 0...
    """


class RecordingError(TacstripError, ValueError):
    """A recording that cannot be read or made: not one, damaged, already there, of another sensor.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Recording("none.mcap")
    Traceback (most recent call last):
        ...
    tacstrip.errors.RecordingError: none.mcap: no such file
    """


class PortError(TacstripError, OSError):
    """A device that cannot be used: no such port, no tacstrip firmware on it, another sensor than the spec.

    Parameters
    ----------
    text
        The message.
    unconfirmed
        How many of the latest scans of a stream that it ends may be another unit's; recordings leave them out.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.live("/dev/none")
    Traceback (most recent call last):
        ...
    tacstrip.errors.PortError: /dev/none: no such port...
    """

    def __init__(self, text: str, unconfirmed: int = 0) -> None:
        super().__init__(text)
        self.unconfirmed = unconfirmed


class OptionError(TacstripError, ValueError):
    """An option with a value that does not exist or cannot be.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.Noise(positional=2.0)
    Traceback (most recent call last):
        ...
    tacstrip.errors.OptionError: positional = 2.0: ...
    """


class ArgumentError(TacstripError, TypeError):
    """An argument of another type than the function takes; the message says what to write instead.

    Examples
    --------
    >>> import tacstrip as ts
    >>> ts.fit_polygon(ts.Scan(k=[0.5]), "sensor.toml")
    Traceback (most recent call last):
        ...
    tacstrip.errors.ArgumentError: fit_polygon: sensor is 'sensor.toml', not a Sensor; write...
    """


def one_of(what: str, value: object, choices: object) -> str:
    """Say that `value` is not one of `choices`, which are listed in the message."""
    names = ", ".join(str(c) for c in choices)  # type: ignore[attr-defined]
    return f"{what} {value!r} does not exist; choose one of: {names}"


def shortened(names: Iterable[str], most: int = 100) -> str:
    """List names of a file in a message; of very many, or very long ones, the first characters alone."""
    text = ", ".join(names)
    return text if len(text) <= most else f"{text[:most]} ..."


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


def figures(value: float, digits: int = 2) -> str:
    """Return a number to so many significant digits, large ones without an exponent: 140, not 1.4e+02."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


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
