"""A log within an e-mail: its headers, the marks of what is quoted, and the signature."""

from __future__ import annotations

import re

from tacstrip.io.log_import.strays import form_of, numbered, without

_HEADER = re.compile(
    r"(?:From|To|Cc|Date|Subject|Von|An|Datum|Betreff|De|A|Objet|Asunto|Message-ID|Reply-To): .*"
)
_FEW, _TOP = 2, 12  # headers; lines in which they stand
_QUOTE = re.compile(r"(?:> ?)*>(?:\s|\Z)")
_MOSTLY = 0.6  # of the lines with a number are quoted
_SIGNED = re.compile(r"--\s*")
_LONGEST = 8  # lines of a signature


def without_mail(text: str) -> tuple[str, str]:
    r"""Return a text without what an e-mail puts around a log, and a remark; another text as it is.

    A signature is what follows a line of two dashes, if no line of it has the form of one above.

    Examples
    --------
    >>> text = "From: Pia\nSubject: log\n\n> 1;2.5\n> 2;2.4\n> 3;2.3\n-- \nPia, tel. 555 01\n"
    >>> without_mail(text)[0].split()
    ['1;2.5', '2;2.4', '3;2.3']
    """
    lines = numbered(text)
    out = {n for n, line in lines[:_TOP] if _HEADER.fullmatch(line)}
    out = out if len(out) >= _FEW else set()
    numeric = [line for _, line in lines if re.search(r"\d", line)]
    quoted = sum(bool(_QUOTE.match(line)) for line in numeric) >= max(_FEW, _MOSTLY * len(numeric))
    if not out and not quoted:
        return text, ""
    lines = [
        (n, _QUOTE.sub("", line, count=1) if quoted and line.startswith(">") else line) for n, line in lines
    ]
    end = next((k for k, (_, line) in enumerate(lines) if k and _SIGNED.fullmatch(line)), len(lines))
    below = [(n, line) for n, line in lines[end:] if line.strip()]
    forms = {form_of(line) for _, line in lines[:end]}
    if len(below) <= _LONGEST + 1 and not any(form_of(line) in forms for _, line in below[1:]):
        out |= {n for n, _ in below}
    plain = without("\n".join(line for _, line in lines), frozenset(out))
    return plain, f"line(s) {', '.join(map(str, sorted(out)))}: of an e-mail, passed over" if out else ""
