"""Arguments and options that several verbs share, and which of them belong together."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from click.decorators import FC

from tacstrip.errors import OptionError, ReadingError, is_number, one_of

if TYPE_CHECKING:
    from tacstrip.contact.shape import Contact
    from tacstrip.sensor.spec import Sensor


class _InDigits(click.ParamType):  # type: ignore[type-arg]
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number, or fail where it is none in the digits 0 to 9; click takes 1_0, other scripts and nan."""
        if isinstance(value, str) and (not is_number(value) or math.isnan(float(value))):
            raise click.BadParameter(f"{value!r} is not a number; write it in the digits 0 to 9", ctx, param)
        return super().convert(value, param, ctx)


class _Number(_InDigits, click.types.FloatParamType):
    pass


class _Whole(_InDigits, click.types.IntParamType):
    pass


class WholeRange(_InDigits, click.IntRange):
    """Whole numbers from one to another."""


HALF_WIDTH = "half-width over Vref; of a standard deviation s give 1.73 s"  # of a uniform error
_MUCH = 0.05  # of Vref: five times P.U. profile II
NUMBER, WHOLE = _Number(), _Whole()
FILE = click.Path(path_type=Path)
POINT = (NUMBER, NUMBER)


def option(*names: str, **settings: Any) -> Callable[[FC], FC]:
    """Return an option as `click.option` does, whose help shows the default unless it is nothing."""
    return click.option(*names, **{"show_default": bool(settings.get("default"))} | settings)


flag = functools.partial(click.option, is_flag=True)
number = functools.partial(option, type=NUMBER)
whole = functools.partial(option, type=WHOLE)
file = functools.partial(option, type=FILE)


def given(*parameters: str) -> list[str]:
    """Return the options that the command line gave, of these parameters of the verb, as the user writes them."""
    context = click.get_current_context()
    names = {p.name: p.opts[-1] for p in context.command.params}
    return [names[p] for p in parameters if context.get_parameter_source(p) is ParameterSource.COMMANDLINE]


def noise_source(given: object, sensor: Sensor) -> str:
    """Say where the noise that a verb counts with comes from."""
    if given:
        return "as given"
    return "the spec's [noise]" if sensor.noise else "estimated (give it, or see tacstrip noise)"


def belong(applies: object, why: str, *parameters: str) -> None:
    """Refuse options that do not apply: `OptionError` names the first that was given, and says why."""
    if not applies and (found := given(*parameters)):
        raise OptionError(f"{found[0]} {why}")


