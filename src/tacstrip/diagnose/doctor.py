"""The examination: dominant faults are named and undone first, because they disturb their neighbours' predictions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from tacstrip.arrays import BoolArray, FloatArray
from tacstrip.diagnose.channels import clipped, never_touched, not_moving, on_rails
from tacstrip.diagnose.common_supply import LOOSE, loose_supply
from tacstrip.diagnose.converter import common_ceiling, single_ceilings, stuck_bits, wrong_reference
from tacstrip.diagnose.drift import Drifts, drift
from tacstrip.diagnose.exchanged import out_of_order, swapped_ends, swapped_strips, swapped_wires, tied_wires
from tacstrip.diagnose.faults import FAULTS, Finding, Question, Report
from tacstrip.diagnose.hum import hum
from tacstrip.diagnose.intermittent import intermittent
from tacstrip.diagnose.log import Log
from tacstrip.diagnose.lost import lost
from tacstrip.diagnose.neighbour_prediction import (
    Suspect,
    WorkingCopy,
    neighbour_residuals,
    places,
    working_copy,
)
from tacstrip.diagnose.noise import NoiseEstimate, excess_noise, measure, quality
from tacstrip.diagnose.pressure import pressure
from tacstrip.diagnose.questions import questions
from tacstrip.diagnose.regression import moved_to_and_fro
from tacstrip.diagnose.shorts import shorts, tied_under_outline
from tacstrip.diagnose.strip_order import Orders, compared_orders, joined, order_question, order_unknown
from tacstrip.io.input_checks import other_scale
from tacstrip.scan import time_goes_back
from tacstrip.sensor.left_out import channel_name, left_out, left_out_wholly
from tacstrip.sensor.rest_level import all_read_hint, rest_hint

_MOST_SCANS, _MOST_READINGS = 20_000, 200_000  # of longer recordings, evenly spread stretches are examined
_LEAST_SIGMA = 2e-4  # over Vref: no reading is trusted to less
_MOST_SIGMA = 0.006  # over Vref, where motion hides the noise: that of P.U. profile II
_OFFSET = 0.02  # over Vref: what a strip may lie off its neighbours' line before calibration is advised
_Test = Callable[[WorkingCopy], Iterable[Suspect]]
_Place = tuple[str, tuple[int, ...]]  # a fault, and its strips
_TESTS: dict[_Test, frozenset[str]] = {  # and the faults that each finds
    never_touched: frozenset({"dead", "open-strip"}),
    on_rails: frozenset({"dead", "stuck", "open-strip", "open-sensing"}),
    not_moving: frozenset({"dead", "stuck", "open-strip"}),
    clipped: frozenset({"saturation"}),
    swapped_wires: frozenset({"swapped-wires", "swapped-ends"}),
    tied_wires: frozenset({"tied-wires"}),
    swapped_ends: frozenset({"swapped-ends"}),
    swapped_strips: frozenset({"swapped-strips"}),
    shorts: frozenset({"short"}),
}
_QUARTERS = 4  # of a recording: a finding stands without any one of them, a question without some one
_FALLS = 1  # quarters: one without which a finding is not seen may hold most of its strips' contacts
_ORDER, _LOOKED = "swapped-strips", 400  # scans of a file that others read
_LATE = {"drift", "wander", "hum"}  # no other fault is judged by these
_SLOW = ("drift", "wander")
_BY_ALL_STRIPS = {"short", "drift", "wander"}  # what these do is held against what all others do
_EVEN, _LOST = 0.7, 0.01  # of the scans: that follow evenly, where so many may be missing without a word
_TIMED = 256  # parts of a recording in which a resting contact is looked at for drift
_FEWEST = 20  # places that determine an offset
_SMALL_DRIFT = 0.01  # over Vref: where this would not be told, the report says so
_EMPTY = 3  # scans of the strip's other channel that make an empty one a dead one
_AT = 0.003  # over Vref: readings this near to a ceiling are not used
_DISTURBED = 8  # strips: predictions of others reach four to either side
_AT_EDGE = 0.3  # weight of a fault where neighbours stand on one side only
_WORST = {"broken": 0, "degraded": 1, "note": 2}


def diagnose(log: Log) -> Report:
    """Examine a recording.

    It should show every strip touched, by a contact four strips wide or more that moves along and across the strips
    and turns (docs/guide/doctor.md); what the recording cannot show is listed as unchecked.

    Returns
    -------
    Report
        Faults with their evidence, notes, what was not checked, and the noise.

    Examples
    --------
    >>> import numpy as np
    >>> import tacstrip as ts
    >>> from tacstrip.diagnose import Log, diagnose
    >>> sensor = ts.Sensor(construction="crs-m", strips=6, pitch_mm=10.0, length_mm=100.0)
    >>> heights = 45.0 + 30.0 * np.sin(np.linspace(0.0, 20.0, 200))
    >>> contacts = [ts.Contact.polygon([(0, y), (60, y + 6), (60, y + 16), (0, y + 10)]) for y in heights]
    >>> scans = [ts.simulate(sensor, c, ts.Noise(positional=0.002), rng=i) for i, c in enumerate(contacts)]
    >>> k = np.stack([scan["k"] for scan in scans])
    >>> k[:, 3] = 0.0  # a wire that nothing comes through
    >>> log = Log.of(sensor, 0.01 * np.arange(200.0), {"k": k})
    >>> report = diagnose(log)
    >>> [(finding.fault, finding.strips) for finding in report.findings]
    [('open-strip', (3,))]
    """
    part = log.part(min(_MOST_SCANS, max(_MOST_READINGS // log.sensor.strips, 2000)))
    seen = _examined(part)
    findings, questions = _without_any_quarter(seen, part)
    known = {i for f in seen.removed for i in f.strips}
    unchecked = [
        log.missing,
        _pauses(log.time_s),
        *_not_checked(part, seen, known, {i for q in questions for i in q.strips}),
        *seen.unchecked,
        *_drift_not_checked(part, seen.least_drift, known),
    ]
    return Report(
        findings=findings,
        notes=(*seen.notes, *_notes(log, seen.rows, seen.at_rest)),
        questions=questions,
        unchecked=tuple(reason for reason in unchecked if reason),
        quality=quality(log.sensor, seen.noise),
        touched_scans=log.touched.sum(axis=0),
        seconds=float(np.ptp(log.time_s)),
        scans=len(log.time_s),
        strip_base=log.sensor.strip_base,
    )


def exchanged_strips(log: Log) -> tuple[tuple[int, ...], bool] | None:
    """Return strips that read as if they were in each other's places, and whether that is sure; None where none do.

    A quick look at `_LOOKED` scans; only where it finds something, all that may look alike is examined.
    """
    part = log.part(_LOOKED)
    if not log.sensor.kind.closed_form or len(part.time_s) < _FEWEST:
        return None
    seen = _examined(part, {_ORDER})
    if not any(
        _ORDER in causes
        for causes in (*((f.fault,) for f in seen.findings), *(q.causes for q in seen.questions))
    ):
        return None
    report = diagnose(part)
    found = [(f.strips, True) for f in report.findings if f.fault == _ORDER]
    return next(iter([*found, *((q.strips, False) for q in report.questions if _ORDER in q.causes)]), None)


def _without_any_quarter(seen: _Examined, part: Log) -> tuple[tuple[Finding, ...], tuple[Question, ...]]:
    """Return the findings that stand without any one quarter of the recording, and the questions; others are questions.

    What one visit of a contact shows, or what hardly exceeds a limit, does not (a delete-one-group jackknife). One that
    falls with one quarter alone stands if it is found without any quarter of its own strips' contacts, too: these may
    have come in one quarter, for the most part. A question that never stands is dropped.
    """
    findings = {(f.fault, f.strips): "levels_at_rest" in f.numbers for f in seen.findings}
    settled = seen.settled
    asked = [{(cause, q.strips) for cause in q.causes} for q in seen.questions]
    every = {*findings, *(place for places in asked for place in places)}
    falls = dict.fromkeys(findings, 0)
    stood = [place <= settled for place in asked]
    quarter = np.arange(len(part.time_s)) * _QUARTERS // len(part.time_s)
    for out in range(_QUARTERS):
        sought = {place for place in findings if falls[place] <= _FALLS and place not in settled}
        sought |= {place for q, there in zip(asked, stood, strict=True) if not there for place in q}
        found, questions = _shown(part, quarter != out, every, sought)
        for place, at_rest in findings.items():
            # At rest no contact is a witness; without the first or the last quarter a drift is smaller, too.
            ends = at_rest and out in (0, _QUARTERS - 1)
            falls[place] += place not in found | questions | settled and not ends
        stood = [there or bool(q & (found | questions)) for q, there in zip(asked, stood, strict=True)]
    stands = {place for place, times in falls.items() if not times}
    for place, times in falls.items():
        if times == _FALLS and not findings[place] and _without_any_quarter_of_its_own(part, every, place):
            stands.add(place)
    doubted = (f for f in seen.findings if (f.fault, f.strips) not in stands)
    return tuple(f for f in seen.findings if (f.fault, f.strips) in stands), (
        *(q for q, there in zip(seen.questions, stood, strict=True) if there),
        *(Question(f.strips, (f.fault,), f.evidence, f.signature) for f in doubted),
    )


def _without_any_quarter_of_its_own(part: Log, every: Set[_Place], place: _Place) -> bool:
    """Whether a fault is found without any quarter of the scans in which its strips are touched."""
    touched = part.touched[:, list(place[1]) or slice(None)].any(axis=1)
    quarter = np.minimum(np.cumsum(touched) * _QUARTERS // max(int(touched.sum()), 1), _QUARTERS - 1)
    return all(place in _shown(part, quarter != out, every, {place})[0] for out in range(_QUARTERS))


def _shown(
    part: Log, left: BoolArray, every: Set[_Place], sought: Set[_Place]
) -> tuple[Set[_Place], Set[_Place]]:
    """Return what is found and what is asked about in some scans (scans,), of what is `sought`.

    Tests are made for that and for what else of `every` fault may disturb it.
    """
    if not sought or not any(np.isfinite(values[left]).any() for values in part.raw.values()):
        return set(), set()
    kinds = {fault for fault, _ in sought}
    everywhere = bool(kinds & _BY_ALL_STRIPS)
    kinds |= {f for f, i in every if f not in _LATE and (everywhere or any(_near(i, j) for _, j in sought))}
    again = _examined(part.kept(left), kinds, sought)
    found = {(f.fault, f.strips) for f in again.findings}
    # A part of a drift may bend, and one of a wander be straight; contacts on one side of a sensing strip's cut alone
    # show a dead channel.
    found |= {(kind, strips) for fault, strips in found if fault in _SLOW for kind in _SLOW}
    found |= {("open-sensing", strips) for fault, strips in found if fault == "dead"}
    return (
        found,
        {(cause, q.strips) for q in again.questions for cause in q.causes},
    )


def _near(one: Sequence[int], other: Sequence[int]) -> bool:
    """Whether a fault of some strips disturbs what is seen of others; of the whole sensor, that of all."""
    return not (one and other) or min(abs(i - j) for i in one for j in other) <= _DISTURBED


@dataclass(frozen=True, eq=False)
class _Examined:
    """What an examination finds, and what notes and all that was not checked are told by.

    findings: broken ones first, of these the surest; removed: those of them that were repaired in `rows`, a row for
    each place. notes: of drift; least_drift: of each strip that would be told, over Vref (strips,); settled: what needs
    no quarters. at_rest: whether, and how, strips that nothing touches count as touched. unchecked: of loose wires,
    bits and hum. orders: the strips' order against others, where it is judged.
    """

    findings: tuple[Finding, ...]
    questions: tuple[Question, ...]
    removed: list[Finding]
    rows: WorkingCopy
    noise: NoiseEstimate
    notes: list[Finding]
    least_drift: FloatArray
    settled: frozenset[_Place]
    at_rest: str
    unchecked: tuple[str, ...]
    orders: Orders | None


def _examined(part: Log, kinds: Set[str] = FAULTS.keys(), sought: Set[_Place] = frozenset()) -> _Examined:
    """Examine a log for faults of some kinds, but, if any are `sought`, for no more once they are named."""
    sensor = part.sensor
    noise = measure(part, "noise" in kinds)
    sigma = working_sigma(noise)
    bits, no_bits = stuck_bits(part) if "bits" in kinds else ([], "")
    ceiling = list(common_ceiling(part, sigma)) if "saturation" in kinds else []
    geometric = sensor.kind.closed_form
    pressed = list(pressure(part)) if geometric and "pressure" in kinds else []
    reference, unsure, factor = (
        wrong_reference(part, sigma) if "wrong-vref" in kinds and not (ceiling or pressed) else ([], [], 1.0)
    )
    lifted, may_lift, no_lift = (
        loose_supply(part) if geometric and not pressed and kinds & LOOSE.keys() else ([], [], "")
    )
    work = _corrected_copy(part, sigma, ceiling, factor)
    # Strips that nothing touches count as touched:
    at_rest = rest_hint(sensor, _touched_readings(part))
    comes_and_goes = geometric and not pressed and not at_rest and "intermittent" in kinds
    as_read = replace(work, k={name: v.copy() for name, v in work.k.items()}, there=work.there.copy())
    work, loose, doubted = _comes_and_goes(work, as_read) if comes_and_goes else (work, [], [])
    rows = places(work)
    tests = [] if pressed else list(_TESTS) if geometric else [never_touched, swapped_wires]
    tests = [t for t in tests if kinds & _TESTS[t] and not (ceiling and t is clipped)]
    suspects = _remove_dominant(rows, tests, {s for s in sought if any(s[0] in _TESTS[t] for t in tests)})
    loose, doubted = _not_beside_exchanged(loose, [*doubted, *_asked_of_doubtful(suspects)], suspects)
    named = [s for s in suspects if not s.doubtful]
    # The surest first: a named fault is one that explains what is seen around it, the most of all first.
    removed = [*pressed, *_merged([s.finding for s in named]), *_silent_channels(part), *loose]
    if "saturation" in kinds and not (pressed or ceiling or reference):
        faulty = {i for f in removed for i in f.strips}
        removed += [f for f in single_ceilings(part, sigma) if not faulty & set(f.strips)]
    slow, settled = Drifts([], [], [], np.full(work.strips, np.inf)), set[_Place]()
    if not kinds.isdisjoint(_SLOW):
        slow, settled = _slow_changes(part, work, named, removed, doubted, sought)
    humming, no_hum = hum(part, sigma) if "hum" in kinds else ([], "")
    noisy = _noise_beside_hum(noise, humming) if "noise" in kinds else []
    known = {i for f in removed for i in f.strips}
    late = [f for f in (*slow.findings, *noisy) if not pressed and not known & set(f.strips)]
    findings = [*bits, *lifted, *reference, *ceiling, *removed, *humming, *late]
    asked: Sequence[Question] = (
        (*may_lift, *unsure, *_questions(rows, known, [*doubted, *slow.questions]))
        if geometric and not (pressed or ceiling)
        else ()
    )
    orders = None
    if geometric and _ORDER in kinds and rows.there.any() and not (pressed or ceiling):
        unrepaired = places(as_read) if suspects else rows
        orders, findings, asked = _with_order(rows, unrepaired, findings, asked)
    return _Examined(
        findings=tuple(sorted(findings, key=lambda f: _WORST[f.kind.severity])),
        questions=tuple(asked),
        removed=removed,
        rows=rows,
        noise=noise,
        notes=slow.notes,
        least_drift=slow.least,
        settled=frozenset(settled),
        at_rest=at_rest,
        unchecked=(
            "intermittent contacts: the rest level is not given" if at_rest and geometric else "",
            no_lift,
            no_bits,
            no_hum,
        ),
        orders=orders,
    )


def _with_order(
    rows: WorkingCopy, unrepaired: WorkingCopy, findings: list[Finding], asked: Sequence[Question]
) -> tuple[Orders, list[Finding], Sequence[Question]]:
    """Return the strips' order against others, and findings and questions with what it asks of the rows as read."""
    orders = compared_orders(rows)
    question = order_question(unrepaired, orders if unrepaired is rows else compared_orders(unrepaired))
    return orders, *(joined(question, unrepaired, findings, asked) if question else (findings, asked))


