"""What is wrong with a device's frames and replies, in words for the user, and not too often."""

from __future__ import annotations

from collections.abc import Callable

from tacstrip.stream.device.protocol.decoder import Counts
from tacstrip.stream.device.protocol.frames import Kind
from tacstrip.stream.device.protocol.messages import Command, Reply, SelfTest, Status

_AGAIN_S = 10.0  # between two messages of one kind
_ANSWER_S = 0.5  # longest wait for a reply
_WORDS = {
    "corrupt": "{} broken frame(s) came and are left out; all others are used: is the cable sound?",
    "lost": "{} scan(s) are missing by their numbers",
    "out_of_order": "{} scan(s) came after later ones; put in their place unless that was given up",
    "unknown": "{} intact frame(s) of another version, kind or length came and are left out; flash the firmware of "
    "this tacstrip",
    "duplicates": "{} scan(s) came again and are taken once",
    "misnumbered": "{} scan(s) have numbers that cannot be; they are kept as they came",
    "out_of_range": "{} scan(s) have codes above the converter's bits and are left out; flash the firmware anew",
}
_REFUSALS = {
    Status.UNKNOWN: "does not know it",
    Status.BAD_BODY: "finds its body invalid",
    Status.OTHER_VERSION: "speaks another version of the protocol",
}


class Troubles:
    """Reports troubles: a kind's first at once, more of it at most every 10 s, with their number.

    Parameters
    ----------
    tell
        Called with messages for the user.
    """

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._told = Counts()
        self._told_s: dict[str, float] = {}
        self._asked: dict[int, tuple[Command, float]] = {}
        self._late = 0

    def reconnected(self) -> None:
        """Forget the commands that were not answered."""
        self._asked.clear()

    def say(self, kind: str, text: str, now_s: float) -> None:
        """Report one trouble of a kind, unless that was done a moment ago."""
        if now_s - self._told_s.get(kind, -_AGAIN_S) >= _AGAIN_S:
            self._told_s[kind] = now_s
            self._tell(text)

    def check_counts(self, counts: Counts, now_s: float, last: bool = False) -> None:
        """Report what the decoder has counted since; the `last` time all of it, however lately a kind was told."""
        if counts == self._told:
            return
        for kind, words in _WORDS.items():
            more = getattr(counts, kind) - getattr(self._told, kind)
            if more > 0 and (last or now_s - self._told_s.get(kind, -_AGAIN_S) >= _AGAIN_S):
                self._told_s[kind] = now_s
                self._tell(words.format(more))
                self._told = self._told._replace(**{kind: getattr(counts, kind)})

    def check_late(self, late: int, seen: bool, now_s: float) -> None:
        """Report scans that began late by the device's own count since its start.

        Not `seen` by a reader that was waiting for them: the device may have waited for a reader who was away.
        """
        if seen and late > self._late:
            text = (
                f"{late} scan(s) began a period or more too late, says the device: it cannot keep this rate"
            )
            self.say("late", f"{text}; ask for a lower one", now_s)
        self._late = late

    def asked(self, command: Command, now_s: float) -> None:
        """Note that a command was sent."""
        if command.kind != Kind.IDENTIFY:
            self._asked[command.sequence] = command, now_s

    def check_message(self, message: object, now_s: float) -> None:
        """Report a reply that refuses its command or answers none, and what nobody asked for."""
        if isinstance(message, Reply):
            self._check_reply(message, now_s)
        elif isinstance(message, SelfTest):
            self.say("test", "the device tells of a test that was not asked for", now_s)
        elif isinstance(message, Command):
            self.say("echo", "commands come back on the line: is an echo on?", now_s)

    def _check_reply(self, reply: Reply, now_s: float) -> None:
        command, _ = self._asked.pop(reply.command_sequence, (None, 0.0))
        if command is None or command.kind != reply.command:
            self.say("reply", "the device answers a command that was not sent", now_s)
            return
        name = Kind(command.kind).name
        if reply.status != Status.DONE:
            reason = _REFUSALS.get(reply.status, f"says {reply.status}")  # type: ignore[call-overload]
            self.say("reply", f"the device refuses {name}: it {reason}", now_s)
        elif command.period_us is not None and reply.value != command.period_us:
            asked, given = command.period_us, reply.value
            self.say("rate", f"the device scans every {given} us, and was asked for {asked} us", now_s)

    def unanswered(self, now_s: float) -> list[Command]:
        """Return the commands whose reply is overdue, once, and report it."""
        late = [n for n, (_, sent_s) in self._asked.items() if now_s - sent_s > _ANSWER_S]
        commands = [self._asked.pop(number)[0] for number in late]
        if commands:
            name = Kind(commands[0].kind).name
            self.say("answer", f"the device did not answer {name} within {_ANSWER_S:g} s", now_s)
        return commands
