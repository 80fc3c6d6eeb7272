"""`tacstrip recover`."""

from __future__ import annotations

from pathlib import Path

import click

from tacstrip.cli import options, protect
from tacstrip.stream.recording.recover import recover


@click.command()
@click.argument("recording", type=options.FILE)
@options.output("New file; default: RECORDING-recovered.mcap in the same folder.", required=False)
@options.FORCE
def command(recording: Path, output: Path | None, force: bool) -> None:
    """Copy the undamaged part of a cut or damaged RECORDING to a new file with an index.

    It may be any MCAP file of ROS 2. Exit code 1: the new file could not be written.

    Example: tacstrip recover session.mcap -o session-whole.mcap
    """
    target = output or recording.with_name(f"{recording.stem}-recovered.mcap")
    protect(target, recording, force=force)
    saved = recover(recording, target, force)
    counts = ", ".join(f"{topic}: {count}" for topic, count in saved.messages.items() if count)
    total = sum(saved.messages.values())
    click.echo(f"{target}: {total} message(s) over {saved.seconds:.6g} s saved ({counts})")
    lost = "\n  ".join(saved.lost)
    click.echo(f"Lost: {lost}" if lost else f"Nothing was lost: every message of {recording} is in it")
