"""Lines of code by history: what stays, moves or is written anew in its place goes back; what is added does not."""

import subprocess
from pathlib import Path

import count_lines
import pytest

FIRST = '''\
"""A module."""

LIMIT = 3  # a remark


def kept(x):
    """Twice."""
    # a comment
    total = x + LIMIT
    return total


def moved(values):
    total = sum(v * v for v in values)
    return total / len(values)
'''


def test_docstrings_comments_and_blanks_are_no_lines_of_code() -> None:
    assert count_lines.lines_of_code(FIRST) == {3, 6, 9, 10, 13, 14, 15}


def test_lines_go_back_over_a_rename_a_move_and_a_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    room = tmp_path / "src" / "package" / "room"
    room.mkdir(parents=True)

    def commit(**files: str) -> str:
        for old in room.glob("*.py"):
            old.unlink()
        for name, text in files.items():
            (room / f"{name}.py").write_text(text)
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        subprocess.run(["git", "add", "-A"], check=True)
        subprocess.run(["git", *who, "commit", "-qm", "a"], check=True)
        found = subprocess.run(["git", "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
        return found.stdout.strip()

    subprocess.run(["git", "init", "-q"], check=True)
    whole = FIRST.replace("LIMIT = 3", "import mathematics\n\nLIMIT = 3")
    since = commit(first=whole)
    body, moved = whole.split("\n\n\ndef moved")
    grown = body.replace("x + LIMIT", "x * LIMIT").replace("    return", "    total += 1\n    return")
    new = "\n\ndef new(x):\n    return x\n"
    commit(renamed=body + "\n", other="def means" + moved)
    commit(renamed=grown + "\n", other="def means" + moved + new, fresh="import mathematics\n" + new)
    count_lines.main(since)
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    # The import, LIMIT, 3 lines of `kept` and one that was added, 3 of what was moved. Neither `new` nor what a file of
    # new definitions imports goes back.
    assert rows == [["room", "14", "9", "8"], ["all", "14", "9", "8"]]
