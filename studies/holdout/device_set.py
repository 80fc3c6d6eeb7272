"""A device that misbehaves, written from docs/reference/protocol.md alone: what the host records and says."""

from __future__ import annotations

import contextlib
import os
import re
import select
import struct
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import tacstrip as ts

_VERSION, _RATE, _STRIPS, _BITS = 1, 100.0, 10, 12
_SECONDS = 4.5  # of a case
_MARKS = 6  # strips whose k_h carries three bits each of the scan's own number
SPAN = 1800  # us: from the first strip to the last
AT = 1.5  # s: when what happens once happens


def crc16(data: bytes) -> int:
    """Return CRC-16/IBM-3740 of bytes."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021) & 0xFFFF if value & 0x8000 else value << 1
    return value


def stuffed(data: bytes) -> bytes:
    """Return bytes without zeros (COBS)."""
    out, run = bytearray(), bytearray()
    for byte in data:
        if byte:
            run.append(byte)
            if len(run) == 254:
                out += b"\xff" + run
                run.clear()
        else:
            out += bytes([len(run) + 1]) + run
            run.clear()
    return bytes(out + bytes([len(run) + 1]) + run)


def unstuffed(data: bytes) -> bytes | None:
    """Return what was stuffed, None where it is not whole."""
    out, at = bytearray(), 0
    while at < len(data):
        step = data[at]
        if not step or at + step > len(data):
            return None
        out += data[at + 1 : at + step]
        at += step
        if step < 255 and at < len(data):
            out.append(0)
    return bytes(out)


def framed(kind: int, sequence: int, time_us: int, body: bytes, version: int = _VERSION) -> bytes:
    """Return a frame with its zeros."""
    head = struct.pack("<BBII", version, kind, sequence % 2**32, time_us % 2**32) + body
    return b"\0" + stuffed(head + struct.pack(">H", crc16(head))) + b"\0"


@dataclass
class Device:
    """A device on a pseudo-terminal, sound unless `Script` changes it; times are seconds since it began to send.

    `clock(t)` is its clock [s], `send(device, number, frame)` what leaves it in place of a scan's frame.
    """

    unit: str = "left-hand"
    construction: str = "crs-crs"
    strips: int = _STRIPS
    bits: int = _BITS
    rate: float = _RATE
    clock: Callable[[float], float] = lambda t: 1.0 + t
    answers: bool = True  # IDENTIFY
    streaming: bool = False
    sequence: int = 0
    sent: list[int] = field(default_factory=list)  # marks of the scans that left whole
    foreign: set[int] = field(default_factory=set)  # marks of another unit's
    marks: int = 0
    began: float = 0.0
    touched_padding: int = 0
    random: np.random.Generator = field(default_factory=np.random.default_rng)
    link: Path = Path()  # the port's name
    heard: bytes = b""  # of a command
    waiting: bytes = b""  # to be sent
    turned: bool = False  # what happens once has happened
    own: tuple[str, int] = ("", 0)  # name and strips that the stream began with

    def now(self) -> float:
        """Return the time since the first scan [s]."""
        return time.monotonic() - self.began if self.began else 0.0

    def stamp(self) -> int:
        """Return the clock [us]."""
        return int(1e6 * self.clock(self.now()))

    def plug(self) -> None:
        """Open a new pseudo-terminal under the port's name."""
        self.host, slave = os.openpty()
        tty.setraw(slave)
        self.slave = slave
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))

    def unplug(self) -> None:
        """Take the line away."""
        for end in (self.host, self.slave):
            with contextlib.suppress(OSError):
                os.close(end)

    def put(self, data: bytes) -> None:
        """Send bytes; what nobody reads within a second is lost."""
        end = time.monotonic() + 1.0
        while data and time.monotonic() < end:
            if select.select([], [self.host], [], 0.05)[1]:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self.host, data[:2048]) :]

    def hello(self) -> bytes:
        """Return a hello."""
        names = 3 if self.construction == "crs-crs" else 4
        body = struct.pack(
            "<HBB3BBHIIII",
            self.strips,
            names,
            self.bits,
            1,
            2,
            3,
            self.streaming,
            5000,
            500000,
            int(1e6 / self.rate),
            2100,
            0,
        )
        body += self.construction.encode().ljust(16, b"\0") + self.unit.encode().ljust(16, b"\0")
        return framed(2, self.sequence, self.stamp(), body)

    def scan(self, count: bool = True, foreign: bool = False, over: bool = False) -> bytes:
        """Return the next scan's frame; its mark is in the lowest bits of k_h of six touched strips."""
        mark = self.marks
        self.marks += 1
        n, top = self.strips, 2**self.bits - 1
        kh = np.full(n, int(0.6 * top) & ~7) + np.arange(n) * 8
        for i in range(_MARKS):
            kh[2 + i] += mark >> 3 * i & 7
        kl = np.full(n, int(0.35 * top)) + np.arange(n) * 8
        if over:
            kh[2 + _MARKS] = top + 1 + int(self.random.integers(2**16 - top - 1))
        touched = np.zeros((n + 7) // 8 * 8, np.uint8)
        touched[2 : 3 + _MARKS] = 1
        touched[n:] = self.touched_padding
        codes = [kh, kl] if self.construction == "crs-crs" else [kh]
        body = (
            struct.pack("<HBBI", n, 3 if len(codes) == 2 else 4, self.bits, SPAN)
            + np.packbits(touched, bitorder="little").tobytes()
        )
        body += b"".join(c.astype("<u2").tobytes() for c in codes)
        frame = framed(1, self.sequence, self.stamp(), body)
        self.sequence += 1
        if foreign:
            self.foreign.add(mark)
        elif count:
            self.sent.append(mark)
        return frame

    def obey(self) -> None:
        """Read commands and answer them."""
        with contextlib.suppress(OSError):
            while select.select([self.host], [], [], 0.0)[0]:
                self.heard += os.read(self.host, 4096)
        *whole, self.heard = self.heard.split(b"\0")
        for data in whole:
            text = unstuffed(data) if data else None
            if not text or len(text) < 12 or crc16(text):
                continue
            kind, sequence = text[1], struct.unpack_from("<I", text, 2)[0]
            value = struct.unpack_from("<I", text, 10)[0] if kind == 0x84 else int(1e6 / self.rate)
            if kind == 0x81:
                if self.answers:
                    self.put(self.hello())
                continue
            if kind == 0x82:
                self.streaming = True
            elif kind == 0x83:
                self.streaming = False
            self.put(framed(3, self.sequence, self.stamp(), struct.pack("<BIBI", kind, sequence, 0, value)))


@dataclass(frozen=True)
class Trouble:
    """What goes wrong: what is sent in place of scan `number` at time t [s], and what the host should then say and do.

    `says` is a pattern that a message, the error or a count must match, "" where nothing is wrong; `ends`: the stream
    ends with an error; `counted`: the counts of frames are enough.
    """

    says: str = ""
    ends: bool = False
    counted: bool = False
    make: Callable[[np.random.Generator], Device] = lambda random: Device()
    step: Callable[[Device, int, float], bytes | None] = lambda d, number, t: d.scan()
    before: Callable[[Device], bytes] = lambda d: d.hello()
    onset: float = 0.0  # when it begins [s]
    seconds: float = 0.0  # how long it needs, where that is longer
    calibrated: str = ""  # the spec has a calibration of this unit


CLOCK = r"clock|time"


def _clock(change: Callable[[float], float], says: str = CLOCK, onset: float = 0.0) -> Trouble:
    return Trouble(says, make=lambda random: Device(clock=change), onset=onset)


def every(n: int, change: Callable[[Device], bytes]) -> Callable[[Device, int, float], bytes]:
    """Return a step that sends what `change` makes in place of every n-th scan."""
    return lambda d, number, t: change(d) if number % n == n - 1 else d.scan()


def _since(reset: float) -> Callable[[float], float]:
    return lambda t: 0.002 + t - reset


def _restart(d: Device, t: float, hello: bool, streaming: bool) -> None:
    """Reset the device once."""
    d.sequence, d.streaming, d.clock = 0, streaming, _since(t)
    if hello:
        d.put(d.hello())


def once(do: Callable[[Device, float], None]) -> Callable[[Device, int, float], bytes | None]:
    """Return a step that does something once, at 1.5 s."""

    def step(d: Device, number: int, t: float) -> bytes | None:
        if t > AT and not d.turned:
            d.turned = True
            do(d, t)
        return d.scan(foreign=(d.unit, d.strips) != d.own) if d.streaming else None

    return step


def _become(hello: bool, unit: str, more: int = 0, answers: bool = True) -> Callable[[Device, float], None]:
    def do(d: Device, t: float) -> None:
        d.unit, d.strips, d.answers = unit, d.strips + more, answers
        _restart(d, t, hello, True)

    return do


def _damaged(d: Device) -> bytes:
    frame = bytearray(d.scan(count=False))
    at = int(d.random.integers(2, len(frame) - 2))
    frame[at] ^= 1 << int(d.random.integers(8))
    return bytes(frame)


def _cut(d: Device) -> bytes:
    frame = d.scan(count=False)
    return frame[: int(d.random.integers(3, len(frame) - 2))]


def _twice(d: Device) -> bytes:
    frame = d.scan()
    return frame + frame


def _turned(d: Device) -> bytes:
    one, two = d.scan(), d.scan()
    return two + one


def _skipped(d: Device) -> bytes:
    d.sequence += int(d.random.integers(1, 4))
    return d.scan()


def _garbage(zeros: bool) -> Callable[[Device], bytes]:
    def put(d: Device) -> bytes:
        noise = d.random.bytes(int(d.random.integers(1, 80)))
        return (noise if zeros else noise.replace(b"\0", b"\x55")) + d.scan()

    return put


def _strange(d: Device) -> bytes:
    later = framed(1, d.sequence, d.stamp(), b"xyz" * 9, version=2)
    return framed(0x33, d.sequence, d.stamp(), b"abc") + later + d.scan()


def _reply(d: Device) -> bytes:
    return framed(3, d.sequence, d.stamp(), struct.pack("<BIBI", 0x82, 77, 2, 0)) + d.scan()


def _silent(d: Device, number: int, t: float) -> bytes | None:
    return None if 1.0 < t < 3.2 else d.scan()


def _burst(d: Device, number: int, t: float) -> bytes:
    """Keep scans in the adapter for a fifth of a second."""
    d.waiting += d.scan()
    if number % 20 < 19:
        return b""
    out, d.waiting = d.waiting, b""
    return out


def _flood(d: Device, number: int, t: float) -> bytes:
    return b"".join(d.scan() for _ in range(12))


def _bytewise(d: Device, number: int, t: float) -> bytes:
    for byte in d.scan():
        d.put(bytes([byte]))
    return b""


def _replug(d: Device, t: float, unit: str = "left-hand") -> None:
    d.unplug()
    d.unit = unit
    time.sleep(0.4)
    d.streaming = False
    d.plug()
    d.sequence, d.clock = 0, _since(t)


def _stopped(d: Device, number: int, t: float) -> bytes | None:
    """Forget that it was started, without a reset."""
    if t > AT and not d.turned:
        d.turned, d.streaming = True, False
    return d.scan() if d.streaming else None


class _Random:
    """A clock that says anything."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(3)

    def __call__(self, t: float) -> float:
        return float(self.random.uniform(0.0, 4294.0))


RESTART = r"restart|reset|anew"
ANOTHER = r"another (unit|device|sensor)|right-hand|unit"
TROUBLES: dict[str, Trouble] = {
    "sound": Trouble(),
    "restart, hello lost, waits for START": Trouble(
        RESTART, onset=AT, step=once(lambda d, t: _restart(d, t, False, False))
    ),
    "restart, hello lost, goes on": Trouble(
        RESTART, onset=AT, step=once(lambda d, t: _restart(d, t, False, True))
    ),
    "restart with a hello": Trouble(RESTART, onset=AT, step=once(lambda d, t: _restart(d, t, True, False))),
    "another unit, hello lost": Trouble(
        ANOTHER, True, onset=AT, step=once(_become(False, unit="right-hand"))
    ),
    "another unit, with a hello": Trouble(
        ANOTHER, True, onset=AT, step=once(_become(True, unit="right-hand"))
    ),
    "another number of strips": Trouble(
        "another|strips", True, onset=AT, step=once(_become(False, "right-hand", more=2))
    ),
    "another unit, does not identify itself": Trouble(
        "identif|hello|another|restart|anew",
        True,
        onset=AT,
        step=once(_become(False, unit="right-hand", answers=False)),
    ),
    "clock stands": _clock(lambda t: 1.0 + min(t, 1.0), onset=1.0),
    "clock at half speed": _clock(lambda t: 1.0 + 0.5 * t),
    "clock at double speed": _clock(lambda t: 1.0 + 2.0 * t),
    "clock at random": Trouble(CLOCK, make=lambda random: Device(clock=_Random())),
    "clock jumps back": _clock(lambda t: 100.0 + t - 7.0 * (t > 1.7), onset=1.7),
    "clock leaps ahead": _clock(lambda t: 1.0 + t + 60.0 * (t > 1.7), onset=1.7),
    "clock wraps at 2^31": _clock(lambda t: (2147.483648 - 1.7 + t) % 2147.483648, onset=1.7),
    "clock runs backwards": _clock(lambda t: 1000.0 - t),
    "clock wraps at 2^32": _clock(lambda t: 4294.967296 - 1.7 + t, ""),
    "clock jitters by 2 ms": _clock(lambda t: 1.0 + t + 0.002 * np.sin(300.0 * t), ""),
    "scans twice": Trouble("twice|duplicate|repeat|old|before", counted=True, step=every(7, _twice)),
    "frames cut": Trouble("corrupt|lost|cut", counted=True, step=every(9, _cut)),
    "frames corrupted": Trouble("corrupt|lost", counted=True, step=every(9, _damaged)),
    "frames out of order": Trouble("order|old|before|late", counted=True, step=every(9, _turned)),
    "numbers missing": Trouble("lost|missing", counted=True, step=every(9, _skipped)),
    "garbage between frames": Trouble("corrupt|lost", counted=True, step=every(5, _garbage(False))),
    "garbage with zeros": Trouble("corrupt|lost", counted=True, step=every(5, _garbage(True))),
    "codes beyond the converter": Trouble(
        "code|range|converter|corrupt|invalid",
        counted=True,
        step=every(9, lambda d: d.scan(count=False, over=True)),
    ),
    "padding bits set": Trouble(make=lambda random: Device(touched_padding=1)),
    "hello unasked": Trouble(step=every(60, lambda d: d.hello() + d.scan())),
    "hello unasked, in a flood": Trouble(step=every(2, lambda d: d.hello() + d.scan())),
    "silence for two seconds": Trouble("silen|no scan|nothing|stop|quiet|wait", onset=1.0, step=_silent),
    "stops without a reset": Trouble("silen|no scan|nothing|stop|again|restart", onset=AT, step=_stopped),
    "flood": Trouble(step=_flood),
    "bursts": Trouble(step=_burst),
    "byte by byte": Trouble(step=_bytewise),
    "number wraps at 2^32": Trouble(make=lambda random: Device(sequence=2**32 - 150)),
    "unknown kinds and a later version": Trouble("version|kind", counted=True, step=every(5, _strange)),
    "replies unasked": Trouble(step=every(5, _reply)),
    "a hundred strips": Trouble(make=lambda random: Device(strips=100, bits=16)),
    "stale bytes before the hello": Trouble(before=lambda d: d.random.bytes(300) + d.hello()),
    "unplugged and plugged in": Trouble(
        "unplug|gone|again|lost|disconnect|restart", onset=AT, step=once(_replug)
    ),
    "another unit plugged in": Trouble(
        ANOTHER, True, onset=AT, step=once(lambda d, t: _replug(d, t, "right-hand"))
    ),
    "another unit, with escapes in its name": Trouble(
        ANOTHER, True, onset=AT, step=once(_become(True, unit="\x1b[31mred"))
    ),
    "clock 3 % fast": Trouble(
        CLOCK, make=lambda random: Device(clock=lambda t: 1.0 + 1.03 * t), seconds=110.0
    ),
    "never answers": Trouble(
        "answer|nothing|hello|identif", True, make=lambda random: Device(answers=False), before=lambda d: b""
    ),
    "speaks something else": Trouble(
        "answer|protocol|came|identif|understand",
        True,
        make=lambda random: Device(answers=False),
        before=lambda d: b"k=512,300\r\n" * 40,
    ),
}


def _run(device: Device, trouble: Trouble, quiet: threading.Event, stop: threading.Event) -> None:
    """Send until it is quiet, and answer until it is stopped."""
    device.put(trouble.before(device))
    number = 0
    while not stop.is_set():
        device.obey()
        if not device.began and device.streaming:
            device.began = time.monotonic()
        if quiet.is_set() and device.waiting:
            device.put(device.waiting)
            device.waiting = b""
        if not device.began or quiet.is_set():
            time.sleep(0.005)
            continue
        with contextlib.suppress(OSError):
            data = trouble.step(device, number, device.now()) if device.streaming or number else None
            device.put(data or b"")
        number += 1
        time.sleep(max(0.0, device.began + number / device.rate - time.monotonic()))
    device.unplug()


def score(seed: int, number: int, troubles: dict[str, Trouble] | None = None) -> dict[str, Any]:
    """Record one misbehaving device."""
    troubles = troubles or TROUBLES
    kind = list(troubles)[number % len(troubles)]
    trouble, random = troubles[kind], np.random.default_rng([14, 4, seed, number])
    device = trouble.make(random)
    device.random = random
    if device.strips == _STRIPS:  # any sensor
        device.construction = str(random.choice(["crs-crs", "crs-m"]))
        device.strips, device.bits = int(random.integers(9, 25)), int(random.choice([10, 12, 16]))
        if "beyond the converter" in kind:  # two bytes hold nothing beyond 16 bits
            device.bits = min(device.bits, 12)
        device.rate = _RATE if kind == "flood" else random.uniform(40.0, 250.0)
    device.own = device.unit, device.strips
    method = "profile" if device.construction == "crs-crs" else "vertex"  # the quickest: recordings count
    said: list[tuple[float, str]] = []
    with tempfile.TemporaryDirectory() as name:
        device.link, file = Path(name) / "port", Path(name) / "session.mcap"
        device.plug()
        sensor = ts.Sensor(
            construction=device.construction, strips=device.strips, pitch_mm=5.0, length_mm=100.0, adc_bits=device.bits,
            calibration=ts.Calibration(unit=trouble.calibrated) if trouble.calibrated else None,
        )  # fmt: skip
        quiet, stop = threading.Event(), threading.Event()
        thread = threading.Thread(target=_run, args=(device, trouble, quiet, stop), daemon=True)
        thread.start()
        row: dict[str, Any] = {"error": "", "counts": "", "absolute": 0.0}
        heard: list[tuple[float, str]] = []
        try:
            with ts.live(
                str(device.link),
                sensor=sensor,
                method=method,
                record=file,
                on_message=lambda m: said.append((device.now(), m)),
            ) as stream:
                end = time.monotonic() + max(_SECONDS, trouble.seconds) + (4.0 if trouble.ends else 0.0)
                while time.monotonic() < end and stream.running:
                    time.sleep(0.02)
                quiet.set()
                heard, ended = list(said), time.time()
                time.sleep(0.4)  # what is under way arrives
                row["counts"] = repr(getattr(stream.source, "counts", ""))
                if stream.error is not None:
                    row["error"] = f"{type(stream.error).__name__}: {stream.error}"
        except (ts.TacstripError, OSError) as failure:
            row["error"] = row["error"] or f"{type(failure).__name__}: {failure}"
        stop.set()
        thread.join()
        marks, times, origin = recorded(file)
        if times and not trouble.ends:
            row["absolute"] = origin + times[-1] - ended
        return (
            {"kind": kind} | row | judged(trouble, device, marks, times, heard, row["error"], row["counts"])
        )


def recorded(file: Path) -> tuple[list[int], list[float], float]:
    """Return the marks and times of a recording, and its origin [s]."""
    marks: list[int] = []
    times: list[float] = []
    if not file.exists():
        return marks, times, 0.0
    recording = ts.Recording(file)
    for raw in recording:
        code = raw.codes["kh" if "kh" in raw.codes else "k"]
        marks.append(sum((int(code[2 + i]) & 7) << 3 * i for i in range(_MARKS)))
        times.append(raw.time_s)
    return marks, times, 1e-9 * recording.origin_ns


def judged(
    trouble: Trouble,
    device: Device,
    marks: list[int],
    times: list[float],
    said: list[tuple[float, str]],
    error: str,
    counts: str,
) -> dict[str, Any]:
    """Return whether intact scans were recorded, the trouble was named, and time went on."""
    got, last = set(marks), max(marks, default=-1)
    # A scan is lost where later ones came; none of the last half second may be missing either, unless the stream ended.
    missing = [m for m in device.sent if m not in got and (m < last or not trouble.ends)]
    told = " | ".join([*(text for _, text in said), error]).strip(" |")
    bad = re.compile(
        trouble.says or r"clock|restart|anew|lost|corrupt|another|silen|stop|error|trouble|no scan|gone", re.I
    )
    count = [int(v) for v in re.findall(r"\w+=(\d+)", counts)[1:]]
    when = [at for at, text in said if bad.search(text)]
    if "\x1b" in told:  # what the device says must not reach the terminal as it came
        named = False
    elif trouble.says:
        named = bool(bad.search(told)) or (trouble.counted and any(count))
    else:
        named = not bad.search(told) and not error
    steps = np.diff(times) if len(times) > 1 else np.zeros(0)
    return {
        "sent": len(device.sent), "recorded": len(marks), "missing": len(missing), "twice": len(marks) - len(got),
        "foreign": len(device.foreign & got), "named": named, "ended": bool(error) == trouble.ends,
        "after": when[0] - trouble.onset if when and trouble.says else None, "backwards": int((steps < 0.0).sum()),
        "longest": float(steps.max(initial=0.0)), "span": times[-1] - times[0] if times else 0.0, "said": told[:400],
    }  # fmt: skip


def right(row: dict[str, Any]) -> bool:
    """Whether nothing is wrong with how the host met a trouble."""
    clean = not (row["missing"] or row["twice"] or row["foreign"] or row["backwards"])
    return bool(clean and row["named"] and row["ended"])


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return what the host made of each trouble."""
    head = "trouble | intact scans | not recorded | twice | of another unit | named | ends as it should"
    head += " | told after, s | steps back | end off by, s | right"
    lines = [f"| {head} |", "|" + " --- |" * (head.count("|") + 1)]
    for r in rows:
        yes = ["yes" if v else "NO" for v in (r["named"], r["ended"], right(r))]
        after = "" if r["after"] is None else f"{r['after']:.1f}"
        lines.append(
            f"| {r['kind']} | {r['sent']} | {r['missing']} | {r['twice']} | {r['foreign']} | {yes[0]} | {yes[1]}"
            f" | {after} | {r['backwards']} | {r['absolute']:+.2f} | {yes[2]} |"
        )
    total = {
        k: sum(r[k] for r in rows)
        for k in ("sent", "missing", "twice", "foreign", "named", "ended", "backwards")
    }
    lines.append(
        f"| all | {total['sent']} | {total['missing']} | {total['twice']} | {total['foreign']} | {total['named']}"
        f" | {total['ended']} | | {total['backwards']} | | {sum(map(right, rows))} of {len(rows)} |"
    )
    lines += ["", "said:"]
    return lines + [
        f"- {r['kind']}: {r['said'] or '-'} [{r['counts']}; span {r['span']:.2f} s]" for r in rows
    ]
