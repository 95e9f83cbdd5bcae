"""A DDS participant that answers requests, also those of Fast DDS, the default of ROS 2.

A reply contains the identity of its request. Fast DDS has it in the inline QoS of the message (related sample identity,
DDS-RPC 7.8.2), to which the library Cyclone DDS gives no access; rmw_cyclonedds has it at the beginning of the message.
So this participant speaks RTPS itself: discovery (SPDP, SEDP), and one reliable reader and writer for each service.
Topics use the library, see dds.py.

A reader of Cyclone DDS takes the first heartbeat of a writer for its beginning, and never asks for what came before. So
a reply waits until its reader has acknowledged a heartbeat.
"""

from __future__ import annotations

import os
import selectors
import socket
import struct
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import psutil

from trocar.procs.ros_messages import discovery, rtps
from trocar.procs.ros_messages.dds import LOOPBACK, PARTICIPANTS, DdsError
from trocar.procs.ros_messages.discovery import READERS_OUT, SEDP, SPDP_READER, SPDP_WRITER, WRITERS_OUT, Address
from trocar.procs.ros_messages.rtps import ACKNACK, DATA, GAP, GUID, HEARTBEAT, PREFIX, Inbox, Submessage

MULTICAST: Final = "239.255.0.1"
LARGEST: Final = 65507  # bytes of a packet
PEERS, CLIENTS = 200, 4000  # participants, and endpoints of theirs, that are remembered
PACKETS: Final = 500  # read in one step
SECOND_NS: Final = 1_000_000_000
LEASE_LIMIT_S: Final = 300  # a silent participant is forgotten after this time, whatever it announces
ANNOUNCE_NS: Final = 3 * SECOND_NS
BEAT_NS: Final = SECOND_NS // 5
KEPT: Final = 32  # replies of a service that are sent again on request
CYCLONE: Final = b"\x01\x10"

RELATED: Final = (0x0083, 0x800F)  # the standard's number, and that of Fast DDS 2


@dataclass(slots=True)
class Peer:
    """Another participant."""

    prefix: bytes
    vendor: bytes
    meta: Address
    user: Address
    lease_ns: int
    heard_ns: int
    inboxes: dict[bytes, Inbox] = field(default_factory=dict)
    """Of its SEDP writers."""
    acked: dict[bytes, int] = field(default_factory=dict)
    """How many messages of our SEDP writers it has."""


@dataclass(slots=True)
class MatchedEndpoint:
    """A reader of replies, or a writer of requests, of another participant."""

    service: ServiceEndpoint
    peer: Peer
    address: Address
    inbox: Inbox = field(default_factory=Inbox)
    told: int = 0
    """Of a reader: our last sequence number that was sent to it, or announced by a heartbeat."""
    acked: int = 0
    """Of a reader: the last sequence number that it has acknowledged; 0: none, so it may not know our writer yet."""


