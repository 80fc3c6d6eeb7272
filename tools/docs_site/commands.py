"""The options of every command, from the command itself: the directive `{command} simulate`."""

from __future__ import annotations

import importlib
import re

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from tacstrip.cli import VERBS


def command_page(verb: str) -> str:
    """Return what a command is for, its arguments and its options, in Markdown."""
    command: click.Command = importlib.import_module(f"tacstrip.cli.{verb}").command
    context = click.Context(command, info_name=f"tacstrip {verb}")
    text = [_prose(command.help or ""), f"```text\n{command.get_usage(context)}\n```"]
    options = [p for p in command.get_params(context) if isinstance(p, click.Option) and not p.hidden]
    for option in options:
        record = option.get_help_record(context)
        assert record is not None
        names, meaning = record
        text.append(f"`{names}`\n: {_escaped(meaning)}")
    return "\n\n".join(text)


def _prose(text: str) -> str:
    """Return a command's docstring as paragraphs; those that click is told not to wrap stay as they are."""
    parts = []
    for paragraph in text.split("\n\n"):
        if paragraph.lstrip().startswith("\b"):
            parts.append("```text\n" + paragraph.replace("\b\n", "").replace("\b", "") + "\n```")
        else:
            prose = " ".join(paragraph.split())
            before, found, example = prose.partition("Example: ")
            parts.append(_escaped(before))
            if found:
                parts.append(f"Example: `{example}`" if "`" not in example else _escaped(found + example))
    return "\n\n".join(filter(None, parts))


def _escaped(text: str) -> str:
    """Return text whose signs are no Markdown, and whose pages of docs/ are links from docs/reference/commands/."""
    text = re.sub(r"([*_<>\[\]])" if "`" not in text else r"([<>])", r"\\\1", text)
    return re.sub(r"\bdocs/([a-z/-]+\.md)", r"[docs/\1](../../\1)", text)


class _Command(SphinxDirective):
    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        verb = self.arguments[0]
        if verb not in VERBS:
            raise self.error(f"there is no command {verb}; there are: {', '.join(VERBS)}")
        return self.parse_text_to_nodes(command_page(verb))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("command", _Command)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
