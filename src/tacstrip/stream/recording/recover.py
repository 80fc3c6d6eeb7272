"""Recover the undamaged part of a cut or damaged MCAP file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema, Statistics

from tacstrip.errors import RecordingError
from tacstrip.files import replacing
from tacstrip.stream.recording.mcap_file import CHUNK_BYTES, McapFile, already_there
from tacstrip.stream.recording.records import Condition, Records

RECOVERED = "tacstrip_recovered"  # name of the metadata of a recovered file
_MAX_DAMAGE_LISTED = 20  # damaged places that are listed one by one


@dataclass(frozen=True)
class Recovered:
    """Result of a recovery.

    Attributes
    ----------
    messages
        Number of messages by topic.
    seconds
        Time from the first to the last message [s].
    condition
        Condition of the damaged file.
    held
        Number of messages of the damaged file by its index; None where the index is lost.
    """

    messages: dict[str, int]
    seconds: float
    condition: Condition
    held: int | None = None

    @property
    def lost(self) -> list[str]:
        """Description of the losses, line by line; empty where the file is whole."""
        found = self.condition
        if found.whole and not found.damage:
            return []
        total = sum(self.messages.values())
        if self.held is None or self.held < total:
            count = "an unknown number of messages, as their index is lost too"
        else:
            count = f"{self.held - total} of {self.held} messages"
        places = found.damage[:_MAX_DAMAGE_LISTED]
        if len(found.damage) > _MAX_DAMAGE_LISTED:
            places.append(f"and {len(found.damage) - _MAX_DAMAGE_LISTED} places more")
        if not found.whole:
            places.append(
                f"what was cut off the end, and of the {found.total_bytes} bytes that are left the last "
                f"{found.lost_bytes}, which are no whole chunk"
                if found.lost_bytes
                else "the file was cut after a whole chunk"
            )
        return [count, *places]


def recover(path: str | Path, output: str | Path, force: bool = False) -> Recovered:
    """Copy all undamaged records of an MCAP file to a new, complete file; it need not be a recording of tacstrip.

    Parameters
    ----------
    path
        The damaged file.
    output
        The new file.
    force
        Overwrite an existing output.

    Returns
    -------
    Recovered
        What was saved, and what was lost.

    Raises
    ------
    RecordingError
        The file is no MCAP file or holds no undamaged message, or the output exists already.
    OSError
        The output cannot be written.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> import tacstrip as ts
    >>> from tacstrip.stream import recover
    >>> sensor = ts.Sensor(construction="crs-m", strips=8, pitch_mm=5.0, length_mm=100.0, adc_bits=10)
    >>> source = ts.SimulatedSource(sensor, lambda time_s: ts.Contact.polygon([(8, 40), (32, 40), (20, 70)]), scans=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file, cut = (pathlib.Path(folder) / name for name in ("session.mcap", "cut.mcap"))
    ...     with ts.Recorder(file, source.sensor, source.names, source.origin_ns) as recorder:
    ...         ts.record(source, recorder)
    ...     size = cut.write_bytes(file.read_bytes()[:-100])
    ...     recovered = recover(cut, pathlib.Path(folder) / "recovered.mcap")
    >>> recovered.messages["/tacstrip/scan"]
    5
    """
    # Schemas and channels come first: the chunk that defines them may be damaged, and the summary repeats them.
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
    about |= {f"damage_{i}": place for i, place in enumerate(first.condition.damage[:_MAX_DAMAGE_LISTED])}
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
        ids = {}
        for old, c in channels.items():
            schema = schema_ids.get(c.schema_id, 0)
            ids[old] = writer.register_channel(c.topic, c.message_encoding, schema, c.metadata)
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