@dataclass(slots=True)
class ServiceEndpoint:
    """One service of ours: a reader of requests and a writer of replies."""

    name: str
    request: str
    reply: str
    reader: bytes
    writer: bytes
    last: int = 1
    """The last sequence number. Number 1 is no reply: a reader that acknowledges it knows our writer."""
    kept: deque[tuple[int, bytes, bytes]] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Sequence number, participant and message of the last replies."""
    waiting: deque[tuple[ServiceRequest, bytes]] = field(default_factory=lambda: deque(maxlen=KEPT))
    """Replies to participants that do not know our writer yet."""


@dataclass(frozen=True, slots=True)
class ServiceRequest:
    """A request; `payload`: the message in CDR, with its encapsulation."""

    service: ServiceEndpoint
    prefix: bytes
    identity: bytes
    """What the reply carries beside the message."""
    header: bytes
    """What the reply carries in front of the message."""
    payload: bytes


class Replier:
    """See above. Close it."""

    def __init__(self, domain: int, interface: str) -> None:
        """DdsError when the interface is not there, or has no free port."""
        self._host = _address_of(interface)
        self._prefix = rtps.HEADER[6:8] + os.urandom(PREFIX - 2)
        self._base = 7400 + 250 * domain
        pairs = (self._bound_pair(self._base + 10 + 2 * index) for index in range(PARTICIPANTS))
        pair = next((each for each in pairs if each), None)
        if pair is None:
            raise DdsError(f"no free port for a participant of ROS domain {domain} at {self._host}")
        self._meta, self._user = self._sockets = pair
        if self._host == LOOPBACK:
            self._everyone = [(LOOPBACK, self._base + 10 + 2 * index) for index in range(PARTICIPANTS)]
        else:
            self._everyone = [(MULTICAST, self._base)]
            self._sockets.append(self._hears_multicast())
        self._selector = selectors.PollSelector()
        for each in self._sockets:
            self._selector.register(each, selectors.EVENT_READ, each)
        self._services: dict[bytes, ServiceEndpoint] = {}
        self._topics: dict[str, ServiceEndpoint] = {}
        self._sedp: dict[bytes, list[bytes]] = {WRITERS_OUT: [], READERS_OUT: []}
        self._peers: dict[bytes, Peer] = {}
        self._readers: dict[bytes, MatchedEndpoint] = {}
        self._writers: dict[bytes, MatchedEndpoint] = {}
        self._count, self._announce_ns, self._beat_ns = 0, 0, 0

    def _bound_pair(self, port: int) -> list[socket.socket]:
        """Sockets at this port and the next one; none where one of them is taken."""
        made: list[socket.socket] = []
        try:
            for each in (port, port + 1):
                made.append(_socket())
                made[-1].bind((self._host, each))
        except OSError:
            for socket_ in made:
                socket_.close()
            return []
        return made

    def _hears_multicast(self) -> socket.socket:
        """A socket for announcements to all participants of a network."""
        host, made = socket.inet_aton(self._host), _socket()
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((MULTICAST, self._base))
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(MULTICAST) + host)
        self._meta.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, host)
        return made

    def serve(self, name: str, request: tuple[str, str], reply: tuple[str, str]) -> ServiceEndpoint:
        """A service by its ROS name; DDS type name and user data of requests and replies. Before the first step."""
        key = struct.pack(">I", len(self._services) // 2 + 1)[1:]
        made = ServiceEndpoint(name, f"rq/{name}Request", f"rr/{name}Reply", key + b"\x04", key + b"\x03")
        self._services |= {made.reader: made, made.writer: made}
        self._topics |= {made.request: made, made.reply: made}
        for entity, topic, out, (kind, user_data) in ((made.reader, made.request, READERS_OUT, request),
                                                      (made.writer, made.reply, WRITERS_OUT, reply)):
            self._sedp[out].append(discovery.endpoint(self._prefix, entity, topic, kind, user_data))
        return made

    def gids(self) -> tuple[list[bytes], list[bytes]]:
        """The identifiers of our readers and of our writers, 16 bytes each."""
        return ([self._prefix + entity for entity in self._services if entity[3] == 4],
                [self._prefix + entity for entity in self._services if entity[3] == 3])

    def step(self, now_ns: int) -> list[ServiceRequest]:
        """Read what came, keep discovery going; returns the requests."""
        found: list[ServiceRequest] = []
        for _ in range(PACKETS):
            ready = self._selector.select(0.0)
            for key, _ in ready:
                with suppress(OSError):  # an earlier packet found no receiver
                    packet, sender = key.data.recvfrom(LARGEST)
                    for one in rtps.messages(packet, self._prefix):
                        found += self._take(one, packet[6:8], sender[0], now_ns)
            if not ready:
                break
        if now_ns >= self._announce_ns:
            self._announce_ns = now_ns + ANNOUNCE_NS
            self._announce({*self._everyone, *(peer.meta for peer in self._peers.values())})
            for prefix in [key for key, peer in self._peers.items() if now_ns - peer.heard_ns > peer.lease_ns]:
                self._forget(prefix)
        if now_ns >= self._beat_ns:
            self._beat_ns = now_ns + BEAT_NS
            self._beat()
        return found

    def _take(self, one: Submessage, vendor: bytes, host: str, now_ns: int) -> list[ServiceRequest]:
        """One message from another participant."""
        prefix, entity = one.guid[:PREFIX], one.guid[PREFIX:]
        if entity == SPDP_WRITER and one.kind == DATA:
            with suppress(ValueError, struct.error):
                self._meet(one, prefix, vendor, host, now_ns)
            return []
        peer = self._peers.get(prefix)
        if peer is None:
            return []
        peer.heard_ns = now_ns
        if entity in SEDP:
            inbox = peer.inboxes.setdefault(entity, Inbox())
            for each in self._received(one, inbox, SEDP[entity], peer.prefix, peer.meta):
                with suppress(ValueError, struct.error):
                    self._discover(each, peer)
        elif one.kind == ACKNACK:
            self._acked(one, peer)
        elif one.guid in self._writers:
            client = self._writers[one.guid]
            turn = self._received(one, client.inbox, client.service.reader, prefix, client.address)
            return [request for each in turn if (request := _request(each, client)) is not None]
        return []

    def _received(self, one: Submessage, inbox: Inbox, reader: bytes, to: bytes, address: Address) -> list[Submessage]:
        """A message of a reliable writer to a reader of ours; returns those whose turn it is."""
        if one.kind in (DATA, GAP):
            return inbox.put(one)
        if one.kind != HEARTBEAT:
            return []
        turn, missing = inbox.begins(one.first), inbox.missing(one.last)
        if missing or not one.is_final:
            inbox.count += 1
            self._send(address, to, rtps.acknack(one.guid[PREFIX:], reader, inbox.base, missing, inbox.count))
        return turn

    def _meet(self, one: Submessage, prefix: bytes, vendor: bytes, host: str, now_ns: int) -> None:
        """SPDP: a participant is there, or leaves."""
        if discovery.has_left(one):
            self._forget(prefix)
            return
        rows, order = rtps.described(one.payload)
        peer = self._peers.get(prefix)
        if peer is None and prefix != self._prefix and len(self._peers) < PEERS:
            meta = discovery.locator(rows, discovery.META_LOCATOR, order, host)
            user = discovery.locator(rows, discovery.USER_LOCATOR, order, host)
            if meta is None or user is None:
                return
            lease_s = min(max(1, discovery.lease_of(rows, order)), LEASE_LIMIT_S)
            peer = Peer(prefix, vendor, meta, user, lease_s * SECOND_NS, now_ns)
            self._peers[prefix] = peer
            self._announce([meta])
            for writer in SEDP:
                self._describe(peer, writer, range(1, len(self._sedp[writer]) + 1))
        if peer is not None:
            peer.heard_ns = now_ns

    def _announce(self, to: Iterable[Address]) -> None:
        """SPDP: here we are."""
        ports = (self._meta.getsockname()[1], self._user.getsockname()[1])
        part = rtps.data(SPDP_WRITER, SPDP_READER, 1, discovery.participant(self._prefix, self._host, *ports))
        for address in to:
            self._send(address, bytes(PREFIX), part)

    def _describe(self, peer: Peer, writer: bytes, sequences: Iterable[int]) -> None:
        """SEDP: our endpoints, by their places in the list."""
        messages = self._sedp[writer]
        for sequence in sequences:
            if 0 < sequence <= len(messages):
                self._send(peer.meta, peer.prefix, rtps.data(writer, SEDP[writer], sequence, messages[sequence - 1]))
        self._send(peer.meta, peer.prefix, self._heartbeat(writer, SEDP[writer], 1, len(messages)))

    def _heartbeat(self, writer: bytes, reader: bytes, first: int, last: int) -> bytes:
        self._count += 1
        return rtps.heartbeat(writer, reader, first, last, self._count)

    def _discover(self, one: Submessage, peer: Peer) -> None:
        """SEDP: an endpoint of another participant is there, or leaves."""
        if discovery.has_left(one):
            for guid in (value for key, value in (*one.inline, *discovery.rows_of(one.payload))
                         if key in (discovery.KEY_HASH, discovery.ENDPOINT_GUID)):
                self._readers.pop(guid, None)
                self._writers.pop(guid, None)
            return
        rows, order = rtps.described(one.payload)
        values = dict(rows)
        service = self._topics.get(rtps.text_of(values.get(discovery.TOPIC, b""), order))
        guid = values.get(discovery.ENDPOINT_GUID, b"")
        if service is None or guid[:PREFIX] != peer.prefix or len(guid) != GUID:
            return
        is_writer = one.guid[PREFIX:] == WRITERS_OUT
        if is_writer != (service.request == rtps.text_of(values[discovery.TOPIC], order)):
            return
        address = discovery.locator(rows, discovery.ENDPOINT_LOCATOR, order, peer.user[0]) or peer.user
        known = self._writers if is_writer else self._readers
        if len(known) < CLIENTS and guid not in known:
            known[guid] = MatchedEndpoint(service, peer, address, told=service.last)
            if not is_writer:
                self._send(address, peer.prefix, self._kept_by(service, guid[PREFIX:]))

    def _acked(self, one: Submessage, peer: Peer) -> None:
        """Send again what a reader has not received."""
        if one.target in SEDP:
            peer.acked[one.target] = one.first - 1
            if one.missing:
                self._describe(peer, one.target, one.missing)
        elif (client := self._readers.get(one.guid)) is not None and client.service.writer == one.target:
            client.acked = max(client.acked, min(one.first - 1, client.service.last))
            self._reply_waiting(client.service)
            kept = {sequence: message for sequence, prefix, message in client.service.kept if prefix == peer.prefix}
            for sequence in one.missing:
                if sequence <= client.service.last:
                    again = kept.get(sequence) or rtps.gap(one.target, one.guid[PREFIX:], sequence, sequence)
                    self._send(client.address, peer.prefix, again)

    def _beat(self) -> None:
        """Heartbeats to those who have not received everything."""
        for peer in self._peers.values():
            for writer, messages in self._sedp.items():
                if peer.acked.get(writer, 0) < len(messages):
                    self._send(peer.meta, peer.prefix, self._heartbeat(writer, SEDP[writer], 1, len(messages)))
        for guid, client in self._readers.items():
            if client.acked < client.told:
                self._send(client.address, client.peer.prefix, self._kept_by(client.service, guid[PREFIX:]))

    def _kept_by(self, service: ServiceEndpoint, reader: bytes) -> bytes:
        """A heartbeat: the replies that can be sent again."""
        return self._heartbeat(service.writer, reader, max(2, service.last - KEPT + 1), service.last)

    def reply(self, request: ServiceRequest, payload: bytes) -> None:
        """Send the reply, a message in CDR with its encapsulation, to the participant that asked."""
        request.service.waiting.append((request, payload))
        self._reply_waiting(request.service)

    def _reply_waiting(self, service: ServiceEndpoint) -> None:
        """Send the replies to all participants that know our writer."""
        for _ in range(len(service.waiting)):
            request, payload = service.waiting.popleft()
            readers = [(guid, each) for guid, each in self._readers.items()
                       if each.service is service and each.peer.prefix == request.prefix]
            if readers and all(each.acked for _, each in readers):
                self._send_reply(request, payload, readers)
            elif request.prefix in self._peers:
                service.waiting.append((request, payload))

    def _send_reply(self, request: ServiceRequest, payload: bytes,
                    readers: Iterable[tuple[bytes, MatchedEndpoint]]) -> None:
        service = request.service
        service.last += 1
        message = payload[:4] + request.header + payload[4:]
        part = rtps.data(service.writer, rtps.UNKNOWN, service.last, message,
                         [(key, request.identity) for key in RELATED])
        service.kept.append((service.last, request.prefix, part))
        for guid, client in readers:
            before = [rtps.gap(service.writer, guid[PREFIX:], client.told + 1, service.last - 1)
                      ] if client.told + 1 < service.last else []
            client.told = service.last
            self._send(client.address, request.prefix, *before, part, self._kept_by(service, guid[PREFIX:]))

    def _send(self, address: Address, to: bytes, *parts: bytes) -> None:
        with suppress(OSError):  # it has gone, or the buffer is full: the next heartbeat repeats it
            self._meta.sendto(rtps.packet(self._prefix, to, *parts), address)

    def _forget(self, prefix: bytes) -> None:
        self._peers.pop(prefix, None)
        for table in (self._readers, self._writers):
            for guid in [guid for guid in table if guid[:PREFIX] == prefix]:
                del table[guid]

    def close(self) -> None:
        """Leave the domain; others see it at once."""
        gone = rtps.data(SPDP_WRITER, SPDP_READER, 2, *discovery.departure(self._prefix))
        for peer in self._peers.values():
            self._send(peer.meta, bytes(PREFIX), gone)
        for each in self._sockets:
            each.close()


def _request(one: Submessage, client: MatchedEndpoint) -> ServiceRequest | None:
    """A request in DDS's terms; None: it is too short to be one."""
    identity = next((value[:GUID] for key, value in one.inline if key in RELATED and len(value) >= 24), one.guid)
    header, payload = b"", one.payload
    if client.peer.vendor == CYCLONE:
        header, payload = payload[4:20], payload[:4] + payload[20:]
        if len(header) < 16:
            return None
        header = header if one.payload[1] & 1 else header[7::-1] + header[:7:-1]
    return ServiceRequest(client.service, client.peer.prefix, identity + rtps.number(one.first), header, payload)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setblocking(False)
    return made


def _address_of(interface: str) -> str:
    """The IPv4 address of an interface, by its name or address."""
    rows = psutil.net_if_addrs().get(interface, [])
    return next((row.address for row in rows if row.family == socket.AF_INET), interface)
