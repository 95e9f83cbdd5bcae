"""Requests and replies: by a Cyclone participant as rmw_cyclonedds asks, and by a client as rmw_fastrtps asks.

A client of ROS itself is in tests/system/test_ros_itself.py.
"""

from __future__ import annotations

import random
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.ros_bridge.cyclone_client import CycloneClient
from tests.system.robot import wait_for
from tests.system.test_ros_bridge import own_domain
from trocar.procs.ros_bridge.services import SERVICES, announced
from trocar.procs.ros_messages import discovery, rtps
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import TriggerRequest, TriggerResponse
from trocar.procs.ros_messages.replier import Replier
from trocar.procs.ros_messages.rtps import ACKNACK, DATA, HEADER, HEARTBEAT, Submessage
from trocar.shm.time.clock import monotonic_ns

SERVICE = SERVICES["crtk_version"]
NAME = "PSM1/crtk_version"


class Answering:
    """A participant that answers with the number of the request, while a test waits."""

    def __init__(self, domain: int) -> None:
        self.domain, self.replier, self.asked, self.later_ns = domain, Replier(domain, "lo"), 0, 0
        for name in (NAME, "PSM2/crtk_version"):
            self.replier.serve(name, announced(SERVICE.request), announced(SERVICE.response))

    def step(self) -> bool:
        for request in self.replier.step(monotonic_ns() + self.later_ns):
            assert TriggerRequest.deserialize(request.payload) == TriggerRequest()
            self.asked += 1
            self.replier.reply(request, TriggerResponse(True, f"{request.service.name} {self.asked}").serialize())
        return True

    def until(self, condition: Callable[[], object], what: str) -> None:
        wait_for(lambda: self.step() and condition(), 60, what)

    def answers(self, client: CycloneClient) -> Any:
        client.ask(structure_needs_at_least_one_member=0)
        self.until(client.hears, "a reply")
        return client.got[-1]


@pytest.fixture
def served() -> Iterator[Answering]:
    made = Answering(own_domain())
    yield made
    made.replier.close()


@pytest.fixture
def participant(served: Answering) -> Iterator[Participant]:
    made = Participant(served.domain)
    yield made
    made.close()


def test_each_client_gets_the_replies_to_its_own_requests(served: Answering, participant: Participant) -> None:
    first, second = (CycloneClient(participant, NAME, SERVICE, guid) for guid in (11, 12))
    other = CycloneClient(participant, "PSM2/crtk_version", SERVICE)
    for client in (first, second, other):
        served.until(client.is_served, "the service")
    said = [served.answers(client).message for client in (first, other, second, first)]
    assert said == [f"{NAME} 1", "PSM2/crtk_version 2", f"{NAME} 3", f"{NAME} 4"]


def test_a_network_that_loses_a_quarter_of_all_packets_loses_no_reply(
        served: Answering, participant: Participant, monkeypatch: pytest.MonkeyPatch) -> None:
    lots, send, take = random.Random(1), served.replier._send, served.replier._take
    monkeypatch.setattr(served.replier, "_send", lambda *given: lots.random() < 0.25 or send(*given))
    monkeypatch.setattr(served.replier, "_take", lambda *given: [] if lots.random() < 0.25 else take(*given))
    client = CycloneClient(participant, NAME, SERVICE)
    served.until(client.is_served, "the service")
    assert [served.answers(client).message for _ in range(5)] == [f"{NAME} {k}" for k in range(1, 6)]
    assert served.asked == 5 and len(client.got) == 5


