"""Verbs of the command line run in the tests' own process: starting a program takes most of such a test's time."""

from __future__ import annotations

import io
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

from tacstrip.cli import main


def run(folder: Path, *words: object) -> CompletedProcess[str]:
    """Run a verb in a folder; return its exit code and what it wrote, as of a program of its own."""
    line = ["tacstrip", *map(str, words)]
    said, errors = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
    code: object = 0
    with chdir(folder), redirect_stdout(said), redirect_stderr(errors), patch.object(sys, "argv", line):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    assert isinstance(code, int)
    texts = [stream.buffer.getvalue().decode() for stream in (said, errors)]
    return CompletedProcess(line, code, *texts)
