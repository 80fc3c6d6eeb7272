"""The bar of progress: what a pipe gets of it, and a terminal."""

from __future__ import annotations

import pytest
from rich.console import Console

from tacstrip.cli import progress


def test_a_pipe_gets_nothing_of_the_bar(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.followed(["a", "b", "c"], "scans")) == ["a", "b", "c"]
    assert capsys.readouterr() == ("", "")


def test_a_terminal_shows_what_is_followed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "Console", lambda stderr: Console(stderr=stderr, force_terminal=True))
    assert list(progress.followed(range(3), "scans")) == [0, 1, 2]
    out, error = capsys.readouterr()
    assert out == ""
    assert "scans" in error