def above_0(_: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse a number that is not above 0: a callback of options."""
    if value is not None and not value > 0.0:
        raise OptionError(f"{parameter.opts[-1]} {value}: must be above 0")
    return value


def finite_above_0(context: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse a number that is not above 0 or infinite: a callback of options."""
    return above_0(context, parameter, math.nan if value == math.inf else value)


def rate(_: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse scans a second at which times are no longer told apart, or never come: a callback of options."""
    if value is not None and not 1e-6 <= value <= 1e6:
        raise OptionError(f"{parameter.opts[-1]} {value:g}: give scans a second [Hz], from 1e-6 to 1e6")
    return value


def _seed(_: click.Context, parameter: click.Parameter, value: int) -> int:
    if value < 0:
        raise OptionError(f"{parameter.opts[-1]} {value}: must be 0 or more")
    return value


def _picture(_: click.Context, __: click.Parameter, path: Path | None) -> Path | None:
    if path is not None:
        from tacstrip.plot.theme import check_picture

        check_picture(path)
    return path


def _format(_: click.Context, __: click.Parameter, kind: str) -> str:
    from tacstrip.plot.theme import ENDINGS

    if f".{kind}" not in ENDINGS:
        raise OptionError(one_of("--format", kind, [ending[1:] for ending in ENDINGS]))
    return kind


def _one_input(_: click.Context, __: click.Parameter, files: tuple[str, ...]) -> tuple[str, ...]:
    if len(files) > 2:
        raise OptionError(f"{files[2]}: one INPUT only, with its SENSOR before it")
    return files


SENSOR = click.argument("sensor", metavar="SENSOR")
CONTACT = click.argument("contact", metavar="CONTACT", type=FILE)
FORCE = flag("--force", help="Write over files that are there.")
OVERWRITE = flag("--overwrite", help="Write over files that are there.")  # where --force means something else
DURABLE = flag("--durable", help="Record so that a power cut loses a second at most; "
               "the page 'What a recording costs' says what of disk and processor.")  # fmt: skip
SEED = whole("--seed", default=0, callback=_seed, show_default=True, help="Of random errors.")
TURN = number("--turn", default=0.0, metavar="DEG", help="Turn the contact anticlockwise.")
AT = option("--at", type=POINT, metavar="X Y", help="Put the contact's centroid here [mm].")


def placed(contact: Path, at: tuple[float, float] | None, turn_deg: float) -> Contact:
    """Read a contact and put it where --at and --turn say."""
    from tacstrip.io.geojson import read_contact  # late: it loads NumPy

    shape = read_contact(contact)
    return (shape.placed(*at) if at else shape).turned(math.radians(turn_deg))


WITHOUT = option("--without", multiple=True, metavar="STRIP[:CHANNEL]",
                 help="Leave out a dead or stuck channel, as 7:v_h, or a strip, as 7; repeat.")  # fmt: skip
MODEL = option("--model", help="closed or network; by default closed where there are closed forms.")
ELECTRODES = option("--electrodes", default="own", help="CRS-CRP: own or all.")


def output(text: str, required: bool = True) -> Callable[..., Any]:
    """Return the option -o; `text` is its help."""
    return file("-o", "--output", required=required, help=text)


def plot(text: str = "Picture to write (.png, .svg, .pdf).") -> Callable[..., Any]:
    """Return the option --plot, whose ending is checked; `text` is its help."""
    return file("--plot", callback=_picture, help=text)


def figure_format(text: str) -> Callable[..., Any]:
    """Return the option --format, of figures; `text` is its help."""
    return option("--format", "kind", default="png", callback=_format, metavar="svg|pdf|png", help=text)


def sensor_and_input(metavar: str = "[SENSOR] INPUT", required: bool = True) -> Callable[..., Any]:
    """Return the arguments `files`: a source of scans, and before it the sensor that it is of."""
    return click.argument("files", metavar=metavar, nargs=-1, required=required, callback=_one_input)


def noise(command: Callable[..., None]) -> Callable[..., None]:
    """Add --quantisation, --positional and --distribution to a verb, which takes them as one `noise`."""

    @number("--quantisation", default=0.0,
            help="C.Q.E. of the readings, half-width over Vref (thesis: 0.001).")  # fmt: skip
    @number("--positional", default=0.0,
            help=f"P.U. of the readings, {HALF_WIDTH} (thesis: 0.005, 0.01).")  # fmt: skip
    @option("--distribution", default="uniform", help="uniform or normal.")
    @functools.wraps(command)
    def call(quantisation: float, positional: float, distribution: Any, **rest: Any) -> None:
        from tacstrip.contact.noise import Noise

        belong(
            given("quantisation", "positional"), "is of noise that is given: add --positional", "distribution"
        )
        made = Noise(quantisation=quantisation, positional=positional, distribution=distribution)
        for name, half in (("--quantisation", quantisation), ("--positional", positional)):
            if half > _MUCH:
                click.echo(
                    f"Warning: {name} {half:g}: is {100.0 * half:.4g} % of Vref; is it in percent? Then write "
                    f"{half / 100.0:g}", err=True
                )  # fmt: skip
        command(noise=made, **rest)

    return call


ANSWERS = option("--answer", "answers", multiple=True, metavar="KEY=VALUE",
                 help="Answer a question, or say what a column is; repeat.")  # fmt: skip


def answered(texts: tuple[str, ...]) -> dict[str, str]:
    """Return answers by their key; `OptionError` where one has none."""
    found = {}
    for text in texts:
        key, equals, value = text.rpartition("=")
        if not equals or not key.strip():
            raise OptionError(f"--answer {text}: write KEY=VALUE, such as --answer time_unit=ms")
        found[key.strip()] = value.strip()
    return found


@contextmanager
def asked_of(log: Path, more: str = "") -> Iterator[None]:
    """Turn questions into a failure with exit code 1 that asks them; name the log in errors, and `more` to help."""
    # Late: they load NumPy.
    from tacstrip.io.log_import.containers import SeveralSheets
    from tacstrip.io.log_import.questions import Question, Unanswered

    try:
        yield
    except SeveralSheets as several:
        which = Question(
            "sheet",
            "several sheets hold something: which one (all: one after the other)?",
            tuple(str(several).split(", ")),
        )
        raise click.ClickException(f"{log} does not say:\n  {which}") from None
    except Unanswered as open_:
        raise click.ClickException(
            "\n  ".join([f"{log} does not say:", *map(str, open_.questions), *filter(None, [more])])
        ) from None
    except ReadingError as error:
        named = f"{log}: {error}" if not str(error).startswith(str(log)) else str(error)
        helps = more if log.is_file() else ""
        raise ReadingError("\n  ".join(filter(None, [named, helps]))) from None
