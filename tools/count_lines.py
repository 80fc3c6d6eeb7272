"""Count the lines of code of the package by room, and which of them go back to an earlier commit.

    python tools/count_lines.py            lines by room
    python tools/count_lines.py a57c08f    and how many of them belong to what that commit could do

A line of code holds a token of Python; docstrings, comments and blanks do not count. History is followed commit by
commit. A definition (function, method, class without its methods, assignment) goes back if in each commit it has the
name of one that does, in the same file or the one it was renamed from; or if it has the name of one that left its file
in that commit, or at least half of its longer lines are taken over from such files. Within such a definition a line
goes back that stays or that takes the place of one that does; lines that are added do not. The imports of a file in
which no other definition goes back do not either: any new file imports much of what old ones do.
"""

import argparse
import ast
import functools
import io
import subprocess
import tokenize
from collections import Counter
from collections.abc import Iterator
from difflib import SequenceMatcher

_NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
_LONG = 10  # characters without blanks from which on a line is told from others by what it says

Definitions = dict[str, tuple[str, ...]]  # the lines of code of each definition of a file, blanks taken out
Origins = dict[
    str, tuple[bool, ...]
]  # for each of these lines: does it go back; definitions that do not are left out


def lines_of_code(text: str) -> set[int]:
    """Return the numbers of the lines that hold a token of Python, those of docstrings left out."""
    documentation: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if first is not None and ast.get_docstring(node, clean=False) is not None:
                documentation.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = {n for t in tokens if t.type not in _NO_CODE for n in range(t.start[0], t.end[0] + 1)}
    return code - documentation


def _extents(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[str, set[int]]]:
    """Yield name and lines of each definition; the methods of a class are definitions of their own."""
    for node in body:
        decorators = getattr(node, "decorator_list", [])
        start = min([node.lineno, *(decorator.lineno for decorator in decorators)])
        lines = set(range(start, (node.end_lineno or start) + 1))
        if isinstance(node, ast.ClassDef):
            methods = [s for s in node.body if isinstance(s, ast.FunctionDef | ast.AsyncFunctionDef)]
            for name, of_method in _extents(list(methods), f"{prefix}{node.name}."):
                lines -= of_method
                yield name, of_method
            yield prefix + node.name, lines
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield prefix + node.name, lines
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield "import", lines
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            yield ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target), lines
        else:
            yield "statement", lines


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], capture_output=True, check=True, text=True).stdout


@functools.cache
def _definitions(blob: str) -> Definitions:
    text = _git("cat-file", "blob", blob)
    rows, code = text.splitlines(), lines_of_code(text)
    found: dict[str, list[str]] = {}
    for name, lines in _extents(ast.parse(text).body):
        found.setdefault(name, []).extend("".join(rows[n - 1].split()) for n in sorted(lines & code))
    return {name: tuple(lines) for name, lines in found.items() if lines}


@functools.cache
def _files(commit: str) -> dict[str, str]:
    """Return the blob of each file of the package."""
    rows = (row.split("\t") for row in _git("ls-tree", "-r", commit, "src").splitlines())
    return {path: meta.split()[2] for meta, path in rows if path.endswith(".py")}


def _everything(commit: str) -> dict[str, Origins]:
    files = {path: _definitions(blob) for path, blob in _files(commit).items()}
    return {p: {name: (True,) * len(lines) for name, lines in known.items()} for p, known in files.items()}


def _carried(before: tuple[str, ...], origins: tuple[bool, ...], after: tuple[str, ...]) -> tuple[bool, ...]:
    """Tell which lines of a definition go back after a change: those that stay, and those in the place of others."""
    carried = [False] * len(after)
    for _, i, i_end, j, j_end in SequenceMatcher(None, before, after, autojunk=False).get_opcodes():
        n = min(i_end - i, j_end - j)
        carried[j : j + n] = origins[i : i + n]
    return tuple(carried)


def _step(parent: str, commit: str, origins: dict[str, Origins]) -> dict[str, Origins]:
    """Return what goes back in a commit, from what does in its parent."""
    before, after = _files(parent), _files(commit)
    result = {path: origins[path] for path, blob in after.items() if before.get(path) == blob}
    changed = [path for path in after if path not in result]
    renames: dict[str, str] = {}
    if any(path not in before for path in changed):
        listed = _git("diff-tree", "-r", "-M40%", "--diff-filter=R", parent, commit, "--", "src")
        renames = {new: old for _, old, new in (row.split("\t") for row in listed.splitlines())}
    lines_there: set[str] = set()
    names_that_left: set[str] = set()
    for path, blob in before.items():
        if after.get(path) != blob:
            left = set(origins[path]) - set(_definitions(after[path]) if path in after else ())
            names_that_left |= left - {"import", "statement"}
            lines_there |= {line for name in origins[path] for line in _definitions(blob)[name]}
    for path in changed:
        source = path if path in before else renames.get(path)
        known = _definitions(before[source]) if source else {}
        result[path] = {}
        for name, lines in _definitions(after[path]).items():
            if name in known:
                if name in origins[source or path]:
                    result[path][name] = _carried(known[name], origins[source or path][name], lines)
                continue
            longer = [line for line in lines if len(line) >= _LONG]
            taken_over = sum(line in lines_there for line in longer)
            if name in names_that_left or (longer and 2 * taken_over >= len(longer)):
                result[path][name] = (True,) * len(lines)
    return result


def going_back(since: str) -> dict[str, Origins]:
    """Return which definitions, and which of their lines, go back to a commit."""
    commits = _git("rev-list", "--reverse", "--topo-order", "--parents", f"{since}..HEAD").splitlines()
    known: dict[str, dict[str, Origins]] = {}
    head = since
    for head, *parents in (row.split() for row in commits):
        merged: dict[str, Origins] = {}
        for parent in parents:
            if parent not in known:  # the commit itself, or one before it
                known[parent] = _everything(parent)
            for path, definitions in _step(parent, head, known[parent]).items():
                there = merged.setdefault(path, {})
                for name, origins in definitions.items():
                    other = there.get(name, origins)
                    there[name] = tuple(a or b for a, b in zip(origins, other, strict=True))
        known[head] = merged
    return _without_mere_imports(known[head], head) if commits else _everything(since)


def _without_mere_imports(origins: dict[str, Origins], commit: str) -> dict[str, Origins]:
    """Leave out what goes back in files that hold definitions, of which none goes back but the imports."""
    held = {path: set(_definitions(blob)) for path, blob in _files(commit).items()}
    return {
        path: ours for path, ours in origins.items() if set(ours) != {"import"} or held[path] == {"import"}
    }


def main(since: str = "") -> None:
    """Print the table of rooms."""
    origins = going_back(since) if since else {}
    rooms: dict[str, Counter[str]] = {}
    for path, blob in _files("HEAD").items():
        definitions, ours = _definitions(blob), origins.get(path, {})
        room = rooms.setdefault(path.split("/")[2], Counter())
        room["now"] += sum(map(len, definitions.values()))
        room["definitions"] += sum(len(definitions[name]) for name in ours)
        room["lines"] += sum(map(sum, ours.values()))
    total = sum(rooms.values(), Counter())
    columns = ["now", "definitions", "lines"] if since else ["now"]
    print(f"{'':16}" + "".join(f"{column:>13}" for column in columns))
    for name, room in [*sorted(rooms.items()), ("all", total)]:
        print(f"{name:16}" + "".join(f"{room[column]:13}" for column in columns))


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("since", nargs="?", default="", help="a commit")
    main(options.parse_args().since)
