"""One DDS participant that ROS 2 takes for a node: its writers and readers, and its ROS discovery data.

Names, encoding and settings are compatible with rmw_cyclonedds and rmw_fastrtps: topics `rt/…`, plain XCDR1 without
keys, and hashes of types in the user data of each endpoint. Services have a participant of their own, see replier.py.
"""

from __future__ import annotations

import os
import select
from collections.abc import Callable, Iterable
from contextlib import suppress
from io import FileIO
from typing import Any, Final, Generic, TypeVar

from cyclonedds.core import DDSException, DDSStatus, Listener, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from trocar.procs.machine.interfaces import lacks_interface
from trocar.procs.ros_messages.hashes import type_hash
from trocar.procs.ros_messages.messages import Gid, NodeEntitiesInfo, ParticipantEntitiesInfo

LOOPBACK: Final = "127.0.0.1"
DEPTH: Final = 10  # the default of ROS clients
LATCHED: Final = 1
EVENT_DEPTH: Final = 100
BLOCKING_NS: Final = 100_000_000
LARGEST: Final = "256 kB"
"""Maximum message size; reading a larger one would block the process."""
PARTICIPANTS: Final = 120  # on one machine, of one domain; each is one of ROS's processes
EPROSIMA: Final = "1.15"
ONE: Final = (1).to_bytes(8, "little")

Message = TypeVar("Message", bound=IdlStruct)


def settings(interface: str) -> str:
    """Cyclone DDS's configuration for one network interface, by its name or address.

    On loopback participants find each other without multicast, where many systems have none. Fast DDS 3 sends type
    information that Cyclone takes for an error; types match by their names.
    """
    is_name = not interface.replace(".", "").isdigit()
    where = f'name="{interface}"' if is_name else f'address="{interface}"'
    alone = interface in (LOOPBACK, "lo")
    peers = f'<Peers><Peer address="{LOOPBACK}"/></Peers>' if alone else ""
    return (f"<CycloneDDS><Domain><General><Interfaces><NetworkInterface {where}/></Interfaces>"
            f"<AllowMulticast>{'false' if alone else 'default'}</AllowMulticast></General>"
            f"<Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{PARTICIPANTS}</MaxAutoParticipantIndex>{peers}</Discovery>"
            f"<Internal><MaxSampleSize>{LARGEST}</MaxSampleSize></Internal>"
            f"<Compatibility><IgnoreTypeInformation>{EPROSIMA}</IgnoreTypeInformation></Compatibility>"
            "</Domain></CycloneDDS>")


class DdsError(RuntimeError):
    """A refusal by DDS, in words."""


class TopicWriter(Generic[Message]):
    """Publishes one topic. `is_read`: it had a subscriber at the last `Participant.look`."""

    def __init__(self, writer: DataWriter[Any], name: str) -> None:
        self._writer, self.name, self.is_read = writer, name, False

    def write(self, message: Message) -> None:
        """Never blocks for a slow reader: of those only the newest are kept."""
        self._writer.write(message)

    def look(self) -> None:
        """Update `is_read`: whether it has a subscriber."""
        self.is_read = self._writer.get_publication_matched_status().current_count > 0  # type: ignore[no-untyped-call]

    @property
    def gid(self) -> Gid:
        """Its DDS identifier."""
        return _gid(self._writer)


class TopicReader(Generic[Message]):
    """Subscribes to one topic."""

    def __init__(self, reader: DataReader[Any], name: str, depth: int) -> None:
        self._reader, self.name, self._depth = reader, name, depth

    def take(self, tell: Callable[[str], None] | None = None) -> list[Message]:
        """Messages since the last call, oldest first; those that only report a departed writer are left out.

        Unreadable ones are left out too: any program may write any data under our names, for example text that is not
        UTF-8. `tell` receives a description. One at a time, because the library drops all messages taken together with
        an unreadable one.
        """
        found: list[Message] = []
        for _ in range(self._depth + 1):  # and one that only reports a departed writer
            try:
                taken = self._reader.take(1)
            except DDSException:
                raise
            except Exception as error:
                if tell is not None:
                    tell(f"{self.name}: a message that cannot be read: {error}")
                continue
            if not taken:
                break
            found += [each for each in taken if each.sample_info.valid_data]
        return found

    @property
    def gid(self) -> Gid:
        """Its DDS identifier."""
        return _gid(self._reader)

    def writer(self, handle: int) -> Any:
        """DDS data of a writer, by the handle in its messages; None: it has left."""
        return self._reader.get_matched_publication_data(handle)

    @property
    def is_published(self) -> bool:
        """Whether there is a program that publishes the topic."""
        return bool(self._reader.get_subscription_matched_status().current_count)  # type: ignore[no-untyped-call]

    @property
    def entity(self) -> DataReader[Any]:
        """The reader of the library."""
        return self._reader


def _gid(entity: DataWriter[Any] | DataReader[Any]) -> Gid:
    return Gid(entity.get_guid().bytes)


class Arrivals:
    """Wakes one thread when data arrives. Close it after its readers.

    A wait of the library ends by the time of day (its wheels lack pthread_condattr_setclock): when that is set back by
    an hour, the wait takes an hour longer.
    """

    def __init__(self) -> None:
        self._event = FileIO(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC), "r+")
        self._poll = select.poll()
        self._poll.register(self._event, select.POLLIN)
        self.listener = Listener(on_data_available=self._came)  # type: ignore[no-untyped-call]
        """For readers."""

    def _came(self, reader: Any) -> None:
        with suppress(ValueError):  # closed
            self._event.write(ONE)

    def wait(self, timeout_ns: int) -> bool:
        """Whether data has arrived since the last call; waits at most this long."""
        return bool(self._poll.poll(max(0, timeout_ns) / 1e6)) and self._event.read(len(ONE)) is not None

    def close(self) -> None:
        """Release its file."""
        self._event.close()