class FastClient:
    """Sends requests as rmw_fastrtps does: with the identifier of its reader of replies beside each."""

    def __init__(self, served: Answering) -> None:
        self.served, self.prefix = served, b"\x01\x0f" + b"fast-client"[:10]
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port, self.heard = self.socket.getsockname()[1], list[Submessage]()
        self.server = 7400 + 250 * served.domain + 10

    def send(self, *parts: bytes, user: bool = False) -> None:
        packet = HEADER[:6] + b"\x01\x0f" + rtps.packet(self.prefix, bytes(12), *parts)[8:]
        self.socket.sendto(packet, ("127.0.0.1", self.server + user))

    def hears(self) -> list[Submessage]:
        """Everything so far; heartbeats of the writer of replies are acknowledged."""
        try:
            while True:
                for one in rtps.messages(self.socket.recv(65507), self.prefix):
                    self.heard.append(one)
                    if one.kind == HEARTBEAT and one.guid[12:] == b"\0\0\1\3":
                        self.send(rtps.acknack(b"\0\0\1\3", b"\0\0\7\4", one.last + 1, (), len(self.heard)), user=True)
        except BlockingIOError:
            return self.heard

    def joins(self) -> None:
        """Discovery, without a care for what gets lost."""
        self.send(rtps.data(discovery.SPDP_WRITER, discovery.SPDP_READER, 1,
                            discovery.participant(self.prefix, "127.0.0.1", self.port, self.port)))
        for out, entity, topic, kind in ((discovery.WRITERS_OUT, b"\0\0\7\3", f"rq/{NAME}Request", SERVICE.request),
                                         (discovery.READERS_OUT, b"\0\0\7\4", f"rr/{NAME}Reply", SERVICE.response)):
            told = discovery.endpoint(self.prefix, entity, topic, *announced(kind))
            self.send(rtps.data(out, discovery.SEDP[out], 1, told), rtps.heartbeat(out, discovery.SEDP[out], 1, 1, 1))

    def asks(self, sequence: int) -> None:
        related = self.prefix + b"\0\0\7\4" + bytes(8)
        self.send(rtps.data(b"\0\0\7\3", bytes(4), sequence, TriggerRequest().serialize(), [(0x800F, related)]),
                  rtps.heartbeat(b"\0\0\7\3", bytes(4), 1, sequence, sequence), user=True)

    def replies(self) -> list[Submessage]:
        return [one for one in self.hears() if one.kind == DATA and one.guid[12:] == b"\0\0\1\3"]


@pytest.fixture
def fast(served: Answering) -> Iterator[FastClient]:
    made = FastClient(served)
    made.joins()
    served.until(lambda: len({one.guid for one in made.hears() if one.kind == ACKNACK and one.first == 2}) == 2,
                 "both to be known")
    yield made
    made.socket.close()


def test_a_reply_names_the_reader_and_the_number_of_its_request(served: Answering, fast: FastClient) -> None:
    for sequence in (1, 2):
        fast.asks(sequence)
        served.until(lambda: len(fast.replies()) == sequence, "a reply")  # noqa: B023
        reply = fast.replies()[-1]
        assert {value for key, value in reply.inline if key in (0x0083, 0x800F)} == {
            fast.prefix + b"\0\0\7\4" + rtps.number(sequence)}
        assert TriggerResponse.deserialize(reply.payload).message == f"{NAME} {sequence}"


def test_a_request_that_comes_twice_is_answered_once(served: Answering, fast: FastClient) -> None:
    for _ in range(3):
        fast.asks(1)
    served.until(fast.replies, "a reply")
    fast.asks(2)
    served.until(lambda: served.asked == 2, "the next request")


@pytest.mark.parametrize("how", ["it says so", "it is silent"])
def test_a_client_that_has_left_gets_no_more_packets(served: Answering, fast: FastClient, how: str) -> None:
    fast.asks(1)
    served.until(fast.replies, "a reply")
    if how == "it says so":
        fast.send(rtps.data(discovery.SPDP_WRITER, discovery.SPDP_READER, 2, *discovery.departure(fast.prefix)))
    else:
        served.step()  # what it has sent is read before it is silent
        served.later_ns = (discovery.LEASE_S + 5) * 10**9
    count = served.asked
    served.until(lambda: not served.replier._peers.get(fast.prefix), "it to be forgotten")
    fast.asks(2)
    served.step()
    assert served.asked == count
