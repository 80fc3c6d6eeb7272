"""Results of scans that cannot be meant: untouched strips with readings, exchanged columns, means of what moved."""

from __future__ import annotations

from dataclasses import replace

from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.exchanged import exchanged
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor


def doubt_implausible(result: Reconstruction, scan: Scan, sensor: Sensor) -> Reconstruction:
    """Return the result; where the readings are implausible "doubtful" in place of "ok", and with advice."""
    hint = implausible_hint(scan, sensor, result.status not in ("ok", "likely") or bool(result.advice))
    if not hint:
        return result

    def doubted(found: RecoveredObject) -> RecoveredObject:
        status = "doubtful" if found.status in ("ok", "likely") else found.status
        return replace(found, status=status, advice="; ".join(filter(None, (found.advice, hint))))

    return replace(result, objects=tuple(map(doubted, result.objects)))


def implausible_hint(scan: Scan, sensor: Sensor, failed: bool) -> str:
    """Say why readings cannot be meant, nothing where they can; `failed`: whether their result is doubted anyway."""
    read = {name: scan[name] for name in scan.signatures}
    hint = exchanged(read) if sensor.kind.closed_form else ""
    if scan.touched.all() and not hint:
        hint = rest_hint(sensor, invert_calibration(sensor, read), failed)
    if scan.moved:
        hint = (
            f"the contact moved while {scan.averaged} scans were averaged: half of the channels changed by "
            f"{100.0 * scan.moved:.2g} % of Vref or more; average fewer"
        )
    return hint
