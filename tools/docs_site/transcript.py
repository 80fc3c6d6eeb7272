"""What a command prints, from running it while the site is built: the directive `{transcript}`.

Lines begin with `$ tacstrip ...`; they run in a folder of their page, one after the other, so that a later one finds
the files of an earlier one. Lines without `$` before the first command are a file: `:file: object.wkt` names it.
"""

from __future__ import annotations

import contextlib
import io
import shlex
import shutil
import sys
from pathlib import Path
from typing import ClassVar
from unittest import mock

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def run(line: str, folder: Path) -> tuple[int, str]:
    """Run `tacstrip ...` in a folder; return the exit code and all that it prints."""
    from tacstrip.cli import main

    arguments = shlex.split(line, comments=True)
    said, code = io.StringIO(), 0
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        mock.patch.object(sys, "argv", arguments),
    ):
        try:
            main()
        except SystemExit as done:
            code = int(done.code or 0)
    return code, said.getvalue()


class _Transcript(SphinxDirective):
    has_content = True
    option_spec: ClassVar = {
        "file": directives.unchanged,
        "exit": directives.nonnegative_int,
        "lines": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        folder = self._folder_of_page()
        shown = []
        if "file" in self.options:
            text = "\n".join(self.content) + "\n"
            (folder / self.options["file"]).write_text(text, encoding="utf-8")
            shown.append(text.rstrip())
        else:
            for line in self.content:
                shown.append(line)
                if not line.startswith("$ "):
                    continue
                code, said = run(line[2:], folder)
                if code != self.options.get("exit", 0):
                    raise self.error(f"{line} ended with exit code {code}:\n{said}")
                lines = said.rstrip().replace(str(folder), ".").splitlines()
                most = self.options.get("lines", 40)
                shown += lines[:most] + ["..."] * (len(lines) > most)
        block = nodes.literal_block("\n".join(shown), "\n".join(shown), language="text")
        if "file" in self.options:
            return [nodes.paragraph("", "", nodes.literal("", self.options["file"]), nodes.Text(":")), block]
        return [block]

    def _folder_of_page(self) -> Path:
        # Within the build: a folder elsewhere would stay, as the processes that read pages end without cleaning up.
        folder = Path(self.env.doctreedir, "transcripts", self.env.docname)
        if "transcript" not in self.env.temp_data:
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            self.env.temp_data["transcript"] = True
        return folder


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("transcript", _Transcript)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
