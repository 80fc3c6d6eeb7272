"""Results of scans whose readings are doubted as a whole: untouched strips have some, or the contact moved."""

from __future__ import annotations

from dataclasses import replace

from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor


def doubt_untouched(result: Reconstruction, scan: Scan, sensor: Sensor) -> Reconstruction:
    """Return the result, "doubtful" in place of "ok" and with advice where its readings are doubted.

    Untouched strips seem to have some, or they are the mean of scans of a contact that moved.
    """
    hint = ""
    if scan.touched.all():
        raw = invert_calibration(sensor, {name: scan[name] for name in scan.signatures})
        hint = rest_hint(sensor, raw, failed=result.status not in ("ok", "likely") or bool(result.advice))
    if scan.moved:
        hint = (
            f"the contact moved while {scan.averaged} scans were averaged: half of the channels changed by "
            f"{100.0 * scan.moved:.2g} % of Vref or more; average fewer"
        )
    if not hint:
        return result

    def doubted(found: RecoveredObject) -> RecoveredObject:
        status = "doubtful" if found.status in ("ok", "likely") else found.status
        return replace(found, status=status, advice="; ".join(filter(None, (found.advice, hint))))

    return replace(result, objects=tuple(map(doubted, result.objects)))