def _corrected_copy(part: Log, sigma: float, ceiling: list[Finding], factor: float) -> WorkingCopy:
    """Return the readings to work on: over the reference that they show, without strays and what a ceiling cuts."""
    work = working_copy(_without_strays(part), sigma)
    work.drop(*np.flatnonzero(left_out_wholly(part.sensor)).tolist())
    for name, values in work.k.items():
        beyond = [c.numbers["side"] * (values - c.numbers["level"]) > -_AT for c in ceiling]
        out = np.any([np.zeros(values.shape, bool), *beyond], axis=0)
        work.k[name] = np.where(out, np.nan, values / factor)
    return work


def _asked_of_doubtful(suspects: Iterable[Suspect]) -> Iterator[Question]:
    """Give the question that each doubtful suspect is: a strip that is open in some places may be so at some times."""
    for s in (s for s in suspects if s.doubtful):
        causes = (s.finding.fault, *["intermittent"] * (s.finding.fault == "open-strip"))
        yield Question(s.finding.strips, causes, s.finding.evidence)


def _not_beside_exchanged(
    loose: list[Finding], doubted: list[Question], named: list[Suspect]
) -> tuple[list[Finding], list[Question]]:
    """Leave out what comes and goes beside strips in the wrong order.

    They have a gap at a contact's end, and so do, by them, those beside. An order that is in question takes no finding.
    """
    exchanged = [s for s in named if s.finding.fault == "swapped-strips"]
    beside, perhaps = (
        {i + side for s in some for i in s.finding.strips for side in (-1, 0, 1)}
        for some in ([s for s in exchanged if not s.doubtful], exchanged)
    )
    return (
        [f for f in loose if not beside & set(f.strips)],
        [q for q in doubted if "intermittent" not in q.causes or not perhaps & set(q.strips)],
    )


