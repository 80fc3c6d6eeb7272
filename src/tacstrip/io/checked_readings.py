"""Readings for Python: read, and looked at for what was probably not meant."""

from __future__ import annotations

import warnings
from pathlib import Path

from tacstrip.arguments import takes
from tacstrip.errors import ReadingWarning
from tacstrip.io.input_checks import readings_suspicions, unlikely_lengths
from tacstrip.io.readings import Frame, read_unchecked
from tacstrip.scan import Scan
from tacstrip.sensor.layers import AnySensor, LayeredSensor
from tacstrip.sensor.spec import Sensor


@takes(sensor=Sensor | LayeredSensor)
def read_readings(path: str | Path | Frame, sensor: AnySensor) -> list[Scan]:
    r"""Read a readings file (CSV), or a table of the same columns; the sensor's calibration, if any, corrects them.

    Parameters
    ----------
    path
        The file: a line per strip and scan, in volts or A/D codes (docs/reference/files.md); or a pandas DataFrame
        with its columns, or of another form, as `tacstrip import` reads (docs/guide/import.md), NaN where nothing
        touches.
    sensor
        The sensor that it is of. Of two layers each line names its layer, 0 or 1, in the column `layer`.

    Returns
    -------
    list of Scan
        In the file's order.

    Warns
    -----
    ReadingWarning
        What was read is probably not what was meant: volts that look like fractions of Vref or like codes of another
        converter, v_h and v_l exchanged, lines that are cut, strips with one reading of two; a sensor in metres or
        centimetres.

    Raises
    ------
    ReadingError
        The file cannot be read, lacks a column or a strip, or has a value that cannot be; the message
        names the line and the remedy.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> sensor = ts.Sensor(construction="crs-m", strips=2, pitch_mm=6.5, length_mm=325.0, vref_volt=5.0)
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "readings.csv"
    >>> _ = file.write_text("scan,time_s,strip,v_out\n0,0,0,2.5\n0,0,1,\n")
    >>> ts.read_readings(file, sensor)[0].k
    array([0.5, nan])
    """
    scans = read_unchecked(path, sensor)
    for text in (unlikely_lengths(sensor), *readings_suspicions(path, sensor, scans, scale=True)):
        if text:
            warnings.warn(text, ReadingWarning, stacklevel=3)  # at the caller of what `takes` makes of this
    return scans
