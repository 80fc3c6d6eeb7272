"""A pressed solid's poses over time, from a CSV file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tacstrip.contact.press.solid import Solid
from tacstrip.errors import ContactError, ReadingError, shortened
from tacstrip.io.column_names import nearly
from tacstrip.io.columns import finite
from tacstrip.io.csv_rows import Row, read_csv

_NEEDED = ("x_mm", "y_mm", "z_mm", "dx", "dy", "dz")
_GIVEN = ("time_s", "turn_deg", "depth_mm", "force_n")


@dataclass(frozen=True, eq=False)
class PosedSolid:
    """A solid at one pose of a path.

    Attributes
    ----------
    line
        Of the file.
    time_s
        When [s]; None where the file has no times.
    solid
        At its pose.
    depth_mm, force_n
        How far or how hard it is pressed there; both None where the file does not say.
    """

    line: int
    time_s: float | None
    solid: Solid
    depth_mm: float | None
    force_n: float | None


def read_poses(path: str | Path, solid: Solid) -> list[PosedSolid]:
    """Read where a solid is from scan to scan.

    Columns are x_mm, y_mm, z_mm of its lowest place and dx, dy, dz, the direction in which it is pressed; where they
    are there, also time_s, turn_deg about that direction, and depth_mm or force_n.

    Raises
    ------
    ReadingError
        The file cannot be read, has no pose or other columns, or times do not ascend.
    """

    def parse(header: list[str], rows: Iterator[Row]) -> list[PosedSolid]:
        for name in _NEEDED:
            if name not in header:
                raise ReadingError(
                    nearly(header, [name], (*_NEEDED, *_GIVEN), letters=False)
                    or f"column {name!r} is missing; the header has: {shortened(header)}"
                )
        if unknown := [name for name in header if name not in (*_NEEDED, *_GIVEN)]:
            raise ReadingError(
                f"column {unknown[0]!r} is unknown; poses have: {', '.join((*_NEEDED, *_GIVEN))}"
            )
        at = {name: header.index(name) for name in header}
        if "depth_mm" in at and "force_n" in at:
            raise ReadingError(
                "columns depth_mm and force_n: a solid is pressed so far or so hard; leave one out"
            )
        found: list[PosedSolid] = []
        for line, row in rows:
            value = {name: finite(row[i], line, name) for name, i in at.items()}
            place, toward = ([value[name] for name in part] for part in (_NEEDED[:3], _NEEDED[3:]))
            try:
                posed = solid.at(place, toward, math.radians(value.get("turn_deg", 0.0)))
            except ContactError as error:
                raise ReadingError(f"line {line}: {error}") from None
            last, now = found[-1].time_s if found else None, value.get("time_s")
            if last is not None and now is not None and not now > last:
                raise ReadingError(
                    f"line {line}: time_s = {now:g} does not come after {last:g}, the line before"
                )
            found.append(PosedSolid(line, now, posed, value.get("depth_mm"), value.get("force_n")))
        if not found:
            raise ReadingError("the file has a header and no poses; give a line a scan")
        return found

    return read_csv(path, "poses", parse, "time_s,x_mm,y_mm,z_mm,dx,dy,dz,depth_mm")