def _slow_changes(
    part: Log,
    work: WorkingCopy,
    named: list[Suspect],
    removed: list[Finding],
    doubted: list[Question],
    sought: Set[_Place],
) -> tuple[Drifts, set[_Place]]:
    """Look for drift and wander once what was named is repaired, and say which faults sought are settled.

    What an outline that fits all scans tells of tied strips is added to `removed`, or to `doubted`.
    """
    sensor, settled = part.sensor, set[_Place]()
    tied = [s for s in named if s.finding.fault == "short"]
    for suspect in named:
        if suspect not in tied:
            suspect.repair(work)
    work.changed()
    timed = places(work, max(len(part.time_s) // _TIMED, 1))
    outlined = sensor.kind.closed_form and sensor.sensing_ratio and not sought
    pair = tied_under_outline(timed) if outlined else None
    if pair is not None:
        fresh = not {i for f in removed for i in f.strips} & set(pair.finding.strips)
        if fresh or not pair.doubtful:
            settled.add((pair.finding.fault, pair.finding.strips))
        if fresh and pair.doubtful and pair.finding.strips not in {q.strips for q in doubted}:
            doubted.append(Question(pair.finding.strips, (pair.finding.fault,), pair.finding.evidence))
        elif fresh and not pair.doubtful:
            removed.append(pair.finding)
            tied.append(pair)
    for suspect in tied:
        suspect.repair(timed)
    slow = drift(part, timed, timed.time_s, {i for fault, strips in sought if fault in _SLOW for i in strips})
    return slow, settled | {(fault, (i,)) for fault in _SLOW for i in slow.settled}


def _noise_beside_hum(noise: NoiseEstimate, humming: list[Finding]) -> list[Finding]:
    """Return channels that are too noisy; hum is noise, too, and is told already."""
    loud = {f.strips for f in humming}
    return [f for f in excess_noise(noise) if f.strips not in loud]


def _without_strays(log: Log) -> Log:
    """Return the log without touches of one strip alone in one scan alone, as a stray reading makes them."""
    if len(log.time_s) < 3 or log.sensor.rest_volt is None:
        return log
    touched = np.pad(log.touched, 1)
    around = touched[1:-1, :-2] | touched[1:-1, 2:] | touched[:-2, 1:-1] | touched[2:, 1:-1]
    return replace(log, touched=log.touched & around)


def working_sigma(noise: NoiseEstimate) -> float:
    """Return the standard deviation of a reading over Vref that tests count on."""
    sigma = max(noise.sigma if np.isfinite(noise.sigma) else 0.0, _LEAST_SIGMA)
    return sigma if noise.steady else min(sigma, _MOST_SIGMA)  # motion, for the most part


def _comes_and_goes(
    work: WorkingCopy, as_read: WorkingCopy
) -> tuple[WorkingCopy, list[Finding], list[Question]]:
    """Return the copy without strips that are gone for a stretch or drop out, and these, each once.

    The copy `as_read` where strips read as if in each other's places: these come and go at a contact's ends.
    """
    gone, unsure = lost(work)
    named = {i for f in gone for i in f.strips} | {i for q in unsure for i in q.strips}
    loose, asked = intermittent(work)
    found = [*gone, *(f for f in loose if not named & set(f.strips))]
    doubted = [*unsure, *(q for q in asked if not named & set(q.strips))]
    exchanged = (found or doubted) and any(out_of_order(places(as_read)))
    return as_read if exchanged else work, found, doubted


def _questions(rows: WorkingCopy, known: set[int], moving: Sequence[Question]) -> tuple[Question, ...]:
    """Return what to ask, each strip once."""
    asked = list(questions(rows, known))
    named = known | {i for q in asked for i in q.strips}
    return (*asked, *(q for q in moving if not named & set(q.strips)))


def _remove_dominant(rows: WorkingCopy, tests: Sequence[_Test], sought: Set[_Place]) -> list[Suspect]:
    """Name and undo the faults that explain the largest misfits around them, again and again until none is found.

    Or until those `sought` are, if any.
    """
    named: dict[tuple[str, tuple[int, ...], str | None], Suspect] = {}
    while len(rows.there) and not (sought and sought <= {(f, strips) for f, strips, _ in named}):
        edges = {int(rows.order[0]), int(rows.order[-1])}
        faulty = {i for _, strips, _ in named for i in strips}
        suspected = [
            s for test in tests for s in test(rows)
            if s.finding.place not in named
            and (s.finding.fault != "swapped-strips" or not faulty & set(s.finding.strips))
        ]  # fmt: skip
        if not suspected:
            break
        suspected.sort(
            key=lambda s: s.explained * (_AT_EDGE if edges & set(s.finding.strips) else 1.0), reverse=True
        )
        for worst in _apart(suspected, rows):
            worst.repair(rows)
            named[worst.finding.place] = worst
        rows.changed()
    return list(named.values())


def _apart(suspected: Sequence[Suspect], rows: WorkingCopy) -> list[Suspect]:
    """Return the suspects, the worst first, that no worse one disturbs: it is further away than predictions reach."""
    place = np.argsort(rows.order)
    across = [place[list(s.finding.strips)].tolist() for s in suspected]
    return [s for n, s in enumerate(suspected) if not any(_near(worse, across[n]) for worse in across[:n])]


def _merged(findings: list[Finding]) -> list[Finding]:
    """Drop exchanged wires where the strip's ends are exchanged: exchanging Vref and ground looks like both."""
    turned = {f.strips for f in findings if f.fault == "swapped-ends"}
    return [f for f in findings if not (f.fault == "swapped-wires" and f.strips in turned)]


def _silent_channels(log: Log) -> Iterator[Finding]:
    """Find channels without any reading where the strip's other channel has some: a logger leaves a dead one empty."""
    out, channels = left_out(log.sensor), log.sensor.signatures
    for name, other in (channels, channels[::-1]) if len(channels) == 2 else ():
        if name not in log.raw or other not in log.raw or not np.isfinite(log.raw[name]).any():
            continue  # of one signature alone
        read = np.isfinite(log.raw[other]).sum(axis=0)
        mute = ~np.isfinite(log.raw[name]).any(axis=0) & (read >= _EMPTY)
        for strip in np.flatnonzero(mute & ~out.get(name, np.zeros_like(mute))).tolist():
            evidence = f"empty in all {int(read[strip])} scans in which the strip's other channel reads"
            yield Finding("dead", (strip,), evidence, {"scans": float(read[strip])}, name)


def _touched_readings(log: Log) -> dict[str, FloatArray]:
    return {name: np.where(log.touched, values, np.nan) for name, values in log.raw.items()}


def _notes(log: Log, work: WorkingCopy, at_rest: str) -> Iterator[Finding]:
    pairs = [neighbour_residuals(work, n) for n in work.k] if log.sensor.kind.closed_form else []
    # Extrapolation to the outermost strips is inaccurate.
    for strip in range(1, work.strips - 1):
        worst = max((_offset(e[:, strip], r[:, strip], work.sigma) for e, r in pairs), key=abs, default=0.0)
        if abs(worst) > max(_OFFSET, 4.0 * work.sigma):
            yield Finding(
                "calibration", (int(work.order[strip]),),
                f"reads {100 * worst:+.2g} % of Vref off its neighbours' line", {"offset": worst},
            )  # fmt: skip
    raw = _touched_readings(log)
    if hint := at_rest or (all_read_hint(log.sensor, raw) if len(log.time_s) > 1 else ""):
        yield Finding("rest-level", (), hint)
    elif hint := other_scale(log.sensor, raw):
        yield Finding("scale", (), hint)


def _offset(expected: FloatArray, off: FloatArray, sigma: float) -> float:
    """Return a channel's median deviation from its neighbours' prediction; 0 where only some contacts show it."""
    known = np.isfinite(off)
    if known.sum() < _FEWEST or not moved_to_and_fro(expected[known], sigma):
        return 0.0
    low, middle, high = np.percentile(off[known], [25.0, 50.0, 75.0])
    return float(middle) if low * high > 0.0 else 0.0


def _not_checked(log: Log, seen: _Examined, ill: set[int], asked: set[int]) -> Iterator[str]:
    """Yield what this recording could not show; `ill` are strips that are named already, `asked` those in question."""
    work = seen.rows
    base = log.sensor.strip_base
    silent = left_out_wholly(log.sensor)
    if silent.any():
        yield f"{_names([int(i) + base for i in np.flatnonzero(silent)])}: left out by the spec (without)"
    single = [
        channel_name(int(i), name, base)
        for name, out in left_out(log.sensor).items()
        for i in np.flatnonzero(out & ~silent)
    ]
    if single:
        yield f"{', '.join(single)}: left out by the spec (without)"
    if never := [
        int(i) + base for i in np.flatnonzero(~log.touched.any(axis=0) & ~silent) if i not in asked | ill
    ]:
        yield f"{_names(never)}: never touched; move the contact over them"
    if not log.sensor.kind.closed_form:
        yield "open strips, shorts, order, ends: a CRS-CRP sheet's strips shift each other's readings"
        return
    wide = work.there.sum(axis=1).max(initial=0)
    if wide < 4:
        yield f"shorts and strips exchanged: no contact is four strips wide, the widest {wide}"
    if len(work.there) < 6:
        what = "shorts, strips exchanged, stuck channels, saturation"
        yield f"{what}: the contact stood at {len(work.there)} place(s); move and turn it"
    elif wide >= 4 and seen.orders is not None:
        told = ill | asked | set(np.flatnonzero(silent).tolist())
        unknown = sorted(order_unknown(work, seen.orders) - told)
        names = _names([i + base for i in unknown])
        if unknown:
            why = "an exchange would go unnoticed; move the contact across them, and turn it"
            yield f"strips exchanged, of {names}: {why}"
    known = np.any([np.isfinite(neighbour_residuals(work, n)[0]).any(axis=0) for n in work.k], axis=0)
    alone = [
        int(number) + base
        for number, compared in zip(work.order, known, strict=True)
        if log.touched[:, number].any() and not compared and number not in ill
    ]
    if alone:
        yield f"{_names(sorted(alone))}: no usable neighbours at the same time; touch two or more next to them too"
    if log.time_s[0] == log.time_s[-1] and len(log.time_s) > 1:
        yield "drift and hum: the scans have no times"


def _pauses(time_s: FloatArray) -> str:
    """Say how many scans of an even recording are missing; empty where none are."""
    if told := time_goes_back(time_s):
        return f"drift and hum: {told}"
    step = np.diff(time_s)
    if len(step) < _FEWEST or not (period := float(np.median(step))) > 0.0:
        return ""
    pause = step > 1.5 * period
    if np.mean(np.abs(step - period) < 0.2 * period) < _EVEN:
        return ""
    lost = int(np.sum(np.round(step[pause] / period) - 1.0))
    if lost <= _LOST * len(time_s):
        return ""
    longest = float(step.max())
    return f"{lost} scans are missing in {int(pause.sum())} gap(s) of the recording, the longest of {longest:.3g} s"


def _drift_not_checked(log: Log, least: FloatArray, ill: set[int]) -> Iterator[str]:
    base = log.sensor.strip_base
    mine = log.touched.any(axis=0) & ~np.isin(np.arange(log.sensor.strips), list(ill))
    again = "go over the same places again, early and late in the recording"
    if (missing := np.flatnonzero(mine & np.isinf(least))).size:
        yield f"drift of {_names([int(i) + base for i in missing])}: {again}"
    small = np.flatnonzero(mine & np.isfinite(least) & (least > _SMALL_DRIFT))
    if small.size:
        most = f"{100 * float(least[small].max()):.2g} % of Vref"
        more = again if log.sensor.rest_volt is not None else f"log untouched strips (rest_volt), or {again}"
        yield f"drift of {_names([int(i) + base for i in small])} by less than up to {most}: {more}"


def _names(strips: list[int]) -> str:
    """Write strips as "strips 0-3, 7"."""
    parts: list[list[int]] = []
    for i in strips:
        if parts and i == parts[-1][-1] + 1:
            parts[-1].append(i)
        else:
            parts.append([i])
    ranges = ", ".join(str(p[0]) if len(p) == 1 else f"{p[0]}-{p[-1]}" for p in parts)
    return ("strip " if len(strips) == 1 else "strips ") + ranges
