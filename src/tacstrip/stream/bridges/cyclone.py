"""Topics of ROS 2 on Cyclone DDS; messages are written as they are, in CDR. Importing it needs cyclonedds."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from typing import Any
from xml.sax.saxutils import quoteattr

from cyclonedds.core import DDSException
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic
from rosbags.interfaces import Nodetype

from tacstrip.stream.bridges.ros_messages import type_store

LOOPBACK, ANY = "127.0.0.1", "auto"
_DEPTH = 1000  # messages that wait for a reader's acknowledgement: a second at 1,000 scans/s
_BLOCKING_NS = 20_000_000  # longest wait for a reader that does not keep up
_ACKNOWLEDGED_NS = 1_000_000_000  # longest wait for the readers of the last messages
# Loopback knows no multicast, so participants are looked for on the ports of the first 33 of the domain.
_UNICAST = """
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
<Peers><Peer address="localhost"/></Peers></Discovery>"""


class Participant:
    """A participant of a DDS domain that writes messages of ROS 2.

    Parameters
    ----------
    domain
        Domain id.
    interface
        Network interface by name or address; "auto": the one that Cyclone DDS chooses. What `CYCLONEDDS_URI` of the
        environment says does not count.

    Raises
    ------
    OSError
        The domain cannot be joined on this interface.
    """

    def __init__(self, domain: int, interface: str = LOOPBACK) -> None:
        try:
            self._domain = Domain(domain, configuration(interface))
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise OSError(str(error)) from None
        self._publisher = Publisher(self._participant)
        self._writers: dict[str, Any] = {}

    def offer(self, topic: str, kind: str, latched: bool = False) -> None:
        """Announce a topic, unless that was done before: readers need a moment to find it, and miss what comes earlier.

        Parameters
        ----------
        topic
            Name in ROS, without the slash before it.
        kind
            Type as ROS names it, "std_msgs/msg/String".
        latched
            Whether later readers get the last message, too ("transient local").
        """
        if topic not in self._writers:
            self._writers[topic] = self._writer(topic, kind, latched)

    def write(self, topic: str, cdr: bytes, time_ns: int) -> bool:
        """Write a message to a topic that is offered; return False where a reader did not keep up and it was dropped.

        Parameters
        ----------
        topic
            As of `offer`.
        cdr
            The message.
        time_ns
            Its source time stamp, since 1970 [ns].
        """
        writer = self._writers[topic]
        sample = object.__new__(writer.data_type)
        sample.cdr = cdr
        try:
            writer.write(sample, max(time_ns, 0))
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise OSError(str(error)) from None
            return False
        return True

    def close(self) -> None:
        """Wait for the readers of the last messages, and leave the domain."""
        with suppress(DDSException):
            self._publisher.wait_for_acks(_ACKNOWLEDGED_NS)
        self._writers.clear()
        del self._publisher, self._participant, self._domain  # which leaves

    def _writer(self, topic: str, kind: str, latched: bool) -> Any:
        quality = Qos(
            Policy.Reliability.Reliable(_BLOCKING_NS),
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(1 if latched else _DEPTH),
            Policy.DataRepresentation(use_cdrv0_representation=True),
            # Where ROS 2 looks for it from Iron on.
            Policy.Userdata(f"typehash={type_store().hash_rihs01(kind)};".encode()),
        )
        about = Topic(self._participant, f"rt/{topic}", idl_struct(kind))
        return DataWriter(self._publisher, about, quality)


def configuration(interface: str) -> str:
    """Return Cyclone DDS' configuration for a network interface, by name or address, or "auto"."""
    key = "address" if interface.replace(".", "").isdigit() or ":" in interface else "name"
    chosen = f"<Interfaces><NetworkInterface {key}={quoteattr(interface)}/></Interfaces>"
    return (
        f'<CycloneDDS><Domain Id="any"><General>{"" if interface == ANY else chosen}</General>'
        f"{_UNICAST if interface == LOOPBACK else ''}</Domain></CycloneDDS>"
    )


@cache
def idl_struct(kind: str) -> Any:
    """Return the type of a message as Cyclone DDS takes it; a sample's bytes are its attribute `cdr`."""
    package, _, name = kind.split("/")
    _, fields = type_store().fielddefs[kind]
    annotations = {field: _idl_type(node, what) for field, (node, what) in fields}
    made = make_idl_struct(f"{name}_", f"{package}.msg.dds_.{name}_", annotations)
    made.serialize = lambda self, **_: self.cdr
    return made


def _idl_type(node: Nodetype, what: Any) -> Any:
    if node == Nodetype.NAME:
        return idl_struct(what)
    if node == Nodetype.SEQUENCE:
        return types.sequence[_idl_type(*what[0])]
    return str if what[0] == "string" else getattr(types, what[0])
