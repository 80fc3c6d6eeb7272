"""Scans in the order of their numbers: what came twice, late or misnumbered, and whether the device restarted."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import NamedTuple

# A number further ahead or behind is none of a gap or of a late scan.
MAX_AHEAD, MAX_BEHIND = 2**16, 2**10
# Scans after a gap wait for those missing, until so many have come or so much of the device's time has passed.
MAX_HELD, MAX_HELD_US = 16, 100_000
# Scans in a row that come again, after which they are taken for a run of their own: from number 0 on, as after a reset,
# and from another number, as where a block of them is sent once more.
MAX_AGAIN, MAX_BLOCK = 8, 64
# A scan is of the same run if its time follows that of the one before so closely, or precedes a later one's.
_FOLLOWS_US = 2_000_000
_STEADY = 32  # scans after which a number that cannot be is a restart, and not one wrong number more
_NUMBERS = struct.Struct("<xxII")


class OrderedScan(NamedTuple):
    """Header and body of a scan's frame, and whether the device restarted before it."""

    plain: bytes
    restarted: bool = False


class _Seen(NamedTuple):
    time_us: int
    digest: int


class ScanOrder:
    """Puts the scans of one device in order.

    A scan's number tells its place and its time is the second witness. Same number and same bytes: it came twice. A
    number that was missing: it is late, and is waited for. Any other number that is not due: the device has restarted;
    where that shows again and again while the time continues, the numbers are wrong, and scans are kept as they come.
    It has restarted, too, where nothing comes but what has come before: from number 0 on, or for long.

    Parameters
    ----------
    count
        Called with what to add to the decoder's counts.
    """

    def __init__(self, count: Callable[..., None]) -> None:
        self._count = count
        self.next: int | None = None  # the number that is due
        self.announced = False  # a hello said that the device has restarted; the next scan shows it
        self._newest_us = 0
        self._held: dict[int, bytes] = {}
        self._seen: dict[int, _Seen] = {}
        self._since_jump = _STEADY  # scans since a number that cannot be, or a restart
        self._again: list[bytes] = []  # scans that came again since the last new one

    def take(self, plain: bytes) -> Iterator[OrderedScan]:
        """Take a scan as it came; yield those whose turn it is."""
        number, time_us = _NUMBERS.unpack_from(plain)
        ahead = 0 if self.next is None else _signed(number - self.next)
        follows = 0 < _signed(time_us - self._newest_us) < _FOLLOWS_US
        if self.announced and self.next is not None:
            self.announced = False
            if not (follows and 0 <= ahead < MAX_AHEAD):
                yield from self._restart(plain, number, lost=number if number < MAX_AHEAD else 0)
                return
        if ahead == 0:
            yield self._accept(plain, number, time_us)
            yield from self._run()
        elif self._came_before(plain, number):
            yield from self._repeat(plain, number)
        elif 0 < ahead < MAX_AHEAD:
            self._held[number] = plain
            if not self._held_in_order():
                yield from self._renumber()
                return
            waited_us = max(_signed(time_us - _NUMBERS.unpack_from(p)[1]) for p in self._held.values())
            while len(self._held) > MAX_HELD or (self._held and waited_us >= MAX_HELD_US):
                yield from self._skip()
                waited_us = 0
        elif self._is_late(number, time_us):
            self._count(out_of_order=1)
        elif follows and self._since_jump < _STEADY:
            yield from self.release()
            self._count(misnumbered=1)
            self._since_jump = 0
            yield self._accept(plain, number, time_us)
        else:
            yield from self._restart(plain, number)

    def release(self) -> Iterator[OrderedScan]:
        """Yield the scans that wait; those missing before them count as lost."""
        while self._held:
            yield from self._skip()

    def _repeat(self, plain: bytes, number: int) -> Iterator[OrderedScan]:
        """Take a scan that has come before; many in a row, and nothing new, are a device that does all of it again."""
        if self._again and not 0 < _signed(number - _NUMBERS.unpack_from(self._again[-1])[0]) <= MAX_BEHIND:
            self._again = []
        self._count(duplicates=1)
        self._again.append(plain)
        again = self._again
        if len(again) > (MAX_BLOCK if _NUMBERS.unpack_from(again[0])[0] else MAX_AGAIN):
            self._count(duplicates=-len(again))
            yield from self._restart(again[0], _NUMBERS.unpack_from(again[0])[0])
            for scan in again[1:]:
                yield from self.take(scan)

    def _accept(self, plain: bytes, number: int, time_us: int, restarted: bool = False) -> OrderedScan:
        self.next, self._newest_us = (number + 1) % 2**32, time_us
        self._again = []
        self._since_jump += 1
        self._seen.pop(number, None)
        self._seen[number] = _Seen(time_us, hash(plain))
        if len(self._seen) > MAX_BEHIND:
            del self._seen[next(iter(self._seen))]
        return OrderedScan(plain, restarted)

    def _run(self) -> Iterator[OrderedScan]:
        """Yield the scans that wait and whose turn has come; the missing one that came counts as out of order."""
        late = bool(self._held)
        while self.next is not None and (plain := self._held.pop(self.next, None)) is not None:
            yield self._accept(plain, *_NUMBERS.unpack_from(plain))
        self._count(out_of_order=late)

    def _skip(self) -> Iterator[OrderedScan]:
        """Give up the scans that are missing before the first that waits."""
        assert self.next is not None
        due = self.next
        gap = min((number - due) % 2**32 for number in self._held)
        self._count(lost=gap)
        self.next = (due + gap) % 2**32
        while (plain := self._held.pop(self.next, None)) is not None:
            yield self._accept(plain, *_NUMBERS.unpack_from(plain))

    def _held_in_order(self) -> bool:
        """Return whether the numbers of the scans that wait agree with their arrival, or with their times."""
        assert self.next is not None
        gaps = [(number - self.next) % 2**32 for number in self._held]
        if gaps == sorted(gaps):
            return True
        times = [_signed(_NUMBERS.unpack_from(p)[1] - self._newest_us) for p in self._held.values()]
        by_number = sorted(range(len(gaps)), key=gaps.__getitem__)
        return by_number == sorted(range(len(gaps)), key=times.__getitem__)

    def _renumber(self) -> Iterator[OrderedScan]:
        """Yield the scans that wait as they came, as their numbers cannot be."""
        held, self._held = list(self._held.values()), {}
        self._count(misnumbered=len(held))
        for plain in held:
            yield self._accept(plain, *_NUMBERS.unpack_from(plain))

    def _restart(self, plain: bytes, number: int, lost: int = 0) -> Iterator[OrderedScan]:
        yield from self.release()
        self._seen.clear()
        self._since_jump = 0
        self._count(restarts=1, lost=lost)
        yield self._accept(plain, number, _NUMBERS.unpack_from(plain)[1], restarted=True)

    def _came_before(self, plain: bytes, number: int) -> bool:
        seen = self._seen.get(number)
        return self._held.get(number) == plain or (seen is not None and seen.digest == hash(plain))

    def _is_late(self, number: int, time_us: int) -> bool:
        """Return whether a scan with an old number was never seen and has a time that belongs there."""
        if number in self._seen or self.next is None or (self.next - number) % 2**32 > MAX_BEHIND:
            return False
        after = next((s for n in range(1, MAX_BEHIND) if (s := self._seen.get((number + n) % 2**32))), None)
        before = next((s for n in range(1, MAX_BEHIND) if (s := self._seen.get((number - n) % 2**32))), None)
        precedes = after is not None and 0 < _signed(after.time_us - time_us) < _FOLLOWS_US
        return precedes and (before is None or _signed(time_us - before.time_us) > 0)


def _signed(difference: int) -> int:
    """Return a difference modulo 2^32 as a signed number."""
    return (difference + 2**31) % 2**32 - 2**31
