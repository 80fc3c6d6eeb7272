"""`tacstrip doctor`."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np

from tacstrip.cli import load_log, note, options, protect
from tacstrip.diagnose.doctor import diagnose
from tacstrip.diagnose.faults import Finding, Report
from tacstrip.diagnose.log import Log


@click.command()
@click.argument("file", type=options.FILE)
@options.option("--sensor", metavar="SENSOR", help="Spec file or shipped spec; a recording holds its own.")
@options.flag("--json", "as_json", help="Print the report as JSON.")
@options.plot("Picture of every strip's health (.png, .svg, .pdf).")
def command(file: Path, sensor: str | None, as_json: bool, plot: Path | None) -> None:
    """Say what is wrong with the hardware that made FILE: readings (CSV) or a recording (.mcap).

    Needs a contact four strips wide or more that goes across and along all strips and turns; docs/guide/doctor.md says
    which fault needs what, and the report lists what was not checked. Exit code 0: no fault found, even if
    questions are open; 1: faults found; 2: bad input.

    Example: tacstrip doctor readings.csv --sensor sensor.toml --plot health.png
    """
    protect(plot, file, sensor)
    log = load_log(file, sensor)
    report = diagnose(log)
    click.echo(json.dumps(report.to_json(), indent=1) if as_json else "\n".join(_lines(log, report)))
    if plot is not None:
        from tacstrip.plot.strip_health import health_figure
        from tacstrip.plot.theme import save

        note(f"{save(health_figure(log, report), plot)} written")
    sys.exit(0 if report.healthy else 1)


def _lines(log: Log, report: Report) -> Iterator[str]:
    """Give the report in words."""
    kind = f"{log.sensor.construction}, {log.sensor.strips} strips"
    yield f"{kind}: {report.scans} scan(s) over {report.seconds:.4g} s"
    for finding in report.findings:
        yield f"{finding.kind.severity.upper()}: {_sentence(report, finding)}"
        yield f"    Check {finding.kind.check}."
        broken = finding.kind.severity == "broken" and log.sensor.kind.closed_form
        if broken and (name := report.without(finding)):
            yield f'    Until then leave it out: --without {name}, or without = ["{name}"] in the spec.'
    for finding in report.notes:
        yield f"Note: {_sentence(report, finding)} {_capital(finding.kind.check)}."
    for question in report.questions:
        yield f"Question: {report.where(question)}: {question.evidence}; {question.ask(report.strip_base)}."
    yield _noise(report)
    for reason in report.unchecked:
        yield f"Not checked: {reason}."
    count, asked = len(report.findings), len(report.questions)
    last = f"{count} fault(s) found" if count else "No fault found, as far as this recording shows"
    yield f"{last}; {asked} question(s) open: a fault or not, see above" if asked else last


def _sentence(report: Report, finding: Finding) -> str:
    return f"{report.where(finding)}: {finding.kind.title}. {_capital(finding.evidence)}."


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _noise(report: Report) -> str:
    noise = report.quality
    if not noise.profile:
        return "Noise: not measured; it needs scans that follow each other closely"
    where = "above profile II (+-1 %)" if noise.profile == "above II" else f"within profile {noise.profile}"
    most = "" if noise.steady else "at most "
    half = noise.half_width_percent
    text = f"Noise: P.U. {most}+-{half:.2g} % of Vref by the median channel, {where}"
    if np.isfinite(noise.strips).any():
        worst = int(np.nanargmax(noise.strips))
        percent = 100.0 * math.sqrt(3.0) * noise.strips[worst]
        text += f"; strip {worst + report.strip_base} is the noisiest, +-{percent:.2g} %"
    if noise.steady:  # a bound that motion is in is no noise to go by
        text += f"; for other verbs: --positional {half / 100.0:.2g}"
    if math.isfinite(noise.vertex_rms_mm):
        text += f"; corners of a typical contact to {noise.vertex_rms_mm:.3g} mm RMS at best"
    return text if noise.steady else text + " (the scan rate is too low to separate noise from motion)"
