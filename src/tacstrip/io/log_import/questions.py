"""What a log does not tell: questions with the answers that they take, and the answers that were given."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from tacstrip.errors import OptionError, one_of
from tacstrip.io.log_import.fields import number_of
from tacstrip.io.log_import.names import CHANNELS, meaning
from tacstrip.io.log_import.table import PART, Table
from tacstrip.sensor.spec import Sensor

ROLES = ("time", "scan", "strip", "which", "position", "skip", *CHANNELS)
KEYS = (
    "time_unit", "rate_hz", "strip_base", "strips", "unit", "untouched", "missing", "broken_lines", "vref_volt",
    "adc_bits", "exchanged", "order", "strip_order", "scale", "coding", "restart", "which_h", "sheet", "readings",
    "turn",
)  # fmt: skip
OF_FORM = ("broken_lines", "rate_hz", "order", "which_h", "missing", "untouched")
_STEP = re.compile(r"(\d+(?:\.\d+)?)\s?([mu]?V)")
_OF_BITS = re.compile(r"(\d{1,2}) ?-?bits?")  # codes of these
_PART = re.compile(r"1/(\d{1,9})")  # of Vref, as of a full-scale code of no power of two
_SHOWN = 8  # columns
_BASES = {"0-based": "0", "1-based": "1"}  # strips=1-based says strip_base=1


@dataclass(frozen=True)
class Question:
    """What the log does not tell: the key of the answer, what is asked, and answers that are possible.

    Examples
    --------
    >>> print(Question("strip_base", "is the first strip 0 or 1?", ("0", "1")))
    is the first strip 0 or 1?  --answer strip_base=0 or --answer strip_base=1
    """

    key: str
    text: str
    choices: tuple[str, ...]
    of_form: bool = False  # whether what the columns hold may answer it, and not only what the user knows
    default: str = ""  # the answer that changes no reading, taken where nothing else is open

    def __str__(self) -> str:
        ways = [f"{self.key}={choice}" for choice in self.choices]
        return self.text + "  " * bool(ways) + " or ".join(f"--answer {_for_shell(way)}" for way in ways)


class UnknownAnswerError(OptionError):
    """An answer to no question, for which no column has the name either."""

    def __init__(self, key: str, answer: str, names: Sequence[str]) -> None:
        shown = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
        super().__init__(
            f"--answer {key}={answer}: no question has the key {key!r}, and no column is called so (they are: {shown})"
        )
        self.key = key


class Unanswered(Exception):  # noqa: N818, it is no error of the user's
    """Questions that must be answered before the log can be read."""

    def __init__(self, *questions: Question) -> None:
        super().__init__("; ".join(map(str, questions)))
        self.questions = questions


@dataclass
class Clues:
    """A log, its sensor if that is known, the answers given; what was concluded and what remains to be asked.

    Raises
    ------
    OptionError
        An answer to nothing, or one that is not possible.
    """

    table: Table
    sensor: Sensor | None
    answers: dict[str, str]
    reasons: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    stated: frozenset[str] | None = None  # keys that the spec's file states; None: not known
    doubts: list[str] = field(default_factory=list)  # what is read all the same, and may be meant otherwise

    only: tuple[str, ...] = ()  # lines that are taken, as "pad=left"
    descending: bool = False  # whether the first strip's columns, which have no names, stand last
    strip_names: str = ""  # with commas, from strip 0 on, where strips have names instead of numbers
    counted: bool = False  # whether strips are counted here, for the log gives them no numbers

    def __post_init__(self) -> None:
        self.reasons += self.table.remarks
        self.doubts += self.table.doubts
        if (base := _BASES.get(self.answers.get("strips", ""))) is not None:
            self.answers = {k: v for k, v in self.answers.items() if k != "strips"} | {"strip_base": base}
        if m := _STEP.fullmatch(
            self.answers.get("unit", "")
        ):  # volts of a code: a unit, times a number of them
            self.answers = {"scale": m[1]} | self.answers | {"unit": m[2]}
        if m := _OF_BITS.fullmatch(self.answers.get("unit", "")):
            self.answers = {"adc_bits": m[1]} | self.answers | {"unit": "code"}
        if m := _PART.fullmatch(self.answers.get("unit", "")):
            self.answers = {"scale": repr(1.0 / int(m[1]))} | self.answers | {"unit": "fraction"}
        self.answers = {self._full_name(key): answer for key, answer in self.answers.items()}
        self.table = self.table.part_at_note(self.answers.get(PART, ""))
        for key, answer in list(self.answers.items()):
            named = key in self.table.names
            if named and key not in KEYS and self._names_lines(key, answer):
                self.only += (f"{key}={answer}",)
                self.answers = self.answers | {key: "skip"}
                continue
            if key not in KEYS and not named:
                raise UnknownAnswerError(key, answer, self.table.names)
            if (
                named
                and key not in KEYS
                and answer not in ROLES
                and not re.fullmatch(r"-?\d+:(h|l|out)", answer)
            ):
                raise OptionError(
                    f"--answer {key}={answer}: " + one_of("role of a column", answer, (*ROLES, "3:h"))
                )

        self.table = self.table.where(self.only)
        for condition in self.only:
            self.because(f"only lines with {condition}")

    def _full_name(self, key: str) -> str:
        """Return the name of the one column whose last part is such a key, as "strips.n" of "n"; else the key."""
        if key in (*KEYS, PART, *self.table.names):
            return key
        found = [n for n in self.table.names if n.rpartition(".")[2] == key]
        return found[0] if len(found) == 1 else key

    def _names_lines(self, name: str, answer: str) -> bool:
        """Return whether an answer is what stands in a column on the lines that are meant, as in "pad=left"."""
        role = meaning(name).role
        said = role in ("", "which") or (role == "scan" and number_of(answer) is None)  # as a frame's name
        return said and answer not in ROLES and answer in self.table.column(name)

    def ask(self, key: str, text: str, *choices: str, of_form: bool = False, default: str = "") -> None:
        """Ask for what cannot be known; once for each key."""
        if key not in {q.key for q in self.questions}:
            self.questions.append(Question(key, text, choices, of_form or key in OF_FORM, default))

    def stop(self) -> None:
        """Raise `Unanswered` if anything was asked."""
        if self.questions:
            raise Unanswered(*self.questions)

    def doubt(self, text: str) -> None:
        """Note what may be meant otherwise, of what is read all the same; once."""
        if text and text not in self.doubts:
            self.doubts.append(text)

    def because(self, reason: str) -> None:
        """Note why something is read as it is."""
        self.reasons.append(reason)

    def choice(self, key: str, known: tuple[str, ...]) -> str:
        """Return the answer of some that are possible; "" where there is none."""
        answer = self.answers.get(key, "")
        if answer and answer not in known and not (key == "strip_order" and "," in answer):
            raise OptionError(f"--answer {key}={answer}: " + one_of(key, answer, known))
        return answer

    def number(self, key: str) -> float | None:
        """Return an answer that is a number; None where there is none."""
        if key not in self.answers:
            return None
        value = number_of(self.answers[key])
        if value is None or value < 0.0:
            raise OptionError(f"--answer {key}={self.answers[key]}: not a number of 0 or more")
        return value

    def values(self, name: str) -> list[float | None]:
        """Return a column's numbers."""
        return [number_of(t, self.table.decimal) for t in self.table.column(name)]

    @property
    def expected(self) -> tuple[str, ...]:
        """The channels of the sensor; () where it is not known."""
        return () if self.sensor is None else ("out",) if self.sensor.signatures == ("k",) else ("h", "l")


def _for_shell(way: str) -> str:
    return way if re.fullmatch(r"[\w=.,:+-]+", way) else "'" + way.replace("'", "'\\''") + "'"
