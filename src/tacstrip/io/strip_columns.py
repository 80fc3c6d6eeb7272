"""The columns of a readings file that name a strip: its number, and of a sensor of two layers its layer."""

from __future__ import annotations

from collections.abc import Callable

from tacstrip.errors import ReadingError
from tacstrip.io.columns import LAYER, strip_index
from tacstrip.io.csv_rows import find
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor


def strip_reader(header: list[str], sensor: AnySensor) -> Callable[[list[str], int], int]:
    """Return what reads from a row, and its line's number, the strip's place in a scan from 0.

    Without a column `layer` all strips are of layer 0. Errors as of `strip_index`.
    """
    at, layers = find(header, "strip"), header.index(LAYER) if LAYER in header else None
    count = len(sensor.layers) if isinstance(sensor, LayeredSensor) else 1

    def place(row: list[str], line: int) -> int:
        text = "0" if layers is None else row[layers]
        if text not in map(str, range(count)):
            known = "the spec has one layer, 0" if count == 1 else f"layers are 0 to {count - 1}"
            raise ReadingError(f"line {line}: layer is {text!r}, and {known}")
        if isinstance(sensor, Sensor):
            return strip_index(row[at], line, sensor)
        number = int(text)
        start: int = sensor.slices[number].start
        try:
            return start + strip_index(row[at], line, sensor.layers[number].sensor)
        except ReadingError as error:
            raise ReadingError(f"{error} (layer {number})") from None

    return place


def strip_fields(sensor: AnySensor) -> tuple[list[str], list[list[int]]]:
    """Return the columns that name a strip, and what stands in them for every strip of a scan."""
    if isinstance(sensor, Sensor):
        return ["strip"], [[i + sensor.strip_base] for i in range(sensor.strips)]
    fields = [
        [number, i + layer.sensor.strip_base]
        for number, layer in enumerate(sensor.layers)
        for i in range(layer.sensor.strips)
    ]
    return [LAYER, "strip"], fields
