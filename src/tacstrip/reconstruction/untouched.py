"""Results of scans in which untouched strips have readings: they are doubted, and say what the spec lacks."""

from __future__ import annotations

from dataclasses import replace

from tacstrip.reconstruction.result import Reconstruction, RecoveredObject
from tacstrip.scan import Scan
from tacstrip.sensor.raw import invert_calibration
from tacstrip.sensor.rest_level import rest_hint
from tacstrip.sensor.spec import Sensor


def doubt_untouched(result: Reconstruction, scan: Scan, sensor: Sensor) -> Reconstruction:
    """Return the result; where untouched strips seem to have readings "doubtful" in place of "ok", and with advice."""
    if not scan.touched.all():
        return result
    raw = invert_calibration(sensor, {name: scan[name] for name in scan.signatures})
    hint = rest_hint(sensor, raw, failed=result.status not in ("ok", "likely") or bool(result.advice))
    if not hint:
        return result

    def doubted(found: RecoveredObject) -> RecoveredObject:
        status = "doubtful" if found.status in ("ok", "likely") else found.status
        return replace(found, status=status, advice="; ".join(filter(None, (found.advice, hint))))

    return replace(result, objects=tuple(map(doubted, result.objects)))