class Participant:
    """A node of ROS. Close it."""

    def __init__(self, domain: int, interface: str = LOOPBACK, name: str = "trocar", namespace: str = "/") -> None:
        """DdsError when the interface is not there, or the process has another participant of the domain."""
        self.name, self.namespace = name, namespace
        try:
            self._domain = Domain(domain, settings(interface))
            self._participant = DomainParticipant(domain, Qos(Policy.Userdata(b"enclave=/;")))
        except DDSException as error:
            why = lacks_interface(interface) or error.msg
            raise DdsError(f"ROS domain {domain} on interface {interface}: {why}") from error
        self._arrivals, self._matches = Arrivals(), WaitSet(self._participant)
        self.is_read = False
        """One of our topics has a subscriber."""
        self.writers: list[TopicWriter[Any]] = []
        self.readers: list[TopicReader[Any]] = []
        self._graph: TopicWriter[ParticipantEntitiesInfo] = self.write_as(
            "ros_discovery_info", ParticipantEntitiesInfo, LATCHED)

    def full_name(self, name: str) -> str:
        """A name in our namespace; one with a slash in front is the same in all of them."""
        return f"{self.namespace}/{name}".strip("/") if not name.startswith("/") else name[1:]

    def writer(self, topic: str, message: type[Message], latched: int = 0) -> TopicWriter[Message]:
        """A topic of ours; `latched`: late subscribers get this many of the last messages."""
        made = self.write_as(f"rt/{self.full_name(topic)}", message, latched)
        self.writers.append(made)
        return made

    def reader(self, topic: str, message: type[Message], depth: int = DEPTH, *,
               wakes: bool = True) -> TopicReader[Message]:
        """A topic of others. Never messages latched before we joined: old commands are not for us.

        `wakes`: its messages end `wait`.
        """
        return self.read_as(f"rt/{self.full_name(topic)}", message, depth, wakes=wakes)

    def read_latched(self, topic: str, message: type[Message], depth: int, *,
                     wakes: bool = True) -> TopicReader[Message]:
        """A topic of others, with latched messages: for states, not for commands."""
        return self.read_as(f"rt/{self.full_name(topic)}", message, depth, latched=True, wakes=wakes)

    def read_as(self, name: str, message: type[IdlStruct], depth: int, *, latched: bool = False,
                wakes: bool = True) -> TopicReader[Any]:
        """Read the DDS topic `name`."""
        durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
        qos = self._qos((durability, Policy.History.KeepLast(depth)), message)
        entity = DataReader(self._participant, Topic(self._participant, name, message), qos,
                            self._arrivals.listener if wakes else None)
        made: TopicReader[Any] = TopicReader(entity, name, depth)
        self.readers.append(made)
        return made

    def write_as(self, name: str, message: type[IdlStruct], latched: int = 0) -> TopicWriter[Any]:
        """Write the DDS topic `name`; see `writer`."""
        kept = _latched(latched) if latched else (Policy.Durability.Volatile, Policy.History.KeepLast(EVENT_DEPTH))
        qos = self._qos((*kept, Policy.WriterDataLifecycle(autodispose=False)), message)
        entity: DataWriter[Any] = DataWriter(self._participant, Topic(self._participant, name, message), qos)
        entity.set_status_mask(DDSStatus.PublicationMatched)
        self._matches.attach(entity)
        return TopicWriter(entity, name)

    @staticmethod
    def _qos(policies: tuple[Any, ...], message: type[IdlStruct]) -> Qos:
        told = f"typehash={type_hash(message)};".encode()
        return Qos(Policy.Reliability.Reliable(BLOCKING_NS), *policies, Policy.Userdata(told))

    def wait(self, timeout_ns: int) -> bool:
        """Wait for data, at most this long; returns whether any has arrived since the last call."""
        return self._arrivals.wait(timeout_ns)

    def look(self) -> bool:
        """Update `TopicWriter.is_read` of all writers; returns whether any subscribers changed."""
        if not self._matches.wait(0):
            return False
        for writer in (self._graph, *self.writers):
            writer.look()
        self.is_read = any(writer.is_read for writer in self.writers)
        return True

    def announce(self, readers: Iterable[bytes] = (), writers: Iterable[bytes] = ()) -> None:
        """Publish to ROS which node has which endpoints; once all exist. Given: identifiers of others of the node."""
        node = NodeEntitiesInfo(self.namespace, self.name, [*(each.gid for each in self.readers), *map(Gid, readers)],
                                [*(each.gid for each in self.writers), *map(Gid, writers)])
        self._graph.write(ParticipantEntitiesInfo(Gid(self._participant.get_guid().bytes), [node]))

    def close(self) -> None:
        """Leave the domain; others see it at once."""
        for reader in self.readers:
            reader.entity.set_listener(None)  # it must not call an interpreter that ends
        self.writers.clear()
        self.readers.clear()
        for part in ("_graph", "_matches", "_participant", "_domain"):
            delattr(self, part)
        self._arrivals.close()


def _latched(depth: int) -> tuple[Any, ...]:
    return (Policy.Durability.TransientLocal, Policy.History.KeepLast(max(depth, EVENT_DEPTH)),
            Policy.DurabilityService(0, Policy.History.KeepLast(depth), -1, -1, -1))
