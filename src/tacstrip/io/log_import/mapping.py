"""How a log's columns become readings: a small TOML file that is written once and used again."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path

from tacstrip.errors import OptionError, one_of
from tacstrip.files import read_text, why_unreadable, write_text
from tacstrip.io.log_import.names import CHANNELS, CLOCKS, READING_UNITS, TIME_UNITS, seconds_of

RESTARTS = ("error", "continue", "first", "last")
STRIP_ORDERS = ("ascending", "descending")
_KINDS: dict[str, type | tuple[type, ...]] = {
    "columns": dict, "untouched": list, "only": list, "strips": int, "strip_base": int, "format": int,
    "rate_hz": (int, float), "vref_volt": (int, float), "adc_bits": int, "time_bits": int, "strip_step": (int, float),
    "scale": (int, float), "zero": (int, float), "from_vref": bool,
}  # fmt: skip


@dataclass(frozen=True)
class ColumnMapping:
    """What the columns of a log are.

    Attributes
    ----------
    columns
        Column -> "h", "l" or "out" where each line is of one strip, "3:h" where the column is of one strip.
    unit
        Of the readings: "V", "mV", "uV", "code", "fraction", "percent" or "permille" (of Vref).
    time, time_unit, rate_hz
        Column of the time and its unit ("2.5ms" for a timer's ticks, "clock" for times of day and dates, "hh:mm" or
        "mm:ss" for 14:05), or scans per second where there is none; neither: times are left empty.
    scan, strip, which
        Columns of the scan's number, the strip's, and of the channel's name where a line holds readings of one of them.
    strip_base
        Number of the first strip.
    strips
        How many there are.
    untouched
        What stands where nothing touches, besides empty fields.
    missing
        "untouched": strips without a line are untouched ones; "skip": scans that lack one are left out; "error".
    broken_lines
        "skip" or "error".
    vref_volt
        For fractions, or codes of another converter than the spec's, where no spec says it.
    which_h
        What stands in the column `which` for the channel h, where its words do not say so.
    adc_bits
        Of codes that are not of the spec's converter; 0: they are.
    time_bits
        Of a device's clock that begins anew when these are full; 0: it never did.
    restart
        Where the clock begins anew otherwise: "error", "continue" (a usual step later), "first" or "last" (only the
        part before or after).
    strip_step
        Where the column of the strip says instead where it lies: from strip to strip, in the column's unit; else 0.
    only
        Lines that are taken, where others are of other sensors: "pad=left".
    scale
        What readings are multiplied by, as where they are behind a divider.
    zero
        The code of 0 V, where codes have a sign that is written as an offset.
    turn
        "1/2" where two sensors write in turn, and the first is meant.
    strip_order
        "descending" where the log's first strip is the sensor's last one; or the sensor's strips in the log's order,
        as "2,0,1"; or the names that the log has for its strips, as "red,brown,black", from the first strip on.
    from_vref
        Whether readings are measured from Vref down: Vref less the reading is the voltage.
    """

    columns: dict[str, str]
    unit: str
    strips: int
    strip_base: int = 0
    time: str = ""
    time_unit: str = "s"
    rate_hz: float = 0.0
    scan: str = ""
    strip: str = ""
    which: str = ""
    untouched: tuple[str, ...] = ()
    missing: str = "error"
    broken_lines: str = "error"
    vref_volt: float = 0.0
    format: int = field(default=1)
    which_h: str = ""
    adc_bits: int = 0
    time_bits: int = 0
    restart: str = "error"
    strip_step: float = 0.0
    only: tuple[str, ...] = ()
    scale: float = 1.0
    zero: float = 0.0
    turn: str = ""
    strip_order: str = "ascending"
    from_vref: bool = False

    def save(self, path: str | Path) -> None:
        """Write it as TOML."""
        lines = ["# How `tacstrip import` reads logs of this form; use it again with --mapping."]
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "columns" or (value == item.default and item.name != "format"):
                continue
            shown = f"[{', '.join(map(_quoted, value))}]" if isinstance(value, tuple) else value
            shown = str(value).lower() if isinstance(value, bool) else shown
            lines.append(f"{item.name} = {_quoted(shown) if isinstance(value, str) else shown}")
        lines += [
            "",
            "[columns]",
            *(f"{_quoted(name)} = {_quoted(what)}" for name, what in self.columns.items()),
        ]
        write_text(path, "\n".join(lines) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> ColumnMapping:
        """Read one; `OptionError` names what is wrong with it."""
        try:
            if why := why_unreadable(path):
                raise OptionError(f"{path}: {why}")
            given = tomllib.loads(read_text(path))
        except FileNotFoundError:
            raise OptionError(f"{path}: no such file") from None
        except OptionError:
            raise
        except (OSError, ValueError, RecursionError) as error:
            raise OptionError(f"{path}: no mapping in TOML ({error})") from None
        known = {item.name: item for item in fields(cls)}
        for key, value in given.items():
            if key not in known:
                raise OptionError(f"{path}: " + one_of("key", key, tuple(known)))
            kind = _KINDS.get(key, str)
            if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
                raise OptionError(
                    f"{path}: {key} = {value!r} is of the wrong kind; let `tacstrip import` write one to see"
                )
        if lack := [key for key in ("columns", "unit", "strips") if key not in given]:
            raise OptionError(f"{path}: {lack[0]} is missing; let `tacstrip import` write one to see")
        if given.get("format", 1) != 1:
            raise OptionError(f"{path}: format = {given['format']}: this version reads format 1")
        for name, what in given["columns"].items():
            if not isinstance(what, str):
                raise OptionError(f'{path}: columns: {name} = {what!r} is no text; write "h", "l" or "out"')
        for key in ("untouched", "only"):
            given[key] = tuple(map(str, given.get(key, ())))
        made = cls(**given)
        made.check(str(path))
        return made

    def check(self, place: str) -> None:
        """Raise `OptionError` where it contradicts itself."""
        listed = self.strip_names or self.order_of_strips(place)
        for name, value, known in (
            ("unit", self.unit, READING_UNITS), ("missing", self.missing, ("untouched", "skip", "error")),
            ("broken_lines", self.broken_lines, ("skip", "error")),
            ("restart", self.restart, RESTARTS),
            ("strip_order", "" if listed else self.strip_order, ("", *STRIP_ORDERS)),
        ):  # fmt: skip
            if value not in known:
                raise OptionError(f"{place}: " + one_of(name, value, known))
        if self.time_unit not in CLOCKS and not seconds_of(self.time_unit) > 0.0:
            raise OptionError(
                f"{place}: " + one_of("time_unit", self.time_unit, (*TIME_UNITS, *CLOCKS, "2.5ms"))
            )
        turn = re.fullmatch(r"(\d)/(\d)", self.turn)
        if self.turn and not (turn and 1 <= int(turn[1]) <= int(turn[2]) > 1):
            raise OptionError(f"{place}: turn = {self.turn!r}; write 1/2 for the first of two sensors")
        if self.scale <= 0.0:
            raise OptionError(f"{place}: scale = {self.scale:g}; it must be above 0")
        if self.strips < 1 or not self.columns:
            raise OptionError(
                f"{place}: strips = {self.strips}, columns: {len(self.columns)}; both must be 1 or more"
            )
        for name, what in self.columns.items():
            strip, colon, channel = what.rpartition(":")
            if (channel not in CHANNELS and not self.which) or (
                colon and not re.fullmatch("-?[0-9]+", strip)
            ):
                raise OptionError(
                    f'{place}: {name} = {what!r}; write "h", "l" or "out", or "3:h" for a column of strip 3'
                )

    def order_of_strips(self, place: str) -> list[int]:
        """Return the sensor's strip, from 0, of each of the log's, if listed; `OptionError` if not each is once."""
        if "," not in self.strip_order or self.strip_names:
            return []
        listed = [int(n) if n.strip().isdigit() else -1 for n in self.strip_order.split(",")]
        if sorted(listed) != [*range(min(listed), min(listed) + self.strips)] or min(listed) not in (0, 1):
            raise OptionError(
                f"{place}: strip_order = {self.strip_order}: list each of {self.strips} strips once"
            )
        return [n - min(listed) for n in listed]

    @property
    def strip_names(self) -> tuple[str, ...]:
        """Names, from strip 0 on, where the log has these for numbers, such as the colours of wires; else ()."""
        names = tuple(n.strip() for n in self.strip_order.split(","))
        return (
            names if len({*names}) == len(names) > 1 and not any(re.search(r"\d", n) for n in names) else ()
        )

    @property
    def wide(self) -> bool:
        """Whether each column is of one strip."""
        return any(":" in what for what in self.columns.values())

    @property
    def timed(self) -> bool:
        """Whether scans have times."""
        return bool(self.time or self.rate_hz)

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that it gives, in the order h, l, out."""
        there = {what.rpartition(":")[2] for what in self.columns.values()}
        return CHANNELS[:2] if self.which else tuple(c for c in CHANNELS if c in there)


def _quoted(text: object) -> str:
    return '"' + str(text).replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t") + '"'
