"""Make a cut or damaged MCAP file whole again, as far as it goes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema, Statistics

from tacstrip.errors import RecordingError
from tacstrip.files import replacing
from tacstrip.stream.framing import Condition, Records
from tacstrip.stream.mcapfile import CHUNK_BYTES, McapFile, already_there

RECOVERED = "tacstrip_recovered"  # name of the metadata that says so
_MOST_PLACES = 20  # of damage that are told one by one


@dataclass(frozen=True)
class Recovered:
    """What was saved.

    Attributes
    ----------
    messages
        Messages by topic.
    seconds
        From the first to the last message [s].
    condition
        The state of the file that was read.
    held
        Messages that the file held by its own index; None where the index is lost too.
    """

    messages: dict[str, int]
    seconds: float
    condition: Condition
    held: int | None = None

    @property
    def lost(self) -> list[str]:
        """What was lost, in words, a line each; empty where the file is whole."""
        found = self.condition
        if found.whole and not found.damage:
            return []
        total = sum(self.messages.values())
        if self.held is None or self.held < total:
            count = "an unknown number of messages, as their index is lost too"
        else:
            count = f"{self.held - total} of {self.held} messages"
        places = found.damage[:_MOST_PLACES]
        if len(found.damage) > _MOST_PLACES:
            places.append(f"and {len(found.damage) - _MOST_PLACES} places more")
        if not found.whole:
            places.append(
                f"{found.lost_bytes} bytes of {found.total_bytes} lie after the last whole chunk"
                if found.lost_bytes
                else "the file was cut after a whole chunk"
            )
        return [count, *places]


def recover(path: str | Path, output: str | Path, force: bool = False) -> Recovered:
    """Copy all that is whole in an MCAP file to a new, complete file; any MCAP file of ROS 2 will do.

    Raises
    ------
    RecordingError
        It is no MCAP file, holds no whole message, or the output exists already.
    OSError
        The output cannot be written.
    """
    # First what the messages are: the chunk that says so may be the damaged one, and the summary says it again.
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages = 0
    held: int | None = None
    first = Records(path)
    for record in first:
        match record:
            case Schema():
                schemas[record.id] = record
            case Channel():
                channels[record.id] = record
            case Message():
                messages += 1
            case Statistics() if sum(record.channel_message_counts.values()) == record.message_count:
                held = record.message_count
            case _:
                pass
    if not messages or not channels:
        raise RecordingError(f"{path}: it holds no whole chunk, so there is nothing to recover")
    if Path(output).exists() and not force:
        raise RecordingError(already_there(output))
    about = {"from": Path(path).name, "lost_bytes": str(first.condition.lost_bytes)}
    about |= {f"damage_{i}": told for i, told in enumerate(first.condition.damage[:_MOST_PLACES])}
    with replacing(output) as part:
        file = McapFile(part, force=True)
        saved = _copy(Records(path), file, schemas, channels)
        with file.guard():
            file.writer.add_metadata(RECOVERED, about)
        file.close()
    return Recovered(*saved, first.condition, held)


def _copy(
    records: Records, file: McapFile, schemas: dict[int, Schema], channels: dict[int, Channel]
) -> tuple[dict[str, int], float]:
    """Copy attachments, metadata and messages; return messages by topic, and seconds."""
    writer = file.writer
    with file.guard():
        schema_ids = {old: writer.register_schema(s.name, s.encoding, s.data) for old, s in schemas.items()}
        ids = {
            old: writer.register_channel(
                c.topic, c.message_encoding, schema_ids.get(c.schema_id, 0), c.metadata
            )
            for old, c in channels.items()
        }
    counts = {c.topic: 0 for c in channels.values()}
    times: list[int] = []
    waiting = 0
    for record in records:
        with file.guard():
            match record:
                case Attachment():
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
                case Message(channel_id=channel, log_time=at) if channel in ids:
                    writer.add_message(ids[channel], at, record.data, record.publish_time, record.sequence)
                    counts[channels[channel].topic] += 1
                    times = [min(times[0], at), max(times[1], at)] if times else [at, at]
                    waiting += len(record.data)
                case _:
                    pass
        if waiting >= CHUNK_BYTES:
            file.flush()
            waiting = 0
    return counts, (times[1] - times[0]) / 1e9 if times else 0.0
